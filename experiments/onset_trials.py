"""What the diagnosis says of a cause that sets in during a campaign: virtual labs in which something happens.

Every effect that a lab can hide is hidden once, of a size that a lab draws, from some row on; and once more all the
time, where nothing sets in. A campaign in which something happens is put together from two of the same lab, with
nothing and with the effect. An effect may be too small to be seen in a part of the rows: that is not asked. Where it is
told to set in, the rows before and after are diagnosed each on their own. Then comes one lab of each family that no
catalogue has: what changes there has no name.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from drivers.mocks.lab.foreign.families import FOREIGN
from drivers.mocks.lab.hidden import HIDDEN
from experiments.blind.draws import log_uniform
from experiments.blind.reach import hideable
from experiments.blind.scoring import Share
from experiments.blind.trial import BlindTrial, measured
from experiments.harness.registry import Experiment
from experiments.harness.result import Cell, Result, Table
from experiments.harness.settings import Countdown, Settings
from models.dataset import load_measurements
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.diagnosis.onset import Onset
from models.diagnosis.stretches import stretches

FIRST_SEED = 580_000
NEXT_S = 2 * 180.0  # two rows
_SHARES = (0.3, 0.7)  # of a campaign's time, after which the effect sets in


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """The answer to one lab: what was hidden, when it set in, and what is said of a part of the time, and of all.

    ``before`` is the verdict of the rows before that alone, ``after`` that of those after it and what it states.
    """

    trial: BlindTrial
    sets_in_s: float
    verdict: str
    onset: Onset | None
    before: str | None
    after: str | None
    stated: tuple[str, ...]
    always: Onset | None

    @property
    def is_named(self) -> bool:
        """Whether a cause of the catalogue is told to set in, or to go away."""
        return self.onset is not None and self.onset.change is None

    @property
    def is_found(self) -> bool:
        """Whether the effect is told to set in, and nothing in its place."""
        told = self.onset if self.is_named else None
        return told is not None and told.sets_in and told.effect in self.trial.names

    @property
    def is_told_apart(self) -> bool:
        """Whether nothing is found before it, and after it the effect alone, or a group that it is in."""
        return self.before == "consistent" and self.stated != () and self.trial.names[0] in self.stated

    @property
    def is_dated(self) -> bool:
        """Whether that is at the row where it did, or two rows from it: a row may show nothing of an effect."""
        return self.onset is not None and abs(self.onset.after_s - self.sets_in_s) <= NEXT_S


def happened(before: pd.DataFrame, after: pd.DataFrame, share: float) -> tuple[pd.DataFrame, float]:
    """The first table up to a share of its time, then the second one; and when that is, in s from the first row on."""
    at_s = float(before["time_s"].quantile(share))
    first, then = before[before["time_s"] < at_s], after[after["time_s"] >= at_s]
    return pd.concat([first, then], ignore_index=True), float(then["time_s"].min() - before["time_s"].min())


def said(trial: BlindTrial) -> Said:
    """The answers to one lab's two campaigns."""
    nothing, hidden = measured(BlindTrial(row=trial.row, seed=trial.seed)), measured(trial)
    share = np.random.default_rng([trial.seed, 15]).uniform(*_SHARES)
    table, sets_in_s = happened(nothing, hidden, share)
    whole = load_measurements(table)
    found = diagnose(whole)
    before, after = [each.found for each in stretches(found, whole, diagnose)] or [None, None]
    return Said(
        trial=trial,
        sets_in_s=sets_in_s,
        verdict=found.verdict.kind,
        onset=_onset_of(found),
        before=None if before is None else before.verdict.kind,
        after=None if after is None else after.verdict.kind,
        stated=() if after is None else after.verdict.stated,
        always=_onset_of(diagnose(load_measurements(hidden))),
    )


def _onset_of(found: Diagnosis) -> Onset | None:
    return None if found.unexplained is None else found.unexplained.onset


def run(settings: Settings) -> Result:
    """One effect after the other, then what no catalogue has."""
    names = hideable()[: settings.thinned(len(hideable()))]
    strange = sorted(FOREIGN)[: settings.thinned(len(FOREIGN))]
    countdown, answers = Countdown(len(names) + len(strange), settings), list[Said]()
    ranges = [(name, HIDDEN[name].drawn) for name in names] + [
        (name, FOREIGN[name].drawn) for name in strange
    ]
    for seed, (name, drawn) in enumerate(ranges, start=FIRST_SEED):
        value = log_uniform(drawn, np.random.default_rng([seed, 14]))
        answers.append(said(BlindTrial(row="onset", seed=seed, hidden=((name, value),))))
        countdown.finished(f"{name} sets in")
    answers, foreign = answers[: len(names)], answers[len(names) :]
    told, changed = ([s for s in each if s.onset is not None] for each in (answers, foreign))
    right = Share.of(s.is_found for s in told)
    dated = Share.of(s.is_dated for s in [*told, *changed])
    apart = Share.of(s.is_told_apart for s in told)
    wrong = Share.of(s.is_named for s in changed)
    false = Share.of(s.always is not None for s in [*answers, *foreign])
    return Result(
        virtual=True,
        goals=(
            right.goal("told to set in: the right effect", 95.0, at_least=True),
            dated.goal("told to set in, or to change: no more than two rows away", 95.0, at_least=True),
            apart.goal("on their own: nothing before, the effect after", 90.0, at_least=True),
            wrong.goal("foreign, told to change: with the name of a cause", 5.0, at_least=False),
            false.goal("always there, but told to set in", 1.0, at_least=False),
        ),
        tables=(
            _effects("One effect that sets in", answers),
            _effects("What no catalogue has sets in", foreign),
        ),
        notes=(
            f"{len(told)} of {len(answers)} are told to set in, of {len(foreign)} foreign effects {len(changed)} to "
            f"change something; seeds {FIRST_SEED} to {FIRST_SEED + len(ranges) - 1}",
        ),
    )


def _effects(title: str, answers: list[Said]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for s in answers:
        ((name, value),), onset = s.trial.hidden, s.onset
        what: tuple[Cell, ...] = (None, None, None)
        if onset is not None:
            told = onset.effect if onset.change is None else onset.change.place
            what = told, onset.value - onset.aside, onset.after_s
        seen: tuple[Cell, ...] = s.trial.seed, s.sets_in_s, s.verdict, *what, s.is_found, s.is_dated
        rows.append((f"{name} = {value:.3g}", *seen, s.before, s.after, s.is_told_apart))
    columns = (
        "hidden", "seed", "sets in, s", "verdict", "told to set in", "by", "told, s", "found", "dated",
        "rows before", "rows after", "told apart",
    )  # fmt: skip
    return Table(title=f"{title}, all channels", columns=columns, rows=tuple(rows))


EXPERIMENT = Experiment(title="Causes that set in during a campaign", run=run, apart=True)
