"""What no cause explains, for people: where it is, how large, and a short formula of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.evidence import Hypothesis, probability_of
from models.diagnosis.leftover import IN_TIME
from models.diagnosis.onset import Onset, is_onset
from models.diagnosis.over_temperature import (
    OverTemperature,
    is_over_temperature,
    over_temperature,
    temperature_steps,
)
from models.diagnosis.refinery import Refinery
from models.diagnosis.sensors import SensorError, is_sensor, sensor_error, sensor_steps
from sim.operating_points import Points

Array = NDArray[np.float64]

_WORTH_A_LOOK = 0.01  # of probability
_LIKELY = 0.5  # probability of a leftover from which it is described
_SURE = 0.95  # of all leftovers: from which it is called a sensor's, or a property's that goes by temperature
_KILO = 1000.0
_TERMS: dict[str, Callable[[Points], Array]] = {
    "1": lambda p: np.ones(len(p)),
    "P/kW": lambda p: np.asarray(p.power_W) / _KILO,
    "(P/kW)^2": lambda p: (np.asarray(p.power_W) / _KILO) ** 2,
    "D1": lambda p: np.asarray(p.D1) + 0.0,
    "D2": lambda p: np.asarray(p.D2) + 0.0,
    "D1^2": lambda p: np.asarray(p.D1) ** 2,
    "D2^2": lambda p: np.asarray(p.D2) ** 2,
    "D1*P/kW": lambda p: np.asarray(p.D1) * np.asarray(p.power_W) / _KILO,
    "D2*P/kW": lambda p: np.asarray(p.D2) * np.asarray(p.power_W) / _KILO,
    "D1*D2": lambda p: np.asarray(p.D1) * np.asarray(p.D2),
    "t/h": lambda p: np.asarray(p.time_s) / 3600.0,
}
_MOST_TERMS = 2
_STILL = 0.1  # of a leftover: what changes by less does not change


@dataclass(frozen=True, slots=True, kw_only=True)
class Unexplained:
    """A leftover: its most probable place, root mean square in W at the input, formula, and how much that holds.

    ``watts`` (n,) is its most probable value at the frame's ``rows`` (n,), whose ``readings`` (n,) of the input power
    show it; ``size`` its length in sigmas of what the fit beside it leaves open, errors of its causes' laws included;
    ``probability`` that of any leftover, ``at_place`` that of one there. ``sensor`` is what is off where it is a
    sensor's error, ``over_temperature`` the property where it is one that goes by its part's temperature, ``onset`` the
    cause where it is one that is not there all the time.
    """

    location: str
    rms_W: float
    formula: str
    explained: float
    rows: NDArray[np.intp]
    readings: NDArray[np.intp]
    watts: Array
    size: float
    probability: float
    at_place: float
    sensor: SensorError | None = None
    over_temperature: OverTemperature | None = None
    onset: Onset | None = None

    @property
    def likely(self) -> bool:
        """Whether it is more likely there than not, and said."""
        return self.probability >= _LIKELY


def unexplained(
    hypotheses: Sequence[Hypothesis], refinery: Refinery, onset: Onset | None = None
) -> Unexplained | None:
    """The leftover of the most probable hypothesis that has one; None where nothing speaks for any.

    That of a sensor, or of a property that goes by temperature, is told only where that is sure of all leftovers, or no
    other comes near; its ``size`` is what it is. The ``onset`` is the one that is among the leftovers.
    """
    with_one = [h for h in hypotheses if h.leftover is not None]
    probability = probability_of(with_one)
    if probability < _WORTH_A_LOOK:
        return None
    at_place = dict[str, float]()
    for h in with_one:
        at_place[_where(h)] = at_place.get(_where(h), 0.0) + h.probability
    leading = with_one[0]
    best = leading
    if _is_specific(_where(leading)) and at_place[_where(leading)] < _SURE * probability:
        plain = (h for h in with_one if not _is_specific(_where(h)))
        best = next((h for h in plain if at_place[_where(h)] > (1 - _SURE) * probability), leading)
    observations, location = refinery.observations, _where(best)
    at = observations.of("efficiency") & observations.loaded[observations.row]
    shift, largest = _course(refinery, best), _course(refinery, leading)
    readings = np.flatnonzero(at)
    rows, watts = observations.row[readings], shift[readings]
    formula, explained = shortest_formula(observations.points.take(rows), watts)
    return Unexplained(
        location=_place(location, watts),
        rms_W=float(np.sqrt(np.mean(watts**2))),
        formula=formula,
        explained=explained,
        rows=rows,
        readings=readings,
        watts=watts,
        size=float(np.sqrt(largest @ refinery.solve(leading.fit, largest[None])[0])),
        probability=probability,
        at_place=at_place[location],
        onset=onset.read(shift) if onset is not None and is_onset(location) else None,
        sensor=sensor_error(sensor_steps(observations, refinery.known), location, shift),
        over_temperature=over_temperature(temperature_steps(observations, refinery.known), location, shift),
    )


def _where(hypothesis: Hypothesis) -> str:
    """The place of its leftover."""
    return "" if hypothesis.leftover is None else hypothesis.leftover.location


def _is_specific(location: str) -> bool:
    """Whether a leftover there says what it is, not only where."""
    return is_sensor(location) or is_over_temperature(location)


def _course(refinery: Refinery, hypothesis: Hypothesis) -> Array:
    """The most probable course (M,) of the leftover of a hypothesis that has one."""
    assert hypothesis.leftover is not None
    pulled = refinery.solved(hypothesis.fit, hypothesis.leftover)
    return refinery.geometry.leftovers.of(hypothesis.leftover, pulled)


def _place(location: str, watts: Array) -> str:
    """The place of a leftover; what is over time and stands still is only at the input."""
    still = float(np.std(watts)) < _STILL * float(np.sqrt(np.mean(watts**2)))
    return "input" if location == IN_TIME and still else location


def shortest_formula(points: Points, watts: Array) -> tuple[str, float]:
    """The sum of at most two simple terms that comes nearest to watts (n,), and the share of its square explained.

    Terms are chosen by the Bayesian information criterion (Schwarz, 1978).

    >>> p = Points(D1=np.linspace(0.5, 1, 30), D2=0.2, power_W=np.linspace(300, 900, 30) * np.tile([1, 2], 15))
    >>> shortest_formula(p, 3.0 * (p.power_W / 1000) ** 2)
    ('3 W * (P/kW)^2', 1.0)
    """
    values = {name: term(points) for name, term in _TERMS.items()}
    total = float(watts @ watts)
    if total == 0.0:
        return "0 W", 1.0
    best: tuple[float, tuple[str, ...], Array, float] | None = None
    for count in range(1, _MOST_TERMS + 1):
        for names in combinations(values, count):
            design = np.stack([values[n] for n in names], axis=1)
            factors = np.asarray(np.linalg.lstsq(design, watts, rcond=1e-9)[0], dtype=np.float64)
            missed = float(np.sum((watts - design @ factors) ** 2))
            criterion = watts.size * np.log(max(missed / total, 1e-12)) + count * np.log(watts.size)
            if best is None or criterion < best[0]:
                best = (float(criterion), names, factors, missed)
    assert best is not None
    _, names, factors, missed = best
    return _written(names, factors), round(1 - missed / total, 3)


def _written(names: Sequence[str], factors: Array) -> str:
    parts = [
        f"{factor:.3g} W" + ("" if name == "1" else f" * {name}")
        for name, factor in zip(names, factors, strict=True)
    ]
    return " + ".join(parts).replace("+ -", "- ")
