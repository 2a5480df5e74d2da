"""Inductor and transformer: windings, cores, and an inductance that falls with current."""

from dataclasses import dataclass

import numpy as np

from sim.checks import REFERENCE_C, Array, Quantity, check, not_negative, positive

_BENDS = np.linspace(0.0, 1.4, 8)  # of a saturating inductor's flux, over the current at which it is told


@dataclass(frozen=True, slots=True, kw_only=True)
class Core:
    """A core with Steinmetz loss ``P = k f^alpha B^beta`` per volume (SI: W/m3, Hz, T)."""

    k: Quantity
    alpha: float
    beta: float
    area_m2: float
    volume_m3: float
    turns: float

    def __post_init__(self) -> None:
        not_negative(self, "k")
        positive(self, "alpha", "beta", "area_m2", "volume_m3", "turns")


@dataclass(frozen=True, slots=True, kw_only=True)
class Winding:
    """A winding: dc resistance at 25 degC, and the extra resistance at the switching frequency, relative to that.

    The extra grows with frequency squared (the low-frequency branch of Dowell's equation) and flattens about the
    harmonic ``flattens_at_harmonic``, where eddy currents' own field keeps them out of the strands.
    """

    resistance_Ohm: Quantity
    ac_extra: Quantity
    resistance_per_K: Quantity = 0.0039
    flattens_at_harmonic: float = (
        15.0  # Assumption: litz, its strands 0.4 of the skin depth at the switching frequency
    )

    def __post_init__(self) -> None:
        not_negative(self, "resistance_Ohm", "ac_extra")
        positive(self, "flattens_at_harmonic")

    def at(self, temperature_C: Quantity) -> Quantity:
        """Dc resistance in Ohm at a temperature.

        >>> round(Winding(resistance_Ohm=0.1, ac_extra=0.0).at(125.0), 4)
        0.139
        """
        return self.resistance_Ohm * (1 + self.resistance_per_K * (temperature_C - REFERENCE_C))


@dataclass(frozen=True, slots=True, kw_only=True)
class Inductor:
    r"""The series inductor of the ac link, on the primary side.

    ``inductance_H`` is that of a small current; at ``saturation_A`` it is lower by ``saturation`` (relative):
    :math:`L(i) = L / (1 + s (i/I)^2)`, s = saturation / (1 - saturation), the slope of an arctangent.
    The flux is taken as straight lines, bent at fifths of ``saturation_A``.
    """

    inductance_H: Quantity
    winding: Winding
    core: Core
    thermal_K_per_W: Quantity
    saturation: Quantity = 0.0
    saturation_A: float = 15.0

    def __post_init__(self) -> None:
        positive(self, "inductance_H", "thermal_K_per_W", "saturation_A")
        check(self, "in [0, 0.9]", lambda x: (x >= 0) & (x <= 0.9), "saturation")

    @property
    def saturates(self) -> bool:
        """Whether the inductance depends on the current anywhere."""
        return bool(np.any(np.asarray(self.saturation) > 0))

    def bands(self) -> tuple[Array, Array]:
        """Where the flux bends, (B - 1,) in A, and the inductance between, (B, ...), over that of a small current.

        >>> core = Core(k=1.0, alpha=1.3, beta=2.5, area_m2=1e-4, volume_m3=1e-5, turns=10.0)
        >>> winding = Winding(resistance_Ohm=0.1, ac_extra=0.0)
        >>> coil = Inductor(inductance_H=1e-4, winding=winding, core=core, thermal_K_per_W=5.0, saturation=0.2)
        >>> [row.round(3).tolist() for row in coil.bands()]
        [[3.0, 6.0, 9.0, 12.0, 15.0, 18.0], [0.997, 0.977, 0.941, 0.89, 0.831, 0.768, 0.703]]
        """
        bends_A = self.saturation_A * _BENDS[1:-1]
        share = np.asarray(self.saturation, dtype=float)
        # saturation_A over the arctangent's own scale
        knee = np.sqrt(np.maximum(share, 1e-12) / (1.0 - share))
        at = _BENDS.reshape(-1, *(1,) * share.ndim)
        return bends_A, np.diff(np.arctan(knee * at) / knee, axis=0) / np.diff(at, axis=0)

    def flux_Vs(self, current_A: Array) -> Array:
        """Flux linkage in V s of a current above 0, (N,)."""
        if not self.saturates:
            return np.asarray(self.inductance_H * current_A)
        bends_A, relative = self.bands()
        begin, end = np.concatenate([[0.0], bends_A]), np.concatenate([bends_A, [np.inf]])
        parts = (r * np.clip(current_A - b, 0.0, e - b) for r, b, e in zip(relative, begin, end, strict=True))
        return np.asarray(self.inductance_H * sum(parts))


@dataclass(frozen=True, slots=True, kw_only=True)
class Transformer:
    """The transformer, n:1; the winding is both windings referred to the primary."""

    turns_ratio: float
    magnetizing_H: Quantity
    winding: Winding
    core: Core
    thermal_K_per_W: Quantity

    def __post_init__(self) -> None:
        positive(self, "turns_ratio", "magnetizing_H", "thermal_K_per_W")
