"""Particle swarms over the unit square, for many independent problems (loads) at once.

PSO-SAVL, eqs. (6) to (9), with N particles and the best one g:

    d_i = mean distance of particle i to the others                                      (7)
    f   = (d_g - d_min) / (d_max - d_min), and 0 when all distances are equal            (6)
    VL  = X_max / (1 + (1/vl_min - 1) · exp(f · ln[(1/vl_max - 1) / (1/vl_min - 1)]))    (8), corrected
    V   = ω V' + c1 r1 (pb - X) + c2 r2 (gb - X)                                         (9)

Eq. (8) as printed exchanges vl_min and vl_max and runs from 0.20 to 0.54 instead of from 0.05 to 0.20;
``printed_limit`` keeps it for comparison. A velocity beyond ±VL is clamped to it when f >= 0.5 and redrawn
uniformly in ±VL otherwise; a coordinate that leaves the box is redrawn in it. ω falls linearly.

``share_every`` is beyond the paper: every so many iterations the two particles that found least are put where the
swarms of the neighbouring problems found most, for loads side by side have optima side by side. It costs nothing more.

Assumptions: the swarm starts on allowed points (up to ``START_DRAWS`` uniform draws each); an iteration is
one evaluation of every particle, so that 50 iterations of 10 particles are 500 evaluations per load.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from models.boosting import Floats

Bools = NDArray[np.bool_]
START_DRAWS = 50


class Problem(Protocol):
    """``count`` independent maximisations over the unit square."""

    @property
    def count(self) -> int:
        """How many problems there are."""
        ...

    def allowed(self, x: Floats) -> Bools:
        """Whether points (count, n, 2) may be used: (count, n)."""
        ...

    def value(self, x: Floats) -> Floats:
        """What to maximise at points (count, n, 2): (count, n), -inf where not allowed."""
        ...

    def one(self, number: int) -> Self:
        """Problem ``number`` alone."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Optimum:
    """Best points (count, 2), their values (count,) (-inf: none allowed was met), evaluations per problem."""

    x: Floats
    value: Floats
    evaluations: int


class Optimiser(Protocol):
    """A search with a name; the same seed gives the same answer."""

    @property
    def name(self) -> str:
        """What reports call it."""
        ...

    def maximise(self, problem: Problem, *, seed: int) -> Optimum:
        """Search all problems."""
        ...


VelocityLimit = Callable[[Floats], Floats]


def savl_limit(f: Floats, vl_min: float = 0.05, vl_max: float = 0.2) -> Floats:
    """Velocity limit over the state f in [0, 1], eq. (8) as meant: from vl_min to vl_max.

    >>> savl_limit(np.array([0.0, 1.0])).round(3).tolist()
    [0.05, 0.2]
    """
    wide, narrow = 1 / vl_max - 1, 1 / vl_min - 1
    return np.asarray(1 / (1 + narrow * np.exp(f * np.log(wide / narrow))), dtype=np.float64)


def printed_limit(f: Floats, vl_min: float = 0.05, vl_max: float = 0.2) -> Floats:
    """Eq. (8) as printed: vl_min and vl_max exchanged.

    >>> printed_limit(np.array([0.0, 1.0])).round(2).tolist()
    [0.2, 0.54]
    """
    wide, narrow = 1 / vl_max - 1, 1 / vl_min - 1
    return np.asarray(1 / (1 + wide * np.exp(f * np.log(wide / narrow))), dtype=np.float64)


def constant_limit(f: Floats) -> Floats:
    """Plain PSO: a velocity limit of 0.2 at any state."""
    return np.full_like(f, 0.2)


def evolutionary_state(x: Floats, best: NDArray[np.intp]) -> Floats:
    """State f (count,) of swarms x (count, N, 2) with best particles ``best`` (count,): eqs. (6), (7)."""
    apart = np.linalg.norm(x[:, :, None, :] - x[:, None, :, :], axis=-1)
    d = apart.sum(axis=2) / max(x.shape[1] - 1, 1)
    d_g = np.take_along_axis(d, best[:, None], axis=1)[:, 0]
    spread = np.ptp(d, axis=1)
    equal = spread <= 1e-12  # rounding of equal distances
    return np.where(equal, 0.0, (d_g - d.min(axis=1)) / np.where(equal, 1.0, spread))


@dataclass(frozen=True, slots=True, kw_only=True)
class ParticleSwarm:
    """A swarm at Table IV's settings; ``limit`` and ``redraw`` make it PSO-SAVL or plain PSO."""

    name: str
    limit: VelocityLimit
    redraw: bool
    particles: int = 10
    iterations: int = 50
    learning: float = 2.05
    inertia: tuple[float, float] = (0.9, 0.1)
    share_every: int | None = None

    def maximise(self, problem: Problem, *, seed: int) -> Optimum:
        """All problems move together: one evaluation call per iteration."""
        rng = np.random.default_rng(seed)
        x = _start(problem, self.particles, rng)
        v = rng.uniform(-1.0, 1.0, x.shape) * self.limit(np.ones(problem.count))[:, None, None]
        own, own_value = x.copy(), problem.value(x)
        for turn, inertia in enumerate(np.linspace(*self.inertia, self.iterations - 1)):
            best = own_value.argmax(axis=1)
            f = evolutionary_state(x, best)
            leader = np.take_along_axis(own, best[:, None, None], axis=1)
            r1, r2 = rng.random(x.shape), rng.random(x.shape)
            v = inertia * v + self.learning * (r1 * (own - x) + r2 * (leader - x))
            v = self._limited(v, f, rng)
            x = x + v
            x = np.where((x < 0) | (x > 1), rng.random(x.shape), x)
            if self.share_every is not None and turn % self.share_every == 0:
                _take_over(x, own_value, leader[:, 0])
            value = problem.value(x)
            better = value > own_value
            own, own_value = np.where(better[..., None], x, own), np.where(better, value, own_value)
        best = own_value.argmax(axis=1)
        rows = np.arange(problem.count)
        return Optimum(
            x=own[rows, best], value=own_value[rows, best], evaluations=self.particles * self.iterations
        )

    def _limited(self, v: Floats, f: Floats, rng: np.random.Generator) -> Floats:
        limit = np.broadcast_to(self.limit(f)[:, None, None], v.shape)
        fresh = rng.uniform(-1.0, 1.0, v.shape) * limit
        clamped = np.clip(v, -limit, limit)
        explore = (f < 0.5)[:, None, None] & self.redraw
        return np.where(np.abs(v) > limit, np.where(explore, fresh, clamped), v)


@dataclass(frozen=True, slots=True, kw_only=True)
class DifferentialEvolution:
    """SciPy's differential evolution, one problem after the other, at the swarm's number of evaluations."""

    name: str = "differential evolution"
    particles: int = 10
    iterations: int = 50

    def maximise(self, problem: Problem, *, seed: int) -> Optimum:
        """Each problem gets ``particles`` x ``iterations`` evaluations."""
        streams = np.random.default_rng(seed).spawn(problem.count)
        found = [self._one(problem.one(number), rng) for number, rng in enumerate(streams)]
        x = np.stack([point for point, _ in found])
        value = np.array([best for _, best in found])
        return Optimum(x=x, value=value, evaluations=self.particles * self.iterations)

    def _one(self, problem: Problem, rng: np.random.Generator) -> tuple[Floats, float]:
        def cost(columns: Floats) -> Floats:  # (2, n) -> (n,)
            value = problem.value(columns.T[None])[0]
            return np.where(np.isfinite(value), -value, 1e6)  # finite: SciPy averages the costs

        result = differential_evolution(
            cost,
            [(0.0, 1.0), (0.0, 1.0)],
            init=_start(problem, self.particles, rng)[0],
            maxiter=self.iterations - 1,
            tol=0.0,
            polish=False,
            vectorized=True,
            updating="deferred",
            rng=rng,
        )
        return result.x, float(-result.fun) if result.fun < 1e6 else -np.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Polished:
    """A search restarted a few times, then improved from the best points of all loads.

    Not in the paper. Swarms sit on a tree's plateaus, and neighbouring loads have neighbouring optima: so
    each round tries, for every load, what the other loads found, then a comb of points along D1 and along
    D2 through its best point, then a small pattern around it.
    """

    search: Optimiser
    restarts: int = 12
    rounds: int = 6
    comb: int = 128

    @property
    def name(self) -> str:
        """The search's name with ``+ polish``."""
        return f"{self.search.name} + polish"

    def maximise(self, problem: Problem, *, seed: int) -> Optimum:
        """Search ``restarts`` times, then improve for ``rounds`` rounds."""
        runs = [self.search.maximise(problem, seed=seed + run * 1_000_003) for run in range(self.restarts)]
        starts = np.concatenate([run.x for run in runs])  # of every load, offered to every load
        offered = np.broadcast_to(starts, (problem.count, *starts.shape))
        x, value = _better(problem, offered, runs[0].x, runs[0].value)
        evaluations = sum(run.evaluations for run in runs) + len(starts)
        rng = np.random.default_rng(seed)
        for number in range(self.rounds):
            moves = (self._comb(x, 0, rng), self._comb(x, 1, rng), self._pattern(x, 0.5 ** (number + 4)))
            for tried in (*moves, np.broadcast_to(x, (problem.count, *x.shape))):
                x, value = _better(problem, tried, x, value)
                evaluations += tried.shape[1]
        return Optimum(x=x, value=value, evaluations=evaluations)

    def _comb(self, x: Floats, axis: int, rng: np.random.Generator) -> Floats:
        """Evenly spaced points with one random shift along ``axis`` through each point of x (count, 2)."""
        tried = np.repeat(x[:, None, :], self.comb, axis=1)
        tried[:, :, axis] = (np.arange(self.comb) + rng.random((len(x), 1))) / self.comb
        return tried

    @staticmethod
    def _pattern(x: Floats, step: float) -> Floats:
        grid = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 2), axis=-1).reshape(-1, 2)
        return np.clip(x[:, None, :] + step / 3 * grid, 0.0, 1.0)


def _better(problem: Problem, tried: Floats, x: Floats, value: Floats) -> tuple[Floats, Floats]:
    """The best of ``tried`` (count, n, 2) where it beats x (count, 2) with its value (count,)."""
    tried_value = problem.value(tried)
    best = tried_value.argmax(axis=1)
    rows = np.arange(problem.count)
    better = tried_value[rows, best] > value
    return np.where(better[:, None], tried[rows, best], x), np.where(better, tried_value[rows, best], value)


def _take_over(x: Floats, own_value: Floats, leader: Floats) -> None:
    """Put the two worst particles of every problem where the leaders of its two neighbours are."""
    worst, rows = own_value.argsort(axis=1), np.arange(len(x))
    for place, neighbour in enumerate((rows - 1, rows + 1)):
        x[rows, worst[:, place]] = leader[np.clip(neighbour, 0, rows[-1])]


def _start(problem: Problem, particles: int, rng: np.random.Generator) -> Floats:
    """Uniform positions (count, particles, 2), redrawn while they are not allowed."""
    x = rng.random((problem.count, particles, 2))
    for _ in range(START_DRAWS):
        outside = ~problem.allowed(x)
        if not outside.any():
            break
        x = np.where(outside[..., None], rng.random(x.shape), x)
    return x


PSO_SAVL = ParticleSwarm(name="PSO-SAVL", limit=savl_limit, redraw=True)
PSO_SAVL_PRINTED = ParticleSwarm(name="PSO-SAVL, eq. (8) as printed", limit=printed_limit, redraw=True)
PSO_SAVL_POLISHED = Polished(search=PSO_SAVL)
PSO_SAVL_SHARED = ParticleSwarm(
    name="PSO-SAVL, leaders shared between loads", limit=savl_limit, redraw=True, share_every=5
)
PLAIN_PSO = ParticleSwarm(name="plain PSO", limit=constant_limit, redraw=False)
OPTIMISERS: tuple[Optimiser, ...] = (
    PSO_SAVL,
    PSO_SAVL_PRINTED,
    PSO_SAVL_SHARED,
    PLAIN_PSO,
    DifferentialEvolution(),
    PSO_SAVL_POLISHED,
)
