"""How far the simulation's own laws may be off where every part is known: one sigma of every reading.

A conduction law is a line through a datasheet's curve, a switching energy a power law from another voltage and current,
a core loss a law from sines: each loss part is right to a share of itself, and a channel shows the parts behind it.
Beside that every channel has a little of its own. What a bridge loses where a swing is cut short depends on its
capacitances at low voltage and on the last nanoseconds of the dead time: that is known less well than a soft edge, or
one that is hard all the way. What is smooth over (D1, D2, power) is told from what happens at edges, which changes from
soft to hard over a short way.
"""

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations
from sim.modulation import EDGES
from sim.simulate import Result
from sim.station import IN_LINK

Array = NDArray[np.float64]

# Assumption: how well laws are known, by the last word of a part's name; the others are plain resistances or constants.
_LAWS = {"conduction": 0.01, "copper": 0.01, "core": 0.03, "switching": 0.05, "recovery": 0.05}
_AT_EDGES = ("switching", "recovery")
BRIDGES = ("primary", "secondary")
_CUT_SHORT, _PART_OF_IT = 0.3, (0.01, 0.99)  # Assumption: of the switching loss of a bridge with such an edge


def inaccuracy(observations: Observations, near: Result) -> Array:
    """One sigma of what is smooth, of what happens at edges, and at swings cut short, for every reading, (3, M).

    ``near`` is the baseline's simulation of the rows with readings.
    """
    row, cut_short = np.searchsorted(np.unique(observations.row), observations.row), _cut_short(near)
    own = np.array([channel.accuracy for channel in observations.channels])[observations.channel]
    squares = np.stack([own**2, np.zeros_like(own), np.zeros_like(own)])
    for part, law, at_edges in _parts(near):
        lost_W = np.nan_to_num(near[f"loss_{part}_W"])
        error_W = np.stack([law * lost_W, np.zeros_like(lost_W), np.zeros_like(lost_W)])
        if at_edges:
            error_W[1] = law * lost_W
            error_W[2] = _CUT_SHORT * cut_short[part.partition("_")[0]] * lost_W
        for channel in _showing(part):
            mask = observations.of(channel)
            squares[:, mask] += error_W[:, row[mask]] ** 2
    return np.asarray(np.sqrt(squares))


def _cut_short(near: Result) -> dict[str, NDArray[np.bool_]]:
    """Where an edge of each bridge is switched neither softly nor hard all the way, (N,)."""
    low, high = _PART_OF_IT
    cut = {edge: (near[f"missing_{edge}"] > low) & (near[f"missing_{edge}"] < high) for edge in EDGES}
    return {
        bridge: np.any([at for edge, at in cut.items() if edge.startswith(bridge)], axis=0)
        for bridge in BRIDGES
    }


def law_errors(near: Result) -> tuple[Array, Array, Array]:
    """One sigma of the input power in W: by all laws (N,), by those of edges (N,), by swings cut short (bridges, N)."""
    cut_short, parts = _cut_short(near), _parts(near)
    lost_W = {part: np.nan_to_num(near[f"loss_{part}_W"]) for part, _, _ in parts}
    none = np.zeros(np.shape(near["P1_W"]))
    of_edges = [part for part, _, at_edges in parts if at_edges]

    def together(errors_W: list[Array]) -> Array:
        return np.asarray(np.linalg.norm([none, *errors_W], axis=0))

    return (
        together([law * lost_W[part] for part, law, _ in parts]),
        together([law * lost_W[part] for part, law, at_edges in parts if at_edges]),
        np.stack([
            _CUT_SHORT * cut_short[bridge] * together([lost_W[p] for p in of_edges if p.startswith(bridge)])
            for bridge in BRIDGES
        ]),
    )  # fmt: skip


def _showing(part: str) -> tuple[str, ...]:
    """The channels of power that a loss part lies behind."""
    if part.startswith("primary"):
        return ("efficiency",)
    return ("efficiency", "P_link1_W") if part in IN_LINK else ("efficiency", "P_link1_W", "P_link2_W")


def _parts(near: Result) -> list[tuple[str, float, bool]]:
    """Loss parts that follow a law, how well it is known, and whether it is one of edges."""
    names = [
        column.removeprefix("loss_").removesuffix("_W")
        for column in near.values
        if column.startswith("loss_")
    ]
    kinds = {name: name.rpartition("_")[2] for name in names}
    return [(name, _LAWS[kind], kind in _AT_EDGES) for name, kind in kinds.items() if kind in _LAWS]
