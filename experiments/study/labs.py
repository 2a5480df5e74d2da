"""The virtual labs of the study, their campaigns, and the simulated grids; each made once in a folder.

Twelve labs, each with two effects of the catalogue hidden in it, drawn at random with their values, every part off
by its everyday tolerance: no conclusion shall hang on one plant. A campaign is the paper's: 1000 set points in the
ranges of Table II, of those that the baseline simulation can carry, in random order, at the paper's pace.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import drivers.mocks.lab
import sim
from drivers.mocks.lab.hidden import HIDDEN
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import Schedule, noise_free_efficiency, schedule, survey
from experiments.harness.journal import code_hash
from experiments.harness.settings import Settings
from models.screening import LOADED_KINDS
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.simulate import Points, grid, simulate

Array = NDArray[np.float64]

FIRST_SEED = 400_000
LABS, LEAST_LABS = 12, 2
EFFECTS_A_LAB = 2
CAMPAIGN_POINTS, LEAST_POINTS = 1000, 160
FULL_CAMPAIGN_SCALE = 0.1  # from here on every campaign has all its points
CAMPAIGN_S = 9 * 3600 + 17 * 60  # Table V: all data of the paper
REFERENCE_EVERY = 12
SUPPLY_V = 300.0
PAPER_GRID = (25, 25, 20)
DENSE_GRID = (35, 35, 26)  # of which about 12,500 points are feasible
POWER_RANGE_W = (200.0, 2000.0)

ASSUMED = (
    "where the 1000 measured points lie: at random in Table II's ranges, where the simulation can carry the power",
    "what makes the prototype differ from its simulation: two effects drawn at random in each lab, tolerances of all "
    "parts, instruments inside their specification",
)


def lab_numbers(settings: Settings) -> range:
    """The labs of a run: all twelve, or a share, two at the least."""
    return range(min(LABS, LEAST_LABS + round((LABS - LEAST_LABS) * settings.scale)))


def campaign_points(settings: Settings) -> int:
    """Set points of a campaign: the paper's 1000, fewer only in a run thinned beyond the quick one."""
    return max(LEAST_POINTS, round(CAMPAIGN_POINTS * min(1.0, settings.scale / FULL_CAMPAIGN_SCALE)))


def seed_of(number: int) -> int:
    """The seed of a lab."""
    return FIRST_SEED + number


@cache
def laboratory(number: int) -> Laboratory:
    """The lab of a number, with what its seed hides in it."""
    rng = np.random.default_rng([seed_of(number), 20])
    names = sorted(set(CATALOGUE) & set(HIDDEN))
    chosen = rng.choice(names, EFFECTS_A_LAB, replace=False)
    return Laboratory.draw(seed=seed_of(number), hidden={str(name): None for name in chosen})


def set_points(count: int, rng: np.random.Generator) -> Array:
    """Rows (count, 3) of D1, D2, power_W, uniform in Table II's ranges where the baseline can run."""
    found = np.empty((0, 3))
    while len(found) < count:
        D1, D2, power_W = rng.random(4 * count), rng.random(4 * count), rng.uniform(*POWER_RANGE_W, 4 * count)
        runs = simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W)).feasible
        found = np.concatenate([found, np.stack([D1, D2, power_W], axis=1)[runs]])
    return found[:count]


def paced(plan: Schedule) -> Schedule:
    """A schedule over the hours that the paper took for all its data."""
    return replace(plan, time_s=np.linspace(0.0, CAMPAIGN_S, plan.time_s.size))


def measured_at(number: int, points: Array, *, seed: int, modulation: str = "hybrid") -> pd.DataFrame:
    """A lab's readings at (D1, D2, power_W) rows, all at one time; rows that cannot run are absent."""
    plan = schedule(*points.T, standby=0, no_load=0, reference_every=len(points) + 1)
    at_once = replace(plan, time_s=np.zeros(plan.time_s.size))
    table = survey(laboratory(number).driven_by(modulation), at_once, seed=seed)
    return table[table["kind"] == "load"].reset_index(drop=True)


def true_efficiency(number: int, points: Array, *, time_s: float = 0.0, modulation: str = "hybrid") -> Array:
    """What the lab's analyzer would show without noise, (N,); NaN where it cannot run."""
    D1, D2, power_W = points.T
    lab = laboratory(number).driven_by(modulation)
    return noise_free_efficiency(lab, D1, D2, power_W, supply_V=SUPPLY_V, time_s=time_s)


def campaign(folder: Path, number: int, points: int) -> pd.DataFrame:
    """The measurement table of a lab's campaign, with three columns more where something is loaded.

    ``simulated`` is the baseline's efficiency at the applied D1, D2 and the measured power, ``true`` what the analyzer
    would show there without noise half-way through the campaign, ``set_point`` tells the plan's points from each other.
    """
    return _kept(folder, f"lab-{number}-{points}", lambda: _campaign(number, points))


def loads_of(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of the plan's own points that can be compared."""
    usable = (table["kind"] == "load") & table["simulated"].notna() & table["true"].notna()
    return table[usable].reset_index(drop=True)


def grid_table(folder: Path, shape: tuple[int, int, int] = PAPER_GRID) -> pd.DataFrame:
    """The baseline on a grid: every point, with ``feasible`` and the columns of a simulation."""
    name = "grid-" + "x".join(map(str, shape))
    return _kept(folder, name, lambda: pd.DataFrame(simulate(Model.baseline(), grid(shape)).columns()))


def _campaign(number: int, points: int) -> pd.DataFrame:
    chosen = set_points(points, np.random.default_rng([seed_of(number), 21]))
    plan = paced(schedule(*chosen.T, reference_every=REFERENCE_EVERY))
    table = survey(laboratory(number), plan, seed=seed_of(number))
    loaded = table["kind"].isin(LOADED_KINDS).to_numpy()
    rows = table.loc[loaded, ["D1", "D2", "P2_W"]].to_numpy(dtype=np.float64)
    D1, D2, power_W = rows.T
    table[["simulated", "true"]] = np.nan
    table.loc[loaded, "simulated"] = simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W))[
        "efficiency"
    ]
    set_W = table.loc[loaded, "P_set_W"].to_numpy(dtype=np.float64)
    table.loc[loaded, "true"] = true_efficiency(
        number, np.stack([D1, D2, set_W], axis=1), time_s=CAMPAIGN_S / 2
    )
    return table


def _kept(folder: Path, name: str, make: Callable[[], pd.DataFrame]) -> pd.DataFrame:
    """What this code made under that name before, or made now; two processes may both make it."""
    path = folder / "shared" / f"{name}-{_code()}.parquet"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_suffix(f".{os.getpid()}.part")
        make().to_parquet(beside)
        os.replace(beside, path)
    return pd.read_parquet(path)


@cache
def _code() -> str:
    import experiments.study.labs as own

    return code_hash(sim, drivers.mocks.lab, own)
