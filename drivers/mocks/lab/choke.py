r"""The link inductor's soft saturation.

The differential inductance falls with the square of the current, :math:`L(i) = L_0 (1 - s\, i^2 / I_r^2)` with
the drop s at I_r = 15 A, so the flux linkage is :math:`\lambda = L_0 (i - c\, i^3)`, :math:`c = s / (3 I_r^2)`.
The link's voltages set the flux, whose course the waveform solver knows as that of a constant inductance,
:math:`x = \lambda / L_0`; the current is its bent
image :math:`i = x (1 + b + 3 b^2 + 12 b^3 + \dots)`, :math:`b = c x^2`.

Assumption: the drops of what conducts follow x, not i; they are some volts of 300, and the bend some per cent.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.steady_state import Orbit, Pieces

Array = NDArray[np.float64]

REFERENCE_A = 15.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1), 0.5 * _WEIGHTS


@dataclass(frozen=True, slots=True, kw_only=True)
class Choke:
    """An inductor whose inductance drops by ``drop``, relative, at 15 A."""

    drop: float = 0.0

    def current(self, straight_A: Array) -> Array:
        """Current in A where a constant inductance would carry ``straight_A``.

        >>> float(Choke(drop=0.2).current(np.array(10.0)).round(2))
        10.33
        """
        bend = self.drop / (3 * REFERENCE_A**2) * straight_A**2
        return np.asarray(straight_A * (1 + bend * (1 + bend * (3 + bend * (12 + 55 * bend)))))

    def charge(self, pieces: Pieces) -> Array:
        """Integral of i over each piece, (K, N) in A s."""
        return self._integral(self.current(_straight(pieces)), pieces)

    def square(self, pieces: Pieces) -> Array:
        """Integral of i^2 over each piece, (K, N) in A^2 s."""
        return self._integral(self.current(_straight(pieces)) ** 2, pieces)

    def secondary_square(self, pieces: Pieces) -> Array:
        """Integral of the squared current that the transformer hands on, over each piece, (K, N) in A^2 s."""
        return self._integral((self.current(_straight(pieces)) - _magnetizing(pieces)) ** 2, pieces)

    def extra_W(self, orbit: Orbit) -> Array:
        """Power into the secondary bridge beyond that of a constant inductance, (N,)."""
        pieces = orbit.pieces
        straight = _straight(pieces)
        extra = self._integral(self.current(straight) - straight, pieces)
        return np.asarray(np.sum(pieces.nvs_V * extra, axis=0) / np.sum(pieces.duration_s, axis=0))

    @staticmethod
    def _integral(values: Array, pieces: Pieces) -> Array:
        return np.asarray(pieces.duration_s * np.tensordot(_WEIGHTS, values, axes=1))


def _straight(pieces: Pieces) -> Array:
    """The solver's current at the quadrature's nodes in each piece, (4, K, N)."""
    time_s = _NODES[:, None, None] * pieces.duration_s
    line = pieces.share * pieces.magnetizing_A_per_s
    decayed = -np.expm1(-pieces.decay_per_s * time_s) / pieces.decay_per_s
    return np.asarray(pieces.current_A + line * time_s + (pieces.slope_A_per_s - line) * decayed)


def _magnetizing(pieces: Pieces) -> Array:
    """The magnetizing current there."""
    time_s = _NODES[:, None, None] * pieces.duration_s
    return np.asarray(pieces.magnetizing_A + pieces.magnetizing_A_per_s * time_s)
