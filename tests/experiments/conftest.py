"""One folder for all experiments of a test run, so that grids and campaigns are made once."""

from types import SimpleNamespace

import numpy as np
import pytest

from experiments.harness.settings import Settings
from experiments.study import learners, optima
from models.surrogate import SimulatorStage
from sim.model import Model
from sim.simulate import Points, simulate


def _simulated(D1: np.ndarray, D2: np.ndarray, power_W: np.ndarray) -> np.ndarray:
    return simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W))["efficiency"]


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """The smallest run of an experiment: two labs, 160 points each, in this process."""
    return Settings(out=tmp_path_factory.mktemp("experiments"), scale=0.001, processes=1)


@pytest.fixture
def instant_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulator stands in for the calibrated physics: the diagnosis has tests of its own, and takes its time."""
    found = SimpleNamespace(calibrated=SimulatorStage(_simulated))
    for module in (learners, optima):
        monkeypatch.setattr(module, "diagnose", lambda *_, **__: found)
