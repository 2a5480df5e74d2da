"""How far the simulation's own laws may be off where every part is known: one sigma of every reading.

A conduction law is a line through a datasheet's curve, a switching energy a power law from another voltage and current,
a core loss a law from sines: each loss part is right to a share of itself, and a channel shows the parts behind it.
Beside that every channel has a little of its own. What it costs to close on the rest of a swing that is cut short
depends on capacitances at low voltage and on the last nanoseconds of the dead time: that is known less well than a soft
edge, or one that is hard all the way. What is smooth over (D1, D2, power) is told from what happens at edges, which
changes from soft to hard over a short way.
"""

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations
from sim.losses import missing_losses
from sim.modulation import EDGES
from sim.parameters import Converter
from sim.simulate import Result
from sim.station import IN_LINK

Array = NDArray[np.float64]

# Assumption: how well laws are known, by the last word of a part's name; the others are plain resistances or constants.
_LAWS = {"conduction": 0.01, "copper": 0.01, "core": 0.03, "switching": 0.05, "recovery": 0.05}
_AT_EDGES = ("switching", "recovery")
BRIDGES = ("primary", "secondary")
_PART_OF_IT = (0.01, 0.99)
# Assumption: of what closing on the rest of a swing costs; and of what the bridge switches, whose other switch opens at
# a current far below those of its datasheet
_THE_REST, _AT_SMALL_CURRENT = 0.5, 0.1


def inaccuracy(observations: Observations, near: Result, converter: Converter) -> Array:
    """One sigma of what is smooth, of what happens at edges, and at swings cut short, for every reading, (3, M).

    ``near`` is the baseline's simulation of the rows with readings, ``converter`` the one that it simulates.
    """
    row, cut_short = _rows(observations), _cut_short(near)
    own = np.array([channel.accuracy for channel in observations.channels])[observations.channel]
    squares = np.stack([own**2, np.zeros_like(own), np.zeros_like(own)])
    for part, law, at_edges in _parts(near):
        lost_W = np.nan_to_num(near[f"loss_{part}_W"])
        error_W = np.stack([law * lost_W, np.zeros_like(lost_W), np.zeros_like(lost_W)])
        if at_edges:
            error_W[1] = law * lost_W
            error_W[2] = _AT_SMALL_CURRENT * cut_short[part.partition("_")[0]] * lost_W
        for channel, per_W in _showing(part, converter).items():
            mask = observations.of(channel)
            squares[:, mask] += (per_W * error_W[:, row[mask]]) ** 2
    for edge, rest_W in zip(EDGES, _rest_W(near, converter), strict=True):
        for channel, per_W in _showing(edge, converter).items():
            mask = observations.of(channel)
            squares[2, mask] += (per_W * _THE_REST * rest_W[row[mask]]) ** 2
    return np.asarray(np.sqrt(squares))


def of_laws(observations: Observations, near: Result) -> Array:
    """One sigma of the input power by each loss part's law, zero for the other channels, (parts, M)."""
    row, at_input = _rows(observations), observations.of("efficiency")
    errors_W = [law * np.nan_to_num(near[f"loss_{part}_W"])[row] for part, law, _ in _parts(near)]
    return np.where(at_input, np.reshape(errors_W, (-1, row.size)), 0.0)


def _rows(observations: Observations) -> NDArray[np.intp]:
    """Which row of a simulation of the rows with readings each reading is of, (M,)."""
    return np.searchsorted(np.unique(observations.row), observations.row)


def _rest_W(near: Result, converter: Converter) -> Array:
    """What closing on the rest of a swing costs where an edge is neither soft nor hard all the way, (4, N)."""
    return np.where(_is_cut(_missing(near)), _closing_W(near, converter), 0.0)


def _closing_W(near: Result, converter: Converter) -> Array:
    """What closing on what is missing of each swing costs, all of a hard one, (4, N)."""
    at = near.points.with_voltages_of(converter)
    return missing_losses(converter, _missing(near), np.asarray(at.V1_V), np.asarray(at.V2_V))


def _missing(near: Result) -> Array:
    """The share of its swing that each edge misses, (4, N); 0 where nothing runs."""
    return np.nan_to_num([near[f"missing_{edge}"] for edge in EDGES])


def _is_cut(missing: Array) -> NDArray[np.bool_]:
    low, high = _PART_OF_IT
    return np.asarray((missing > low) & (missing < high))


def _cut_short(near: Result) -> dict[str, NDArray[np.bool_]]:
    """Where an edge of each bridge is switched neither softly nor hard all the way, (N,)."""
    cut = dict(zip(EDGES, _is_cut(_missing(near)), strict=True))
    return {
        bridge: np.any([at for edge, at in cut.items() if edge.startswith(bridge)], axis=0)
        for bridge in BRIDGES
    }


def loss_sigmas_W(near: Result, converter: Converter) -> tuple[Array, Array, Array, Array]:
    """One sigma of the input power in W at N points, by what may be wrong.

    All laws (N,); those of edges (N,); what each bridge switches, were one of its swings cut short (bridges, N);
    closing on the rest of each swing, or on all of it (edges, N).
    """
    parts = _parts(near)
    lost_W = {part: np.nan_to_num(near[f"loss_{part}_W"]) for part, _, _ in parts}
    none = np.zeros(np.shape(near["P1_W"]))
    of_edges = [part for part, _, at_edges in parts if at_edges]

    def together(errors_W: list[Array]) -> Array:
        return np.asarray(np.linalg.norm([none, *errors_W], axis=0))

    def at_edges(bridge: str) -> Array:
        return together([lost_W[part] for part in of_edges if part.startswith(bridge)])

    return (
        together([law * lost_W[part] for part, law, _ in parts]),
        together([law * lost_W[part] for part, law, at_edges in parts if at_edges]),
        np.stack([_AT_SMALL_CURRENT * at_edges(bridge) for bridge in BRIDGES]),
        _THE_REST * _closing_W(near, converter),
    )


def at_edges_W(near: Result) -> Array:
    """What all laws of edges make of N points together, (N,)."""
    return np.asarray(
        np.sum([near[f"loss_{part}_W"] for part, _, at_edges in _parts(near) if at_edges], axis=0)
    )


def _showing(part: str, converter: Converter) -> dict[str, float]:
    """The channels that a watt of a loss part, or of an edge, moves, and by how much: powers in front, and its heat."""
    behind = ["efficiency"]
    if not part.startswith("primary"):
        behind.append("P_link1_W")
        if part not in IN_LINK:
            behind.append("P_link2_W")
    return dict.fromkeys(behind, 1.0) | _warming(part, converter)


def _warming(part: str, converter: Converter) -> dict[str, float]:
    """The temperature that a watt of a loss part, or of an edge, moves, in K; none where no sensor is."""
    if part.startswith(BRIDGES):
        return {"T_heatsink_C": float(converter.heatsink_K_per_W)}
    for place, wound in (("inductor", converter.inductor), ("transformer", converter.transformer)):
        if part.startswith(place):
            return {f"T_{place}_C": float(wound.thermal_K_per_W)}
    return {}


def _parts(near: Result) -> list[tuple[str, float, bool]]:
    """Loss parts that follow a law, how well it is known, and whether it is one of edges."""
    names = [
        column.removeprefix("loss_").removesuffix("_W")
        for column in near.values
        if column.startswith("loss_")
    ]
    kinds = {name: name.rpartition("_")[2] for name in names}
    return [(name, _LAWS[kind], kind in _AT_EDGES) for name, kind in kinds.items() if kind in _LAWS]
