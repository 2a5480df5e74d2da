r"""From a fit to calibrated physics: the parts' state, the inductance by the readings at the edge, the leftover.

Readings close to the most that D1 and D2 can carry take no part in a diagnosis, since everything answers there at
once. The better all else is known, the more they say of where that edge is. After the fit the link inductance
is moved by

.. math:: \delta = \frac{s^T C^{-1} r}{s^T C^{-1} s + 1 / \sigma^2}

with r what the fitted simulator leaves of all readings of efficiency, s its change with the relative inductance, and C
the leftover's covariance. Rows so near the edge that this does not tell have run all the same, and show what is carried
(:mod:`models.most_carried`): the inductance is moved by what that makes of the most, on average.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.calibrated import PLAIN, CalibratedPhysics, Leftover
from models.diagnosis.covariance import length_scale
from models.diagnosis.hypotheses import Fit
from models.diagnosis.observations import Observations
from models.diagnosis.refinery import Refinery
from models.law_doubts import COLUMNS, law_doubts
from models.most_carried import Most, above_the_most
from models.set_points import set_power
from sim.effects.catalogue import effect
from sim.model import Model
from sim.operating_points import Points
from sim.simulate import Result

Array = NDArray[np.float64]

_IN_TIME = ("warm_up_drift", "ambient_drift")  # causes that go with time, by a law that is roughly known
_NAMED = (0.05, 0.2)  # how far off that law may be, of the loss; over which share of the campaign
_EVERYDAY = (effect("warm_up_drift").headline.tolerance, 1.0)  # what every bench creeps by, slowly
_SMOOTHER = 5 / 3  # than the laws: what a fit leaves is, over half of D1 and D2
_INDUCTANCE = 2e-3  # relative: how well the edge is known when all other readings are fitted
_ASIDE = 1e-3  # relative: from the inductance to those that tell its slope
_SMOOTH = 5e-4  # of the rated power: a reading's bend over them; where it bends more, an edge passes another
_AS_SET = 2e-3  # relative: a power that is read nearer than that to the one that was set is that one
_INPUT = 5e-4  # relative: how well the power, in units of the inductance, is known at a reading


@dataclass(frozen=True, slots=True, kw_only=True)
class _Readings:
    """Readings (N,) of the input power with load: ``place`` (N, 4) is where and when, ``value``, ``noise_W`` (N,).

    First come the ``loads`` among those that the fit has seen, then those near the ``edge``.
    """

    refinery: Refinery
    loads: NDArray[np.bool_]
    edge: Observations
    place: Array
    value: Array
    noise_W: Array

    @classmethod
    def of(cls, refinery: Refinery, sigma: Array, edge: Observations) -> "_Readings":
        """All that there are; near the edge a reading is as noisy, for its power, as anywhere."""
        seen = refinery.observations
        loads, edge = _loaded(seen), edge.take(_loaded(edge))
        kept, near = _where(seen)[loads], _where(edge)
        noise_W = sigma[loads]
        ratio = float(np.median(noise_W / kept[:, 2])) if noise_W.size else np.inf
        return cls(
            refinery=refinery,
            loads=loads,
            edge=edge,
            place=np.concatenate([kept, near]),
            value=np.concatenate([seen.value[loads], edge.value]),
            noise_W=np.concatenate([noise_W, ratio * near[:, 2]]),
        )

    def simulated(self, models: list[Model]) -> list["_Simulated"]:
        """What each model says of them."""
        seen = self.refinery.observations
        parts = [_simulated(seen.take(self.loads), models, self._near())]
        if self.edge.value.size:
            parts.append(_simulated(self.edge, models, None))
        return [_Simulated(model=model, parts=own) for model, *own in zip(models, *parts, strict=True)]

    def _near(self) -> Result | None:
        """Where models start from at readings with load."""
        seen, near = self.refinery.observations, self.refinery.near
        rows, chosen = np.unique(seen.row), np.unique(seen.row[self.loads])
        return None if near is None else near.take(np.searchsorted(rows, chosen))

    def beside(self, simulated: "_Simulated", chosen: NDArray[np.bool_], empty: Leftover) -> Leftover:
        """The leftover before the fit at some of them, beside a model that was simulated."""
        loss_W = simulated.value - self.place[:, 2]
        place = np.column_stack([self.place, loss_W, simulated.doubts()])[chosen]
        return replace(empty, place=place, noise_W=self.noise_W[chosen], weight=np.zeros(len(place)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Simulated:
    """A model's simulations of readings (N,), those near the edge by themselves: what it predicts, and all columns."""

    model: Model
    parts: list[tuple[Array, Result]]

    @property
    def value(self) -> Array:
        """What it says of each of them, (N,)."""
        return np.concatenate([value for value, _ in self.parts])

    def doubts(self) -> Array:
        """What its laws may be wrong by at each of them, (N, COLUMNS)."""
        return np.concatenate([law_doubts(result, self.model) for _, result in self.parts])


def _simulated(
    observations: Observations, models: list[Model], near: Result | None
) -> list[tuple[Array, Result]]:
    """What each model says of readings (N,), and its simulation at their rows."""
    _, row = np.unique(observations.row, return_inverse=True)
    return [
        (observations.predicted(result), result.take(row)) for result in observations.results(models, near)
    ]


def calibrate(refinery: Refinery, fit: Fit, sigma: Array, edge: Observations) -> CalibratedPhysics:
    """The calibrated physics of one fit: its effects, the spreads under it, and the leftover.

    ``sigma`` (M,) is the noise of the readings; ``edge`` holds readings that were too near the edge for the fit.

    The analyzer's gain and offset inside their specification go to the leftover: the surrogate predicts what
    the bench shows. Voltages and ambient are those of the campaign, its medians; time is its end.
    """
    observations = refinery.observations
    p = observations.points
    time_s = np.asarray(p.time_s, dtype=np.float64)
    drift, share = _NAMED if set(_IN_TIME) & set(fit.effects) else _EVERYDAY
    readings = _Readings.of(refinery, sigma, edge)
    empty = Leftover(
        place=np.empty((0, PLAIN + COLUMNS)),
        weight=np.empty(0),
        noise_W=np.empty(0),
        length=np.append(_SMOOTHER * length_scale(observations), max(share * float(np.ptp(time_s)), 1.0)),
        drift=drift,
        doubt=refinery.known.doubt,
    ).of(refinery.baseline.converter)
    model = refinery.model(fit, refinery.spreads(fit))
    off, readings, smooth = _by_slopes(model, readings, empty)
    physics = CalibratedPhysics(
        model=model,
        variants=tuple(_variants(refinery, fit)),
        leftover=empty,
        V1_V=float(np.median(np.asarray(p.V1_V))),
        V2_V=float(np.median(model.set_points(p).V2_V[observations.loaded])),  # type: ignore[index]
        ambient_C=float(np.median(np.asarray(p.ambient_C))),
        time_s=float(time_s.max()),
    )
    physics = _carrying(_with_inductance(physics, off), _ran(edge))
    return replace(physics, leftover=_leftover(physics.model, readings, smooth, empty))


def _by_slopes(
    model: Model, readings: _Readings, empty: Leftover
) -> tuple[float, _Readings, NDArray[np.bool_]]:
    """How far the inductance is off, and the readings, as noisy as its slope makes them, with those that are smooth."""
    here, *aside = readings.simulated([model, _moved(model, _ASIDE), _moved(model, -_ASIDE)])
    simulated, more, less = here.value, *(each.value for each in aside)
    slope, bend = (more - less) / (2 * _ASIDE), np.abs(more - 2 * simulated + less)
    smooth = bend < _SMOOTH * model.converter.rated_power_W  # NaN is not
    readings = replace(readings, noise_W=np.hypot(readings.noise_W, _INPUT * slope))
    solved = readings.beside(here, smooth, empty).solver()
    s, r = slope[smooth], (readings.value - simulated)[smooth]
    off = float(s @ solved(r) / (s @ solved(s) + _INDUCTANCE**-2)) if r.size else 0.0
    return off, readings, smooth


def _carrying(physics: CalibratedPhysics, ran: Points) -> CalibratedPhysics:
    """The same with an inductance that carries what points ``ran`` show to be carried."""
    above = above_the_most(physics.model, ran)
    if not above.size:
        return physics
    most = Most.of(physics.most.sigma, above)
    carrying = _with_inductance(physics, 1 / (1 + most.mean) - 1)
    return replace(carrying, shown=(1 + most.shown) / (1 + most.mean) - 1)


def _leftover(model: Model, readings: _Readings, smooth: NDArray[np.bool_], empty: Leftover) -> Leftover:
    """What is left of smooth readings beside a model."""
    (there,) = readings.simulated([model])
    left = readings.value - there.value
    usable = smooth & np.isfinite(left)
    prior = readings.beside(there, usable, empty)
    return prior.fitted(left[usable], prior.noise_W)


def _ran(edge: Observations) -> Points:
    """The points near the edge that ran under load, at the power that was set where that is what was read."""
    rows = np.unique(edge.row[_loaded(edge)])
    read = edge.frame["P2_W"]
    set_W = np.asarray(set_power(edge.frame, read), dtype=float)[rows]
    points = edge.points.take(rows)
    as_set = np.abs(set_W / points.power_W - 1) < _AS_SET
    return replace(points, power_W=np.where(as_set, set_W, points.power_W))


def _loaded(observations: Observations) -> NDArray[np.bool_]:
    return observations.of("efficiency") & observations.loaded[observations.row]


def _where(observations: Observations) -> Array:
    """D1, D2, power and time of every reading, (N, 4)."""
    p = observations.points
    return np.stack([p.D1, p.D2, p.power_W, p.time_s], axis=1)[observations.row]


def _with_inductance(physics: CalibratedPhysics, off: float) -> CalibratedPhysics:
    """The same physics, every model of it with another link inductance."""
    variants = tuple(_moved(variant, off) for variant in physics.variants)
    return replace(physics, model=_moved(physics.model, off), variants=variants)


def _moved(model: Model, off: float) -> Model:
    """The model with another link inductance, by a share of it."""
    inductor = model.converter.inductor
    other = replace(inductor, inductance_H=inductor.inductance_H * (1 + off))
    return replace(model, converter=replace(model.converter, inductor=other))


def _variants(refinery: Refinery, fit: Fit) -> Iterator[Model]:
    """The model at one standard deviation along each axis of what the measurements leave open."""
    known, own = refinery.known, fit.own(refinery.known)
    size, prior = len(known.modes), np.array([t.head.prior for t in fit.terms])
    directions = np.concatenate(
        [known.spreads[:size], *(p * t.slope[None] for p, t in zip(prior, fit.terms, strict=True))]
    )
    directions[own[own < size]] = 0.0
    inner = directions @ refinery.geometry.solve(directions, own).T
    across = inner[:, size:]  # the effects have no part in the covariance yet
    inner -= across @ np.linalg.solve(np.eye(prior.size) + across[size:], across.T)
    left = np.eye(len(inner)) - inner
    left[own[own < size]] = 0.0
    variance, axes = np.linalg.eigh(0.5 * (left + left.T))
    spreads = refinery.spreads(fit)
    for length, axis in zip(np.sqrt(np.maximum(variance, 0.0)), axes.T, strict=True):
        step = length * axis
        yield refinery.model(fit.moved(prior * step[size:]), spreads + known.modes.parts(step[:size]))
