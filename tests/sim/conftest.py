"""The baseline's whole grid, simulated once."""

import pytest

from sim.model import Model
from sim.simulate import Result, grid, simulate


@pytest.fixture(scope="session")
def baseline_grid() -> Result:
    """The paper's 12,500 points."""
    return simulate(Model.baseline(), grid())
