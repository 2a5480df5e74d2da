"""Variants of one converter as one converter whose differing values are arrays."""

from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim.parameters import Converter, ParameterError

T = TypeVar("T")

FIXED = {"frequency_Hz", "junction_V", "grading", "alpha", "beta", "area_m2", "volume_m3", "turns",
          "turns_ratio", "V1_V", "V2_V", "rated_power_W", "part", "name", "saturation_A", "synchronous", "modulation",
          "tolerances"}  # fmt: skip
_PLAIN = (float, str, bool, int)


def stack(converters: Sequence[Converter], repeats: int) -> Converter:
    """Each converter's values repeated for ``repeats`` points; values that all share stay floats.

    Raises
    ------
    ParameterError
        When the converters differ in something that one circuit cannot hold (a part, a frequency).
    """
    return _stack(list(converters), repeats)  # type: ignore[no-any-return]


def _stack(objects: list[Any], repeats: int) -> Any:
    first = objects[0]
    if all(other is first for other in objects):
        return first
    changed: dict[str, Any] = {}
    for name in _names(first):
        values = list(map(attrgetter(name), objects))
        if is_dataclass(values[0]):
            changed[name] = _stack(values, repeats)
        elif values.count(values[0]) < len(values):
            if name in FIXED:
                raise ParameterError(f"variants differ in {type(first).__name__}.{name}: {set(values)}")
            changed[name] = np.repeat(np.array(values, dtype=float), repeats)
    return _with(first, changed)


def _names(parameters: Any) -> Iterable[str]:
    """Names of a parameter object's fields, without asking for the fields themselves: that costs as much as to pick."""
    return parameters.__dataclass_fields__  # type: ignore[no-any-return]


def pick(parameters: T, chosen: np.ndarray[Any, Any]) -> T:
    """Stacked parameters at some of their points; a part without arrays is handed back as it is."""
    changed: dict[str, Any] = {}
    for name in _names(parameters):
        value = getattr(parameters, name)
        if isinstance(value, _PLAIN):  # most are
            continue
        if isinstance(value, np.ndarray):
            changed[name] = value[chosen]
        elif isinstance(value, dict):
            if any(isinstance(v, np.ndarray) for v in value.values()):
                changed[name] = {k: v[chosen] if isinstance(v, np.ndarray) else v for k, v in value.items()}
        elif is_dataclass(value) and (part := pick(value, chosen)) is not value:
            changed[name] = part
    return _with(parameters, changed) if changed else parameters


def own_rows(rows: NDArray[np.intp], *values: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """Of each point (last axis) the entries in its own rows (k, N) of arrays (m, N).

    That is ``np.take_along_axis``, which takes twice as long for each of several arrays.

    >>> rows = np.array([[0, 1]])
    >>> own_rows(rows, np.array([[1, 2], [3, 4]]))[0].tolist()
    [[1, 4]]
    """
    places = rows * rows.shape[-1] + np.arange(rows.shape[-1])
    return tuple(value.take(places) for value in values)


def put(whole: Any, rows: np.ndarray[Any, Any], part: Any) -> None:
    """Write the arrays of a part into those of the whole, whose points ``rows`` it has."""
    if is_dataclass(whole):
        for field in fields(whole):
            put(getattr(whole, field.name), rows, getattr(part, field.name))
    elif isinstance(whole, dict):
        for name, values in whole.items():
            put(values, rows, part[name])
    elif isinstance(whole, np.ndarray):
        whole[..., rows] = part


def _with(parameters: T, changed: dict[str, Any]) -> T:
    """A copy with other values; they stem from parameters that were checked, and are not checked again."""
    copy = object.__new__(type(parameters))
    for name in _names(parameters):
        object.__setattr__(copy, name, changed[name] if name in changed else getattr(parameters, name))
    return copy
