"""Operating points: what is set and demanded, as arrays."""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.parameters import ParameterError, Quantity

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """N operating points; every field is an array (N,) or a float for all.

    ``power_W`` is demanded at the output terminals; ``pwm`` false is standby (supply on, bridges off).
    ``time_s`` counts from the campaign's start; ``range_I1_A`` is the analyzer's input current range (0 where
    not known).
    """

    D1: Quantity
    D2: Quantity
    power_W: Quantity
    V1_V: Quantity = 300.0
    V2_V: Quantity = 140.0
    ambient_C: Quantity = 25.0
    time_s: Quantity = 0.0
    range_I1_A: Quantity = 0.0
    pwm: Quantity | NDArray[np.bool_] = True

    def __post_init__(self) -> None:
        arrays = np.broadcast_arrays(*(np.atleast_1d(getattr(self, f.name)) for f in fields(self)))
        for field, array in zip(fields(self), arrays, strict=True):
            kind = bool if field.name == "pwm" else float
            object.__setattr__(self, field.name, np.array(array, dtype=kind))
        for name in ("V1_V", "V2_V"):
            if not np.all(getattr(self, name) > 0):
                raise ParameterError(f"Points.{name} must be above 0 V everywhere")

    def __len__(self) -> int:
        return int(np.size(self.D1))

    def take(self, chosen: NDArray[np.intp]) -> Self:
        """Some of the points."""
        return type(self)(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})

    @classmethod
    def join(cls, parts: "list[Points]") -> "Points":
        """Points of several sets, one after the other."""
        return cls(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)})


def grid(
    shape: tuple[int, int, int] = (25, 25, 20), *, lowest_W: float = 200.0, highest_W: float = 2000.0
) -> Points:
    """The paper's grid over D1, D2 in [0, 1] and power, end points included.

    >>> len(grid())
    12500
    """
    D1, D2, power = np.meshgrid(
        np.linspace(0, 1, shape[0]),
        np.linspace(0, 1, shape[1]),
        np.linspace(lowest_W, highest_W, shape[2]),
        indexing="ij",
    )
    return Points(D1=D1.ravel(), D2=D2.ravel(), power_W=power.ravel())
