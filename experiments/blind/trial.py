"""One blind trial: a virtual lab hides something, is measured, and the diagnosis is asked."""

import time
from collections.abc import Collection
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from drivers.mocks.lab.foreign.families import FOREIGN
from drivers.mocks.lab.hidden import HIDDEN
from drivers.mocks.lab.instruments import InstrumentErrors
from drivers.mocks.lab.laboratory import DRIFT_S, Laboratory
from drivers.mocks.lab.survey import Schedule, settle, survey
from experiments.blind.answer import NO_ANSWER, Answer
from experiments.blind.reach import (
    CHANNELS,
    EFFICIENCY_ONLY,
    Reach,
    departure,
    design,
    hiding,
    reach_of,
    readings,
    shift_between,
    without,
)
from experiments.blind.sight import LEAST_SIGMA, Sight
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from models.screening import LOADED_KINDS
from sim.model import Model

ORDINARY, HEAVY, CORRELATED, UNDERSTATED = "ordinary", "heavy tails", "autocorrelated", "under-stated"
NOISES = (ORDINARY, HEAVY, CORRELATED, UNDERSTATED)
_UNDERSTATED_BY = 1.5
# when is known to the truth's isolability too
_EFFICIENCY_COLUMNS = ["time_s", "D1", "D2", "P2_W", "efficiency"]
_LITTLE_LESS = 0.9  # of what is seen: an effect that leaves more in a nominal lab is no rival in another
_U_OF = {"u_P1_W": ("P1_W", 3.5e-5), "u_P2_W": ("P2_W", 3.5e-5)}  # of reading: the mean of eight updates


@dataclass(frozen=True, slots=True, kw_only=True)
class BlindTrial:
    """What one seed hides, and how it is measured.

    ``design`` is the seed of a pool's set points, for trials whose isolability is asked of the truth; without
    one the set points are the trial's own. ``rival`` is what the hidden effect is tied with, where that is tried.
    """

    row: str
    seed: int
    hidden: tuple[tuple[str, float], ...] = ()
    noise: str = ORDINARY
    efficiency_only: bool = False
    design: int | None = None
    points: int = 100
    rival: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The hidden effects."""
        return tuple(name for name, _ in self.hidden)

    @property
    def key(self) -> str:
        """Everything that the outcome depends on."""
        what = " + ".join(f"{name} = {value!r}" for name, value in self.hidden) or "nothing"
        where = "own design" if self.design is None else f"design {self.design}"
        seen = "efficiency only" if self.efficiency_only else "all channels"
        tie = "" if self.rival is None else f", tied with {self.rival}"
        return (
            f"{self.row}: {what}{tie}, seed {self.seed}, {self.noise}, {seen}, {where}, {self.points} points"
        )

    @property
    def headlines(self) -> dict[str, float]:
        """The hidden values as the catalogue means them: a drift's is what it has come to at the last row."""
        values = dict(self.hidden)
        if "warm_up_drift" in values:
            values["warm_up_drift"] *= -float(np.expm1(-self.plan.time_s[-1] / DRIFT_S))
        return values

    @property
    def plan(self) -> Schedule:
        """The set points in their order."""
        return design(self.seed if self.design is None else self.design, self.points)


def laboratory(trial: BlindTrial) -> Laboratory:
    """The lab of a trial, with its kind of noise."""
    lab = Laboratory.draw(seed=trial.seed, hidden=dict(trial.hidden))
    return replace(lab, errors=_noisy(lab.errors, trial))


def plain_laboratory(trial: BlindTrial) -> Laboratory:
    """What the lab of a trial is judged against: nothing hidden, and the parts in question as designed."""
    return without(Laboratory.draw(seed=trial.seed), trial.names)


def _noisy(errors: InstrumentErrors, trial: BlindTrial) -> InstrumentErrors:
    """Heavy tails: three degrees of freedom. Autocorrelated: 0.6 from row to row. Under-stated: loads are noisier
    than the reference rows, whose scatter they are judged by, and the stated uncertainty is as much too small."""
    if trial.noise == HEAVY:
        return replace(errors, tail=3.0)
    if trial.noise == CORRELATED:
        return replace(errors, correlation=0.6)
    if trial.noise == UNDERSTATED:
        return replace(errors, noise=np.where(trial.plan.kind == "load", _UNDERSTATED_BY, 1.0))
    return errors


def measured(trial: BlindTrial) -> pd.DataFrame:
    """The measurement table of a trial."""
    table = survey(laboratory(trial), trial.plan, seed=trial.seed)
    if trial.noise == UNDERSTATED:
        table = table.assign(**{u: share * table[column] for u, (column, share) in _U_OF.items()})
    return table


def sight_of(trial: BlindTrial, table: pd.DataFrame) -> Sight:
    """What the truth says can be seen of what the trial hides.

    The rivals of a single effect that take some of it, one reading aside, are tried in the trial's own lab, where
    edges turn and limits lie as they do for what is hidden: a nominal one may have a row at the most that it can
    carry which seems to tell two apart that are one on all others. A row that one cannot run tells nothing of it.
    """
    assert trial.design is not None
    lab = plain_laboratory(trial)
    start = settle(lab, trial.plan)
    plain = survey(lab, trial.plan, seed=trial.seed, settled=start)
    if trial.efficiency_only:
        table = table[table["kind"].isin(LOADED_KINDS)]
    known, shift = reach_of(trial.design, trial.points), shift_between(table, plain)
    quiet = survey(lab.without_noise(), trial.plan, seed=trial.seed, samples=1, settled=start)
    sight = _sight(trial, known, shift, quiet)
    if len(trial.names) > 1 or trial.names[0] in FOREIGN or sight.detectability < LEAST_SIGMA:
        return sight

    def does(name: str, value: float) -> pd.Series:
        other = hiding(lab, {name: value})
        there = survey(other, trial.plan, seed=trial.seed, settled=settle(other, trial.plan, start))
        return shift_between(there, plain)

    others = [name for name in sight.planes if name not in trial.names]
    near = [name for name in others if sight.share_beyond(name) < _LITTLE_LESS]
    here = {name: [does(name, value) for value in HIDDEN[name].drawn] for name in near}
    return _sight(trial, known.with_planes(here), shift, quiet) if here else sight


def _sight(trial: BlindTrial, known: Reach, shift: pd.Series, quiet: pd.DataFrame) -> Sight:
    """The sight of a shift with what a trial's table holds: efficiency alone comes without voltages.

    ``quiet`` is what the lab reads without what is hidden and without noise. Whatever is asked of the input power is
    asked at the output power that is read.
    """
    alone = trial.efficiency_only
    plain = readings(quiet.assign(P1_W=quiet["P1_W"] - (quiet["P2_W"] - quiet["P_set_W"])))
    channels = EFFICIENCY_ONLY if alone else CHANNELS
    return known.sight(shift, channels, voltages_read=not alone, plain=plain)


def isolability(trial: BlindTrial, sight: Sight) -> float:
    """Sigmas by which what is hidden stands out of whatever could be mistaken for it.

    One effect: of every other effect. A foreign one: of the whole catalogue together. Of a pair, the shift of
    both: of every single effect, and of each of the two with any third. Efficiency alone: of nothing, as the design
    has it and as this lab shows it. Each effect also of an ordinary bench whose parts are as far off.
    """
    if any(name in FOREIGN for name in trial.names):
        return sight.beyond(list(sight.planes))
    lab = laboratory(trial)
    ordinary = min(departure(lab, name) for name in trial.names)
    if trial.efficiency_only:
        return min(sight.detectability, sight.beyond_ordinary, ordinary)
    beside = [()] if len(trial.names) == 1 else [(name,) for name in trial.names]
    return min(ordinary, *(min(sight.rivals(trial.names, left).values()) for left in beside))


def ask(trial: BlindTrial) -> dict[str, Any]:
    """Hide, measure, diagnose; plain data. The diagnosis gets the table alone.

    A trial of a pool's design that cannot be seen is ``excluded`` and not diagnosed.
    """
    table = measured(trial)
    truth: dict[str, Any] = {"excluded": False, "isolability": None, "tied": [], "nearest": None}
    if trial.design is not None:
        sight = sight_of(trial, table)
        truth["isolability"] = isolability(trial, sight)
        if truth["isolability"] < LEAST_SIGMA:
            return truth | {"excluded": True}
        if trial.efficiency_only and trial.names[0] not in FOREIGN:
            truth["tied"] = list(sight.tied(trial.names[0]))
            truth["nearest"] = sight.nearest(trial.names[0])
    seen = efficiency_table(table) if trial.efficiency_only else table
    return truth | {"answer": asdict(answered(seen))}


def efficiency_table(table: pd.DataFrame) -> pd.DataFrame:
    """Set points, efficiency and when, of the rows that carry load, and nothing else."""
    return table.loc[table["kind"].isin(LOADED_KINDS), _EFFICIENCY_COLUMNS]


def answered(table: pd.DataFrame, model: Model | None = None, *, without: Collection[str] = ()) -> Answer:
    """The diagnosis of a table against a model, the prototype by default, whatever comes of it."""
    start_s = time.process_time()
    try:
        plain = diagnose(load_measurements(table), model, without=without).as_plain(ahead=False)
    except ValueError as error:  # of whatever kind: no answer is an answer that counts against it
        refused = f"{type(error).__name__}: {error}"
        return Answer(verdict=NO_ANSWER, refused=refused, cpu_s=time.process_time() - start_s)
    return Answer.of(plain, time.process_time() - start_s)
