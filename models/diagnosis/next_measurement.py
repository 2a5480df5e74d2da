"""What to measure next: the points and actions that tell the remaining causes apart best per minute.

For two causes i and j with their fitted shifts, a new reading with noise sigma separates them by
d_ij = |shift_i - shift_j| / sigma; an action is worth the sum of p_i p_j d_ij^2 / 2 over the pairs, per minute.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations
from models.diagnosis.verdict import Cause
from sim.model import Model
from sim.operating_points import Points
from sim.simulate import Result, simulate_many

Array = NDArray[np.float64]

_LEAST = 0.01  # probability from which a cause takes part
_MOST_CAUSES = 5
_POINT_MINUTES, _STANDBY_MINUTES = 4.0, 1.5
_POWERS = 6
_SIGMA = {"P1_W": 1.5e-4, "D0": 2e-4, "T_heatsink_C": 0.3, "T_inductor_C": 0.4, "T_transformer_C": 0.4}


@dataclass(frozen=True, slots=True, kw_only=True)
class NextMeasurement:
    """An action, the causes it separates, by how many sigmas, and the bench minutes it takes."""

    action: str
    separates: tuple[str, ...]
    expected_sigma: float
    minutes: float

    def as_plain(self) -> dict[str, object]:
        """For the JSON answer."""
        return {
            "action": self.action,
            "separates": list(self.separates),
            "expected_sigma": self.expected_sigma,
            "minutes": self.minutes,
        }


def _candidates(observations: Observations) -> tuple[list[str], Array, Points]:
    """Names, minutes and set points of what could be done: standby, no load, and points of the map."""
    p, loaded = observations.points, observations.loaded
    D1, D2, power = (np.asarray(x)[loaded] for x in (p.D1, p.D2, p.power_W))
    chosen = np.unique(
        [int(np.argmin(np.abs(power - q))) for q in np.linspace(power.min(), power.max(), _POWERS)]
        + [int(np.argmin(D1)), int(np.argmax(D1)), int(np.argmin(D2)), int(np.argmax(D2))]
    )
    names = ["standby", "no_load"]
    names += [f"measure D1 = {D1[k]:.3f}, D2 = {D2[k]:.3f}, {power[k]:.0f} W again" for k in chosen]
    best = int(np.argmin(power))
    points = Points(
        D1=np.concatenate([[1.0, D1[best]], D1[chosen]]),
        D2=np.concatenate([[0.0, D2[best]], D2[chosen]]),
        power_W=np.concatenate([[0.0, 0.0], power[chosen]]),
        pwm=np.array([False, *[True] * (chosen.size + 1)]),
    )
    minutes = np.array([_STANDBY_MINUTES, *[_POINT_MINUTES] * (chosen.size + 1)])
    return names, minutes, points


def _distance2(a: Result, b: Result, present: set[str]) -> Array:
    """Squared separation of two causes at every candidate, summed over channels."""
    total = np.zeros(len(a.points))
    for column, sigma in _SIGMA.items():
        if column in present:
            scale = np.maximum(sigma * np.asarray(a.points.power_W), 0.05) if column == "P1_W" else sigma
            total += np.nan_to_num((a[column] - b[column]) / scale) ** 2
    return total


def next_measurements(
    observations: Observations, baseline: Model, causes: Sequence[Cause], most: int = 3
) -> list[NextMeasurement]:
    """The best few actions; none where one cause or none is left."""
    rivals = [c for c in causes if c.probability >= _LEAST][:_MOST_CAUSES]
    if len(rivals) < 2:
        return []
    names, minutes, points = _candidates(observations)
    models = [baseline.with_effect(c.effect, **c.term.signature.values(c.term.value)) for c in rivals]
    seen = simulate_many(models, points)
    present = {c.column for c in observations.channels}
    worth = np.zeros(len(names))
    apart = {}
    for i in range(len(rivals)):
        for j in range(i):
            d2 = _distance2(seen[i], seen[j], present)
            apart[rivals[j].effect, rivals[i].effect] = d2
            worth += rivals[i].probability * rivals[j].probability * 0.5 * d2
    order = np.argsort(-worth / minutes)[:most]
    found = []
    for k in order:
        pair = max(apart, key=lambda names_, at=k: apart[names_][at])  # type: ignore[misc]
        found.append(
            NextMeasurement(
                action=names[k],
                separates=pair,
                expected_sigma=float(np.sqrt(apart[pair][k])),
                minutes=float(minutes[k]),
            )
        )
    return [step for step in found if step.expected_sigma > 0.0]
