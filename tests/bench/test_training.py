"""Training: for another converter than the prototype at its own voltages and powers, and how it is told."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.commands.learn import judged_text
from bench.model_file import read_model
from bench.optimum import loads_of
from bench.training import NotTrained, Trainer, efficiency_of, feasible_of, simulated_table
from bench.training_data import TrainingData
from models.accuracy import accuracy_of
from models.dataset import Measurements
from models.lut import Surroundings
from models.surrogate import SimulatorStage, StagedModel
from sim.model import Model
from sim.operating_points import Points
from sim.simulate import simulate

# 400 V, 48 V, 1.5 kW
TWO_LEVEL = Path(__file__).resolve().parents[2] / "docs" / "examples" / "two_level_dab.toml"


@pytest.fixture(scope="module")
def other() -> Model:
    return read_model(TWO_LEVEL)


def test_another_converter_is_simulated_at_its_own_voltages(other: Model) -> None:
    place = np.array([0.9]), np.array([0.1]), np.array([900.0])
    expected = simulate(other, Points(D1=0.9, D2=0.1, power_W=900.0, V1_V=400.0, V2_V=48.0))
    assert expected.feasible.all()
    assert efficiency_of(other)(*place).tolist() == expected["efficiency"].tolist()
    assert feasible_of(other)(*place).all()
    predicted, _ = Surroundings(model=Predicting(), simulator=other).ask(*place)
    assert np.isfinite(predicted).all()


class Predicting:
    """A model that predicts the same everywhere: what is not NaN in a table is what the simulator carries."""

    def predict(self, D1, D2, power_W):
        return np.full(np.shape(power_W), 0.9)


def test_powers_go_from_a_tenth_of_the_rated_one_to_all_of_it(other: Model) -> None:
    table = simulated_table(other, (5, 5, 3))
    assert set(table["power_W"]) <= {150.0, 825.0, 1500.0}
    assert loads_of(other)[0] == pytest.approx(150.0, rel=1e-15)  # a tenth rounds
    assert loads_of(Model.baseline()) == tuple(float(power_W) for power_W in range(200, 2001, 100))


def test_points_without_a_prediction_are_told() -> None:
    truth = np.array([0.95, 0.96, 0.97])
    assert judged_text(accuracy_of(truth, truth)) == "3"
    assert judged_text(accuracy_of(np.array([0.95, np.nan, 0.97]), truth)) == "2 of 3"


def beyond(count: int) -> TrainingData:
    """Rows of more power than the simulation carries at their D1 and D2."""
    rows = pd.DataFrame({"D1": np.linspace(0.3, 0.4, count), "D2": 0.55, "P2_W": 1800.0, "kind": "load"})
    rows = rows.assign(efficiency=0.97, P1_W=rows["P2_W"] / 0.97)
    read = Measurements(frame=rows, rows=tuple(range(1, count + 1)), rejected=(), notes=())
    return TrainingData.of_file(Path("theirs.csv"), read)


def test_a_model_that_predicts_none_of_the_rows_that_judge_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulator = StagedModel(kind="calibrated", stages=(SimulatorStage(efficiency_of(Model.baseline())),))
    monkeypatch.setattr(Trainer, "fit", lambda *_: simulator)
    trainer = Trainer(simulator=Model.baseline(), simulated=pd.DataFrame())
    with pytest.raises(
        NotTrained, match="no calibrated model: it predicts none of the 12 rows that judge it"
    ):
        trainer.judged("calibrated", beyond(30), seed=1)


def test_a_gap_to_a_simulation_that_predicts_no_row_cannot_be_learnt() -> None:
    trainer = Trainer(simulator=Model.baseline(), simulated=pd.DataFrame())
    with pytest.raises(NotTrained, match="the simulation predicts none of the 30 rows to fit"):
        trainer.fit("simulator_first_stage", beyond(30), np.arange(30))
