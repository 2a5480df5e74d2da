"""How an experiment is run, and what it tells those who watch."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One moment of an experiment: how much is done, what was just done, seconds left where known."""

    done: int
    total: int
    said: str
    left_s: float | None = None


Watch = Callable[[Step], None]


def silent(_: Step) -> None:
    """Watch nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """``scale`` thins an experiment (1 is all of it), ``out`` is its folder, ``now`` a clock in seconds.

    So many ``processes`` work side by side, or instead of them the workers of a scheduler at the address ``dask``
    (``local``: a cluster of so many here). ``reference`` is a file of other people's points, for the experiment that
    compares with them; ``only`` names the parts to run, empty for all.
    """

    out: Path
    scale: float = 1.0
    processes: int = 2
    dask: str | None = None
    reference: Path | None = None
    only: tuple[str, ...] = ()
    watch: Watch = silent
    now: Callable[[], float] = time.perf_counter

    def __post_init__(self) -> None:
        if not 0 < self.scale <= 1:
            raise ValueError(f"scale is {self.scale}; it must be above 0 and at most 1")
        if self.processes < 1:
            raise ValueError(f"processes is {self.processes}; it must be at least 1")

    def thinned(self, count: int) -> int:
        """So many of ``count``, at least one.

        >>> Settings(out=Path("."), scale=0.1).thinned(6)
        1
        """
        return max(1, round(count * self.scale))


class Countdown:
    """Tells that it begins, counts what is done, tells the time left; what was there before sets no pace."""

    def __init__(self, total: int, settings: Settings, *, before: int = 0) -> None:
        self._total, self._done, self._before = total, before, before
        self._watch, self._now, self._start_s = settings.watch, settings.now, settings.now()
        kept = f", {before} kept from before" if before else ""
        self._watch(Step(done=before, total=total, said=f"begun{kept}"))

    def finished(self, said: str) -> None:
        """One more is done."""
        self._done += 1
        pace_s = (self._now() - self._start_s) / (self._done - self._before)
        left_s = pace_s * (self._total - self._done)
        self._watch(Step(done=self._done, total=self._total, said=said, left_s=left_s))
