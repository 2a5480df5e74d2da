"""The circuit at its operating points, and the instants at which its bridges step."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.stacking import own_rows

Array = NDArray[np.float64]

_SHARED = ("curves", "bends_A")


@dataclass(frozen=True, slots=True, kw_only=True)
class Circuit:
    """What the solver needs of a converter at N operating points; arrays have shape (N,) unless told.

    ``forward``, ``reverse``, ``zero`` are the loop's drops (threshold in V, resistance in Ohm, shape (2, N))
    in the active state with the current along vp, against it, and in the zero state; ``secondary`` (3, 2, N) are those
    that depend on the secondary's state instead (current out of it along its voltage, against it, zero state), and
    ``eddy_s`` is tau. ``charge_C`` (4, N) moves each leg through its swing along the ``curve``-th of its ``curves``
    (4, G, 65), shared by all points. ``behind_Ohm`` is what of the resistances lies behind the magnetizing inductance,
    in every state. The inductance is ``relative_L`` (B, N) of that of a small current between the
    bends (B - 1,) of the flux, shared by all points; without bends it is that of a small current.
    """

    V1_V: Array
    nV2_V: Array
    turns_ratio: Array
    inductance_H: Array
    magnetizing_H: Array
    half_period_s: Array
    dead_time_s: Array
    forward: Array
    reverse: Array
    zero: Array
    charge_C: Array
    curves: Array
    curve: NDArray[np.intp]
    secondary: Array | None = None
    eddy_s: Array | float = 0.0
    behind_Ohm: Array | float = 0.0
    bends_A: Array = field(default_factory=lambda: np.zeros(0))
    relative_L: Array = field(default_factory=lambda: np.ones((1, 1)))

    @property
    def dead_share(self) -> Array:
        """The dead times in half periods, (N,)."""
        return self.dead_time_s / self.half_period_s

    def take(self, chosen: NDArray[np.intp]) -> Self:
        """The circuit at some of its points."""
        part = object.__new__(type(self))  # made of what was made: ten times as fast as replace()
        shared = _SHARED if self.bends_A.size else (*_SHARED, "relative_L")
        for name in self.__slots__:
            value = getattr(self, name)
            if isinstance(value, np.ndarray) and name not in shared:
                value = value.take(chosen, axis=-1)
            object.__setattr__(part, name, value)
        return part


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """The bridges' steps in a half period, in units of Th: four flips cut it into five stretches.

    ``place`` (4, N) is where each leg flips, ``jump_V`` (4, N) by how much its bridge's voltage (times n), ``rank``
    (4, N) how many flip before it; ``duration_s``, ``vp_V`` and ``nvs_V`` (5, N) are of the stretches.
    """

    place: Array
    jump_V: Array
    rank: NDArray[np.intp]
    duration_s: Array
    vp_V: Array
    nvs_V: Array

    @classmethod
    def of(cls, circuit: Circuit, flips: Array) -> "Steps":
        """From the positions (4, N) at which the square waves rise."""
        place, after = half_wave(flips)
        half = 0.5 * np.stack([circuit.V1_V, circuit.V1_V, circuit.nV2_V, circuit.nV2_V])
        rank = _rank(place)
        order = np.empty_like(rank)
        np.put_along_axis(order, rank, np.broadcast_to(np.arange(4)[:, None], rank.shape), axis=0)
        level = half * after
        jump = 2.0 * level
        ordered, places = own_rows(order, jump, place)
        of_secondary = order >= 2
        zero = np.zeros_like(place[:1])
        times = np.concatenate([zero, places, zero + 1.0])

        def staircase(first: Array, steps: Array) -> Array:
            return np.concatenate([-first[None], np.cumsum(steps, axis=0) - first])

        return cls(
            place=place,
            jump_V=jump,
            rank=rank,
            duration_s=np.diff(times, axis=0) * circuit.half_period_s,
            vp_V=staircase(level[0] + level[1], np.where(of_secondary, 0.0, ordered)),
            nvs_V=staircase(level[2] + level[3], np.where(of_secondary, ordered, 0.0)),
        )

    def stretch(self, k: int) -> tuple[Array, Array]:
        """Length (N,) of a stretch, and of what of it lies before the half period: its last one goes on in the next."""
        if k not in (0, 4):
            return self.duration_s[k], np.zeros_like(self.duration_s[k])
        before = self.duration_s[4] if k == 0 else np.zeros_like(self.duration_s[4])
        return self.duration_s[0] + self.duration_s[4], before

    def magnetizing(self, circuit: Circuit) -> tuple[Array, Array]:
        """Magnetizing current at the start of each stretch, and its slope there, (5, N)."""
        slope = self.nvs_V / circuit.magnetizing_H
        risen = np.cumsum(slope * self.duration_s, axis=0)
        return np.concatenate([np.zeros_like(risen[:1]), risen[:-1]]) - 0.5 * risen[-1], slope


def half_wave(positions: Array) -> tuple[Array, Array]:
    """Place in the half period, in [0, 1), of waves that rise at ``positions``, and their sign after it."""
    turn = np.floor(positions)
    return positions - turn, 1.0 - 2.0 * (turn - 2.0 * np.floor(0.5 * turn))


def _rank(place: Array) -> NDArray[np.intp]:
    """How many of four places (4, N) come before each; of equal ones the first does."""
    rank = np.zeros(place.shape, dtype=np.intp)
    for one in range(4):
        for other in range(one + 1, 4):
            later = place[one] > place[other]
            rank[one] += later
            rank[other] += ~later
    return rank


def lossless_start_A(circuit: Circuit, flips: Array) -> Array:
    """Start current (N,) of the orbit without drops: minus half of what the voltages add in a half period.

    A square wave of +-V that rises at place u of the half period and stays adds V (1 - 2u) Th.
    """
    place, after = half_wave(flips)
    mean = after * (1.0 - 2.0 * place)
    half_V = 0.5 * (circuit.V1_V * (mean[0] + mean[1]) - circuit.nV2_V * (mean[2] + mean[3]))
    return np.asarray(-0.5 * half_V * circuit.half_period_s / circuit.inductance_H)
