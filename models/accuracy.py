"""How far a model is from measured efficiency, on points it was not fitted to."""

import math
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
        percentage=float(1 - np.mean(np.abs(error) / truth[known])),
        points=int(known.sum()),
        unpredicted=int((~known).sum()),
    )


def half_width(predicted: Floats, truth: Floats, coverage: float = 0.95) -> float:
    """Half of the interval around a prediction that holds the truth as often as ``coverage`` says.

    The ceil((n + 1) · coverage)-th smallest of n absolute errors on points that were not fitted (split conformal
    prediction; Vovk, Gammerman and Shafer, *Algorithmic Learning in a Random World*, 2005). NaN when n is too
    small for that: 19 points are needed for 95 %. Validity: points like the held-out ones.

    >>> half_width(np.full(19, 0.97), np.linspace(0.971, 0.989, 19))
    0.019
    """
    error = np.abs(predicted - truth)
    error = np.sort(error[np.isfinite(error)])
    rank = math.ceil((len(error) + 1) * coverage)
    return float(round(error[rank - 1], 12)) if 0 < rank <= len(error) else math.nan
