"""Boosted regression trees of (D1, D2, power) or more: XGBoost with fixed settings, and their leaves as boxes.

An ensemble is a sum over trees, each constant on boxes of its inputs, here of the usual three:

    y(x) = base + Σ_l leaf_l(x),    x = (D1, D2, power_W) in single precision

The boxes are what makes an exact optimum possible (:mod:`models.exhaustive`).

The target is a fraction. XGBoost makes no split that lowers the squared error by less than 1e-6, so that
leftovers of about 0.1 points stay unlearnt; learning per cent instead was tried and judged no better on
points that were not fitted.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import xgboost

Floats = NDArray[np.float64]
FEATURES = ("D1", "D2", "power_W")


@dataclass(frozen=True, slots=True, kw_only=True)
class BoostSettings:
    """Settings of one ensemble: tree depth, trees, L2 penalty, learning rate; seed, threads of training."""

    depth: int
    trees: int
    l2: float
    rate: float
    seed: int = 0
    threads: int = 1

    def __post_init__(self) -> None:
        if self.depth < 1 or self.trees < 1 or self.threads < 1:
            raise ValueError(f"depth, trees and threads must be at least 1: {self}")
        if not (self.l2 >= 0 and 0 < self.rate <= 1):
            raise ValueError(f"l2 must be at least 0 and rate in (0, 1]: {self}")


XGBOOST_I = BoostSettings(depth=11, trees=140, l2=1.0, rate=0.05)  # Table III, on simulated efficiency
XGBOOST_II = BoostSettings(depth=9, trees=94, l2=0.01, rate=0.1)  # Table III, on measured - XGBoost-I


def design(*inputs: ArrayLike) -> tuple[NDArray[np.float32], tuple[int, ...]]:
    """Rows (N, inputs) of single-precision inputs, and the broadcast shape they came from."""
    columns = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in inputs))
    rows = np.stack([c.ravel() for c in columns], axis=1).astype(np.float32)
    return rows, columns[0].shape


@dataclass(frozen=True, slots=True, kw_only=True)
class LeafBoxes:
    """All leaves of an ensemble: ``low <= x < high`` (L, 3) adds ``value`` (L,) to ``base``."""

    low: Floats
    high: Floats
    value: Floats
    base: float

    def at_power(self, power_W: float) -> Self:
        """The leaves that hold at one power (compared in single precision, as the trees do)."""
        power = np.float64(np.float32(power_W))
        here = (self.low[:, 2] <= power) & (power < self.high[:, 2])
        return type(self)(low=self.low[here], high=self.high[here], value=self.value[here], base=self.base)


class BoostedTrees:
    """One trained ensemble; ``predict`` is deterministic and keeps the shape of its inputs.

    Its inputs are ``FEATURES``, and in their order whatever it was trained with beyond them.
    """

    def __init__(self, booster: "xgboost.Booster", settings: BoostSettings) -> None:
        self.settings = settings
        self._booster = booster
        # One thread predicts: a search asks for some hundred rows at a time, and a team of threads that waits
        # for each other on a busy machine costs far more than it saves. The answer is the same.
        self._booster.set_param({"nthread": 1})

    @classmethod
    def fit(
        cls, inputs: Sequence[ArrayLike], target: ArrayLike, settings: BoostSettings, more: Sequence[str] = ()
    ) -> Self:
        """Train on ``inputs`` = (D1, D2, power_W) and ``target``, all (N,); ``more`` names further inputs.

        Raises ValueError when there is no row, an input has no name, or a number is not finite.
        """
        names = [*FEATURES, *more]
        if len(inputs) != len(names):
            raise ValueError(f"{len(inputs)} inputs for the names {', '.join(names)}")
        rows, _ = design(*inputs)
        y = np.asarray(target, dtype=np.float64).ravel()
        if len(y) == 0 or len(y) != len(rows):
            raise ValueError(
                f"training needs as many targets as inputs, and at least one: {len(y)}, {len(rows)}"
            )
        if not (np.isfinite(rows).all() and np.isfinite(y).all()):
            raise ValueError("training inputs and targets must be finite; drop infeasible points first")
        import xgboost  # here: it takes a second to load, and most verbs grow no trees

        parameters = {
            "objective": "reg:squarederror",
            "tree_method": "exact",  # splits half-way between samples; histograms split on one
            "max_depth": settings.depth,
            "eta": settings.rate,
            "lambda": settings.l2,
            "seed": settings.seed,
            "nthread": settings.threads,
        }
        data = xgboost.DMatrix(rows, y, feature_names=names, nthread=settings.threads)
        return cls(xgboost.train(parameters, data, num_boost_round=settings.trees), settings)

    def predict(self, *inputs: ArrayLike) -> Floats:
        """Sum of all trees at points that broadcast; same shape out."""
        rows, shape = design(*inputs)
        out = self._booster.inplace_predict(rows, validate_features=False)
        return np.asarray(out, dtype=np.float64).reshape(shape)

    def first(self, trees: int) -> Self:
        """The ensemble of the first so many trees: what training would have given that stopped there."""
        if not 1 <= trees <= self.settings.trees:
            raise ValueError(f"trees is {trees}; the ensemble has {self.settings.trees}")
        return type(self)(self._booster[:trees], replace(self.settings, trees=trees))

    def boxes(self) -> LeafBoxes:
        """Every leaf of every tree as a box of (D1, D2, power_W); ValueError for a model of further inputs."""
        if self._booster.num_features() != len(FEATURES):
            raise ValueError(f"boxes are of {', '.join(FEATURES)}; this model has further inputs")
        learner = json.loads(self._booster.save_raw("json"))["learner"]
        trees = learner["gradient_booster"]["model"]["trees"]
        base = float(learner["learner_model_param"]["base_score"].strip("[]"))
        leaves = [_leaves(tree) for tree in trees]
        low, high, value = (np.concatenate(part) for part in zip(*leaves, strict=True))
        return LeafBoxes(low=low, high=high, value=value, base=base)

    def save(self, path: Path) -> None:
        """Write the ensemble as XGBoost's own UBJSON, and its settings beside it (``<path>.json``)."""
        path.write_bytes(self._booster.save_raw("ubj"))  # a full disk is an OSError then, not a trace of C++
        path.with_suffix(".json").write_text(json.dumps(asdict(self.settings), indent=2) + "\n")

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what ``save`` wrote."""
        import xgboost

        settings = BoostSettings(**json.loads(path.with_suffix(".json").read_text()))
        booster = xgboost.Booster()
        booster.load_model(path)
        return cls(booster, settings)


def _leaves(tree: dict[str, list[float]]) -> tuple[Floats, Floats, Floats]:
    """Boxes (low, high) and values of one tree's leaves, walked level by level from the root."""
    left = np.asarray(tree["left_children"], dtype=np.int64)
    right = np.asarray(tree["right_children"], dtype=np.int64)
    feature = np.asarray(tree["split_indices"], dtype=np.int64)
    condition = np.asarray(tree["split_conditions"], dtype=np.float32).astype(np.float64)
    low = np.full((len(left), len(FEATURES)), -np.inf)
    high = np.full((len(left), len(FEATURES)), np.inf)
    level = np.array([0])
    while len(level):
        level = level[left[level] >= 0]
        split, threshold = feature[level], condition[level]
        for child in (left[level], right[level]):
            low[child], high[child] = low[level], high[level]
        high[left[level], split] = np.minimum(high[left[level], split], threshold)
        low[right[level], split] = np.maximum(low[right[level], split], threshold)
        level = np.concatenate([left[level], right[level]])
    leaf = left < 0
    return low[leaf], high[leaf], condition[leaf]
