"""Trials of the learners: one lab, one split, one number of training points; errors on the validation points."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import drivers.mocks.lab
import experiments.study
import models
import sim
from experiments.harness.journal import Journal, code_hash
from experiments.harness.result import POINTS
from experiments.harness.settings import Settings
from experiments.harness.trials import perform
from experiments.study.labs import DENSE_GRID, PAPER_GRID, campaign, grid_table, loads_of, seed_of
from experiments.study.learners import Lesson, learned
from models.accuracy import accuracy_of
from models.boosting import Floats
from models.splits import Split, split_experiment, split_simulation
from models.surrogate import SIMULATION_ONLY


@dataclass(frozen=True, slots=True, kw_only=True)
class LessonTrial:
    """Which learners learn what.

    ``train`` measured points are taken, None for the paper's 40 %; ``dense`` takes 10 % of a grid so dense that they
    are as many simulated points as in Table III. ``points`` is the size of the campaign.
    """

    lab: int
    split: int
    kinds: tuple[str, ...]
    points: int
    train: int | None = None
    dense: bool = False
    folder: Path = field(compare=False)

    @property
    def key(self) -> str:
        """All that the outcome depends on."""
        size = "" if self.train is None else f", {self.train} to train"
        dense = ", dense grid" if self.dense else ""
        return (
            f"lab {self.lab} of {self.points} points, split {self.split}{size}{dense}: {' '.join(self.kinds)}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Of one learner on the validation points, mean absolute, in points of efficiency.

    ``read`` is against the analyzer's readings (the paper's way), ``true`` against what it would show without noise,
    ``accuracy`` the paper's percentage; ``emulation`` of a first stage alone, against the simulator.
    """

    lab: int
    split: int
    kind: str
    train: int
    read: float
    true: float
    accuracy: float
    floor: float
    emulation: float | None = None


def learn(trial: LessonTrial) -> dict[str, Any]:
    """All learners of a trial."""
    table = campaign(trial.folder, trial.lab, trial.points)
    loads = loads_of(table)
    rows = split_experiment(loads, seed=seed_of(trial.split))
    train = rows.train if trial.train is None else _first(rows, trial)
    simulated = training_rows(trial.folder, trial.split, dense=trial.dense)
    judged = loads.iloc[rows.validation].reset_index(drop=True)
    lesson = Lesson(
        simulated=simulated,
        fitted=loads.iloc[train].reset_index(drop=True),
        judged=judged,
        idle=table[table["kind"] != "load"],
        seed=trial.split,
    )
    return {kind: _judged(kind, learned(kind, lesson), judged) for kind in trial.kinds} | {
        "train": len(lesson.fitted),
        "simulated": len(simulated),
        "floor": _mean_abs(judged["efficiency"] - judged["true"]),
    }


def training_rows(folder: Path, split: int, *, dense: bool = False) -> pd.DataFrame:
    """XGBoost-I's training rows: 10 % of the feasible ones of a grid."""
    grid = grid_table(folder, DENSE_GRID if dense else PAPER_GRID)
    feasible = grid[grid["feasible"]].reset_index(drop=True)
    return feasible.iloc[split_simulation(feasible, seed=split).train]


def _first(rows: Split, trial: LessonTrial) -> np.ndarray[Any, np.dtype[np.intp]]:
    """So many of the points that are not for validation, in an order of the split's own."""
    candidates = np.concatenate([rows.train, rows.test])
    return np.random.default_rng([seed_of(trial.split), 22]).permutation(candidates)[: trial.train]


def _judged(kind: str, predicted: Floats, judged: pd.DataFrame) -> dict[str, float | None] | None:
    if not np.isfinite(predicted).any():
        return None
    read = accuracy_of(predicted, judged["efficiency"].to_numpy(dtype=np.float64))
    return {
        "read": POINTS * read.mean_abs,
        "accuracy": 100 * read.percentage,
        "true": _mean_abs(predicted - judged["true"]),
        "emulation": _mean_abs(predicted - judged["simulated"]) if kind == SIMULATION_ONLY else None,
    }


def _mean_abs(difference: Any) -> float:
    return float(POINTS * np.nanmean(np.abs(difference)))


def lessons(name: str, trials: Sequence[LessonTrial], settings: Settings) -> list[Errors]:
    """The errors of every learner in every trial; trials that a journal of that name holds are not run again."""
    code = code_hash(sim, models, drivers.mocks.lab, experiments.study)
    journal = Journal(path=settings.out / f"{name}.jsonl", code=code)
    records = perform(learn, trials, journal, settings)
    return [
        Errors(
            lab=trial.lab, split=trial.split, kind=kind,
            train=record["train"], floor=record["floor"], **record[kind],
        )
        for trial, record in zip(trials, records, strict=True)
        for kind in trial.kinds
        if record[kind] is not None
    ]  # fmt: skip


def of_kind(errors: Sequence[Errors], kind: str) -> list[Errors]:
    """Those of one learner."""
    return [e for e in errors if e.kind == kind]


def mean_and_spread(values: Sequence[float]) -> tuple[float, float]:
    """Mean and standard deviation; of one value, no deviation."""
    array = np.asarray(values, dtype=np.float64)
    return float(array.mean()), float(array.std(ddof=1)) if array.size > 1 else float("nan")


def over_labs(errors: Sequence[Errors], name: str) -> tuple[float, float]:
    """Mean over labs of an error, and the standard deviation between labs."""
    labs = sorted({e.lab for e in errors})
    each = [float(np.mean([getattr(e, name) for e in errors if e.lab == lab])) for lab in labs]
    return mean_and_spread(each)
