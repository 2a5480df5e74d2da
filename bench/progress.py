"""What a running campaign tells those who watch: where it is, how far off the simulation is, time left."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bench.plan import Plan, PlannedPoint


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """One moment of a campaign; efficiencies are fractions.

    ``left_s`` is real time, for who waits: a virtual bench's clock may run fast. It and ``total`` are the most there
    may be where the plan grows: ``at_most``.
    """

    done: int
    total: int
    at_most: bool = False
    row: PlannedPoint | None = None
    said: str = ""
    measured: float | None = None
    predicted: float | None = None
    mean_residual: float | None = None  # running mean of measured - simulated efficiency
    left_s: float | None = None

    @property
    def residual(self) -> float | None:
        """Measured - simulated efficiency of the point just measured."""
        if self.measured is None or self.predicted is None:
            return None
        return self.measured - self.predicted


def silent(_: Progress) -> None:
    """Watch nothing."""


class Tracker:
    """Counts points and residuals, and reports them."""

    def __init__(
        self, plan: Plan, report: Callable[[Progress], None], real_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._total, self._grows = plan.most or len(plan.points), plan.most is not None
        self._report, self._real_s = report, real_s
        self._first_s: float | None = None
        self._before = 0  # rows that an earlier session has measured
        self._residuals: list[float] = []
        self.accepted = self.rejected = 0

    @property
    def done(self) -> int:
        """Rows measured so far."""
        return self.accepted + self.rejected

    def say(self, what: str) -> None:
        """Something other than a point."""
        self._report(self._now(said=what))

    def begin(self, row: PlannedPoint) -> None:
        """A point is about to be set."""
        if self._first_s is None:
            self._first_s, self._before = self._real_s(), self.done
        self._report(self._now(row=row, left_s=self._left_s()))

    def finish(
        self, row: PlannedPoint, reason: str | None, *, measured: float | None, predicted: float
    ) -> None:
        """A point was accepted, or rejected for ``reason``."""
        self.accepted += reason is None
        self.rejected += reason is not None
        known = measured is not None and predicted == predicted
        if known and reason is None and measured is not None:
            self._residuals.append(measured - predicted)
        self._report(
            self._now(
                row=row,
                said=f"rejected: {reason}" if reason else "accepted",
                measured=measured,
                predicted=predicted if known else None,
                mean_residual=sum(self._residuals) / len(self._residuals) if self._residuals else None,
                left_s=self._left_s(),
            )
        )

    def _now(self, **more: Any) -> Progress:
        return Progress(done=self.done, total=self._total, at_most=self._grows, **more)

    def _left_s(self) -> float | None:
        measured = self.done - self._before
        if not measured or self._first_s is None:
            return None
        return (self._real_s() - self._first_s) / measured * (self._total - self.done)
