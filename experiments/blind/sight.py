"""What can be seen of something that is hidden: whitened directions, and what no effect of theirs imitates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import orth

Array = NDArray[np.float64]

LEAST_SIGMA = 5.0
_ROUNDING = 1e-9  # of the longest direction of a plane: a shorter one is none


def beyond(plane: Array, columns: Array) -> Array:
    """What is left of columns (M, K) without all that is in a plane (M, P), whose columns may be none, or alike."""
    q = orth(plane, rcond=_ROUNDING) if plane.size else plane
    return np.asarray(columns - q @ (q.T @ columns))


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """Whitened directions: a shift (M,), what the lab's own parts do beside it (M,), effects' planes (M, 2+) by name.

    ``each`` (M, M) has in its columns what each reading does alone.
    """

    shift: Array
    own: Array
    planes: Mapping[str, Array]
    each: Array

    @property
    def detectability(self) -> float:
        """Sigmas of the shift against nothing at all."""
        return float(np.linalg.norm(self.shift))

    @property
    def beyond_ordinary(self) -> float:
        """The same as this very lab shows it, whose other parts add to it or take it back.

        Of all ordinary benches with any parts, the likeliest is less likely by exp(-s²/2) than what is there.
        """
        speaks_for_it = float(self.shift @ (self.shift + 2.0 * self.own))
        return float(np.sqrt(max(speaks_for_it, 0.0)))

    def beyond(self, names: Sequence[str]) -> float:
        """Sigmas of the shift that these effects together cannot imitate."""
        return float(np.linalg.norm(self._left(names)[:, 0]))

    def share_beyond(self, name: str) -> float:
        """The share of the shift that an effect cannot imitate, without the one reading that says most for it."""
        left, all_of_it = (self._but_one(names) for names in ([name], []))
        return float(np.sqrt(np.min(left / np.maximum(all_of_it, np.finfo(float).tiny))))

    def _but_one(self, names: Sequence[str]) -> Array:
        """Squared sigmas of the shift that these effects cannot imitate, without each reading in turn, (M,)."""
        left, *each = self._left(names, self.each).T
        told = np.square(each @ left) / np.sum(np.square(each), axis=1)
        return np.asarray(np.maximum(left @ left - told, 0.0))

    def _left(self, names: Sequence[str], *beside: Array) -> Array:
        """What these effects leave of the shift, (M, 1), and of columns beside it."""
        columns = np.concatenate([self.shift[:, None], *beside], axis=1)
        return beyond(
            np.concatenate([np.empty((len(columns), 0)), *(self.planes[n] for n in names)], axis=1), columns
        )

    def rivals(self, own: Sequence[str], beside: Sequence[str] = ()) -> dict[str, float]:
        """Isolability from every other effect, each with those ``beside`` it."""
        others = [name for name in self.planes if name not in own]
        return {name: self.beyond([name, *beside]) for name in others}

    def tied(self, own: str) -> tuple[str, ...]:
        """The effects that this shift cannot be told from, itself first."""
        near = [name for name, sigma in self.rivals([own]).items() if sigma < LEAST_SIGMA]
        return (own, *sorted(near))

    def nearest(self, own: str) -> float:
        """Sigmas to the nearest effect that it can be told from; infinite where there is none."""
        return min((s for s in self.rivals([own]).values() if s >= LEAST_SIGMA), default=float("inf"))
