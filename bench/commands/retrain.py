"""The verb retrain: a model that follows the measurements, and is only ever replaced by one that is no worse."""

import threading
from typing import Annotated

import typer
from rich.markup import escape

from bench.commands.bench import on_signals
from bench.commands.lut import tell_unsound
from bench.commands.models import now
from bench.commands.options import DEFAULT_FOLDER, Database, Folder, SimModel
from bench.commands.streams import err, out, stamp
from bench.diagnosing import NotDiagnosed, answer_of, refused_in_words
from bench.errors import InputError
from bench.model_file import model_from
from bench.processes import behind_the_campaign
from bench.retrain import KINDS, Retrainer, Retraining, newest_data, note_in_store, watch
from bench.store import Store, database_url
from bench.training_data import TrainingData
from bench.wording import counted
from models.dataset import load_measurements
from models.registry import Registry
from sim.model import Model

app = typer.Typer()

LOOK_EVERY_S = 1.0


@app.command()
def retrain(
    campaign_id: Annotated[
        int | None, typer.Argument(metavar="[CAMPAIGN_ID]", min=1, help="else the newest")
    ] = None,
    keep_watching: Annotated[
        bool, typer.Option("--watch", help="go on: retrain as measurements come in, until Ctrl-C")
    ] = False,
    every: Annotated[
        int, typer.Option(min=1, help="with --watch: accepted rows between two retrainings")
    ] = 25,
    kind: Annotated[str, typer.Option(help=f"of model: {', '.join(KINDS)}; else the best of them")] = "",
    diagnose: Annotated[
        bool, typer.Option("--diagnose/--no-diagnose", help="renew the diagnosis as well")
    ] = True,
    folder: Folder = DEFAULT_FOLDER,
    sim_model: SimModel = None,
    db: Database = None,
) -> None:
    """Train on all accepted rows of a bench, judge on blocks that no model saw, and promote what is no worse.

    With --watch it goes on beside a campaign, in a process of its own that yields to the measuring.
    """
    if kind and kind not in KINDS:
        raise InputError.of("command line", "--kind", kind, f"one of {', '.join(KINDS)}")
    kinds = (kind,) if kind else KINDS
    simulator = model_from(sim_model)
    retrainer = Retrainer(registry=Registry(folder), simulator=simulator, now=now, kinds=kinds, say=_progress)
    with Store(database_url(db)) as store:
        if not keep_watching:
            data = newest_data(store, campaign_id)
            if data is None:
                raise InputError.of(
                    "database", "campaigns", None, "none yet; d2ea run or d2ea import makes one"
                )
            _settle(store, data, retrainer.retrain(data), simulator if diagnose else None)
            return
        if campaign_id is not None:
            raise InputError.of("command line", "--watch", True, "follows the newest campaign; name none")
        behind_the_campaign()
        stop = threading.Event()
        with on_signals(stop.set):
            out.print(
                f"watching {escape(store.url)}; a retraining after every {every} accepted rows. Ctrl-C ends it."
            )
            rounds = watch(store, retrainer, every=every, wait=lambda: not stop.wait(LOOK_EVERY_S))
            for data, retraining in rounds:
                _settle(store, data, retraining, simulator if diagnose else None)
        err.print("no longer watching")


def _progress(said: str) -> None:
    err.print(escape(said))


def _settle(store: Store, data: TrainingData, retraining: Retraining, simulator: Model | None) -> None:
    """Say what came of it, note it beside the campaign, and renew the diagnosis where there is a simulator for it."""
    stamp(bool(data.virtual))
    out.print(escape(f"{counted(len(data), 'accepted row')} of {data.data}"))
    out.print(escape(retraining.said))
    note_in_store(store, data, retraining)
    for file in retraining.files:
        out.print(escape(f"table: {file}"))
    if retraining.lut is not None:
        tell_unsound(retraining.lut.lines)
    if simulator is not None and retraining.decision is not None:
        _diagnose(store, data, simulator)


def _diagnose(store: Store, data: TrainingData, simulator: Model) -> None:
    """Renew the diagnosis of the newest campaign, or say why there is none."""
    from bench.verdict_wording import verdict_text
    from models.diagnosis.diagnose import diagnose as find_cause  # here: they load slowly
    from models.diagnosis.stretches import stretches

    newest = data.campaigns[-1]
    try:
        with refused_in_words():
            measured = load_measurements(store.measurement_table(newest))
            found = find_cause(measured, simulator)
            apart = stretches(found, measured, lambda rows: find_cause(rows, simulator), _progress)
    except NotDiagnosed as why:
        out.print(escape(f"no diagnosis of campaign {newest}: {why}"))
        return
    answer = answer_of(found, measured, store.campaign(newest), None, apart)
    store.add_diagnosis(answer, campaign_id=newest)
    out.print(escape(f"diagnosis of campaign {newest}: {verdict_text(answer)}"))
