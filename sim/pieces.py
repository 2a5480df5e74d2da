"""The link current in exponential pieces, and its integrals in closed form."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.decay import decay_integral, decay_moment, decay_ramp, decay_square

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pieces:
    """The half period in exponential pieces (some empty), arrays (K, N), as many in each of five stretches.

    In a piece that starts at ``start_s`` the current is ``y e^(-a t) + w (1 - e^(-a t)) / a`` with w =
    ``drive_A_per_s``, a = ``decay_per_s``, and the ``share`` rho of the magnetizing current, which starts from
    ``magnetizing_A`` and rises by ``magnetizing_A_per_s``; y is the rest of ``current_A`` at the start. ``sign`` is
    that of the current. Integrals are of what leaves the terminals, the current and ``eddy_s`` times its slope;
    ``relative_L`` scales both inductance and ``eddy_s``.
    """

    start_s: Array
    duration_s: Array
    current_A: Array
    drive_A_per_s: Array
    decay_per_s: Array
    sign: Array
    vp_V: Array
    nvs_V: Array
    eddy_s: Array | float
    relative_L: Array
    share: Array
    magnetizing_A: Array
    magnetizing_A_per_s: Array
    behind_Ohm: Array | float

    def current_at(self, time_s: Array) -> Array:
        """Link current in A at times of the half period [0, Th], shape (..., N)."""
        count = self.start_s.shape[0]
        index = np.sum(time_s[None] >= self.start_s.reshape(count, *(1,) * (time_s.ndim - 1), -1), axis=0) - 1
        index = np.clip(index, 0, count - 1).reshape(-1, time_s.shape[-1])

        def pick(values: Array) -> Array:
            return np.take_along_axis(values, index, axis=0).reshape(time_s.shape)

        t = time_s - pick(self.start_s)
        first = pick(self._first)
        straight = pick(self.current_A) + pick(self.share * self.magnetizing_A_per_s) * t
        return straight + t * decay_integral(pick(self.decay_per_s) * t) * first

    @property
    def _first(self) -> Array:
        """dy/dt at the start."""
        return self.drive_A_per_s - self.decay_per_s * (self.current_A - self.share * self.magnetizing_A)

    @property
    def slope_A_per_s(self) -> Array:
        """di/dt at the start."""
        return np.asarray(self._first + self.share * self.magnetizing_A_per_s)

    def slope_at(self, current_A: Array, time_s: Array) -> Array:
        """di/dt a time after the start, at the current there."""
        return self.slope_A_per_s - self.decay_per_s * (
            current_A - self.current_A - self.share * self.magnetizing_A_per_s * time_s
        )

    @property
    def end_A(self) -> Array:
        """Current at the end of each piece, in A: where the next one starts."""
        T, line = self.duration_s[-1], (self.share * self.magnetizing_A_per_s)[-1]
        last = self.current_A[-1] + T * (self._first[-1] * decay_integral(self.decay_per_s[-1] * T) + line)
        return np.concatenate([self.current_A[1:], last[None]])

    def charge(self) -> Array:
        """Integral of the terminal current over each piece, in A s."""
        return self._charge(self._integrals()[0])

    def _charge(self, y: Array) -> Array:
        T = self.duration_s
        line = self.share * T * (self.magnetizing_A + 0.5 * self.magnetizing_A_per_s * T)
        return np.asarray(y + line + self.eddy_s * self.relative_L * (self.end_A - self.current_A))

    def _integrals(self) -> tuple[Array, Array]:
        """Of y and of y times the time from the start."""
        T, x = self.duration_s, self.decay_per_s * self.duration_s
        y = self.current_A - self.share * self.magnetizing_A
        plain = T * (y * decay_integral(x) + self.drive_A_per_s * T * decay_moment(x))
        return plain, T**2 * (0.5 * y + self._first * T * decay_ramp(x))

    def square(self) -> Array:
        """Integral of the squared terminal current over each piece, in A^2 s."""
        T, i, w = self.duration_s, self.current_A - self.share * self.magnetizing_A, self.drive_A_per_s
        x = self.decay_per_s * T
        plain = T * (
            i**2 * decay_integral(2 * x) + w * T * (i * decay_integral(x) ** 2 + w * T * decay_square(x))
        )
        crossed = 2.0 * self.share * self._by_magnetizing(*self._integrals())
        line = self.share**2 * self.magnetizing_square()
        eddy_s = self.eddy_s * self.relative_L
        eddy = eddy_s * (self.end_A**2 - self.current_A**2 + eddy_s * self.squared_slope())
        return np.asarray(plain + crossed + line + eddy)

    def _by_magnetizing(self, plain: Array, timed: Array) -> Array:
        """Integral of a quantity times the magnetizing current, from those of itself and of itself times time."""
        return np.asarray(self.magnetizing_A * plain + self.magnetizing_A_per_s * timed)

    def magnetizing_square(self) -> Array:
        """Integral of the squared magnetizing current over each piece, in A^2 s."""
        T, m, s = self.duration_s, self.magnetizing_A, self.magnetizing_A_per_s
        return np.asarray(T * (m * m + s * T * (m + s * T / 3.0)))

    def both(self) -> Array:
        """Integral of terminal times magnetizing current over each piece, in A^2 s."""
        return self._both(*self._integrals())

    def _both(self, y: Array, timed: Array) -> Array:
        T, m, s = self.duration_s, self.magnetizing_A, self.magnetizing_A_per_s
        plain = y + self.share * T * (m + 0.5 * s * T)
        timed = timed + self.share * T**2 * (0.5 * m + s * T / 3.0)
        induced = self.end_A * (m + s * T) - self.current_A * m - s * plain
        return np.asarray(self._by_magnetizing(plain, timed) + self.eddy_s * self.relative_L * induced)

    def secondary_square(self) -> Array:
        """Integral of the squared terminal current less the magnetizing one over each piece, in A^2 s."""
        return np.asarray(self.square() - 2.0 * self.both() + self.magnetizing_square())

    def bridge_energy(self) -> Array:
        r"""Energy into the ideal secondary bridge over each piece, in J.

        With d the change of the magnetizing current that the drop of R' makes, :math:`L_m \dot d = R' (i - i_m)`, the
        bridge takes n vs (i - d), and of a period :math:`-\langle n v_s d \rangle = R' \langle (i - i_m) i_m \rangle`
        by parts of n vs = Lm di_m/dt.
        """
        y, timed = self._integrals()
        shunted = self.behind_Ohm * (self._both(y, timed) - self.magnetizing_square())
        return np.asarray(self.nvs_V * self._charge(y) + shunted)

    def squared_slope(self) -> Array:
        """Integral of (di/dt)^2 over each piece, in A^2/s."""
        T, line, first = self.duration_s, self.share * self.magnetizing_A_per_s, self._first
        x = self.decay_per_s * T
        curved = first**2 * decay_integral(2 * x) + 2.0 * line * first * decay_integral(x)
        return np.asarray(T * (curved + line**2))

    def squared_induced(self) -> Array:
        """The same of the voltage across the inductance, over that of a small current squared."""
        return np.asarray(self.relative_L**2 * self.squared_slope())
