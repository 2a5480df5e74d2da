"""Which readings of a measurement table a diagnosis uses, and their signatures.

Left out are rows close to the most that D1 and D2 carry, columns and stretches that cannot be what they are called,
and readings that some variant cannot predict. A table of which too little is left is refused.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import pandas as pd

from models.dataset import Measurements
from models.diagnosis.heat_lag import History
from models.diagnosis.held import held
from models.diagnosis.hypotheses import Fit
from models.diagnosis.near_limit import (
    LINK_INDUCTANCE,
    answers_about,
    first_looks,
    margin,
    still_to_spare,
)
from models.diagnosis.noise import HOLDS
from models.diagnosis.observations import Observations
from models.diagnosis.plausibility import RejectedColumn, check_inputs, check_set_points, implausible
from models.diagnosis.refinery import Refinery
from models.diagnosis.signatures import Signatures, signatures
from models.set_points import set_power, together
from sim.model import Model
from sim.parameters import ParameterError

LEAST_ROWS = 12
LEAST_SET_POINTS = 6  # Assumption: fewer do not tell even what one effect does over D1, D2 and power
_CARRIED = 0.75  # of the readings, with power to spare: where fewer are, the set points are asked about


class TooFewPoints(ValueError):
    """A measurement table too small to say anything; the message says how many rows are needed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Usable:
    """M readings with their signatures, and what is left out of them.

    ``edge`` are the readings of rows that the baseline, by the ``margin`` that was asked for, or the cause that leads
    carries with too little power to spare; ``unpredicted`` those of other rows that some variant does not predict.
    """

    observations: Observations
    known: Signatures
    margin: float
    edge: Observations
    unpredicted: Observations
    rejected_columns: list[RejectedColumn]

    def as_explained(self, refinery: Refinery, fit: Fit) -> Self:
        """The same without the rows that the causes of a fit which leads a search leave too little power to spare.

        Itself where there are none, or where too few rows would be left. Where it counts what a link inductance bends,
        with efficiency alone, that is what it bends about this fit.
        """
        if not fit.terms:
            return self
        o, model = self.observations, refinery.model(fit, refinery.spreads(fit))
        spare, known = still_to_spare(o, refinery.baseline, model, self.margin), self.known
        if np.all(spare):
            return self
        if len(known.bends) and (link := _link_inductance(known, fit)) is not None:
            parts = np.eye(len(known.modes))[link]
            slope, bend = answers_about(o, model, known.modes.spreads[link], refinery.near)
            spare &= np.isfinite(slope + bend)
            known = replace(known, bends=np.stack([slope - known.moved(parts), bend]))
        if _rows_left(o.take(spare)) < LEAST_ROWS:
            return self
        return replace(
            self,
            observations=o.take(spare).in_use(),
            known=known.take(spare),
            edge=self.edge.and_also(o.take(~spare)),
        )


def _too_few_left(left: int, whole: Observations) -> TooFewPoints:
    """That so many of a table's loaded rows are too few, and what to do about it."""
    loaded = int(whole.loaded.sum())
    todo = (
        "Make sure that the model file is that of this converter"
        if left < loaded / 2
        else "Measure more rows, further from the most that D1 and D2 can carry"
    )
    return TooFewPoints(
        f"{left} of {loaded} loaded rows are ones that the model can carry with some power to "
        f"spare; a diagnosis needs at least {LEAST_ROWS}. {todo}"
    )


def _link_inductance(known: Signatures, fit: Fit) -> int | None:
    """Which part the link inductance is, where it is none that a fit has as a cause."""
    own = {known.spread_names[k] for k in fit.own(known)}
    parts = (k for k, s in enumerate(known.modes.spreads) if s.path == LINK_INDUCTANCE and s.path not in own)
    return next(parts, None)


def _rows_left(observations: Observations) -> int:
    """How many rows that carry power have readings."""
    return int(np.unique(observations.row[observations.loaded[observations.row]]).size)


def check_table(whole: Observations, measurements: Measurements, baseline: Model) -> None:
    """Refuse a table before anything is simulated for it.

    Raises
    ------
    TooFewPoints
        Too few rows carry power.
    ImplausibleTable
        Voltages, a room or an efficiency that cannot be of this converter.
    """
    loaded = int(whole.loaded.sum())
    if loaded < LEAST_ROWS:
        usable = f"{loaded} usable {'row that carries' if loaded == 1 else 'rows that carry'} power"
        raise TooFewPoints(
            f"{usable}; a diagnosis needs at least {LEAST_ROWS}{_most_lost_before(measurements)}"
        )
    if (different := _set_points(whole)) < LEAST_SET_POINTS:
        raise TooFewPoints(
            f"{loaded} rows at {different} different set points; a diagnosis needs at least {LEAST_SET_POINTS}: rows "
            "at one of them are replicates, which tell the noise and no cause"
        )
    check_inputs(whole, baseline.converter)


def _set_points(observations: Observations) -> int:
    """How many different set points carry power; powers that a load may wander between are one."""
    frame = observations.frame[observations.loaded]
    keys, span = [frame["D1"].round(6), frame["D2"].round(6)], HOLDS * observations.rated_W
    power = together(set_power(frame, frame["P2_W"]), keys, span)
    return len(pd.concat([*keys, power.rename("power")], axis=1).drop_duplicates())


def _most_lost_before(measurements: Measurements) -> str:
    """What the table lost before, and why most of it."""
    if not measurements.rejected:
        return ""
    reason, count = Counter(row.reason for row in measurements.rejected).most_common(1)[0]
    out = len(measurements.rejected)
    were = "1 row was left out" if out == 1 else f"{out} rows were left out, {count} of them"
    return f". {were} because: {reason}"


def usable_readings(
    whole: Observations, baseline: Model, without: frozenset[str], rows: Sequence[int]
) -> Usable:
    """The readings that a diagnosis goes by, with their signatures but for the effects ``without``.

    ``rows`` is which row of the table each of the frame was.

    Raises
    ------
    TooFewPoints
        Too few rows are left that the model can carry with some power to spare.
    ImplausibleTable
        Set points that the model cannot run, or temperatures in degrees Fahrenheit.
    ParameterError
        None of the effects would show in these rows.
    """
    spare, of_all = first_looks(whole, baseline)
    if np.mean(spare) < _CARRIED:
        check_set_points(whole, baseline)
    observations, edge = whole.take(spare), whole.take(~spare)
    if _rows_left(observations) == 0:
        raise _too_few_left(0, whole)
    near = of_all.take(np.searchsorted(np.unique(whole.row), np.unique(observations.row)))
    expected = observations.predicted(near)
    wrong, whole_columns = implausible(observations, expected)
    stuck, stretches = held(observations, expected, rows)
    refused = [column.column for column in whole_columns]
    alone = whole.without(refused).mistrusting(refused)
    if alone.efficiency_alone and not whole.efficiency_alone:  # rows count to nearer the limit then
        again = usable_readings(alone, baseline, without, rows)
        return replace(again, rejected_columns=[*whole_columns, *again.rejected_columns])
    rejected = [*whole_columns, *stretches]
    observations, edge = (o.mistrusting(c.column for c in rejected) for o in (observations, edge))
    history = History.of(whole, of_all)
    known = signatures(observations, baseline, near=near, history=history).leaving_out(without)
    if not known.effects:
        raise ParameterError(
            "none of the effects that are left would show in this table: leave fewer of them out, or measure rows that "
            "they change"
        )
    sound, predicted = ~(wrong | stuck), known.finite()
    kept, unpredicted = sound & predicted, observations.take(sound & ~predicted)
    observations, known = observations.take(kept).in_use(), known.take(kept)
    if (left := _rows_left(observations)) < LEAST_ROWS:
        raise _too_few_left(left, whole)
    return Usable(
        observations=observations,
        known=known,
        margin=margin(whole),
        edge=edge,
        unpredicted=unpredicted,
        rejected_columns=rejected,
    )
