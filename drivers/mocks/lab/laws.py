r"""How the loss laws of a lab's own parts run where no datasheet says: shapes, not sizes.

Each lab draws them by its seed, so that no diagnosis can be right, or know how wrong it is, by the shapes of one lab.
The sizes are the converter's, and scatter as parts do (:mod:`drivers.mocks.lab.parts`).

- Switching energy: a share of it is linear in the current, the rest goes by the datasheet's exponent.
- Eddy currents: Dowell's rise with the square of the frequency flattens where a layer is no longer thin against the
  skin's depth, :math:`k^2 / (1 + f\,(k^2 - 1))` at the harmonic k.
- Core loss: a parabola about the temperature at which the ferrite loses least. Ferrites are flat: at 30 degC they lose
  2 to 22 % more than there.
- Recovery: its energy is lost in the diode and in the switch that drives it, in a ratio that depends on how snappy the
  diode is.
"""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.mocks.lab.choke import Choke
from sim.parameters import SwitchingEnergy

Array = NDArray[np.float64]

_SIZED_C = 60.0  # where a core loses what its data say: about as warm as it runs


@dataclass(frozen=True, slots=True, kw_only=True)
class Laws:
    """Shapes of one lab's laws: ``linear_share`` of switching energies, ``flattening`` of eddy currents per squared
    harmonic, temperature and curvature of the cores' minimum, the diode's share of its recovery; and the choke, which
    follows from what a lab hides.
    """

    linear_share: float = 0.5
    flattening: float = 0.004
    least_core_C: float = 95.0
    core_per_K2: float = 1.5e-5
    diode_share: float = 0.4
    choke: Choke = field(default_factory=Choke)

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """Assumption: every shape evenly about its default; small numbers from half of it to twice."""
        return cls(
            linear_share=float(rng.uniform(0.0, 1.0)),
            flattening=float(np.exp(rng.uniform(np.log(0.002), np.log(0.008)))),
            least_core_C=float(rng.uniform(75.0, 115.0)),
            core_per_K2=float(np.exp(rng.uniform(np.log(0.75e-5), np.log(3e-5)))),
            diode_share=float(rng.uniform(0.2, 0.6)),
        )

    def switching_J(
        self, law: SwitchingEnergy, current_A: Array, voltage_V: Array, junction_C: Array
    ) -> Array:
        """Switching energy through the datasheet's point."""
        share = np.maximum(current_A, 0.0) / law.reference_A
        shape = self.linear_share * share + (1 - self.linear_share) * share**law.current_exponent
        scaled = shape * (voltage_V / law.reference_V) ** law.voltage_exponent
        return np.asarray(law.energy_J * scaled * np.exp(law.energy_per_K * (junction_C - 25.0)))

    def eddy_rise(self, harmonic: NDArray[np.int_]) -> Array:
        """What eddy currents add at a harmonic, over what they add at the first."""
        square = harmonic.astype(float) ** 2
        return np.asarray(square / (1 + self.flattening * (square - 1)))

    def core_warmth(self, core_C: Array) -> Array:
        """Core loss at a temperature over what the core's data say.

        >>> Laws().core_warmth(np.array([25.0, 60.0, 95.0])).round(3).tolist()
        [1.054, 1.0, 0.982]
        """
        warm, sized = (1 + self.core_per_K2 * (at - self.least_core_C) ** 2 for at in (core_C, _SIZED_C))
        return np.asarray(warm / sized)
