"""Quantities that thresholds are of, as they are simulated where nobody read them, and how far that may be off."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import CHANNELS
from sim.operating_points import Points

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

_NAMES = ("T_heatsink_C", "I1_A")
_COLUMNS = [channel.column for channel in CHANNELS]


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """By name the ``value`` of each quantity and one ``sigma`` of it, (N,)."""

    value: Mapping[str, Array] = field(default_factory=dict)
    sigma: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, points: Points, tables: Sequence[Array], usual: Sequence[float]) -> Self:
        """From tables (C, N) of all channels: the baseline's, then those of K variants, whose step counts so much."""
        base, *moved = (_quantities(table, points) for table in tables)
        apart = np.nan_to_num(np.stack(moved) - base) * np.array(usual)[:, None, None]
        sigma = np.sqrt(np.sum(apart**2, axis=0))
        return cls(value=dict(zip(_NAMES, base, strict=True)), sigma=dict(zip(_NAMES, sigma, strict=True)))

    def spread(self, rows: Rows, size: int) -> Self:
        """The same for ``size`` rows of a table, of which these are the ``rows`` (N,)."""

        def put(values: Array, elsewhere: float) -> Array:
            whole = np.full(size, elsewhere)
            whole[rows] = values
            return whole

        return type(self)(
            value={name: put(own, np.nan) for name, own in self.value.items()},
            sigma={name: put(own, 0.0) for name, own in self.sigma.items()},
        )


def _quantities(table: Array, points: Points) -> Array:
    """The heatsink's temperature and the input current of a table (C, N), (2, N)."""
    heatsink_C, P1_W = (table[_COLUMNS.index(name)] for name in ("T_heatsink_C", "P1_W"))
    return np.stack([heatsink_C, P1_W / np.asarray(points.V1_V)])
