r"""The most that a calibrated model carries: how well that is known, and what measured rows show of it.

With g the bench's most over the model's, relative and less one, and :math:`\sigma` how well the model knows it, g is
normal. A row that ran at a power of 1 + a times the most that the model carries at its D1 and D2 shows that g is above
a: of the normal the part above the largest a is left.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr
from scipy.stats import truncnorm

from sim.model import Model
from sim.operating_points import Points
from sim.simulate import can_run, each_can_run, simulate

Array = NDArray[np.float64]

NOTHING = -1.0  # what no row at all shows
_SURE, _HARDLY = 2.0, 3.0  # standard deviations: what is relied upon to be carried, and what is worth a try
_KNOWN = 2e-3  # Assumption: relative: how well the simulator itself knows it
_COARSE = np.arange(0.5, 2.0, 2e-3)  # powers tried for the most, of the rated one
_FINE = np.arange(0.95, 1.05, 2e-4)  # and of what was found
_STRIDE = 15
_TIMES = 10  # the range of them is doubled or halved until it holds the most: up to a thousand times
_REACH = 0.02  # relative: rows with more to spare show nothing, and those without as much are beyond belief
_LADDER = ((2e-3, 21), (2e-4, 10))  # steps over twice that, and within one of them
_CLOSE = 0.01  # relative: warm parts carry less than cold ones by a few parts in a thousand
_BELIEVED = 3.0  # standard deviations: what would show more is a reading to be doubted, not the most


@dataclass(frozen=True, slots=True, kw_only=True)
class Most:
    """What is known of g: normal with ``sigma``, and above ``shown``."""

    sigma: float
    shown: float = NOTHING

    @classmethod
    def of(cls, sigma: float, above: Array) -> Self:
        """From what each row (N,) shows; what is beyond belief does not count."""
        believed = above[above <= _BELIEVED * sigma]
        return cls(sigma=sigma, shown=float(np.max(believed, initial=NOTHING)))

    @property
    def mean(self) -> float:
        """What g most likely is, on average."""
        return float(self._law.mean())

    @property
    def least(self) -> float:
        """What g surely is, by :data:`_SURE` standard deviations of a normal.

        >>> round(Most(sigma=0.002).least, 4), round(Most(sigma=0.002, shown=0.001).least, 4)
        (-0.004, 0.001)
        """
        return float(self._law.ppf(ndtr(-_SURE)))

    @property
    def greatest(self) -> float:
        """What g hardly is above, by :data:`_HARDLY` standard deviations of a normal."""
        return float(self._law.ppf(ndtr(_HARDLY)))

    @property
    def _law(self) -> truncnorm:
        return truncnorm(self.shown / self.sigma, np.inf, scale=self.sigma)


def most_sigma(models: Sequence[Model], widest: Callable[[Array], Points]) -> float:
    """Standard deviation of the most that the first of the models carries, relative, by the others.

    Each of these is one standard deviation aside along an axis of its own; ``widest`` makes points with the widest
    pulses from powers (K,) in W.
    """
    (about_W,) = _most_W(models[:1], _around_the_most_W(models[0], widest), widest)
    nominal_W, *most_W = _most_W(models, about_W * _FINE, widest)
    return float(np.hypot(np.linalg.norm(np.array(most_W) / nominal_W - 1), _KNOWN))


def _around_the_most_W(model: Model, widest: Callable[[Array], Points]) -> Array:
    """Powers of which the least is carried and the largest is not, about the rated one where that is among them."""
    tried_W = model.altered_converter().rated_power_W * _COARSE
    for _ in range(_TIMES):
        least, largest = np.asarray(can_run(model, widest(tried_W[[0, -1]])))
        if least and not largest:
            break
        tried_W = tried_W * (2.0 if least else 0.5)
    return tried_W


def _most_W(models: Sequence[Model], tried_W: Array, widest: Callable[[Array], Points]) -> Array:
    """The largest of the ascending powers tried that each model carries: roughly, then among those near it."""

    def last(tried_W: Array) -> NDArray[np.intp]:
        """Which of the powers is the last that each model carries, the first where it carries none."""
        carried = np.count_nonzero(each_can_run(models, widest(tried_W)), axis=1)
        return np.asarray(np.maximum(carried - 1, 0))

    rough = last(tried_W[::_STRIDE]) * _STRIDE
    near = tried_W[rough.min() : rough.max() + _STRIDE]
    return np.asarray(near[last(near)])


def carries(model: Model, points: Points) -> NDArray[np.bool_]:
    """Whether N points run with a model, (N,): as a simulation has it, with warm parts, where a quick look is close.

    What could carry more runs; only of the others it is asked.
    """
    runs = can_run(model, _with_more(points, _CLOSE))
    left = np.flatnonzero(~runs)
    close = left[can_run(model, points.take(left))] if left.size else left
    if close.size:
        runs[close] = simulate(model, points.take(close)).feasible
    return runs


def above_the_most(model: Model, ran: Points) -> Array:
    """By how much more power than a model carries there points ``ran``, relative, (K,) of those near the most.

    Infinite where the model does not run with :data:`_REACH` less either.
    """
    if not len(ran) or not (near := np.flatnonzero(~can_run(model, _with_more(ran, _REACH)))).size:
        return np.empty(0)
    ran, share, none = ran.take(near), np.full(near.size, -_REACH), np.zeros(near.size, dtype=bool)
    for step, steps in _LADDER:
        tried = share[:, None] + step * np.arange(steps)
        at = ran.take(np.repeat(np.arange(near.size), steps))
        carried = np.sum(carries(model, _with_more(at, tried.ravel())).reshape(tried.shape), axis=1)
        none |= carried == 0
        share = share + step * np.maximum(carried - 1, 0)
    return np.where(none, np.inf, 1.0 / (1.0 + share) - 1.0)


def _with_more(points: Points, share: Array | float) -> Points:
    return replace(points, power_W=points.power_W * (1 + share))
