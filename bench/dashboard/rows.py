"""Rows of a campaign as arrays, so that ten thousand of them are as quick to look at as ten."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bench.store import Row
from models.screening import LOADED_KINDS

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """Arrays (N,) in the order judged, or planned; what is missing is NaN. ``counted``: carries power, not rejected."""

    D1: Floats
    D2: Floats
    P_set_W: Floats
    P2_W: Floats
    efficiency: Floats
    predicted_efficiency: Floats
    u_efficiency: Floats
    counted: Bools

    @classmethod
    def of(cls, rows: Sequence[Row]) -> Self:
        """The rows of the store; a planned one has neither state nor measurements."""
        names = [field.name for field in fields(cls)][:-1]
        numbers = {
            name: np.array([np.nan if row.get(name) is None else row[name] for row in rows], dtype=np.float64)
            for name in names
        }
        counted = np.array(
            [row["kind"] in LOADED_KINDS and row.get("state") != "rejected" for row in rows], dtype=bool
        )
        return cls(**numbers, counted=counted)

    def __len__(self) -> int:
        return len(self.D1)

    def and_then(self, more: Self) -> Self:
        """These rows and more."""
        names = [field.name for field in fields(self)]
        joined = {name: np.concatenate([getattr(self, name), getattr(more, name)]) for name in names}
        return type(self)(**joined)

    def where(self, chosen: Bools) -> Self:
        """Some of the rows."""
        return type(self)(**{field.name: getattr(self, field.name)[chosen] for field in fields(self)})


NO_ROWS = Rows.of(())
