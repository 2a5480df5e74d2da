"""What every parameter object asks of its values."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Quantity = float | NDArray[np.float64]
REFERENCE_C = 25.0
HOTTEST_C = 250.0  # beyond any part's rating; keeps an overloaded point's iteration finite


class ParameterError(ValueError):
    """A parameter outside what is physically possible; names the field, the value and the range."""


def check(owner: object, allowed: str, holds: Callable[[Any], NDArray[np.bool_] | bool], *names: str) -> None:
    for name in names:
        given = getattr(owner, name)
        if (
            isinstance(given, float) and math.isfinite(given) and holds(given)
        ):  # most are: no array is made for them
            continue
        value = np.asarray(given, dtype=float)
        if not (np.all(np.isfinite(value)) and np.all(holds(value))):
            raise ParameterError(f"{type(owner).__name__}.{name} is {value}; allowed: finite and {allowed}")


def positive(owner: object, *names: str) -> None:
    check(owner, "> 0", lambda x: x > 0, *names)


def not_negative(owner: object, *names: str) -> None:
    check(owner, ">= 0", lambda x: x >= 0, *names)
