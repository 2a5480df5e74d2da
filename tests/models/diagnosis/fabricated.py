"""Small made-up data with a known answer: observations, fits, and a bench that is linear."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from models.diagnosis.common_mode import CommonModes
from models.diagnosis.geometry import Geometry
from models.diagnosis.hypotheses import Fit, Term
from models.diagnosis.law import Laws
from models.diagnosis.leftover import AMPLITUDES_W, Leftover, Leftovers
from models.diagnosis.observations import CHANNELS, Observations, observe
from models.diagnosis.refinery import Refinery
from models.diagnosis.signatures import Signature, Signatures
from models.diagnosis.whitener import Whitener
from sim.effects.catalogue import effect
from sim.model import Model
from sim.prototype import prototype

Array = NDArray[np.float64]
CHANNEL = {channel.name: channel for channel in CHANNELS}


def loads(power_W: Array) -> Observations:
    """Observations of the input power alone, at loads that lose 2 %."""
    frame = pd.DataFrame({"D1": 0.9, "D2": 0.1, "P2_W": power_W, "kind": "load", "P1_W": power_W / 0.98})
    frame = frame.assign(efficiency=0.98, time_s=60.0 * np.arange(len(frame)))
    return observe(frame, prototype())


def fit_of(effect: str | None, shift: Array, *, slope: Array | None = None, value: float = 1.0) -> Fit:
    """A fit with this shift of every reading; of nothing where ``effect`` is None."""
    if effect is None:
        return Fit(terms=(), shift=shift)
    return joint_fit({effect: shift if slope is None else slope}, shift, value=value)


def joint_fit(slopes: Mapping[str, Array], shift: Array, *, value: float = 1.0) -> Fit:
    """A fit of several effects with these slopes, all at one value."""
    terms = tuple(
        Term(signature=Signature(entry=effect(name), slope=slope), value=value, sigma=0.1, slope=slope)
        for name, slope in slopes.items()
    )
    return Fit(terms=terms, shift=shift)


def known(effects: Sequence[Signature], readings: int, spreads: Array | None = None) -> Signatures:
    """Signatures about a baseline that predicts 0, with instrument spreads (K, M)."""
    directions = np.zeros((0, readings)) if spreads is None else spreads
    return Signatures(
        baseline=np.zeros(readings),
        effects=tuple(effects),
        modes=CommonModes.of((), prototype()),
        spread_names=tuple(f"spread {k}" for k in range(len(directions))),
        spreads=directions,
        input_sigma=np.zeros(readings),
        bends=np.zeros((0, readings)),
        per_watt=np.zeros(readings),
        inaccuracy=np.zeros((3, readings)),
        laws=np.zeros((0, readings)),
    )


@dataclass(frozen=True)
class LinearBench:
    """Observations whose model is exactly linear: each effect's slope times its distance from off."""

    value: Array
    effects: Sequence[Signature] = field(default_factory=tuple)

    def solved(
        self, models: Sequence[Model], near: object = None, starts: object = ()
    ) -> list[tuple[Array, Array]]:
        """Prediction of every reading by each model; a line needs no start to go from, and leaves none."""
        return [(self._predicted(model), np.empty((0, 0))) for model in models]

    def _predicted(self, model: Model) -> Array:
        total = np.zeros_like(self.value)
        for signature in self.effects:
            head = signature.entry.headline
            value = model.effects.get(signature.effect, {}).get(head.name, head.off)
            total = total + signature.slope * (value - head.off)
        return total


def white_leftovers(readings: int) -> Leftovers:
    """A leftover that may be anything at every reading, at several amplitudes."""
    columns = np.arange(readings)
    configurations = tuple(
        Leftover(location="anywhere", amplitude=amplitude, columns=columns) for amplitude in AMPLITUDES_W
    )
    return Leftovers(basis=np.eye(readings), configurations=configurations, shared_by=len(configurations))


def refinery(
    value: Array,
    effects: Sequence[Signature],
    sigma: Array,
    spreads: Array | None = None,
    laws: Sequence[tuple[Signature, Array]] = (),
) -> Refinery:
    """A linear bench's refinery: independent noise, spreads, a leftover that is white, and laws' columns (r, M)."""
    signatures = known(effects, value.size, spreads)
    bench = LinearBench(value, effects)
    whitener = Whitener.of(covariance_of(sigma, signatures.spreads))
    geometry = Geometry.of(whitener, signatures.spreads, white_leftovers(value.size))
    return Refinery(
        known=signatures,
        observations=bench,  # type: ignore[arg-type]  # as much of it as a refinery needs
        baseline=Model.baseline(),
        geometry=geometry,
        laws=Laws.of(laws, geometry),
    )


def covariance_of(sigma: Array, spreads: Array) -> Array:
    """Independent noise and spreads (K, M), (M, M)."""
    return np.asarray(np.diag(sigma**2) + spreads.T @ spreads)
