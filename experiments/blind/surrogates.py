r"""Efficiency models of virtual labs with a known effect, at 0.02 % noise of efficiency.

Scored against what the lab's analyzer would show without noise when the campaign ends (a lab that drifts is not what
it was when it began), at points that were not measured: the calibrated simulator, D²EA, trees on measured points,
trees on simulated points. The calibrated one has points far from each other and, last, where it was not sure of the
optimum (:mod:`experiments.blind.chosen_points`); trees learn from as many random ones. Beside them stands the
noise-limited bound of random points: an estimator that knew all of the lab's own laws, every part's spread and the
instruments' specification, and had nothing to learn but where in them this lab lies, would have the covariance

.. math:: \Sigma = (J^T S^{-1} J + \Lambda^{-1})^{-1}

(Cramér and Rao, with the spreads as prior information), and a mean absolute error of
:math:`\sqrt{2/\pi}` times the standard deviation that it leaves in efficiency.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from bench.training import simulated_table
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import Schedule, noise_free_efficiency, schedule, survey
from experiments.blind.chosen_points import DESIGN, campaign, measured
from experiments.blind.part import Outcome, Part, Run
from experiments.blind.reach import hideable, worked_out
from experiments.blind.seeds import Seeds
from experiments.blind.trial import BlindTrial
from experiments.harness.lab_data import random_set_points
from experiments.harness.result import Cell, Goal, Table
from models.accuracy import accuracy_of
from models.dataset import load_measurements
from models.lattice import optimise_on_lattice
from models.splits import split_simulation
from models.surrogate import (
    CALIBRATED,
    D2EA,
    EXPERIMENT_ONLY,
    SIMULATION_ONLY,
    EfficiencyModel,
    StagedModel,
    train_d2ea,
    train_experiment_only,
    train_simulation_only,
)
from sim.model import Model

Array = NDArray[np.float64]

LABS = 12
SIZES = {40: 0.02, 400: 0.01}  # measured points, and the bar in points of efficiency
REGRET_BAR = 0.01
LOADS_W = np.arange(200.0, 2001.0, 100.0)
_UNSEEN, _BOUND_AT = 300, 60
_NOISE = 4.0  # times the lab's own: 1e-4 at each port, the mean of eight updates, is 0.005 % of efficiency
_UNSEEN_SEED = 31
_POINTS = 100.0
_FLAT = 100.0  # times the range that labs draw from: no prior information on a hidden effect
_TYPICAL = 0.97  # efficiency, where watts are turned into points


@dataclass(frozen=True, slots=True, kw_only=True)
class LabModel:
    """A lab's own noise-free reading, at a time of its campaign, as an efficiency model."""

    lab: Laboratory
    time_s: float = 0.0

    def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Array:
        """Efficiency (N,), NaN where the lab cannot run."""
        a, b, c = (np.asarray(x, dtype=float).ravel() for x in (D1, D2, power_W))
        return noise_free_efficiency(self.lab, a, b, c, time_s=self.time_s)


@lru_cache(maxsize=1)
def _unseen() -> Array:
    return random_set_points(_UNSEEN, np.random.default_rng([_UNSEEN_SEED, 10])).T


@lru_cache(maxsize=1)
def _simulated() -> pd.DataFrame:
    table = simulated_table(Model.baseline())
    return table.iloc[split_simulation(table, seed=DESIGN).train]


def _trees(loaded: pd.DataFrame) -> dict[str, StagedModel]:
    return {
        D2EA: train_d2ea(_simulated(), loaded),
        EXPERIMENT_ONLY: train_experiment_only(loaded),
        SIMULATION_ONLY: train_simulation_only(_simulated()),
    }


def ask_surrogates(trial: BlindTrial) -> dict[str, Any]:
    """Measure a lab with few and with many points, train every kind, and judge each."""
    lab = Laboratory.draw(seed=trial.seed, hidden=dict(trial.hidden))
    noisy = replace(lab, errors=replace(lab.errors, noise=_NOISE))
    unseen, record = _unseen(), dict[str, Any]()
    for size in SIZES:
        plan = campaign(size)
        truth = LabModel(lab=lab, time_s=float(plan.time_s[-1]))
        wanted, best = truth.predict(*unseen), optimise_on_lattice(truth, LOADS_W)
        diagnosis = measured(noisy, size, LOADS_W, seed=trial.seed)
        random = load_measurements(survey(noisy, plan, seed=trial.seed))
        kinds: dict[str, EfficiencyModel] = {CALIBRATED: diagnosis.calibrated, **_trees(random.loaded())}
        errors = {
            kind: _POINTS * accuracy_of(model.predict(*unseen), wanted).mean_abs
            for kind, model in kinds.items()
        }
        record[str(size)] = {
            "error": errors,
            "bound": _linear(size).bound(trial.names[0]),
            "regret": regret(diagnosis.calibrated.vouched(), truth, best.predicted),
            "verdict": diagnosis.verdict.kind,
        }
    return record


def regret(model: EfficiencyModel, truth: LabModel, best: Array) -> dict[str, float | None]:
    """Points of efficiency lost at a model's optimum against the best there is, by the load in W that the lab carries.

    None where it does not carry that load at the model's optimum, or the model has none.
    """
    chosen = optimise_on_lattice(model, LOADS_W)
    there = np.isfinite(chosen.D1)
    got = np.full(LOADS_W.shape, np.nan)
    if np.any(there):
        got[there] = truth.predict(chosen.D1[there], chosen.D2[there], LOADS_W[there])
    lost = zip(LOADS_W, best, _POINTS * (best - got), strict=True)
    return {_named(W): float(x) if np.isfinite(x) else None for W, most, x in lost if np.isfinite(most)}


def _named(load_W: float) -> str:
    """A load as a key of a record."""
    return f"{load_W:g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Linear:
    """A lab of nominal parts, linear in its parts and effects, at measured readings and at unseen points.

    ``seen`` and ``ahead`` are the changes by one sigma of each part, in noise of a reading (K, M) and in points
    of efficiency (K, N); the dictionaries are those of each effect.
    """

    seen: Array
    ahead: Array
    effect_seen: dict[str, Array]
    effect_ahead: dict[str, Array]

    def bound(self, name: str) -> float:
        """The noise-limited mean absolute error in points, with one effect of unknown size."""
        J = np.concatenate([self.seen, _FLAT * self.effect_seen[name]])
        ahead = np.concatenate([self.ahead, _FLAT * self.effect_ahead[name]])
        information = J @ J.T + np.eye(len(J))
        variance = np.sum(ahead * np.linalg.solve(information, ahead), axis=0)
        return float(np.sqrt(2 / np.pi) * np.mean(np.sqrt(variance)))


@lru_cache(maxsize=2)
def _with_unseen(size: int) -> Schedule:
    """A campaign followed by some of the unseen points."""
    D1, D2, power_W = _unseen()[:, :_BOUND_AT]
    more = schedule(D1, D2, power_W, reference_every=10**9, standby=0, no_load=0)
    return campaign(size).followed_by(more)


@lru_cache(maxsize=2)
def _linear(size: int) -> Linear:
    """The linear lab of a campaign, by the trial generator's own directions."""
    base, plan = campaign(size), _with_unseen(size)
    known = worked_out(plan)
    time_s = known.index.get_level_values(0).to_numpy()
    seen = time_s <= base.time_s[-1]
    asked = ~seen & (known.index.get_level_values(1) == "P1_W").astype(bool)
    power = pd.Series(plan.power_W, index=plan.time_s).reindex(time_s[asked]).to_numpy()
    per_W = _POINTS * _TYPICAL**2 / power  # efficiency is P2/P1
    sigma = _NOISE * known.sigma[seen]
    parts = known.nuisance[:-1]  # the last is the difference of laws, which is no part
    return Linear(
        seen=parts[:, seen] / sigma,
        ahead=parts[:, asked] * per_W,
        effect_seen={name: plane[:, seen] / sigma for name, plane in known.effects.items()},
        effect_ahead={name: plane[:, asked] * per_W for name, plane in known.effects.items()},
    )


def labs(seeds: Seeds) -> Iterator[BlindTrial]:
    """Labs with one effect each, as many different ones as there are labs."""
    names = hideable()
    for k, seed in enumerate(seeds.of("surrogate")):
        name = names[(5 * k + 1) % len(names)]
        value = Laboratory.draw(seed=seed, hidden={name: None}).hidden[name]
        yield BlindTrial(row="surrogate", seed=seed, hidden=((name, value),))


def _surrogate(run: Run) -> Outcome:
    done = run.records(labs, LABS, ask_surrogates, lambda trial: tuple(map(_with_unseen, SIZES)))
    goals, rows = [], []
    for size, bar in SIZES.items():
        records = [record[str(size)] for _, record in done]
        error = float(np.mean([r["error"][CALIBRATED] for r in records]))
        lost, not_carried = _lost(records)
        goals += [
            _goal(
                f"surrogate: calibrated, {size} measured points, mean error ({len(done)} labs)", error, bar
            ),
            _goal(
                f"surrogate: lost at its optimum, {size} points, worst load and lab", max(lost), REGRET_BAR
            ),
            Goal(
                name=f"surrogate: loads that the lab does not carry at its optimum, {size} points",
                value=float(not_carried),
                bar=0.0,
                at_least=False,
            ),
        ]
        rows += [_row(size, kind, records) for kind in (CALIBRATED, D2EA, EXPERIMENT_ONLY, SIMULATION_ONLY)]
        bound = [r["bound"] for r in records]
        rows.append((size, "noise-limited bound", float(np.mean(bound)), max(bound), None, None))
    columns = (
        "measured points", "model", "mean error, points", "worst lab", "mean loss at optimum", "worst loss",
    )  # fmt: skip
    by_lab = Table(
        title="Calibrated, lab by lab",
        columns=("hidden", "seed", "verdict, 40 points", "error", "verdict, 400 points", "error, 400"),
        rows=tuple(
            (
                t.names[0], t.seed, r["40"]["verdict"], r["40"]["error"][CALIBRATED],
                r["400"]["verdict"], r["400"]["error"][CALIBRATED],
            )
            for t, r in done
        ),
    )  # fmt: skip
    table = Table(title="Efficiency models of labs with a known effect", columns=columns, rows=tuple(rows))
    return Outcome(goals=tuple(goals), tables=(table, by_lab, _by_load(done)))


def _goal(name: str, value: float, bar: float) -> Goal:
    return Goal(name=name, value=value, bar=bar, at_least=False, unit="points")


def _lost(records: Sequence[dict[str, Any]]) -> tuple[list[float], int]:
    """Points lost at the optimum over labs and loads, and how many of those could not be run there."""
    found = [x for r in records for x in r["regret"].values()]
    lost = [x for x in found if x is not None]
    return lost or [float("nan")], len(found) - sum(x is not None for x in found)


def _by_load(done: Sequence[tuple[BlindTrial, dict[str, Any]]]) -> Table:
    """Of each load the points lost in the lab that lost most, and which that was."""
    rows: list[tuple[Cell, ...]] = []
    for power_W in LOADS_W.tolist():
        row: tuple[Cell, ...] = (power_W,)
        for size in SIZES:
            found = [(record[str(size)]["regret"].get(_named(power_W)), trial) for trial, record in done]
            known = [(lost, trial) for lost, trial in found if lost is not None]
            lost, trial = max(known, key=lambda pair: pair[0], default=(None, None))
            row += (lost, trial.names[0] if trial else None, trial.seed if trial else None)
        rows.append(row)
    columns = [f"{name}, {size} points" for size in SIZES for name in ("lost", "hidden", "seed")]
    return Table(
        title="Lost at the optimum, the worst lab of each load",
        columns=("load, W", *columns),
        rows=tuple(rows),
    )


def _row(size: int, kind: str, records: Sequence[dict[str, Any]]) -> tuple[Cell, ...]:
    errors = [r["error"][kind] for r in records]
    lost = _lost(records)[0] if kind == CALIBRATED else []
    tail = (float(np.mean(lost)), max(lost)) if lost else (None, None)
    return size, kind, float(np.mean(errors)), max(errors), *tail


SURROGATE_PART = Part(
    name="surrogate", says="efficiency models of labs with a known effect, and their optima", run=_surrogate
)
