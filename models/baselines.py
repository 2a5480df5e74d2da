"""The other learners of Fig. 15 on measured data alone: SVR, BR, RF and NN, behind ``EfficiencyModel``.

Beyond the paper, a Gaussian process: on measured efficiency, or on its gap to a first stage.

Assumption: the paper names them without settings; these are scikit-learn's, with inputs and target scaled
to unit variance and the network small enough for some hundred points. BR is read as Bayesian ridge
regression, on cubic terms, since a plane cannot follow an efficiency map.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from sklearn.base import RegressorMixin
from sklearn.compose import TransformedTargetRegressor
from sklearn.ensemble import RandomForestRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import Matern, WhiteKernel
from sklearn.linear_model import BayesianRidge
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from sklearn.svm import SVR

from models.boosting import Floats, design
from models.surrogate import inputs_of


def _svr(seed: int) -> RegressorMixin:
    return make_pipeline(StandardScaler(), SVR(C=10.0, epsilon=0.01))


def _bayesian_ridge(seed: int) -> RegressorMixin:
    return make_pipeline(StandardScaler(), PolynomialFeatures(degree=3), BayesianRidge())


def _random_forest(seed: int) -> RegressorMixin:
    return RandomForestRegressor(n_estimators=200, random_state=seed, n_jobs=1)


def _neural_network(seed: int) -> RegressorMixin:
    network = MLPRegressor(
        hidden_layer_sizes=(32, 32),
        solver="lbfgs",
        alpha=1e-3,
        max_iter=5000,
        max_fun=100_000,
        random_state=seed,
    )
    return make_pipeline(StandardScaler(), network)


def _gaussian_process(seed: int) -> RegressorMixin:
    kernel = 1.0 * Matern([1.0, 1.0, 1.0], (0.05, 100.0), nu=2.5) + WhiteKernel(1e-3, (1e-8, 1.0))
    return make_pipeline(StandardScaler(), GaussianProcessRegressor(kernel, random_state=seed))


BASELINES: dict[str, Callable[[int], RegressorMixin]] = {
    "svr": _svr,
    "br": _bayesian_ridge,
    "rf": _random_forest,
    "nn": _neural_network,
    "gp": _gaussian_process,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Baseline:
    """A trained regressor of scikit-learn; kept in memory only."""

    kind: str
    regressor: TransformedTargetRegressor

    def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
        """Efficiency as a fraction, of the inputs' broadcast shape."""
        rows, shape = design(D1, D2, power_W)
        out = self.regressor.predict(rows.astype(np.float64))
        return np.asarray(out, dtype=np.float64).reshape(shape)


def train_baseline(kind: str, measured: pd.DataFrame, *, seed: int, target: Floats | None = None) -> Baseline:
    """Train one of ``BASELINES`` on ``measured`` (columns D1 D2 P2_W efficiency), or on a ``target`` (N,) of its rows.

    An optimiser that ends at the bounds of a hyper-parameter, or after its last iteration, still leaves a model; what
    it is worth is judged on data that were not fitted, so its warning is not passed on.
    """
    if kind not in BASELINES:
        raise ValueError(f"no baseline is called {kind!r}; there are {', '.join(BASELINES)}")
    rows, _ = design(*inputs_of(measured))
    scaled = TransformedTargetRegressor(regressor=BASELINES[kind](seed), transformer=StandardScaler())
    wanted = measured["efficiency"].to_numpy(dtype=np.float64) if target is None else target
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        fitted = scaled.fit(rows.astype(np.float64), wanted)
    return Baseline(kind=kind, regressor=fitted)
