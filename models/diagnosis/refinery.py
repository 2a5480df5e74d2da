"""Hypotheses are simulated at their values until they stand still: the simulator decides, not its tangent."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.geometry import Directions, Geometry, Projection
from models.diagnosis.hypotheses import Fit, Term, Weighed, log_prior, weigh
from models.diagnosis.law import Laws
from models.diagnosis.leftover import Leftover
from models.diagnosis.lines import Lines
from models.diagnosis.observations import Observations
from models.diagnosis.signatures import Signatures
from sim.model import Model
from sim.simulate import Result, answering
from sim.spread import shifted_together

Array = NDArray[np.float64]

_ROUNDS = 4
_BEHIND = 30.0  # in log evidence: further behind the best, simulation will not bring a candidate back
_LATE, _BEHIND_LATE = 1, 10.0  # rounds after which less has to do
_BEHIND_ALONE = 300.0  # of nothing
# of a value's standard deviation: a step that changes nothing, and one that gains an eighth in log evidence at most
STILL, ROUGHLY = 0.2, 0.5
# the same, of half a step that lost next to no evidence: what lies between gains an eighth
_WORTH_HALVING = 0.5
_LITTLE = 0.3  # in log evidence
_GAINED = 0.1  # in log evidence: what a step of the spreads alone has to bring
_REACH = 0.7  # prior scales that one step may go
_WITHIN = 3.0  # sigmas that a spread may take
_LEAST = 0.3  # of what a difference of parts does without the effect
_ASIDE = 0.1  # of the prior scale: from a fitted value to the one that tells its slope
_FAR_ENOUGH = 0.2  # standard deviations between two states that tell a slope


@dataclass(frozen=True, slots=True, kw_only=True)
class Refinery:
    """Simulates hypotheses at their fitted values and spreads, each starting from ``near`` along ``lines``.

    ``noise`` (M,) is how far each reading scatters by itself, one sigma, as the geometry has it.
    """

    known: Signatures
    observations: Observations
    baseline: Model
    geometry: Geometry
    noise: Array = field(default_factory=lambda: np.zeros(0))
    laws: Laws = field(default_factory=Laws.none)
    near: Result | None = None
    lines: Lines | None = None

    @property
    def residual(self) -> Array:
        """Readings less the baseline's prediction, (M,)."""
        return self.observations.value - self.known.baseline

    def log_prior(self, fit: Fit) -> float:
        """Log prior of a fit among the effects that take part."""
        return log_prior(fit, len({s.effect for s in self.known.effects}))

    def log_probability(self, fit: Fit) -> float:
        """Log evidence and log prior of a fit, against the constant that all fits share."""
        return fit.log_evidence + self.log_prior(fit)

    def law(self, fit: Fit) -> list[Directions]:
        """The directions in which a fit's laws may be wrong."""
        laws = (self.laws.directions(t.signature, t.distance) for t in fit.terms)
        return [law for law in laws if law is not None]

    def seen(self, fits: Sequence[Fit], *, basis: bool = True) -> list[Projection]:
        """The vectors of every fit and the columns of its laws, projected in one look at the readings."""
        return self.with_laws(fits, self.seen_bare(fits, basis=basis))

    def seen_bare(self, fits: Sequence[Fit], *, basis: bool = True) -> list[Projection]:
        """The same without laws; what fits share is looked at once."""
        if not fits:
            return []
        place: dict[int, int] = {}
        vectors, groups = list[Array](), list[list[int]]()
        for fit in fits:
            for own in (*(t.slope for t in fit.terms), fit.shift):
                if id(own) not in place:
                    place[id(own)] = len(vectors)
                    vectors.append(self.residual - own if own is fit.shift else own)
            groups.append([place[id(own)] for own in (*(t.slope for t in fit.terms), fit.shift)])
        seen = self.geometry.project(np.stack(vectors), basis=basis)
        return [seen.of(group) for group in groups]

    def with_laws(self, fits: Sequence[Fit], seen: Sequence[Projection]) -> list[Projection]:
        """Projections of fits' vectors with the columns of their laws."""
        self.laws.find(t.signature for fit in fits for t in fit.terms if t.distance)
        found = []
        for fit, own in zip(fits, seen, strict=True):
            law = self.law(fit)
            found.append(own.with_directions(fit.vectors(self.residual), law) if law else own)
        return found

    def solved(self, fit: Fit, leftover: Leftover | None = None) -> Array:
        """``C'^-1`` of what a fit leaves, (M,), under the covariance that it is weighed with."""
        return np.asarray(self.solve(fit, (self.residual - fit.shift)[None], leftover)[0])

    def solve(self, fit: Fit, right: Array, leftover: Leftover | None = None) -> Array:
        """The same of any vectors (k, M)."""
        bare = self.geometry.whitener.solve(right.T).T
        laws = self.law(fit)
        vectors = np.concatenate([right, *(d.factor * d.vectors for d in laws)])
        bare = np.concatenate([bare, *(d.factor * d.solved for d in laws)])
        solved = self.geometry.solve(vectors, fit.own(self.known), leftover, bare=bare)
        found, beside, law = solved[: len(right)], solved[len(right) :], vectors[len(right) :]
        if not len(law):
            return np.asarray(found)
        inner = np.eye(len(law)) + law @ beside.T
        return np.asarray(found - np.linalg.solve(inner, law @ found.T).T @ beside)

    def weighed(self, fit: Fit) -> Weighed:
        """The evidence of a fit as it stands."""
        return self.weighed_all([fit])[0]

    def weighed_all(self, fits: Sequence[Fit]) -> list[Weighed]:
        """The evidence of every fit as it stands, in one look at the readings."""
        seen, own = self.seen(fits, basis=False), [fit.own(self.known) for fit in fits]
        return [weighed.at(0) for weighed in weigh(fits, seen, self.geometry, own)] if fits else []

    def spreads(self, fit: Fit) -> Array:
        """The most probable state of the parts' everyday spreads under a fit, in sigmas, (K,)."""
        own, left, beside = fit.own(self.known), self.residual - fit.shift, self.law(fit)
        onto, between = self.geometry.spreads_solved @ left, self.geometry.between_spreads
        if beside:
            law = self.geometry.between(beside)
            on_law = np.concatenate([d.factor * (d.solved @ left) for d in beside])
            inner = np.eye(on_law.size) + law.each_other
            taken = np.linalg.solve(inner, np.column_stack([on_law, law.on_spreads.T]))
            onto, between = onto - law.on_spreads @ taken[:, 0], between - law.on_spreads @ taken[:, 1:]
        if own.size:
            inner = np.eye(own.size) - between[np.ix_(own, own)]
            onto = onto + between[:, own] @ np.linalg.lstsq(inner, onto[own], rcond=1e-9)[0]
        onto[own] = 0.0
        parts = self.known.modes.parts(onto[: len(self.known.modes)] / self.larger(fit))
        return np.clip(parts, -_WITHIN, _WITHIN)

    def larger(self, fit: Fit) -> Array:
        """How many times as far each axis of the parts moves readings beside the fit's effects, (K,).

        An effect that makes more of several parts makes more of how they differ.
        """
        factor = np.ones(len(self.known.modes))
        for t in fit.terms:
            apart = self.known.modes.differences(t.effect)
            factor[apart] = max(t.signature.entry.spread_at(t.value, 1.0), _LEAST)
        return factor

    def model(self, fit: Fit, spreads: Array) -> Model:
        """The baseline with these spreads and the fit's effects."""
        state = zip(self.known.modes.spreads, spreads.tolist(), strict=True)
        converter = shifted_together(self.baseline.converter, state)
        model = Model(converter=converter, effects=self.baseline.effects)
        for term in fit.terms:
            model = model.with_effect(term.effect, **term.signature.values(term.value))
        return model

    def simulated(self, fits: Sequence[Fit]) -> list[Fit]:
        """Every fit with its shift from the simulator, its evidence, and slopes that have learned from the way.

        Where the simulator has no answer the old shift stays.
        """
        states = [self._ahead(fit) for fit in fits]
        models = [self.model(fit, state) for fit, state in zip(fits, states, strict=True)]
        starts = [self._start(fit, state) for fit, state in zip(fits, states, strict=True)]
        solved, seen = self.observations.solved(models, self.near, starts), []
        for fit, state, start, (here, there) in zip(fits, states, starts, solved, strict=True):
            shift = here - self.known.moved(state, self.larger(fit)) - self.known.baseline
            bend = 0.0 if start is None else fit.bend + np.nan_to_num(there - start)
            shift = np.where(np.isfinite(shift), shift, fit.shift)
            seen.append(replace(fit, shift=shift, bend=bend, spreads=state, share=1.0))
        weighed = self.weighed_all(seen)
        return [replace(fit, log_evidence=w.log_evidence) for fit, w in zip(seen, weighed, strict=True)]

    def _ahead(self, fit: Fit) -> Array:
        """The spreads that a fit is simulated with: the most probable ones, or a part of the way there."""
        there = self.spreads(fit)
        return there if fit.share == 1.0 else fit.spreads + fit.share * (there - fit.spreads)

    def _start(self, fit: Fit, spreads: Array) -> Array | None:
        """Unknowns for a fit to start from, with these spreads."""
        if self.lines is None:
            return None
        effects = [(t.signature.key, t.distance) for t in fit.terms]
        return self.lines.at(spreads, effects) + fit.bend

    def near_to(self, fit: Fit) -> Self:
        """The same for hypotheses about a simulated fit: what is simulated responds as it does there."""
        state = np.asarray(fit.spreads)
        if self.near is None or not fit.terms or (unknowns := self._start(fit, state)) is None:
            return self
        return replace(self, near=answering(self.near, self.model(fit, state), unknowns))

    def sharpened(self, fits: Sequence[Fit]) -> list[Fit]:
        """The fits with slopes that are simulated at their values, all spreads as they are."""
        states = [self.spreads(fit) for fit in fits]
        aside = [
            [
                replace(fit, terms=(*fit.terms[:k], t.aside(_ASIDE), *fit.terms[k + 1 :]))
                for k, t in enumerate(fit.terms)
            ]
            for fit in fits
        ]
        cases = [
            (f, state) for fit, state, moved in zip(fits, states, aside, strict=True) for f in (fit, *moved)
        ]
        models, starts = [self.model(*case) for case in cases], [self._start(*case) for case in cases]
        seen = iter([here for here, _ in self.observations.solved(models, self.near, starts)])
        found = []
        for fit, moved in zip(fits, aside, strict=True):
            here = next(seen)
            terms = [
                t.with_slope((next(seen) - here) / (f.terms[k].value - t.value))
                for k, (t, f) in enumerate(zip(fit.terms, moved, strict=True))
            ]
            found.append(replace(fit, terms=tuple(terms)))
        weighed = self.weighed_all(found)
        return [replace(fit, log_evidence=w.log_evidence) for fit, w in zip(found, weighed, strict=True)]

    def followed(self, fits: Iterable[Fit], leader: float = -np.inf, still: float = ROUGHLY) -> list[Fit]:
        """Newton's steps from simulated fits, the best of each set, until all stand still, each to its best state.

        They do where a step would be no longer than ``still`` standard deviations of the values.

        What falls far behind the ``leader`` is left where it is. A step that loses evidence is halved from the
        best state seen, that of the spreads too: where edges pass each other the simulation is not smooth, and near
        the limit a part that is a sigma off bends readings. A fit without causes has steps of its spreads alone, and
        goes on as long as they gain.
        """
        best: dict[tuple[object, ...], Fit] = {}
        for fit in fits:
            best[fit.key] = max(best.get(fit.key, fit), fit, key=lambda f: f.log_evidence)
        ahead = self._onward(list(best.values()), leader, still)
        for turn in range(_ROUNDS):
            before = self.weighed_all([best[fit.key] for fit in ahead])
            if turn:
                behind = _BEHIND if turn == _LATE else _BEHIND_LATE
                kept = [_in_reach(best[f.key], w, leader, behind) for f, w in zip(ahead, before, strict=True)]
                ahead, before = list(compress(ahead, kept)), list(compress(before, kept))
            if not ahead:
                break
            going = []
            for aimed, fit, there in zip(ahead, self.simulated(ahead), before, strict=True):
                known = best[fit.key]
                fit = _taught(fit, known, aimed, there.sigma)
                if fit.log_evidence > known.log_evidence:
                    best[fit.key] = fit
                    gained = fit.log_evidence - known.log_evidence
                    going += self._onward([fit], leader, still) if fit.terms or gained > _GAINED else []
                else:
                    halved = 0.5 * (np.array([t.value for t in fit.terms]) - [t.value for t in known.terms])
                    little = known.log_evidence - fit.log_evidence < _LITTLE
                    least = max(still, _WORTH_HALVING) if little else still
                    if not fit.terms or np.any(np.abs(halved) > least * there.sigma):
                        half = replace(known, terms=_with_slopes(known, fit)).moved(halved)
                        going.append(replace(half, share=0.5 * aimed.share))
            leader, ahead = max([leader, *(f.log_evidence for f in best.values())]), going
        return list(best.values())

    def _onward(self, fits: list[Fit], leader: float, still: float) -> list[Fit]:
        """The fits that have a step to go, moved by it."""
        moved = []
        for fit, weighed in zip(fits, self.weighed_all(fits), strict=True):
            stands = bool(fit.terms) and bool(np.all(np.abs(weighed.step) <= still * weighed.sigma))
            if stands or not _in_reach(fit, weighed, leader, _BEHIND):
                continue
            reach = _REACH * np.array([t.head.prior for t in fit.terms])
            moved.append(fit.moved(np.clip(weighed.step, -reach, reach)))
        return moved


def _in_reach(fit: Fit, weighed: Weighed, leader: float, behind: float) -> bool:
    """Whether a fit may catch up with the leader: from near behind, or by what its slopes promise.

    Steps of the spreads alone bring tens at once.
    """
    if fit.log_evidence >= hopeless(leader, behind if fit.terms else _BEHIND_ALONE):
        return True
    return bool(fit.terms) and weighed.promised > leader


def hopeless(leader: float, behind: float = _BEHIND) -> float:
    """Evidence below which a candidate will not catch up with the leader."""
    return leader - behind if np.isfinite(leader) else -np.inf


def _with_slopes(fit: Fit, taught: Fit) -> tuple[Term, ...]:
    return tuple(replace(t, slope=new.slope) for t, new in zip(fit.terms, taught.terms, strict=True))


def _taught(fit: Fit, before: Fit, aimed: Fit, sigma: Array) -> Fit:
    """The fit with slopes that reproduce the way from ``before``: Broyden's update, steps counted in sigmas.

    The spreads went a part of the way, which is not the values' to learn; and over a sigma in all the simulation itself
    is not smooth, where edges pass each other.
    """
    way = np.array([new.value - old.value for new, old in zip(fit.terms, before.terms, strict=True)])
    scaled = way / np.maximum(sigma, 1e-300)
    length2 = float(scaled @ scaled)
    if length2 < _FAR_ENOUGH**2:
        return fit
    beside = np.asarray(fit.spreads - before.spreads)
    missed = (fit.shift - aimed.shift) / (length2 + float(np.sum(beside**2)) + 1.0)
    terms = tuple(
        t if t.signature.entry.threshold else replace(t, slope=t.slope + missed * (s / max(d, 1e-300)))
        for t, s, d in zip(fit.terms, scaled, sigma, strict=True)
    )
    return replace(fit, terms=terms)
