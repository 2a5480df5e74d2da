"""What the pictures of a run share: bands of power, the range worth colouring, residuals per channel."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from models.screening import LOADED_KINDS

SHARES = (0.3, 0.5, 0.8)  # of the largest power: light, medium and heavy load as in the paper's figures
RESIDUAL_CHANNELS = (
    "efficiency", "D0", "P1_W", "P_link1_W", "P_link2_W", "I_L_rms_A",
    "T_heatsink_C", "T_transformer_C", "T_inductor_C",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Band:
    """The simulated map at one power, and the measured points of the powers nearest to it."""

    power_W: float
    low_W: float
    high_W: float
    simulated: pd.DataFrame
    measured: pd.DataFrame

    @property
    def label(self) -> str:
        """The band's powers, as a subtitle."""
        return f"{self.low_W:.0f} to {self.high_W:.0f} W"

    @property
    def residual_points(self) -> pd.Series:
        """Measured less simulated efficiency of the band's points, in points."""
        return 100 * (self.measured["efficiency"] - self.measured["sim_efficiency"])


def loaded_rows(measurements: pd.DataFrame) -> pd.DataFrame:
    """The measured rows that carry power."""
    kinds = measurements["kind"] if "kind" in measurements else pd.Series("load", index=measurements.index)
    return measurements[kinds.isin(LOADED_KINDS) & measurements["efficiency"].notna()].reset_index(drop=True)


def power_bands(
    simulation: pd.DataFrame, measurements: pd.DataFrame, shares: Sequence[float] = SHARES
) -> list[Band]:
    """A band per share of the largest power, together covering every measured point once."""
    levels = np.unique(simulation["P_set_W"].to_numpy(dtype=np.float64))
    chosen = np.unique([levels[np.abs(levels - share * levels.max()).argmin()] for share in shares])
    rows = loaded_rows(measurements)
    power_W = rows["P2_W"].to_numpy(dtype=np.float64)
    nearest = np.abs(power_W[:, None] - chosen).argmin(axis=1)
    middle = (chosen[:-1] + chosen[1:]) / 2
    low = np.concatenate([[min([levels.min(), *power_W])], middle])
    high = np.concatenate([middle, [max([levels.max(), *power_W])]])
    return [
        Band(
            power_W=float(power),
            low_W=float(low[k]),
            high_W=float(high[k]),
            simulated=simulation[simulation["P_set_W"] == power],
            measured=rows[nearest == k],
        )
        for k, power in enumerate(chosen)
    ]


def shown_range(simulation: pd.DataFrame, measurements: pd.DataFrame) -> tuple[float, float]:
    """Efficiencies between which colours are told apart: the lowest tenth shares the darkest one."""
    values = np.concatenate(
        [simulation["efficiency"].to_numpy(), loaded_rows(measurements)["efficiency"].to_numpy()]
    )
    values = values[np.isfinite(values)]
    if len(values) == 0:
        return 0.9, 1.0
    return float(np.quantile(values, 0.1)), float(values.max())


def residual_channels(measurements: pd.DataFrame) -> dict[str, pd.Series]:
    """Measured less simulated, for every channel that has both columns ``X`` and ``sim_X``."""
    return {
        channel: measurements[channel] - measurements[f"sim_{channel}"]
        for channel in RESIDUAL_CHANNELS
        if {channel, f"sim_{channel}"} <= set(measurements.columns)
        and (measurements[channel] - measurements[f"sim_{channel}"]).notna().any()
    }
