"""The link current in exponential pieces, and its integrals in closed form."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, wraps

import numpy as np
from numpy.typing import NDArray

from sim.decay import Decay, decay_integral

Array = NDArray[np.float64]


def _once(integral: "Callable[[Pieces], Array]") -> "Callable[[Pieces], Array]":
    """An integral that is kept: powers, losses and Newton's rule ask for the same ones."""
    place = f"_{integral.__name__}"

    @wraps(integral)
    def kept(pieces: "Pieces") -> Array:
        if place not in vars(pieces):
            vars(pieces)[place] = integral(pieces)
        return np.asarray(vars(pieces)[place])

    return kept


@dataclass(frozen=True, kw_only=True)
class Pieces:
    """The half period in exponential pieces (some empty), arrays (K, N), as many in each of five stretches.

    In a piece that starts at ``start_s`` the current is ``y e^(-a t) + w (1 - e^(-a t)) / a`` with w =
    ``drive_A_per_s``, a = ``decay_per_s``, and the ``share`` rho of the magnetizing current, which starts from
    ``magnetizing_A`` and rises by ``magnetizing_A_per_s``; y is the rest of ``current_A`` at the start. ``sign`` is
    that of the current. Integrals are of what leaves the terminals, the current and ``eddy_s`` times its slope;
    ``relative_L`` scales both inductance and ``eddy_s``. ``behind_V`` and ``behind_Ohm`` is what the secondary drops,
    by the sign ``secondary_sign`` of the current less the magnetizing one where it has a threshold; ``meets_A_per_s``
    is how fast the limit moves whose crossing began a piece. What was asked once is kept: arrays stay as they are.
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
    behind_V: Array | float = 0.0
    secondary_sign: Array | None = None
    meets_A_per_s: Array | float = 0.0

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

    @cached_property
    def _rest_A(self) -> Array:
        """y at the start."""
        return self.current_A - self.share * self.magnetizing_A

    @cached_property
    def _first(self) -> Array:
        """dy/dt at the start."""
        return self.drive_A_per_s - self.decay_per_s * self._rest_A

    @cached_property
    def _line_A_per_s(self) -> Array:
        """Slope of the share of the magnetizing current."""
        return self.share * self.magnetizing_A_per_s

    @cached_property
    def _decay(self) -> Decay:
        """Of y over each piece."""
        return Decay.of(self.decay_per_s * self.duration_s)

    @cached_property
    def _change_A(self) -> Array:
        """What y would change by in a piece if it did not decay."""
        return self._first * self.duration_s

    @cached_property
    def _magnetized_A(self) -> Array:
        """What the magnetizing current changes by in a piece."""
        return self.magnetizing_A_per_s * self.duration_s

    @cached_property
    def _eddy_s(self) -> Array:
        return self.eddy_s * self.relative_L

    @cached_property
    def half_period_s(self) -> Array:
        """Th (N,)."""
        return np.asarray(np.sum(self.duration_s, axis=0))

    @cached_property
    def slope_A_per_s(self) -> Array:
        """di/dt at the start."""
        return self._first + self._line_A_per_s

    def slope_at(self, current_A: Array, time_s: Array) -> Array:
        """di/dt a time after the start, at the current there."""
        return self.slope_A_per_s - self.decay_per_s * (
            current_A - self.current_A - self._line_A_per_s * time_s
        )

    @cached_property
    def end_A(self) -> Array:
        """Current at the end of each piece, in A: where the next one starts."""
        T = self.duration_s[-1]
        curved = self._first[-1] * decay_integral(self.decay_per_s[-1] * T)
        last = self.current_A[-1] + T * (curved + self._line_A_per_s[-1])
        return np.concatenate([self.current_A[1:], last[None]])

    @_once
    def _plain(self) -> Array:
        """Integral of the current, without what the eddy currents take."""
        y = self._rest_A + self._change_A * self._decay.second
        return self.duration_s * (y + self.share * (self.magnetizing_A + 0.5 * self._magnetized_A))

    @_once
    def _crossed(self) -> Array:
        """Integral of y times the magnetizing current."""
        y, change, decay = self._rest_A, self._change_A, self._decay
        timed = 0.5 * y + change * decay.ramp()  # y times s, the time as a share of the piece
        return self.duration_s * (
            self.magnetizing_A * (y + change * decay.second) + self._magnetized_A * timed
        )

    @_once
    def charge(self) -> Array:
        """Integral of the terminal current over each piece, in A s."""
        return self._plain() + self._eddy_s * (self.end_A - self.current_A)

    @_once
    def square(self) -> Array:
        """Integral of the squared terminal current over each piece, in A^2 s."""
        y, change, decay = self._rest_A, self._change_A, self._decay
        plain = self.duration_s * (y * y + change * (2.0 * y * decay.second + change * decay.square()))
        shared = self.share * (2.0 * self._crossed() + self.share * self.magnetizing_square())
        rise = self.end_A**2 - self.current_A**2
        return plain + shared + self._eddy_s * (rise + self._eddy_s * self.squared_slope())

    def magnetizing_charge(self) -> Array:
        """Integral of the magnetizing current over each piece, in A s."""
        return np.asarray(self.duration_s * (self.magnetizing_A + 0.5 * self._magnetized_A))

    @_once
    def magnetizing_square(self) -> Array:
        """Integral of the squared magnetizing current over each piece, in A^2 s."""
        m, change = self.magnetizing_A, self._magnetized_A
        return self.duration_s * (m * m + change * (m + change / 3.0))

    @_once
    def both(self) -> Array:
        """Integral of terminal times magnetizing current over each piece, in A^2 s."""
        m = self.magnetizing_A
        product = self._crossed() + self.share * self.magnetizing_square()
        end = self.end_A * (m + self._magnetized_A)
        induced = end - self.current_A * m - self.magnetizing_A_per_s * self._plain()
        return product + self._eddy_s * induced

    @_once
    def secondary_square(self) -> Array:
        """Integral of the squared terminal current less the magnetizing one over each piece, in A^2 s."""
        return self.square() - 2.0 * self.both() + self.magnetizing_square()

    @_once
    def bridge_energy(self) -> Array:
        r"""Energy into the ideal secondary bridge over each piece, in J.

        With d the change of the magnetizing current that the drop u = V' + R' (i - i_m) makes, :math:`L_m \dot d = u`,
        the bridge takes n vs (i - d), and of a period :math:`-\langle n v_s d \rangle = \langle u i_m \rangle` by parts
        of n vs = Lm di_m/dt.
        """
        shunted = self.behind_Ohm * (self.both() - self.magnetizing_square())
        if self.secondary_sign is not None:
            shunted = shunted + self.behind_V * self.magnetizing_charge()
        return self.nvs_V * self.charge() + shunted

    @_once
    def squared_slope(self) -> Array:
        """Integral of (di/dt)^2 over each piece, in A^2/s."""
        first, line, decay = self._first, self._line_A_per_s, self._decay
        curved = first * (first * decay.twice() + 2.0 * line * decay.first)
        return self.duration_s * (curved + line * line)

    def squared_induced(self) -> Array:
        """The same of the voltage across the inductance, over that of a small current squared."""
        return np.asarray(self.relative_L**2 * self.squared_slope())
