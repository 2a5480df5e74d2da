"""A verdict on what was found, with all that it rests on."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np

from models.diagnosis.agreement import Confirmed, confirmed
from models.diagnosis.evidence import BesideLeftovers, Hypothesis, posterior, with_laws_as_read
from models.diagnosis.found import Begun, Found
from models.diagnosis.gain import Readings, Worth
from models.diagnosis.onset import Onset
from models.diagnosis.setting import Setting
from models.diagnosis.strain import is_strained
from models.diagnosis.unexplained import Unexplained, unexplained
from models.diagnosis.verdict import Verdict, judge, telling_of

_CLIPPED = 3.0  # sigmas


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A verdict with what it rests on: what its causes are worth, what no cause explains, readings that miss alike."""

    begun: Begun
    setting: Setting
    hypotheses: list[Hypothesis]
    verdict: Verdict
    worth: Worth | None
    nameless: Unexplained | None
    alike: list[Confirmed]

    @property
    def leading(self) -> Hypothesis:
        """The most probable hypothesis that holds all that the verdict states."""
        return _leading(self.hypotheses, self.verdict)

    @classmethod
    def of(cls, found: Found, seed: int, onset: Onset | None = None) -> Self:
        """The verdict of what was found; causes that only doubted laws hold up are stated by none.

        The ``onset`` is the one that was asked about.
        """
        setting = found.setting.looked_again(found.fits)
        beside = with_laws_as_read(BesideLeftovers.of(setting.refinery, found.fits))
        refinery, hypotheses = beside.refinery, posterior(beside)
        setting = replace(setting, refinery=refinery)
        nameless = unexplained(hypotheses, refinery, onset)
        alike = confirmed(setting, hypotheses[0])
        judged = partial(
            judge,
            hypotheses,
            refinery.geometry.whitener,
            misfit=_misfit(setting, hypotheses),
            agreement=alike[0].sigma if alike else 0.0,
            leftover=0.0 if nameless is None else nameless.size,
        )
        verdict = judged()
        worth = _worth(setting, hypotheses, verdict, seed)
        if worth is not None and is_strained(refinery, found.fits, worth):
            verdict, worth = judged(strained=True), None
        if nameless is not None:
            verdict = telling_of(verdict, nameless)
        return cls(
            begun=found.begun,
            setting=setting,
            hypotheses=hypotheses,
            verdict=verdict,
            worth=worth,
            nameless=nameless,
            alike=alike,
        )


def judged_of(found: Found, seed: int, progress: Callable[[str], None]) -> Judged:
    """The verdict; once more beside a cause that seems not to be there all the time, if that explains most then."""
    judged, onset = Judged.of(found, seed), found.onset()
    if onset is None:
        return judged
    progress("weighing them again beside a cause that is not there all the time")
    again = Judged.of(Found.of(found.begun.asking(onset)), seed, onset)
    upheld = again.nameless is not None and again.nameless.likely and again.nameless.onset is not None
    return again if upheld else judged


def _leading(hypotheses: list[Hypothesis], verdict: Verdict) -> Hypothesis:
    """The most probable hypothesis that holds all that the verdict states."""
    return next((h for h in hypotheses if set(verdict.stated) <= set(h.fit.effects)), hypotheses[0])


def _worth(setting: Setting, hypotheses: list[Hypothesis], verdict: Verdict, seed: int) -> Worth | None:
    """What the gain of the stated causes is asked of, next to the best without any of them; None with no cause."""
    if not verdict.stated:
        return None
    wrong = (h.fit for h in hypotheses if h.fit.terms and set(verdict.stated).isdisjoint(h.fit.effects))
    readings = Readings(
        observations=setting.refinery.observations,
        residual=setting.refinery.residual,
        counts=~setting.outliers,
        covariance=setting.covariance,
        leftover=setting.leftover_everywhere(),
    )
    return Worth(
        readings=readings, cause=_leading(hypotheses, verdict).fit, rival=next(wrong, None), seed=seed
    )


def _misfit(setting: Setting, hypotheses: list[Hypothesis]) -> float:
    """Mean square in sigmas that the most probable hypothesis leaves where no leftover stands beside it.

    Each reading counts up to three sigmas: a threshold that is a little elsewhere leaves a few rows far off.
    """
    best = next(h.fit for h in hypotheses if h.leftover is None)
    sigmas = setting.sigma * setting.refinery.solved(best)
    return float(np.mean(np.minimum(sigmas**2, _CLIPPED**2)))
