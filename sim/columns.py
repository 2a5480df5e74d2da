"""What is told of a steady state: its columns, and what must hold for them to be told."""

import numpy as np
from numpy.typing import NDArray

from sim.bridges import part_names
from sim.checks import HOTTEST_C
from sim.modulation import EDGES, centre_offset
from sim.operating_points import Points, efficiency
from sim.parameters import Converter
from sim.station import IN_LINK, OperatingState

Array = NDArray[np.float64]

FLAGS = 2 * len(EDGES)  # columns at the end that say how edges switch: they do not move along straight lines
_ZVS = 0.01  # a swing that misses less than this counts as zero-voltage switching
_COLUMNS = (
    "D0", "P1_W", "I1_A", "P2_W", "efficiency", "I_L_rms_A", "I_L_pp_A", "P_link1_W", "P_link2_W",
    "T_heatsink_C", "T_transformer_C", "T_inductor_C",
)  # fmt: skip


def columns_of(converter: Converter) -> tuple[str, ...]:
    """Names of what is told of a converter."""
    before, behind = part_names(converter)
    losses = (*before, *IN_LINK, *behind, "auxiliary", "input_cable", "output_cable", "added")
    edges = [f"{said}_{edge}" for said in ("missing", "zvs") for edge in EDGES]
    return (*_COLUMNS, *(f"loss_{part}_W" for part in losses), *edges)


def columns(converter: Converter, state: OperatingState, points: Points) -> Array:
    """Every column of N points in the order of :func:`columns_of`, (C, N)."""
    balance, t, missing = state.balance, state.temperatures, state.regulated.orbit.commutation.missing
    found = {
        "D0": state.regulated.phase - centre_offset(np.asarray(points.D1), np.asarray(points.D2)),
        "P1_W": balance.P1_W,
        "I1_A": balance.I1_A,
        "P2_W": balance.P2_W,
        "efficiency": efficiency(balance.P1_W, balance.P2_W),
        "I_L_rms_A": np.sqrt(state.current.square_A2),
        "I_L_pp_A": state.current.peak_to_peak_A,
        "P_link1_W": balance.P_link1_W,
        "P_link2_W": balance.P_link2_W,
        "T_heatsink_C": t.heatsink_C,
        "T_transformer_C": t.transformer_C,
        "T_inductor_C": t.inductor_C,
        "loss_added_W": np.zeros(len(points)),
    }
    found |= {f"loss_{part}_W": loss for part, loss in balance.losses.items()}
    found |= {f"missing_{edge}": missing[k] for k, edge in enumerate(EDGES)}
    found |= {f"zvs_{edge}": missing[k] < _ZVS for k, edge in enumerate(EDGES)}
    return np.stack([found[name] for name in columns_of(converter)]).astype(float, copy=False)


def impossible(state: OperatingState, columns: Array) -> NDArray[np.str_]:
    """Why a state with these columns (C, N) cannot be, "" where it can: a part too hot, numbers that are none."""
    by_place = state.temperatures.by_place()
    temperatures_C = np.stack(np.broadcast_arrays(*by_place.values()))
    names = [place.replace("_", " ") for place in by_place]
    why = np.full(columns.shape[1], "", dtype="U96")
    for k in np.flatnonzero(np.max(temperatures_C, axis=0) >= HOTTEST_C).tolist():
        hottest = names[int(np.argmax(temperatures_C[:, k]))]
        why[k] = f"the {hottest} would be hotter than {HOTTEST_C:.0f} degC"
    why[~np.all(np.isfinite(columns), axis=0)] = "no finite solution"
    return why
