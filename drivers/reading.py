"""What an instrument says: a number, its unit, when, and how far to trust it."""

from dataclasses import dataclass
from enum import StrEnum


class Quality(StrEnum):
    """How far a reading can be trusted; only ``GOOD`` may be stored as a value."""

    GOOD = "good"
    NO_DATA = "no_data"  # the instrument has none (NAN, or its sentinel)
    OVERRANGE = "overrange"  # above the range (INF, its sentinel, or a condition bit)
    STALE = "stale"  # the same update as the reading before


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One value with its unit, its time on the bench's clock in seconds, and its quality."""

    value: float
    unit: str
    time_s: float
    quality: Quality = Quality.GOOD

    @property
    def good(self) -> bool:
        """True when the value may be stored."""
        return self.quality is Quality.GOOD
