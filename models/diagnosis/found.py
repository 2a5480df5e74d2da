"""Runs the search, and once more without the rows that the leading cause brings close to the most they can carry."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

from models.diagnosis.hypotheses import Fit
from models.diagnosis.leftover import Leftovers
from models.diagnosis.noise import ChannelNoise, Replicates, estimate_noise, sigma_of
from models.diagnosis.onset import Onset, find_onset
from models.diagnosis.refinery import Refinery
from models.diagnosis.search import search
from models.diagnosis.setting import FirstSight, Setting, leftovers_of, set_up
from models.diagnosis.usable import Usable
from sim.model import Model

_LAGGING = (0.0, 0.2, 1.0)  # of the heat that lags behind on a slow bench: what is tried
_SLOW = 3.0  # in log likelihood, or log evidence: what says that parts do not settle
# in log evidence: what says that a condition which nobody read was another than the nominal one
_OFF_NOMINAL = 3.0
# in log evidence on tangents: a cause that seldom ends up behind another; all is searched then
_FAR_AHEAD = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Begun:
    """The readings that take part, their noise, and a first sight of them: what is known before all is weighed."""

    usable: Usable
    noise: list[ChannelNoise]
    sight: FirstSight

    @classmethod
    def of(cls, usable: Usable, baseline: Model) -> Self:
        """With heat that lags behind as far as replicates tell, and what they leave open all readings at first sight.

        More of it is taken where that is clearly likelier.
        """
        replicates = Replicates.of(usable.observations)
        shares = _LAGGING if usable.known.lags else _LAGGING[:1]
        tried = [_lagging(usable, share, replicates) for share in shares]
        least = max(each.log_likelihood for each in tried) - _SLOW
        first, *more = [each for each in tried if each.log_likelihood >= least]
        rivals = leftovers_of(usable.observations, baseline, usable.known)
        begun = cls.in_noise(first.distinct(), baseline, first.noise, rivals)
        for slower in (cls.in_noise(each.distinct(), baseline, each.noise, rivals) for each in more):
            if slower.sight.looked.log_evidence > begun.sight.looked.log_evidence + _SLOW:
                begun = slower
        return begun._doubting_conditions(baseline)

    def _doubting_conditions(self, baseline: Model) -> Self:
        """The same without taking for granted what nobody read, where all readings are clearly likelier so, or were.

        Efficiency alone knows no conditions: a voltage that is off does to it what large causes do that bend.
        """
        known = self.usable.known
        if not known.unread:
            return self
        wider = replace(self.usable, known=known.doubting_conditions())
        doubting = type(self).in_noise(wider, baseline, self.noise, self.sight.bench.rivals)
        likelier = doubting.sight.looked.log_evidence > self.sight.looked.log_evidence + _OFF_NOMINAL
        return doubting if likelier or self.usable.observations.found else self

    @classmethod
    def in_noise(cls, usable: Usable, baseline: Model, noise: list[ChannelNoise], rivals: Leftovers) -> Self:
        """The same in a noise that is known, beside what may be left over."""
        sight = FirstSight.of(usable.observations, baseline, usable.known, noise, rivals)
        return cls(usable=usable, noise=noise, sight=sight)

    def asking(self, onset: Onset) -> Self:
        """The same with a cause that is not there all the time among the leftovers."""
        return replace(self, sight=self.sight.asking(onset))

    @property
    def far_ahead(self) -> Fit | None:
        """The cause that leads all others by far, before anything is searched; None where there is none."""
        return leading_by_far(self.sight.tangents)

    def without_edge_of(self, fit: Fit, refinery: Refinery) -> "Begun | None":
        """The same of the rows that the causes of a fit leave power to spare; None where all are.

        Replicates tell the noise whether or not they have that power: two of them bend alike.
        """
        usable = self.usable.as_explained(refinery, fit)
        if usable is self.usable:
            return None
        o, baseline = usable.observations, refinery.baseline
        names = [channel.name for channel in o.channels]
        noise = [entry for entry in self.noise if entry.channel in names]
        return Begun.in_noise(usable, baseline, noise, leftovers_of(o, baseline, usable.known))


def leading_by_far(tangents: Sequence[Fit]) -> Fit | None:
    """The cause that is far likelier on its tangent than nothing and every other one; None where there is none."""
    first, *others = sorted(tangents, key=lambda fit: -fit.log_evidence)
    ahead = all(first.log_evidence > fit.log_evidence + _FAR_AHEAD for fit in others)
    return first if first.terms and ahead else None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Lagging:
    """Readings with some of the heat that lags behind, and their noise by replicates beside it."""

    usable: Usable
    noise: list[ChannelNoise]

    @property
    def log_likelihood(self) -> float:
        """Of all replicates together."""
        return sum(entry.log_likelihood for entry in self.noise)

    def distinct(self) -> Usable:
        """The readings, with the fewest directions of heat that lags behind."""
        known, sigma = self.usable.known, sigma_of(self.usable.observations, self.noise)
        return replace(self.usable, known=known.distinct(sigma))


def _lagging(usable: Usable, share: float, replicates: Replicates) -> _Lagging:
    """With such a share of what a slow bench has."""
    observations, known = usable.observations, usable.known.lagging(share)
    noise = estimate_noise(observations, replicates, observations.value - known.baseline, known.slow)
    return _Lagging(usable=replace(usable, known=known), noise=noise)


@dataclass(frozen=True, kw_only=True)
class Found:
    """What was begun, with the setting that all is weighed in, and all that fits there."""

    begun: Begun
    setting: Setting

    @classmethod
    def of(cls, begun: Begun) -> Self:
        """With all that is known before anything is searched."""
        return cls(begun=begun, setting=set_up(begun.sight))

    @cached_property
    def fits(self) -> list[Fit]:
        """What is found by a search."""
        return search(self.setting.refinery)

    @property
    def leading(self) -> Fit:
        """The most probable of the fits."""
        return max(self.fits, key=self.setting.refinery.log_probability)

    def onset(self) -> Onset | None:
        """The cause that is not there all the time, where one is decisively likelier than all that is."""
        sight, leading = self.begun.sight, self.leading
        nothing = Fit.nothing(leading.shift.size)
        fits = [nothing, leading] if leading.terms else [nothing]
        return find_onset(self.setting.refinery, fits, sight.as_replicated, sight.bench.rivals)


def find(usable: Usable, baseline: Model, progress: Callable[[str], None]) -> Found:
    """What is found in the rows that the explanation which leads in the end leaves power to spare.

    Where one cause is far ahead at first sight, its rows are left out at once: what is found with all of them is of no
    use then. If that cause does not lead in the end, it was not so.
    """
    progress("weighing the causes")
    begun = Begun.of(usable, baseline)
    first = _at_first_sight(begun) or Found.of(begun)
    kept = first.begun.without_edge_of(first.leading, first.setting.refinery)
    if kept is None:
        return first
    progress("weighing them again without the rows that the first explanation leaves no power to spare")
    return Found.of(kept)


def _at_first_sight(begun: Begun) -> Found | None:
    """What is found without the rows that the cause far ahead brings near the limit.

    None where it brings none there, where it does not lead afterwards, and with efficiency alone: how readings bend
    near the limit is then asked of a state that a search has found.
    """
    if begun.usable.observations.efficiency_alone or (ahead := begun.far_ahead) is None:
        return None
    if (kept := begun.without_edge_of(ahead, begun.sight.setting.refinery)) is None:
        return None
    found = Found.of(kept)
    return found if set(ahead.effects) <= set(found.leading.effects) else None
