"""Variants of one converter as one converter whose differing values are arrays."""

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from sim.parameters import Converter, ParameterError

FIXED = {"frequency_Hz", "junction_V", "grading", "alpha", "beta", "area_m2", "volume_m3", "turns",
          "turns_ratio", "V1_V", "V2_V", "rated_power_W", "part", "name", "saturation_A", "synchronous", "modulation",
          "tolerances"}  # fmt: skip


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
    for field in fields(first):
        values = [getattr(o, field.name) for o in objects]
        if is_dataclass(values[0]):
            changed[field.name] = _stack(values, repeats)
        elif any(v != values[0] for v in values[1:]):
            if field.name in FIXED:
                raise ParameterError(f"variants differ in {type(first).__name__}.{field.name}: {set(values)}")
            changed[field.name] = np.repeat(np.array(values, dtype=float), repeats)
    return replace(first, **changed)


def pick(parameters: Any, chosen: np.ndarray[Any, Any]) -> Any:
    """A stacked converter at some of its points."""
    changed = {}
    for field in fields(parameters):
        value = getattr(parameters, field.name)
        if is_dataclass(value):
            changed[field.name] = pick(value, chosen)
        elif isinstance(value, np.ndarray):
            changed[field.name] = value[chosen]
        elif isinstance(value, dict):
            changed[field.name] = {k: v[chosen] if isinstance(v, np.ndarray) else v for k, v in value.items()}
    return replace(parameters, **changed) if changed else parameters
