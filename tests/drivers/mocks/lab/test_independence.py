"""The lab is a second opinion: near the simulator at nominal parts, and not the same formulas."""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import drivers.mocks.lab
from sim.model import Model
from sim.simulate import Points, Result, simulate
from tests.drivers.mocks.lab.laboratories import nominal, set_points, settled

SHARED = {"sim.parameters", "sim.prototype", "sim.spread", "sim.modulation", "sim.regulation",
          "sim.soft_switching", "sim.steady_state"}  # fmt: skip
FOLDER = Path(drivers.mocks.lab.__file__).parent


@pytest.fixture(scope="module")
def simulated() -> Result:
    D1, D2, power_W = set_points(40)
    return simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W))


@pytest.fixture(scope="module")
def difference_points(simulated: Result) -> np.ndarray:
    """Efficiency of the lab less that of the simulator, in percentage points."""
    _, _, P1_W = settled(nominal())
    return 100 * (simulated["P2_W"] / P1_W - simulated["efficiency"])


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda p: p.name)
def test_it_shares_parameters_modulation_and_the_waveform_solver_only(path: Path) -> None:
    tree = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    imported = {node.module or "" for node in tree if isinstance(node, ast.ImportFrom)}
    assert {name for name in imported if name.startswith("sim")} <= SHARED


def test_the_import_contracts_hold() -> None:
    linter = Path(sys.executable).with_name("lint-imports")
    root = FOLDER.parents[2]
    done = subprocess.run([linter, "--no-cache"], cwd=root, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout[-2000:]


def test_at_nominal_parts_both_agree_to_a_tenth_of_a_point(difference_points: np.ndarray) -> None:
    # two sets of laws through the same datasheet points: 0.1 points are 1 W in 1000
    assert np.abs(difference_points).max() < 0.1


def test_at_nominal_parts_they_differ_by_more_than_the_noise(difference_points: np.ndarray) -> None:
    # noise of one update is 0.01 points
    assert np.std(difference_points) > 0.01


def test_they_run_at_the_same_d0(simulated: Result) -> None:
    now, _, _ = settled(nominal())
    # one waveform solver, other temperatures and switching losses: 1 W through 5 kW per Th
    np.testing.assert_allclose(now.D0, simulated["D0"], atol=1e-3)


def test_they_refuse_the_same_points() -> None:
    rng = np.random.default_rng(2)
    D1, D2, power_W = rng.uniform(0, 1, 200), rng.uniform(0, 1, 200), rng.uniform(200, 2000, 200)
    now, _ = nominal().settled(D1, D2, power_W, np.full(200, 300.0), np.zeros(200))
    feasible = simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W)).feasible
    assert np.mean(now.running == feasible) > 0.98  # a point within 0.3 % of its peak may fall either side
