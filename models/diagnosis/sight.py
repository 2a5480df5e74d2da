r"""What these set points and channels can see at all, before any data: detectability, isolability, design's ties.

For an effect of one prior scale with signature s under the everyday covariance, :math:`d_i = \|s_i\|` in sigmas, and
:math:`d_{ij} = \|(I - P_j) s_i\|` is what another effect cannot imitate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.geometry import Projection
from models.diagnosis.refinery import Refinery

Array = NDArray[np.float64]

SEEN = 5.0  # sigmas


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """How well one effect is seen: the smallest distance from off that is five sigmas, and whom it ties with.

    ``parameter`` is what that is of; ``visible`` tells whether the size that deserves its name shows, ``searched``
    whether the smallest that does is one that is searched.
    """

    effect: str
    parameter: str
    smallest: float
    unit: str
    visible: bool
    searched: bool
    tied_with: tuple[str, ...]

    def as_plain(self) -> dict[str, object]:
        """For the JSON answer."""
        return {
            "effect": self.effect,
            "parameter": self.parameter,
            "smallest": self.smallest if np.isfinite(self.smallest) else None,
            "unit": self.unit,
            "visible": self.visible,
            "searched": self.searched,
            "tied_with": list(self.tied_with),
        }


def sight(refinery: Refinery) -> list[Sight]:
    """Every effect of the catalogue that takes part, its clearest setting where it has several."""
    clearest: dict[str, tuple[int, float]] = {}
    geometry, known = refinery.geometry, refinery.known
    scaled = np.stack([s.slope * s.entry.headline.prior for s in known.effects])
    seen = geometry.project(scaled, basis=False)
    own = [known.own_spreads(s.effect) for s in known.effects]
    alone = geometry.products_beside([seen.of([k]) for k in range(len(own))], own, [None])
    for k, (s, (products, _)) in enumerate(zip(known.effects, alone, strict=True)):
        length = float(np.sqrt(max(products[0, 0, 0], 0.0)))
        if s.effect not in clearest or length > clearest[s.effect][1]:
            clearest[s.effect] = (k, length)
    names = list(clearest)
    apart = _isolability(names, seen.of([k for k, _ in clearest.values()]), refinery)
    found = []
    for k, name in enumerate(names):
        first, length = clearest[name]
        head = known.effects[first].entry.headline
        tied = tuple(names[j] for j in range(len(names)) if j != k and apart[k, j] < SEEN <= length)
        smallest = SEEN * head.prior / length if length > 0 else np.inf
        found.append(
            Sight(
                effect=name,
                parameter=head.name,
                smallest=smallest,
                unit=head.unit,
                visible=bool(length >= SEEN),
                searched=bool(smallest <= max(head.upper - head.off, head.off - head.lower)),
                tied_with=tied,
            )
        )
    return found


def _isolability(names: list[str], seen: Projection, refinery: Refinery) -> Array:
    """Sigmas of each effect's shift that each other one cannot imitate, (E, E); its own spread is part of it.

    ``seen`` are the shifts.
    """
    geometry, known = refinery.geometry, refinery.known
    apart = np.empty((len(names), len(names)))
    own = [known.own_spreads(name) for name in names]
    for k, ((products,), _) in enumerate(geometry.products_beside([seen] * len(names), own, [None])):
        length2 = np.maximum(np.diag(products), 1e-300)
        apart[k] = np.sqrt(np.maximum(length2[k] - products[k] ** 2 / length2, 0.0))
    return apart
