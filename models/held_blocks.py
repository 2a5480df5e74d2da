"""Blocks of set points that are kept from every model, the same ones however many measurements there are.

The box of (D1, D2, power) is cut into cells, and a cell is held out or not by a hash of its number: nothing
has to be remembered, and a point measured later never changes the side of one measured before. So two models
trained at different times can be judged on rows that neither of them has seen.
"""

import hashlib

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from models.set_points import set_power

CELL = (0.1, 0.1, 0.125)  # of D1, D2 in half periods, of the rated power
_SHARE = 0.2
_ROUNDING = 1e-9  # 0.3 / 0.1 is less than 3: a round set point belongs to the cell above it
_SEED = 0  # of the hash: another one holds other cells out


def held_out(measured: pd.DataFrame, rated_W: float) -> NDArray[np.bool_]:
    """Whether each row of a measurement table (columns D1, D2, and P_set_W or P2_W) is in a held-out block, (N,).

    ``rated_W`` is the converter's power. The set power, where it is known, keeps repeated readings of one set point
    together.
    """
    power = set_power(measured, measured["P2_W"])
    place = np.stack([measured["D1"], measured["D2"], power / rated_W], axis=1).astype(np.float64)
    cells = np.floor(place / CELL + _ROUNDING).astype(int)
    distinct, member = np.unique(cells, axis=0, return_inverse=True)
    chosen = np.array([_share_of(tuple(cell)) < _SHARE for cell in distinct.tolist()], dtype=bool)
    return np.asarray(chosen[member.ravel()])


def _share_of(cell: tuple[int, ...]) -> float:
    """A number in [0, 1) that belongs to a cell."""
    digest = hashlib.sha256(repr((_SEED, *cell)).encode()).digest()
    return float(int.from_bytes(digest[:8], "big") / 2**64)
