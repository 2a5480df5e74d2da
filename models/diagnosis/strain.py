r"""Whether what explains efficiency alone strains the simulation: it takes laws off by all that is feared of them.

On most benches the simulation's laws are far better than feared, and readings of a cause of the catalogue show it
(:mod:`models.diagnosis.setting`). An effect that nobody has thought of can often be made of such causes, with laws that
are off as it takes. With D the readings, E the explanations without leftover and d the doubt about the simulation, a
share of what is feared, an explanation is sound where

.. math:: \ln p(D, E \mid d = 0.3) \ge \max_{d \in \{0.3, 1\}} \ln p(D \mid d) - 2 ,

or where E has 95 % with d = 0.3 and is led there by the causes that would be stated: what no leftover takes up is no
effect that nobody has thought of, and laws of this bench are off besides.
Where readings have shown that already there is nothing to ask, and beside other channels these tell causes apart.
A cause's own law may be off as well, in proportion to what the cause does: an explanation that predicts held-out
blocks to a few per cent of the gap, with everyday spreads fitted, is no made-up one.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from models.diagnosis.covariance import noiseless_covariance
from models.diagnosis.evidence import Hypothesis, log_total, weighed_with_leftovers
from models.diagnosis.gain import Worth
from models.diagnosis.geometry import Geometry
from models.diagnosis.hypotheses import Fit
from models.diagnosis.refinery import Refinery
from models.diagnosis.verdict import SURE
from models.diagnosis.whitener import Whitener

_SOUND = 0.3  # of what is feared: how far laws are off on most benches, as the readings of those show
_WORTH = 2.0  # in log evidence
_LEADING = 6  # hypotheses that are weighed
_MISSED = 0.05  # of the gap: more than the law of a cause misses on blocks that it was not fitted to


def is_strained(refinery: Refinery, fits: Sequence[Fit], worth: Worth) -> bool:
    """Whether readings of efficiency alone are explained only by laws that are off by all that is feared.

    ``worth`` is that of the causes that would be stated. One at the end of what is searched is made of something else,
    too: nothing tells how much further it would go.
    """
    if not refinery.observations.efficiency_alone:
        return False
    if any(term.at_bound and term.beyond_everyday for term in worth.cause.terms):
        return True
    if refinery.known.doubt <= _SOUND:
        return False
    return _only_by_laws(refinery, fits, worth.cause) and any(
        gain.calibrated > _MISSED * gain.before for gain in worth.gains()
    )


def _only_by_laws(refinery: Refinery, fits: Sequence[Fit], cause: Fit) -> bool:
    """Whether the readings are likelier with laws that are off as feared, or with a leftover, than without both.

    With laws that are off they may be, where with sound ones the ``cause`` leads as well and nothing is left over.
    """
    leading = sorted(fits, key=refinery.log_probability, reverse=True)[:_LEADING]
    feared, sound = (_under(refinery, share) for share in (refinery.known.doubt, _SOUND))
    at_worst, at_best = (weighed_with_leftovers(each, leading) for each in (feared, sound))
    log_best = _log_evidence(at_best, sound)
    whole = sum(h.probability for h in at_best if h.leftover is None)
    if whole >= SURE and at_best[0].fit.effects == cause.effects:
        return False
    log_whole = log_best + math.log(whole) if whole else -math.inf
    return log_whole < max(log_best, _log_evidence(at_worst, feared)) - _WORTH


def _under(refinery: Refinery, share: float) -> Refinery:
    """The same with the simulation's laws doubted by such a share, and causes' own as feared."""
    known = refinery.known.doubted(refinery.observations, share)
    noisy = noiseless_covariance(refinery.observations, known).noisier(refinery.noise**2)
    geometry = Geometry.of(Whitener.of(noisy), known.spreads, refinery.geometry.leftovers)
    return replace(refinery, known=known, geometry=geometry, laws=refinery.laws.in_geometry(geometry))


def _log_evidence(hypotheses: Sequence[Hypothesis], refinery: Refinery) -> float:
    """Log evidence of all hypotheses together, comparable between covariances."""
    return log_total(list(hypotheses), refinery) - 0.5 * refinery.geometry.whitener.log_determinant
