"""Trials of the modulations: in each lab, the best that each of them can do over load.

"Optimal" means best by the lab's own noise-free reading, for every modulation alike: the modulations are compared, not
the models that find their settings. SPS has nothing to choose; DPS and EPS are searched on their lines, TPS and hybrid
on the whole square.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import drivers.mocks.lab
import experiments.study
import models
import sim
from experiments.harness.journal import Journal, code_hash
from experiments.harness.settings import Settings
from experiments.harness.trials import perform
from experiments.study.labs import lab_numbers
from experiments.study.optima import LabItself, Optimum, measured
from models.boosting import Floats
from models.lattice import optimise_on_lattice
from models.optimise import OptimumTable

MODULATIONS = ("hybrid", "sps", "dps", "eps", "tps")
LOADS_W = (200.0, 400.0, 600.0, 800.0, 1000.0, 1200.0, 1400.0, 1600.0, 1800.0)
FEW_LOADS_W = (200.0, 600.0, 1000.0, 1600.0)
# zero states; shorter ones the dead time swallows
_LINE = np.concatenate([[0.0], np.linspace(0.02, 0.9, 89)])


@dataclass(frozen=True, slots=True, kw_only=True)
class ModulationTrial:
    """One lab at some loads."""

    lab: int
    loads_W: tuple[float, ...] = field(default=LOADS_W)

    @property
    def key(self) -> str:
        """All that the outcome depends on."""
        return f"lab {self.lab} at {len(self.loads_W)} loads"


def lines(modulation: str) -> tuple[Floats, Floats]:
    """D1 and D2 that a modulation of one freedom or none allows."""
    if modulation == "sps":
        return np.ones(1), np.zeros(1)
    if modulation == "dps":
        return 1.0 - _LINE, _LINE
    ones = np.ones_like(_LINE)
    return np.concatenate([1.0 - _LINE, ones]), np.concatenate([0.0 * ones, _LINE])


def best_of(lab: int, modulation: str, loads_W: Sequence[float]) -> OptimumTable:
    """The best a modulation can do in a lab."""
    itself, loads = LabItself(lab, modulation), np.array(loads_W)
    if modulation in ("hybrid", "tps"):
        return optimise_on_lattice(itself, loads)
    D1, D2 = lines(modulation)
    shown = itself.predict(D1[None], D2[None], loads[:, None])
    reached = np.asarray(np.isfinite(shown).any(axis=1))
    best = np.where(np.isfinite(shown), shown, -np.inf).argmax(axis=1)
    value = shown[np.arange(loads.size), best]
    return OptimumTable(
        power_W=loads,
        D1=np.where(reached, D1[best], np.nan),
        D2=np.where(reached, D2[best], np.nan),
        predicted=value,
        regret=np.full(loads.size, np.nan),
        confirmed=reached,
        optimiser="every candidate",
        evaluations=D1.size,
    )


def compare(trial: ModulationTrial) -> dict[str, Any]:
    """Every modulation's best in a lab, read there; as plain data."""
    return {
        name: measured(trial.lab, best_of(trial.lab, name, trial.loads_W), modulation=name)
        for name in MODULATIONS
    }


def compared(settings: Settings) -> list[Optimum]:
    """All labs of a run; trials that the journal holds are not run again."""
    loads = LOADS_W if settings.scale >= 1 else FEW_LOADS_W
    trials = [ModulationTrial(lab=lab, loads_W=loads) for lab in lab_numbers(settings)]
    code = code_hash(sim, models, drivers.mocks.lab, experiments.study)
    records = perform(compare, trials, Journal(path=settings.out / "modulations.jsonl", code=code), settings)
    return [
        Optimum(
            lab=trial.lab, method=name, power_W=np.array(trial.loads_W),
            **{column: np.array(values, dtype=np.float64) for column, values in record[name].items()},
        )
        for trial, record in zip(trials, records, strict=True)
        for name in MODULATIONS
    ]  # fmt: skip
