"""What rows are made of: numbers that JSON knows, times in UTC, new ids."""

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import CursorResult


def finite(values: Mapping[str, float]) -> dict[str, float | None]:
    """JSON has no NaN and no infinity: a missing number is null.

    >>> finite({"D0": float("nan"), "P1_W": float("inf"), "V1_V": 300.0})
    {'D0': None, 'P1_W': None, 'V1_V': 300.0}
    """
    return {name: float(value) if math.isfinite(value) else None for name, value in values.items()}


def missing(value: object) -> bool:
    """None, or not a number."""
    return value is None or (isinstance(value, float) and math.isnan(value))


def new_id(result: CursorResult[Any]) -> int:
    """The key of the row just inserted."""
    key = result.inserted_primary_key
    assert key is not None, "every table here has a primary key"
    return int(key[0])


def utc() -> str:
    """Now, for people and for sorting."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
