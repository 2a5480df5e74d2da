"""What a piece of work costs: wall time, which others on the machine lengthen, and its own processor time."""

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Cost:
    """Wall and processor seconds of a step."""

    wall_s: float
    cpu_s: float

    @property
    def use(self) -> float:
        """Processor use over all cores, per cent."""
        return 100 * self.cpu_s / self.wall_s / (os.cpu_count() or 1) if self.wall_s > 0 else math.nan


def timed(work: Callable[[], T]) -> tuple[T, Cost]:
    """What ``work`` returns, and what it cost this process."""
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    made = work()
    return made, Cost(time.perf_counter() - wall_s, time.process_time() - cpu_s)
