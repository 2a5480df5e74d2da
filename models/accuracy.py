"""How far a model is from measured efficiency, on points it was not fitted to."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from models.boosting import Floats
from models.surrogate import EfficiencyModel, inputs_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """Error of a model over ``points`` rows; ``unpredicted`` rows had no prediction and are in no mean.

    ``mean_abs`` and ``worst_abs`` are fractions of efficiency (0.01 is one point). ``percentage`` is the
    paper's figure, 1 - mean(|Δη| / η): 0.9992 stands for 99.92 %.
    """

    mean_abs: float
    worst_abs: float
    bias: float
    percentage: float
    points: int
    unpredicted: int


def accuracy(model: EfficiencyModel, measured: pd.DataFrame) -> Accuracy:
    """Compare ``model`` with the column ``efficiency`` of ``measured`` (columns D1 D2 P2_W efficiency)."""
    truth = measured["efficiency"].to_numpy(dtype=np.float64)
    return accuracy_of(model.predict(*inputs_of(measured)), truth)


def accuracy_of(predicted: Floats, truth: Floats) -> Accuracy:
    """Compare predictions (N,) with ``truth`` (N,); raises ValueError when none of them can be compared."""
    known = np.isfinite(predicted) & np.isfinite(truth)
    if not known.any():
        raise ValueError(f"none of {len(truth)} points has both a prediction and a measured efficiency")
    error = predicted[known] - truth[known]
    return Accuracy(
        mean_abs=float(np.abs(error).mean()),
        worst_abs=float(np.abs(error).max()),
        bias=float(error.mean()),
        percentage=float(1 - np.mean(np.abs(error) / truth[known])),
        points=int(known.sum()),
        unpredicted=int((~known).sum()),
    )
