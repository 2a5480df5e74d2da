"""``diagnose(measurements)``: what the simulation gets wrong, why, how sure, and what it is worth to know."""

from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from models.calibrated import CalibratedPhysics
from models.calibration import calibrate
from models.dataset import Measurements
from models.diagnosis.agreement import Confirmed
from models.diagnosis.bench_options import ANYTHING, Allowed
from models.diagnosis.conditions import Condition, elsewhere, unread_conditions
from models.diagnosis.everyday import parts_beyond
from models.diagnosis.evidence import Hypothesis
from models.diagnosis.extension import extended, interval
from models.diagnosis.found import find
from models.diagnosis.gain import Gain, Worth
from models.diagnosis.gap import Added, gap
from models.diagnosis.hypotheses import Fit
from models.diagnosis.judged import Judged, judged_of
from models.diagnosis.left_out import not_usable, outliers, rows_left_out
from models.diagnosis.next_measurement import (
    MOST_STEPS,
    asks_again,
    next_measurements,
    rivals_of,
)
from models.diagnosis.noise import ChannelNoise
from models.diagnosis.observations import Observations, observe
from models.diagnosis.plausibility import RejectedColumn
from models.diagnosis.race import NextMeasurement, Rival
from models.diagnosis.refinery import Refinery
from models.diagnosis.sight import Sight, sight
from models.diagnosis.unexplained import Unexplained
from models.diagnosis.usable import Usable, check_table, usable_readings
from models.diagnosis.verdict import BY_CHANCE, Cause, Verdict
from sim.effects.catalogue import CATALOGUE, left_out
from sim.model import Model
from sim.side_by_side import at_once, kept

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The verdict with everything that it rests on; what causes are worth, what the points can see and what to measure
    next are found when they are asked for.

    ``parts`` are those that what is found needs beyond the everyday line, with how many sigmas each,
    ``conditions`` those that nobody read; ``measured_rows`` is which row of the table each of the frame was.
    ``held_out`` and ``ahead`` are the gains and the next measurements where they were worked out side by side already;
    None where they are worked out once asked for.
    """

    verdict: Verdict
    observations: Observations
    baseline: Model
    residual: Array
    noise: list[ChannelNoise]
    gap: dict[str, Any]
    added: dict[str, Added]
    worth: Worth | None
    rivals: list[Rival]
    refinery: Refinery
    unexplained: Unexplained | None
    alike: list[Confirmed]
    parts: dict[str, float]
    conditions: list[Condition]
    extended: Model
    leading: Fit
    sigma: Array
    edge: Observations
    measured_rows: Sequence[int]
    rejected: list[dict[str, Any]]
    rejected_columns: list[RejectedColumn]
    held_out: tuple[Gain, ...] | None = None
    ahead: list[NextMeasurement] | None = None

    @cached_property
    def gains(self) -> tuple[Gain, ...]:
        """What the stated causes are worth on blocks of each kind that were not fitted; none without any."""
        if self.held_out is not None or self.worth is None:
            return self.held_out or ()
        with _one_thread():
            return self.worth.gains()

    @cached_property
    def sight(self) -> list[Sight]:
        """What these set points and channels can see of every effect."""
        with _one_thread():
            return sight(self.refinery)

    @cached_property
    def next(self) -> list[NextMeasurement]:
        """What is worth measuring next of everything, in its order."""
        return self.steps(ANYTHING) if self.ahead is None else self.ahead

    @cached_property
    def calibrated(self) -> CalibratedPhysics:
        """A surrogate: the simulator with what was found, and what it still leaves."""
        with _one_thread():
            return calibrate(self.refinery, self.leading, self.sigma, self.edge)

    def steps(self, allowed: Allowed, most: int = MOST_STEPS) -> list[NextMeasurement]:
        """What is worth measuring next of what is allowed, in its order, so many measurements at most."""
        with _one_thread():
            return next_measurements(
                self.observations, self.rivals, refinery=self.refinery, most=most, allowed=allowed
            )

    def residual_table(self) -> pd.DataFrame:
        """Measured less simulated by row: the rows' set points, one column a channel, and what is left over."""
        columns = [c for c in ("point", "kind", "time_s", "D1", "D2", "P2_W") if c in self.observations.frame]
        table = self.observations.frame[columns].copy()
        for k, channel in enumerate(self.observations.channels):
            mask = self.observations.channel == k
            table[f"residual_{channel.column}"] = np.nan
            rows = self.observations.row[mask]
            table.iloc[rows, table.columns.get_loc(f"residual_{channel.column}")] = self.residual[mask]  # type: ignore[index]
        if self.unexplained is not None:
            table["leftover_W"] = np.nan
            table.iloc[self.unexplained.rows, table.columns.get_loc("leftover_W")] = self.unexplained.watts  # type: ignore[index]
        return table

    def as_plain(self, model_file: str | None = None, *, ahead: bool = True) -> dict[str, Any]:
        """The JSON answer, schema 1; without ``ahead`` it has no gain and no next measurements, which take longest."""
        v = self.verdict
        return {
            "schema": 1,
            "verdict": v.kind,
            "points": int(self.observations.loaded.sum()),
            "channels": [c.name for c in self.observations.channels],
            "gap": self.gap,
            "consistent": {"probability": v.consistent_probability},
            "causes": [self._cause(c) for c in v.causes],
            "named": list(v.named),
            "groups": [list(g) for g in v.groups],
            "unknown": {"probability": v.unknown_probability, "formula": None}
            | self._unexplained()
            | {"rows": [asdict(row) for row in self.alike], "strained": v.strained},
            "conditions": [c.as_plain() for c in self.conditions],
            "parts": [{"part": name, "sigma": sigma} for name, sigma in self.parts.items()],
            "next": [n.as_plain() for n in self.next] if ahead else [],
            "gain": self._gain() if ahead else None,
            "model": model_file,
            "sight": [s.as_plain() for s in self.sight],
            "noise": {n.channel: n.as_plain() for n in self.noise},
            "rejected_rows": self.rejected,
            "rejected_columns": [c.as_plain() for c in self.rejected_columns],
        }

    @property
    def gain(self) -> Gain | None:
        """The gain on held-out bands of power, where there is one."""
        return self.gains[0] if self.gains else None

    def _gain(self) -> dict[str, Any] | None:
        if not self.gains:
            return None
        first, *also = (gain.as_plain() for gain in self.gains)
        return first | {"also": also}

    def _unexplained(self) -> dict[str, Any]:
        u = self.unexplained
        if u is None:
            return {}
        placed: dict[str, Any] = {"location": u.location, "at_place": u.at_place, "rms_W": u.rms_W}
        if u.sensor is not None:
            placed["sensor"] = u.sensor.as_plain()
        if u.over_temperature is not None:
            return placed | {"over_temperature": u.over_temperature.as_plain()}
        if u.onset is not None:
            placed["onset"] = u.onset.as_plain(self.measured_rows)
            return placed
        if u.rms_W == 0.0:  # timing, the ac elements and other sensors move no watts
            return placed
        return placed | {"formula": u.formula, "formula_explains": u.explained}

    def _cause(self, cause: Cause) -> dict[str, Any]:
        term, entry = cause.term, cause.term.signature.entry
        head = term.head
        parameters: list[dict[str, Any]] = [
            {
                "name": head.name,
                "unit": head.unit,
                "value": term.value,
                "ci95": list(interval(self.refinery, cause.fit, cause.effect)),
                "off": head.off,
                "at_bound": term.at_bound,
                "in_model": self.extended.effects.get(cause.effect, {}).get(head.name),
            }
        ]
        for p in entry.parameters[1:]:
            value = term.signature.other.get(p.name, p.off)
            parameters.append({"name": p.name, "unit": p.unit, "value": value, "ci95": None, "off": p.off})
        return {
            "effect": cause.effect,
            "probability": cause.probability,
            **self.added[cause.effect].as_plain(),
            "parameters": parameters,
            "tied_with": list(cause.tied_with),
            "says": entry.says_at(term.value),
            "check": entry.check_at(term.value),
        }


def _parts(refinery: Refinery, leading: Hypothesis, verdict: Verdict) -> dict[str, float]:
    """What parts and instruments have to be off by beside what is said, a leftover too; none where that is open."""
    said = leading.leftover if verdict.unknown_probability else None
    return {} if verdict.kind == "unknown" else parts_beyond(refinery, leading.fit, said)


def _one_thread() -> AbstractContextManager[object]:
    """Of many small matrices a second thread only costs."""
    limited: AbstractContextManager[object] = _linear_algebra().limit(limits=1, user_api="blas")
    return limited


@cache
def _linear_algebra() -> ThreadpoolController:
    """Its libraries, looked up once: that takes milliseconds, and all are there once this module is."""
    return ThreadpoolController()


def diagnose(
    measurements: Measurements,
    baseline: Model | None = None,
    *,
    without: Collection[str] = (),
    seed: int = 0,
    progress: Callable[[str], None] = lambda said: None,
    processes: int = 1,
) -> Diagnosis:
    """Diagnose a measurement table against a simulation model.

    Parameters
    ----------
    measurements : Measurements
        At least twelve usable rows that carry power.
    baseline : Model, optional
        What the measurements are compared with; the prototype by default.
    without : names of effects
        Left out of the catalogue: none of them is a cause then, and what they do is for others to explain, or unknown.
    seed : int
        Of the resampled readings that a gain's intervals are of.
    progress : callable
        Is told what is worked on, as words for a person who waits.
    processes : int
        That share large simulations, by forks; more than one only for a program that owns its process.

    Raises
    ------
    TooFewPoints
        Too few rows to say anything.
    ImplausibleTable
        Voltages or set points that cannot be of this converter.
    ParameterError
        ``without`` names an effect that the catalogue does not have, or all that it has.
    """
    with _one_thread(), kept(processes):
        return _diagnosed(
            measurements, baseline or Model.baseline(), left_out(without), seed, progress, processes
        )


def _diagnosed(
    measurements: Measurements,
    baseline: Model,
    unknown: frozenset[str],
    seed: int,
    progress: Callable[[str], None],
    processes: int,
) -> Diagnosis:
    whole = observe(measurements.frame, baseline.converter, processes)
    check_table(whole, measurements, baseline)

    def judge(table: Observations) -> tuple[Usable, Judged]:
        usable = usable_readings(table, baseline, unknown, measurements.rows)
        return usable, judged_of(find(usable, baseline, progress), seed, progress)

    progress(f"simulating {len(CATALOGUE) - len(unknown)} effects at {len(whole.frame)} points")
    first, judged = judge(whole)
    if found := elsewhere(unread_conditions(judged.setting.refinery, judged.leading.fit)):
        progress(f"simulating once more, at what readings tell of {', '.join(found)}")
        first, judged = judge(whole.where(found, baseline.converter))
    begun, setting, hypotheses = judged.begun, judged.setting, judged.hypotheses
    usable, observations, refinery = begun.usable, begun.usable.observations, setting.refinery
    verdict, worth, nameless = judged.verdict, judged.worth, judged.nameless
    leading = judged.leading
    chosen = leading.fit
    rivals = rivals_of(hypotheses, refinery, {name for group in verdict.groups for name in group})
    if worth is not None and processes > 1:
        progress("holding out blocks")
    held_out, ahead = _at_the_end(worth, rivals, refinery)
    return Diagnosis(
        verdict=verdict,
        observations=observations,
        baseline=baseline,
        residual=refinery.residual,
        noise=begun.noise,
        gap=gap(observations, refinery.residual, ~setting.outliers),
        added={
            c.effect: Added.by(observations, refinery.residual, c.shift, ~setting.outliers)
            for c in verdict.causes
        },
        worth=worth,
        rivals=rivals,
        refinery=refinery,
        unexplained=nameless if nameless is not None and nameless.likely else None,
        alike=[replace(c, row=measurements.rows[c.row]) for c in judged.alike if c.sigma > BY_CHANCE],
        parts=_parts(refinery, leading, verdict),
        conditions=unread_conditions(refinery, chosen),
        extended=extended(refinery, chosen, verdict.stated, setting.sigma),
        leading=chosen,
        sigma=setting.sigma,
        edge=usable.edge,
        measured_rows=measurements.rows,
        rejected=rows_left_out(
            measurements, [*not_usable(whole.frame, first, observations), *outliers(setting)]
        ),
        rejected_columns=usable.rejected_columns,
        held_out=held_out,
        ahead=ahead,
    )


def _at_the_end(
    worth: Worth | None, rivals: list[Rival], refinery: Refinery
) -> tuple[tuple[Gain, ...] | None, list[NextMeasurement] | None]:
    """What the stated causes are worth where processes share it, at the same time what one alone measures next."""
    o = refinery.observations
    if o.processes < 2 or worth is None:
        return None, None
    if len(rivals) < 2 or not asks_again(refinery):
        return worth.gains(), None
    # what to measure next stays here: the refinery is twenty times as long to send as what gains are asked of
    ahead, held_out = at_once(partial(next_measurements, o, rivals, refinery=refinery), worth.gains)
    return held_out, ahead
