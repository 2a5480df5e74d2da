"""Bench time to the right verdict: an adaptive campaign against a random one, in the same labs.

Every lab hides one small effect (large ones are named from the start of either). Both campaigns go over the wires
with the same start, references and budget of rows; minutes are those of the bench's own clock, settling and averaging
included. A lab counts as done from the look at which exactly what is hidden was named and stayed named to the end.
The adaptive campaign ends by itself. Half of the labs are benches that read dc powers only, with effects that are
tied with others there.

Seeds from 190000: they belong to tuning.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

import bench
import drivers
import experiments.adaptive
import models
import sim
from bench.wording import counted
from experiments.adaptive.race import ADAPTIVE, ALL, AT_ONCE, MOST, POWERS, RANDOM, Race, run_race
from experiments.blind.draws import TIED_PAIRS
from experiments.blind.reach import hideable
from experiments.first_trials import drawn
from experiments.harness.journal import Journal, code_hash
from experiments.harness.registry import Experiment
from experiments.harness.result import Cell, Goal, Result, Table
from experiments.harness.settings import Settings
from experiments.harness.trials import perform

FIRST_SEED = 190_000
SIZE = "small"  # the lower third of what labs draw from
LABS = 20  # half of each kind of bench
_EVERY = 2  # of the effects that a lab can hide, for benches with all channels

Record = dict[str, Any]


def labs() -> list[tuple[str, str]]:
    """What each lab hides, and the channels of its bench, the two kinds in turn."""
    tied = [name for pair in TIED_PAIRS for name in pair][: LABS // 2]
    others = hideable()[::_EVERY][: LABS // 2]
    return [kind for pair in zip(others, tied, strict=True) for kind in ((pair[0], ALL), (pair[1], POWERS))]


def races(settings: Settings) -> list[Race]:
    """Both campaigns of every lab."""
    found = []
    for k, (name, channels) in enumerate(labs()[: settings.thinned(LABS)]):
        seed = FIRST_SEED + k
        hidden = ((name, drawn(name, SIZE, seed)),)
        found += [Race(hidden=hidden, seed=seed, channels=channels, plan=plan) for plan in (ADAPTIVE, RANDOM)]
    return found


def reached(race: Race, record: Record) -> float:
    """Bench minutes from which on exactly what is hidden was named; infinite where it was not in the end."""
    minutes = np.inf
    for moment in reversed(record["moments"]):
        if moment["verdict"] != "named" or sorted(moment["stated"]) != sorted(race.names):
            break
        minutes = moment["minutes"]
    return float(minutes)


def run(settings: Settings) -> Result:
    """Run what the journal in ``settings.out`` does not hold yet, and compare."""
    trials = races(settings)
    code = code_hash(sim, models, drivers, bench, experiments.adaptive)
    journal = Journal(path=settings.out / "adaptive_campaign.jsonl", code=code)
    records = perform(run_race, trials, journal, settings)
    return compared(list(zip(trials, records, strict=True)))


def compared(done: Sequence[tuple[Race, Record]]) -> Result:
    """Goals, the two plans side by side, and every lab as a row."""
    pairs = list(zip(done[::2], done[1::2], strict=True))
    minutes = np.array([[reached(*adaptive), reached(*random)] for adaptive, random in pairs])
    both = np.isfinite(minutes).all(axis=1)
    ratio = float(np.median(minutes[both, 0] / minutes[both, 1])) if both.any() else np.nan
    missed = np.sum(~np.isfinite(minutes), axis=0)
    labs = counted(int(both.sum()), "lab")
    goals = (
        Goal(
            name=f"bench minutes to the right verdict, adaptive over random, median of {labs}",
            value=ratio, bar=1.0, at_least=False,
        ),
        Goal(
            name="labs that never got there, adaptive less random",
            value=float(missed[0] - missed[1]), bar=0.0, at_least=False,
        ),
    )  # fmt: skip
    waits = [m["cpu_s"] for race, r in done for m in r["moments"] if race.plan == ADAPTIVE]
    notes = (
        f"{counted(len(pairs), 'lab')}, seeds {FIRST_SEED} to {FIRST_SEED + len(pairs) - 1}: they belong to tuning",
        f"at most {MOST} rows a campaign; a look every {AT_ONCE} rows",
        f"a choice took {np.median(waits):.1f} s of processor time in the median, {max(waits):.1f} s at most; the "
        "minutes do not hold it",
        *(f"{race.key}: stopped, {r['stopped']}" for race, r in done if r["stopped"]),
    )
    return Result(
        virtual=True, goals=goals, tables=(_plans(pairs, minutes), _every_lab(pairs, minutes)), notes=notes
    )


Pair = tuple[tuple[Race, Record], tuple[Race, Record]]


def _plans(pairs: Sequence[Pair], minutes: np.ndarray) -> Table:
    """Each plan on each kind of bench: quartiles over its labs, those that never got there as infinite."""
    rows: list[tuple[Cell, ...]] = []
    for channels in (ALL, POWERS):
        of = np.array([adaptive[0].channels == channels for adaptive, _ in pairs])
        for column, plan in enumerate((ADAPTIVE, RANDOM)):
            own = minutes[of, column]
            if not own.size:
                continue
            quartiles = np.quantile(own, (0.25, 0.5, 0.75), method="inverted_cdf")
            spent = float(
                np.median([pair[column][1]["minutes"] for pair, k in zip(pairs, of, strict=True) if k])
            )
            shown = [float(q) if np.isfinite(q) else "never" for q in quartiles]
            rows.append((channels, plan, int(own.size), *shown, int(np.sum(~np.isfinite(own))), spent))
    columns = (
        "bench", "plan", "labs", "lower quartile, minutes", "median", "upper quartile", "never",
        "whole campaign, minutes",
    )  # fmt: skip
    return Table(title="Minutes of bench time to the right verdict", columns=columns, rows=tuple(rows))


def _every_lab(pairs: Sequence[Pair], minutes: np.ndarray) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for ((race, first), (_, second)), own in zip(pairs, minutes, strict=True):
        shown = [float(m) if np.isfinite(m) else "never" for m in own]
        rows.append((
            *race.hidden[0], race.seed, race.channels, *shown, first["rows"], _last_word(first), _last_word(second)
        ))  # fmt: skip
    columns = (
        "hidden", "value", "seed", "bench", "adaptive, minutes", "random, minutes", "adaptive, rows in all",
        "adaptive says in the end", "random says in the end",
    )  # fmt: skip
    return Table(title="Lab by lab", columns=columns, rows=tuple(rows))


def _last_word(record: Record) -> str:
    last = record["moments"][-1]
    return " ".join([last["verdict"], *last["stated"]])


EXPERIMENT = Experiment(title="Bench time to the right verdict: adaptive against random", run=run, apart=True)
