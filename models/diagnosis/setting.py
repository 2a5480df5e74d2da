"""Fits noise and doubt about the simulation to the readings: the covariance that all hypotheses are weighed in."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.covariance import noiseless_covariance
from models.diagnosis.evidence import NEGLIGIBLE, Hypothesis, log_total, weighed_with_leftovers
from models.diagnosis.geometry import Geometry
from models.diagnosis.hypotheses import Fit
from models.diagnosis.law import Laws, law_columns
from models.diagnosis.law_errors import law_errors
from models.diagnosis.leftover import Leftovers, SingleDirection, leftovers
from models.diagnosis.lone import FAR
from models.diagnosis.noise import (
    ChannelNoise,
    corrected,
    sigma_of,
    told_by_replicates,
    usual_noise,
    without_widening,
)
from models.diagnosis.observations import Observations
from models.diagnosis.onset import AMPLITUDE, PLACE, Onset
from models.diagnosis.over_temperature import temperature_steps
from models.diagnosis.refinery import Refinery
from models.diagnosis.search import on_tangents
from models.diagnosis.sensors import sensor_steps
from models.diagnosis.signatures import Signatures
from models.diagnosis.whitener import Covariance, Whitener
from sim.model import Model
from sim.size import size

Array = NDArray[np.float64]

_LOOKS = 6  # a reading far off pulls the explanation towards it: it takes a few looks to see it alone
_SETTLED = 0.1  # relative change of a standard deviation
_LEADING = 4  # effects that are weighed beside leftovers for it
_PROBES = 24  # random signs that estimate a trace to three per cent
_DRIFTS = 3.0  # times the usual noise of an instrument: replicates that scatter by more may drift
_ROUGH = 0.02  # of what the best explanation moves a reading by: no law is good to less, from one reading to the next
# Shares of what the simulation may be off, where the readings show that it is as good as that, and the log evidence
# that each asks for, or may lose: of the first it asks for more, since what is assumed is for any converter; the second
# is taken unless the readings speak against it. It is for efficiency alone, as is noise that settles anew: beside other
# channels both change hardly anything.
_NARROWER = ((0.3, 3.0), (0.1, -1.5))
_OTHERS_NARROWER = ((0.3, 3.0), (0.09, 3.0))  # of all other channels together
# Of what no law is good to from one reading to the next, with efficiency alone, unless the readings speak against it
_SMOOTHER = ((0.3, -2.0),)
_SEED = 0  # of the probes
_LEAST_FREE = 0.05  # of a channel's readings, left free by the explanation: less is within the probes' error


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Noise and covariance of the readings, the refinery that works with them, and the look that told the noise."""

    bench: "_Bench"
    looked: "_Settled"
    covariance: Covariance
    refinery: Refinery

    @property
    def sigma(self) -> Array:
        """The noise of every reading, (M,)."""
        return self.looked.sigma

    @property
    def usual(self) -> Array:
        """The same with no reading widened, (M,)."""
        return without_widening(self.bench.observations, self.looked.first, self.looked.sigma)

    @property
    def far_off(self) -> Array:
        """How many of the usual sigmas a reading lies from what explains the others, (M,)."""
        return self.looked.left / self.usual

    @property
    def outliers(self) -> NDArray[np.bool_]:
        """Which readings (M,) are so far off that they count for next to nothing."""
        return np.asarray(self.far_off > FAR)

    def leftover_everywhere(self) -> Array:
        """Directions (q, M) of the largest leftover that is thought possible in all channels."""
        known = self.refinery.geometry.leftovers
        widest = max(known.configurations, key=lambda c: (c.columns.size, c.amplitude))
        return np.asarray(widest.amplitude * known.basis[widest.columns])

    def looked_again(self, fits: Sequence[Fit]) -> "Setting":
        """The same in the noise that simulated ``fits`` leave: the tangents that told it leave more.

        With efficiency alone, where readings have narrowed the doubt about the simulation, which takes up noise as
        well, and where nothing needs a leftover beside it.
        """
        if not self.bench.observations.efficiency_alone or self.bench.known.doubt == 1.0:
            return self
        leading = sorted(fits, key=self.refinery.log_probability, reverse=True)[:_LEADING]
        found = self._in_noise(replace(self.looked, looks=0, still=False))
        while found.looked.looks < _LOOKS and not found.looked.still:
            look = _left_by(found, weighed_with_leftovers(found.refinery, leading))
            if not look.whole:
                return self
            found = found._in_noise(self.bench.after(found.looked, look))
        return found

    def _in_noise(self, looked: "_Settled") -> "Setting":
        """The same in another noise."""
        there = self.bench.setting(looked)
        geometry, laws = there.refinery.geometry, self.refinery.laws
        refinery = replace(
            self.refinery, geometry=geometry, noise=there.refinery.noise, laws=laws.in_geometry(geometry)
        )
        return replace(there, refinery=refinery)


def leftovers_of(observations: Observations, baseline: Model, known: Signatures) -> Leftovers:
    """All that may be left over: none of it asks how far heat lags behind, or conditions are doubted."""
    steps: list[SingleDirection] = [
        *sensor_steps(observations, known),
        *temperature_steps(observations, known),
    ]
    return leftovers(observations, known.per_watt, size("power", baseline.converter), steps)


@dataclass(frozen=True, kw_only=True)
class FirstSight:
    """One look at what the best tangent leaves, and every effect on its tangent in the setting that this tells of."""

    bench: "_Bench"
    looked: "_Settled"

    @classmethod
    def of(
        cls,
        observations: Observations,
        baseline: Model,
        known: Signatures,
        noise: list[ChannelNoise],
        rivals: Leftovers,
    ) -> Self:
        """With the noise of replicates to begin with, beside what may be left over."""
        noiseless = noiseless_covariance(observations, known)
        bench = _Bench(observations, baseline, known, noise, rivals, noiseless)
        return cls(bench=bench, looked=bench.settled(bench.begun(sigma_of(observations, noise)), looks=1))

    def asking(self, onset: Onset) -> "FirstSight":
        """The same with a cause that is not there all the time among the leftovers."""
        rivals = self.bench.rivals.and_also(PLACE, onset.columns, AMPLITUDE)
        bench = replace(self.bench, rivals=rivals)
        return FirstSight(bench=bench, looked=bench.settled(bench.begun(self.looked.first), looks=1))

    def as_replicated(self, shift: Array) -> Covariance:
        """The covariance in the noise of replicates, beside what moves the readings by a ``shift`` (M,)."""
        bench, doubt = self.bench, self.bench.rough * shift
        return bench.noiseless.noisier(self.looked.first**2 + doubt**2 + bench.known.input_sigma**2)

    @cached_property
    def setting(self) -> Setting:
        """The one that the look tells of."""
        return replace(self.bench, rivals=self.looked.rivals).setting(self.looked)

    @cached_property
    def tangents(self) -> list[Fit]:
        """Nothing, and every effect on its tangent."""
        return on_tangents(self.setting.refinery)

    def settled(self) -> "_Settled":
        """Further looks, until the noise stands still."""
        if self.looked.still:
            return self.looked
        return self.bench.settled(self.bench.after(self.looked, _look(self.setting, self.tangents)))


def set_up(sight: FirstSight) -> Setting:
    """The setting with the noise of replicates, corrected by what the best tangent leaves, from the first look on."""
    bench, best = sight.bench, sight.settled()
    observations, baseline, known = bench.observations, bench.baseline, bench.known
    if (steadier := _steadier(observations, bench.noise, best.first)) is not None:
        best = max(best, bench.settled(bench.begun(steadier)), key=lambda settled: settled.log_evidence)
    bench, best = _narrowed(bench, best)
    found = bench.setting(best)
    near, lines = known.start(observations, baseline)
    geometry = found.refinery.geometry
    errors = law_errors(observations, near, baseline.converter)
    columns = law_columns(known.effects, observations, known.state, errors, slow=known.is_slow)
    laws = Laws.of(columns, geometry)
    everyday = zip(known.effects, _everyday(known, geometry), strict=True)
    effects = tuple(replace(s, everyday=sigma) for s, sigma in everyday)
    known = replace(bench.known, effects=effects)
    return replace(found, refinery=replace(found.refinery, known=known, near=near, lines=lines, laws=laws))


def _everyday(known: Signatures, geometry: Geometry) -> list[float]:
    """One sigma of each value that is fitted where nothing but the effect's own parts are off, each for itself."""
    seen = geometry.project(np.stack([s.slope for s in known.effects]), basis=False)
    own = [known.own_spreads(s.effect) for s in known.effects]
    each = [geometry.with_spreads(seen.of([k]), spreads) for k, spreads in enumerate(own)]
    found = []
    for (products,), _ in geometry.products_beside(each, own, [None]):
        squared, *along = products[0]
        found.append(float(np.linalg.norm(along) / squared) if squared > 0.0 else 0.0)
    return found


def _narrowed(bench: "_Bench", best: "_Settled") -> tuple["_Bench", "_Settled"]:
    """The same with a simulation that is doubted less, as far as the readings are likelier so."""
    o = bench.observations

    def of_input(bench: _Bench, share: float) -> _Bench:
        return bench.knowing(bench.known.doubted(o, share))

    def of_others(bench: _Bench, share: float) -> _Bench:
        return bench.knowing(bench.known.doubted(o, bench.known.doubt, share))

    def from_reading_to_reading(bench: _Bench, share: float) -> _Bench:
        return replace(bench, rough=share * _ROUGH)

    if o.efficiency_alone:
        bench, best = bench.narrowed(best, of_input, _NARROWER, _LOOKS)
        return bench.narrowed(best, from_reading_to_reading, _SMOOTHER, _LOOKS)
    bench, best = bench.narrowed(best, of_input, _NARROWER[:1])
    return bench.narrowed(best, of_others, _OTHERS_NARROWER)


def _steadier(observations: Observations, noise: list[ChannelNoise], sigma: Array) -> Array | None:
    """The noise (M,) where replicates that scatter widely do so by a slow drift; None where none does."""
    scale = np.ones_like(sigma)
    for entry in noise:
        usual = usual_noise(entry.channel)
        if usual is not None and entry.sigma > _DRIFTS * usual:
            scale[observations.of(entry.channel)] = usual / entry.sigma
    return scale * sigma if np.any(scale < 1.0) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Settled:
    """Where the loop that fits the noise stands; all (M,): noise assumed at ``first`` and ``sigma`` now, the ``doubt``
    about the best explanation's law, and what that explanation has ``left``.

    ``told`` is what replicates tell of the first noise. ``log_evidence`` is that of all explanations together after so
    many ``looks``, ``whole`` whether the best needs no leftover, ``rivals`` the leftovers that further looks ask about,
    and ``still`` whether the loop has converged.
    """

    first: Array
    told: list[float]
    rivals: Leftovers
    sigma: Array
    doubt: Array
    left: Array
    looks: int = 0
    log_evidence: float = -np.inf
    whole: bool = False
    still: bool = False


@dataclass(frozen=True, slots=True)
class _Bench:
    """All that stays while the noise is looked for."""

    observations: Observations
    baseline: Model
    known: Signatures
    noise: list[ChannelNoise]
    rivals: Leftovers
    noiseless: Covariance
    rough: float = _ROUGH

    def knowing(self, known: Signatures) -> "_Bench":
        """The same with signatures that are doubted otherwise."""
        return replace(self, known=known, noiseless=noiseless_covariance(self.observations, known))

    def narrowed(
        self,
        best: _Settled,
        doubted: "Callable[[_Bench, float], _Bench]",
        steps: Sequence[tuple[float, float]],
        looks: int = 1,
    ) -> "tuple[_Bench, _Settled]":
        """With the doubt about the simulation reduced to the share of each of the ``steps`` in turn.

        It goes on while a step gains the log evidence beside it, or loses no more where that is negative, and leaves
        nothing over: where something is left, the simulation is not as good as that.
        """
        bench = self
        for share, worth in steps:
            narrower = doubted(bench, share)
            tried = narrower.settled(replace(best, rivals=bench.rivals, looks=0, still=False), looks)
            if not tried.whole or tried.log_evidence <= best.log_evidence + worth:
                break
            bench, best = narrower, tried
        return bench, best

    def setting(self, looked: _Settled) -> Setting:
        """The setting with the noise, and the doubt about what explains the readings, that a look has told."""
        variance = looked.sigma**2 + looked.doubt**2 + self.known.input_sigma**2
        parts = self.noiseless.noisier(variance)
        geometry = Geometry.of(Whitener.of(parts), self.known.spreads, self.rivals)
        refinery = Refinery(
            known=self.known, observations=self.observations, baseline=self.baseline,
            geometry=geometry, noise=np.sqrt(variance),
        )  # fmt: skip
        return Setting(bench=self, looked=looked, covariance=parts, refinery=refinery)

    def begun(self, first: Array) -> _Settled:
        """The ``first`` noise (M,), before any look."""
        return _Settled(
            first=first, told=told_by_replicates(self.observations, self.noise, first), rivals=self.rivals,
            sigma=first, doubt=np.zeros_like(first), left=np.zeros_like(first),
        )  # fmt: skip

    def settled(self, near: _Settled, looks: int = _LOOKS) -> _Settled:
        """Looks at what the best explanation leaves until the noise stands still, ``looks`` in all at most."""
        while near.looks < looks and not near.still:
            setting = replace(self, rivals=near.rivals).setting(near)
            near = self.after(near, _look(setting, on_tangents(setting.refinery)))
        return near

    def after(self, near: _Settled, look: "_Look") -> _Settled:
        """The noise after one look more."""
        left = look.left * near.sigma / near.first
        sigma = corrected(self.observations, self.noise, near.told, near.first, left)
        doubt = self.rough * np.abs(look.explained)
        changed = np.hypot(sigma, doubt) / np.hypot(near.sigma, near.doubt)
        # what was negligible does not come back with a little more noise
        rivals = near.rivals.among(look.leftovers) if look.whole else near.rivals
        return replace(
            near, rivals=rivals, sigma=sigma, doubt=doubt, left=np.abs(look.left) * near.sigma, looks=near.looks + 1,
            log_evidence=look.log_evidence, whole=look.whole, still=bool(np.all(np.abs(np.log(changed)) < _SETTLED)),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class _Look:
    """The best explanation, (M,): the cause with the leftover beside it; and how good all are together.

    ``left`` (M,) is what it leaves of every reading, in sigmas as if that one had not been fitted; it is ``whole``
    without leftover. ``leftovers`` are those that are not negligible.
    """

    explained: Array
    left: Array
    log_evidence: float
    whole: bool
    leftovers: frozenset[tuple[str, float]]


def _look(setting: Setting, tangents: Sequence[Fit]) -> _Look:
    """At what the best tangent leaves; nothing comes first of them."""
    nothing, *tangents = tangents
    leading = sorted(tangents, key=lambda fit: -fit.log_evidence)[:_LEADING]
    return _left_by(setting, weighed_with_leftovers(setting.refinery, [nothing, *leading]))


def _left_by(setting: Setting, weighed: Sequence[Hypothesis]) -> _Look:
    """At what the first of some hypotheses leaves."""
    refinery, geometry, best = setting.refinery, setting.refinery.geometry, weighed[0]
    own = best.fit.own(refinery.known)
    signs = np.random.default_rng(_SEED).choice([-1.0, 1.0], (_PROBES, setting.sigma.size))
    vectors = np.concatenate([(refinery.residual - best.fit.shift)[None], signs * setting.sigma])
    pulled = geometry.solve(vectors, own, best.leftover)
    explained = best.fit.shift
    if best.leftover is not None:
        explained = explained + geometry.leftovers.of(best.leftover, pulled[0])
    solved = setting.sigma * pulled
    free = np.mean(signs * solved[1:], axis=0)  # of each reading: the share that was not absorbed, roughly
    channel = refinery.observations.channel
    share = np.array([np.mean(free[channel == k]) for k in range(int(channel.max()) + 1)])[channel]
    return _Look(
        explained=explained,
        left=solved[0] / np.sqrt(np.maximum(share, _LEAST_FREE)),
        log_evidence=log_total(weighed, refinery) - 0.5 * geometry.whitener.log_determinant,
        whole=best.leftover is None,
        leftovers=frozenset(
            h.leftover.key for h in weighed if h.leftover is not None and h.probability > NEGLIGIBLE
        ),
    )
