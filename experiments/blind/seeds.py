"""Which seeds are whose: those that are scored were never looked at while a diagnosis was tuned.

Every row of the table has ten thousand seeds of its own in either range, the last one half of that; behind them is a
pool of designs (set points whose reach is computed once).
"""

from collections.abc import Iterator
from dataclasses import dataclass

ROWS = (
    "single", "pairs", "nothing", "foreign", "coverage", "tied", "extension", "efficiency_only", "surrogate", "sizes",
)  # fmt: skip
_A_ROW = 10_000
_DESIGNS_FROM = 95_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Seeds:
    """A range of 100,000 seeds; ``said`` tells what it is for."""

    first: int
    said: str

    def of(self, row: str) -> Iterator[int]:
        """The seeds of one row, in their order."""
        start = self.first + _A_ROW * ROWS.index(row)
        return iter(range(start, min(start + _A_ROW, self.first + _DESIGNS_FROM)))

    def design(self, number: int) -> int:
        """The seed of one of the pool's designs."""
        return self.first + _DESIGNS_FROM + number

    def __str__(self) -> str:
        return f"{self.said}: seeds {self.first} to {self.first + 99_999}"


TUNING = Seeds(first=100_000, said="tuning")
# 500,000 to 4,899,999, 4,930,000 to 4,939,999 and 5,000,000 to 5,099,999 were scored before: what they showed is known
SCORING = Seeds(first=5_100_000, said="scoring")
