"""Parameter spaces of any size: set points, voltages and circuit parameters as inputs of one simulation.

A space is a product of axes that is never written out: rows are made where they are asked for, so that a chunk of ten
million points costs what the chunk holds. An input is a column of set points (``D1``, ``D2``, ``P_set_W``), a condition
(``V1_V``, ``V2_V``, ``voltage_ratio``, ``ambient_C``) or a value of the converter by its dotted path, such as
``inductor.inductance_H``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.model import Model
from sim.operating_points import Points
from sim.parameters import Converter, ParameterError, leaves
from sim.side_by_side import shared_out, side_by_side
from sim.simulate import simulate
from sim.stacking import FIXED

Array = NDArray[np.float64]
Columns = dict[str, NDArray[Any]]

SET_POINT = ("D1", "D2", "P_set_W")
CONDITIONS = ("V1_V", "V2_V", "voltage_ratio", "ambient_C", "time_s")
_WORTH = 1000  # rows that are worth a process


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One input and its values, (K,)."""

    name: str
    values: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Space:
    """The product of axes, the last one running fastest."""

    axes: tuple[Axis, ...]

    def __len__(self) -> int:
        return math.prod(axis.values.size for axis in self.axes)

    def rows(self, start: int, stop: int) -> Columns:
        """Columns of the rows from ``start`` up to ``stop``.

        >>> space = Space(axes=(Axis(name="D1", values=np.array([0.5, 0.6])), Axis(name="D2", values=np.arange(3.0))))
        >>> {name: values.tolist() for name, values in space.rows(2, 5).items()}
        {'D1': [0.5, 0.6, 0.6], 'D2': [2.0, 0.0, 1.0]}
        """
        shape = tuple(axis.values.size for axis in self.axes)
        places = np.unravel_index(np.arange(start, min(stop, len(self))), shape)
        return {axis.name: axis.values[place] for axis, place in zip(self.axes, places, strict=True)}


def input_names(converter: Converter) -> tuple[str, ...]:
    """Every input that a space over this converter can have."""
    own = (
        path
        for path, value in leaves(converter).items()
        if isinstance(value, int | float) and path.rpartition(".")[2] not in FIXED
    )
    return (*SET_POINT, *CONDITIONS, *own)


def check_inputs(converter: Converter, columns: Mapping[str, NDArray[Any]]) -> None:
    """Refuse inputs that are unknown, missing, not finite or not possible.

    Raises
    ------
    ParameterError
        Which input, which value, what is allowed.
    """
    known = input_names(converter)
    for name in columns:
        if name not in known:
            near = get_close_matches(name, known, n=3)
            hint = f"did you mean {' or '.join(near)}?" if near else f"conditions are {', '.join(CONDITIONS)}"
            raise ParameterError(f"{name!r} is no input of {converter.name}; {hint}")
    missing = [name for name in SET_POINT if name not in columns]
    if missing:
        raise ParameterError(f"inputs are missing: {', '.join(missing)}")
    if "V2_V" in columns and "voltage_ratio" in columns:
        raise ParameterError("V2_V and voltage_ratio say the same; give one of the two")
    _placed(converter, columns)


def solve_rows(model: Model, columns: Mapping[str, NDArray[Any]], processes: int = 1) -> Columns:
    """The simulation table of rows with their inputs before it; ParameterError for what cannot be an input.

    Many rows are shared out to ``processes``, this one and forks of it.
    """
    size = columns["D1"].size
    parts = shared_out(size, max(1, min(processes, size // _WORTH)))
    if len(parts) == 1:
        return _solved(model, columns)
    solved = side_by_side(lambda rows: _solved(model, {k: v[rows] for k, v in columns.items()}), parts)
    order = np.argsort(np.concatenate(parts))
    return {name: np.concatenate([part[name] for part in solved])[order] for name in solved[0]}


def _solved(model: Model, columns: Mapping[str, NDArray[Any]]) -> Columns:
    converter, points = _placed(model.converter, columns)
    result = simulate(replace(model, converter=converter), points).columns()
    inputs = {name: values for name, values in columns.items() if name not in result}
    return inputs | result


def _placed(converter: Converter, columns: Mapping[str, NDArray[Any]]) -> tuple[Converter, Points]:
    """The converter with its values of every row, and the points."""
    circuit = {name: values for name, values in columns.items() if name not in (*SET_POINT, *CONDITIONS)}
    V1_V = columns.get("V1_V", np.asarray(converter.V1_V))
    V2_V = columns.get("V2_V", np.asarray(converter.V2_V))
    if "voltage_ratio" in columns:  # n V2 / V1
        V2_V = columns["voltage_ratio"] * V1_V / converter.transformer.turns_ratio
    points = Points(
        D1=columns["D1"], D2=columns["D2"], power_W=columns["P_set_W"], V1_V=V1_V, V2_V=V2_V,
        ambient_C=columns.get("ambient_C", np.asarray(25.0)), time_s=columns.get("time_s", np.asarray(0.0)),
    )  # fmt: skip
    return _with_values(converter, circuit), points


def _with_values(owner: Any, values: Mapping[str, Array]) -> Any:
    """A parameter object with some of its values, by dotted path, replaced."""
    changed: dict[str, Any] = {}
    for field in fields(owner):
        inside = {
            path.partition(".")[2]: v for path, v in values.items() if path.partition(".")[0] == field.name
        }
        if inside:
            held = getattr(owner, field.name)
            changed[field.name] = _with_values(held, inside) if is_dataclass(held) else inside[""]
    return replace(owner, **changed) if changed else owner
