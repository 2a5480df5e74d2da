"""Small made-up data with a known answer: observations, fits, and a bench that is linear."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from models.diagnosis.covariance import Covariances, Whitener
from models.diagnosis.evidence import Fit, Refinery
from models.diagnosis.observations import Observations, observe
from models.diagnosis.signatures import Signature, Signatures
from sim.model import Model
from sim.prototype import prototype

Array = NDArray[np.float64]


def loads(power_W: Array) -> Observations:
    """Observations of the input power alone, at loads that lose 2 %."""
    frame = pd.DataFrame({"D1": 0.9, "D2": 0.1, "P2_W": power_W, "kind": "load", "P1_W": power_W / 0.98})
    frame = frame.assign(efficiency=0.98, time_s=60.0 * np.arange(len(frame)))
    return observe(frame, prototype())


def fit_of(effect: str | None, shift: Array, *, slope: Array | None = None, value: float = 1.0) -> Fit:
    """A fit with this shift of every reading; of nothing where ``effect`` is None."""
    slope = shift if slope is None else slope
    signature = None if effect is None else Signature(effect=effect, slope=slope)
    return Fit(signature=signature, value=value, sigma=0.1, log_evidence=0.0, shift=shift, slope=slope)


def known(effects: Sequence[Signature], readings: int, spreads: Array | None = None) -> Signatures:
    """Signatures about a baseline that predicts 0, with instrument spreads (K, M)."""
    directions = np.zeros((0, readings)) if spreads is None else spreads
    return Signatures(
        baseline=np.zeros(readings),
        effects=tuple(effects),
        spread_entries=(),
        spread_names=tuple(f"spread {k}" for k in range(len(directions))),
        spreads=directions,
        input_sigma=np.zeros(readings),
    )


@dataclass(frozen=True)
class LinearBench:
    """Observations whose model is exactly linear: each effect's slope times its distance from off."""

    value: Array
    effects: Sequence[Signature] = field(default_factory=tuple)

    def simulate(self, models: Sequence[Model], near: object = None) -> list[Array]:
        """Prediction of every reading by each model; a line needs no start to go from."""
        return [self._predicted(model) for model in models]

    def _predicted(self, model: Model) -> Array:
        total = np.zeros_like(self.value)
        for signature in self.effects:
            head = signature.entry.headline
            value = model.effects.get(signature.effect, {}).get(head.name, head.off)
            total = total + signature.slope * (value - head.off)
        return total


def refinery(
    value: Array, effects: Sequence[Signature], sigma: Array, spreads: Array | None = None
) -> tuple[Refinery, Covariances]:
    """A linear bench's refinery and covariances: independent noise, spreads, and a leftover that is white."""
    signatures = known(effects, value.size, spreads)
    plain = np.diag(sigma**2) + signatures.spreads.T @ signatures.spreads
    covariance = Covariances(plain=plain, leftover=np.eye(value.size))
    bench = LinearBench(value, effects)
    return (
        Refinery(
            known=signatures,
            observations=bench,  # type: ignore[arg-type]  # as much of it as a refinery needs
            baseline=Model.baseline(),
            whitener=Whitener.of(plain),
        ),
        covariance,
    )
