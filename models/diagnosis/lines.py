"""Where a simulation starts from: along straight lines from the baseline, nearer than the baseline itself.

What the simulator solves for (currents, delays, phase, temperatures) moves with every spread and effect, and for small
ones in proportion. The signatures' simulations tell how; a hypothesis with many of them off starts where all together
lead to. What it starts from decides how soon it settles, not where.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
Key = tuple[str, tuple[tuple[str, float], ...]]


def key_of(effect: str, other: Mapping[str, float]) -> Key:
    """An effect with the values of its other parameters."""
    return effect, tuple(sorted(other.items()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Lines:
    """The unknowns (n, N) of N points at the baseline, and their slopes: (K, n, N) per sigma of the spreads, (n, N) per
    unit of each effect's headline value."""

    baseline: Array
    spreads: Array
    effects: dict[Key, Array]

    @classmethod
    def of(cls, baseline: Array, spreads: Array, effects: Mapping[Key, Array]) -> Self:
        """Without a slope where a variant was not solved."""
        return cls(
            baseline=baseline,
            spreads=np.nan_to_num(spreads),
            effects={key: np.nan_to_num(slope) for key, slope in effects.items()},
        )

    def take(self, chosen: Rows) -> Self:
        """Those of some of the points."""
        effects = {key: slope[:, chosen] for key, slope in self.effects.items()}
        return type(self)(
            baseline=self.baseline[:, chosen], spreads=self.spreads[:, :, chosen], effects=effects
        )

    def at(self, spreads: Array, effects: Sequence[tuple[Key, float]]) -> Array:
        """The unknowns (n, N) with spreads (K,) off by so many sigmas and effects at such distances from off."""
        there = self.baseline + np.tensordot(spreads, self.spreads, axes=1)
        for key, distance in effects:
            if key in self.effects:
                there = there + distance * self.effects[key]
        return np.asarray(there)
