r"""Evidence: how well each hypothesis explains the residuals, against its own complexity.

A hypothesis is "nothing" or one effect, each without or with a smooth leftover. An effect's value has the prior
N(off, prior^2); with signature s the marginal likelihood is closed (Bishop, 2006, section 3.5.1): for residual r and
covariance C, with :math:`d^2 = s^T C^{-1} s` and :math:`b = s^T C^{-1} r`,

.. math:: \ln \frac{p(r | effect)}{p(r | nothing)} = \frac{b^2}{2 (d^2 + 1/\tau^2)} - \frac12 \ln(1 + \tau^2 d^2).

That screens the catalogue. Then every hypothesis, nothing included, is simulated at its fitted value and at the
most probable state of all everyday spreads under it, until it stands still (Gauss-Newton); its evidence is
Laplace's at that point.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.covariance import Covariances, Relieved, Whitener
from models.diagnosis.observations import Observations
from models.diagnosis.signatures import Signature, Signatures
from sim.effects.base import EffectParameter
from sim.model import Model
from sim.simulate import Result

Array = NDArray[np.float64]

AMPLITUDES_W = (0.5, 1.5, 5.0)  # of a leftover, where there is one
_CONSISTENT, _LEFTOVER = 0.5, 0.2  # prior probabilities
_LEADING = 8  # candidates that are followed to the end
_BEHIND = 30.0  # in log evidence: further behind the best, simulation will not bring a candidate back
_ROUNDS = 5
_SIGNIFICANT = 3.0  # standard deviations
_REACH = 3.0  # prior scales that a line is trusted over
_BENT = 4.0  # squared sigmas between a line and the simulation from which more starts are tried
_FAR = (-1.0, -0.4, 0.4, 1.0)  # of the prior scale: where they are
_GAINED = 0.3  # in log evidence
_STILL = 0.05  # of the value's standard deviation
_WITHIN = 3.0  # sigmas that a spread may take


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """One hypothesis fitted: nothing (``signature`` None) or an effect's value with its standard deviation.

    ``shift`` (M,) is what it adds to the baseline's prediction, beside the linear part of the spreads;
    ``slope`` (M,) its change per unit of the value; ``log_evidence`` counts against the bare baseline. ``own``
    (k, M) are the everyday spreads of the effect's own parameters, whose place its value takes.
    """

    signature: Signature | None
    value: float
    sigma: float
    log_evidence: float
    shift: Array
    slope: Array
    own: Array = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def effect(self) -> str:
        """The effect's name, or "nothing"."""
        return "nothing" if self.signature is None else self.signature.effect


@dataclass(frozen=True, slots=True, kw_only=True)
class Hypothesis:
    """A fit with or without leftover, and its posterior probability."""

    fit: Fit
    leftover_W: float
    probability: float


def _within(head: EffectParameter, value: float) -> float:
    return float(np.clip(value, head.lower, head.upper))


def _relieved(own: Array, whitener: Whitener) -> Whitener | Relieved:
    """The covariance under a hypothesis: without the everyday spread of the parameters that it explains."""
    return Relieved.of(whitener, own) if own.size else whitener


def _screened(signature: Signature, own: Array, residual: Array, whitener: Whitener) -> Fit:
    """The closed form for one signature; ``own`` (k, M) are the spreads of its own parameters."""
    head = signature.entry.headline
    under = _relieved(own, whitener)
    weighted = under.solve(signature.slope)
    d2, b = float(signature.slope @ weighted), float(weighted @ residual)
    precision = d2 + 1 / head.prior**2
    value = _within(head, head.off + float(np.clip(b / precision, -_REACH * head.prior, _REACH * head.prior)))
    changed = log_likelihood(residual, under) - log_likelihood(residual, whitener) if own.size else 0.0
    return Fit(
        signature=signature,
        value=value,
        sigma=float(1 / np.sqrt(precision)),
        log_evidence=0.5 * b**2 / precision - 0.5 * float(np.log1p(head.prior**2 * d2)) + changed,
        shift=signature.slope * (value - head.off),
        slope=signature.slope,
        own=own,
    )


def _laplace(fit: Fit, residual: Array, whitener: Whitener) -> tuple[Fit, float]:
    """The fit with Laplace's evidence at its shift, and the Gauss-Newton step of its value from there."""
    under = _relieved(fit.own, whitener)
    left = residual - fit.shift
    weighted = under.solve(np.stack([fit.slope, left], axis=1))
    bare = float(residual @ whitener.solve(residual)) + whitener.log_determinant
    misfit = float(left @ weighted[:, 1]) + under.log_determinant - bare
    if fit.signature is None:
        return replace(fit, log_evidence=-0.5 * misfit), 0.0
    head = fit.signature.entry.headline
    away = (fit.value - head.off) / head.prior
    precision = float(fit.slope @ weighted[:, 0]) + 1 / head.prior**2
    step = (float(fit.slope @ weighted[:, 1]) - away / head.prior) / precision
    gained = 0.5 * min(precision * step**2, 1.0)  # what a last, small step still gains
    evidence = -0.5 * (misfit + away**2) - 0.5 * float(np.log(head.prior**2 * precision)) + gained
    return replace(fit, sigma=float(1 / np.sqrt(precision)), log_evidence=evidence), step


@dataclass(frozen=True, slots=True, kw_only=True)
class Refinery:
    """Simulates hypotheses at their fitted values and spreads, each starting from ``near``."""

    known: Signatures
    observations: Observations
    baseline: Model
    whitener: Whitener
    near: Result | None = None

    @property
    def residual(self) -> Array:
        """Readings less the baseline's prediction, (M,)."""
        return self.observations.value - self.known.baseline

    def spreads(self, fit: Fit) -> Array:
        """The most probable state of the everyday spreads under a fit, in sigmas, (K,)."""
        under = _relieved(fit.own, self.whitener)
        all_of_them = self.known.spreads @ under.solve(self.residual - fit.shift)
        state = np.clip(all_of_them[: len(self.known.spread_entries)], -_WITHIN, _WITHIN)
        if fit.signature is not None:
            state[self.known.own_spreads(fit.effect)] = 0.0
        return np.asarray(state)

    def model(self, fit: Fit, spreads: Array, more: float = 0.0) -> Model:
        """The baseline with these spreads and the fit's effect, its value moved by ``more``."""
        converter = self.baseline.converter
        for entry, sigmas in zip(self.known.spread_entries, spreads, strict=True):
            converter = entry.shifted(converter, float(sigmas))
        model = Model(converter=converter, effects=self.baseline.effects)
        if fit.signature is None:
            return model
        return model.with_effect(fit.effect, **fit.signature.values(fit.value + more))

    def simulated(self, fits: list[Fit], *, slopes: bool) -> list[Fit]:
        """Every fit with its shift (and slope) from the simulator; where that has no answer, the old one stays."""
        models, steps, states = [], [], [self.spreads(fit) for fit in fits]
        for fit, state in zip(fits, states, strict=True):
            models.append(self.model(fit, state))
            steps.append(_beside(fit) if slopes else 0.0)
            if steps[-1] != 0.0:
                models.append(self.model(fit, state, steps[-1]))
        seen = iter(self.observations.simulate(models, self.near))
        moved = []
        for fit, step, state in zip(fits, steps, states, strict=True):
            linear = state @ self.known.spreads[: state.size]
            here = next(seen)
            shift = here - linear - self.known.baseline
            shift = np.where(np.isfinite(shift), shift, fit.shift)
            slope = (next(seen) - here) / step if step != 0.0 else fit.slope
            moved.append(replace(fit, shift=shift, slope=np.where(np.isfinite(slope), slope, fit.slope)))
        return moved

    def followed(self, fits: list[Fit]) -> list[Fit]:
        """Gauss-Newton until all stand still, each from its best state; what falls far behind is left there.

        A step that loses evidence is halved from the best state seen: where edges pass each other the simulation
        is not smooth.
        """
        best: dict[str, Fit] = {}
        for turn in range(_ROUNDS):
            ahead = []
            for fit, step in (
                _laplace(f, self.residual, self.whitener) for f in self.simulated(fits, slopes=True)
            ):
                known = best.get(fit.effect)
                if known is not None and fit.log_evidence < known.log_evidence:
                    ahead.append(_moved(known, 0.5 * (fit.value - known.value)))
                    continue
                best[fit.effect] = fit
                gained = np.inf if known is None else fit.log_evidence - known.log_evidence
                if (
                    abs(step) > _STILL * fit.sigma or gained > _GAINED
                ):  # the spreads settle too, even of nothing
                    ahead.append(_moved(fit, step))
            least = _hopeless(max(fit.log_evidence for fit in best.values())) if turn else -np.inf
            fits = [fit for fit in ahead if best[fit.effect].log_evidence >= least]
            if not fits:
                break
        return list(best.values())


def _hopeless(best: float) -> float:
    """Evidence below which a candidate will not catch up with the best."""
    return best - max(_BEHIND, 0.3 * abs(best))


def _significant(fit: Fit) -> bool:
    """Whether the value is off by more than its own uncertainty could be, everyday spread included."""
    if fit.signature is None:
        return False
    head = fit.signature.entry.headline
    return abs(fit.value - head.off) > _SIGNIFICANT * float(np.hypot(fit.sigma, head.tolerance))


def _beside(fit: Fit) -> float:
    """A step of the value for its slope; 0 where the effect has none or is not smooth."""
    if fit.signature is None or fit.signature.entry.threshold:
        return 0.0
    head = fit.signature.entry.headline
    step = 0.05 * max(abs(fit.value - head.off), head.tolerance, 0.02 * head.prior)
    return step if fit.value + step <= head.upper else -step


def _moved(fit: Fit, step: float) -> Fit:
    if fit.signature is None:
        return fit
    head = fit.signature.entry.headline
    value = _within(head, fit.value + float(np.clip(step, -0.7 * head.prior, 0.7 * head.prior)))
    return replace(fit, value=value, shift=fit.shift + fit.slope * (value - fit.value))


def _best_variants(fits: list[Fit]) -> list[Fit]:
    """One fit an effect: its best variant, with the evidence averaged over the variants tried."""
    found: dict[str, list[Fit]] = {}
    for fit in fits:
        found.setdefault(fit.effect, []).append(fit)
    best = []
    for variants in found.values():
        evidence = np.array([f.log_evidence for f in variants])
        mean = float(np.logaddexp.reduce(evidence) - np.log(evidence.size))
        best.append(replace(variants[int(np.argmax(evidence))], log_evidence=mean))
    return best


def _starts(line: Fit, curve: Fit, whitener: Whitener) -> list[Fit]:
    """More values to start from, for an effect whose simulated shift is not its line: Gauss-Newton may go astray."""
    assert line.signature is not None
    bend = curve.shift - line.shift
    if float(bend @ whitener.solve(bend)) < _BENT:
        return []
    head = line.signature.entry.headline
    values = {_within(head, head.off + far * head.prior) for far in _FAR}
    return [
        replace(line, value=v, shift=line.slope * (v - head.off)) for v in sorted(values) if v != head.off
    ]


def _best_starts(fits: list[Fit]) -> list[Fit]:
    """The best fit of each effect, best first."""
    best: dict[str, Fit] = {}
    for fit in sorted(fits, key=lambda f: -f.log_evidence):
        best.setdefault(fit.effect, fit)
    return list(best.values())


def fitted(refinery: Refinery) -> tuple[Fit, list[Fit]]:
    """Nothing, and every effect alone, best first.

    All are simulated once; those that lead, and those that are not nearly linear, to the end.
    """
    residual, whitener = refinery.residual, refinery.whitener
    still = np.zeros_like(residual)
    nothing = Fit(signature=None, value=0.0, sigma=0.0, log_evidence=0.0, shift=still, slope=still)
    (nothing,) = refinery.followed([nothing])
    known = refinery.known
    screened = [
        _screened(s, known.spreads[known.own_spreads(s.effect)], residual - nothing.shift, whitener)
        for s in known.effects
    ]
    best = _best_variants(screened)
    tried = refinery.simulated(best, slopes=False)
    starts = [
        start for line, curve in zip(best, tried, strict=True) for start in _starts(line, curve, whitener)
    ]
    if starts:
        tried += refinery.simulated(starts, slopes=False)
    once = _best_starts([_laplace(fit, residual, whitener)[0] for fit in tried])
    behind = _hopeless(once[0].log_evidence)
    bent = {start.effect for start in starts}
    near = {
        fit.effect
        for k, fit in enumerate(once)
        if fit.log_evidence > behind and (k < _LEADING or _significant(fit))
    }
    leading = [fit for fit in once if fit.effect in near | bent]
    rest = [fit for fit in once if fit.effect not in near | bent]
    return nothing, sorted([*refinery.followed(leading), *rest], key=lambda f: -f.log_evidence)


def log_likelihood(residual: Array, whitener: Whitener | Relieved) -> float:
    """Gaussian log likelihood of the residuals, up to the constant that all share."""
    return -0.5 * float(residual @ whitener.solve(residual)) - 0.5 * whitener.log_determinant


def posterior(refinery: Refinery, covariance: Covariances) -> list[Hypothesis]:
    """Every hypothesis with its probability, the most probable first."""
    nothing, effects = fitted(refinery)
    each = (1 - _CONSISTENT) / len(effects)
    weights: list[tuple[Fit, float, float]] = []
    for amplitude in (0.0, *AMPLITUDES_W):
        share = 1 - _LEFTOVER if amplitude == 0.0 else _LEFTOVER / len(AMPLITUDES_W)
        whitener = refinery.whitener if amplitude == 0.0 else Whitener.of(covariance.with_leftover(amplitude))
        base = log_likelihood(refinery.residual, whitener) + float(np.log(share))
        for fit, prior in [(nothing, _CONSISTENT), *((fit, each) for fit in effects)]:
            weighed = fit if amplitude == 0.0 else _laplace(fit, refinery.residual, whitener)[0]
            weights.append((weighed, amplitude, base + float(np.log(prior)) + weighed.log_evidence))
    log = np.array([w for _, _, w in weights])
    probability = np.exp(log - np.logaddexp.reduce(log))
    return [
        Hypothesis(fit=weights[k][0], leftover_W=weights[k][1], probability=float(probability[k]))
        for k in np.argsort(-probability)
    ]
