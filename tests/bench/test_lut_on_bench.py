"""A table beside what was measured with it: followed or not, inside its interval or not."""

import numpy as np
import pandas as pd

from bench.lut_on_bench import at_loads, verification, verified
from bench.plan import Kind
from tests.bench.fake_bench import bench_config

GAP = 0.016
TABLE = pd.DataFrame(
    {
        "P_W": [400.0, 800.0],
        "D1": [0.8, 0.9],
        "D2": [0.1, 0.1],
        "predicted": [0.97, 0.98],
        "predicted_low": [0.968, 0.978],
        "predicted_high": [0.972, 0.982],
    }
)


def readings(**columns: list[float]) -> pd.DataFrame:
    given = {"P_set_W": [600.0], "P2_W": [600.0], "D1": [0.85], "D2": [0.1], "efficiency": [0.975]}
    return pd.DataFrame(given | columns).assign(kind="load", u_efficiency=1e-4)


def test_between_rows_a_table_is_a_straight_line() -> None:
    D1, D2 = at_loads(TABLE, np.array([300.0, 500.0, 900.0]), GAP)
    np.testing.assert_allclose(D1, [0.8, 0.825, 0.9])
    np.testing.assert_allclose(D2, 0.1)


def test_every_load_of_a_table_is_measured_and_one_between_each_two() -> None:
    table = pd.DataFrame({"P_W": [400.0, 800.0, 1400.0], "D1": [0.8, 0.9, 0.94], "D2": [0.1, 0.1, 0.06]})
    points = verification(table, bench_config(), name="verify").plan.points
    loads = np.array([(row.power_W, row.D1, row.D2) for row in points if row.kind is Kind.LOAD])
    wanted = [(400, 0.8, 0.1), (600, 0.85, 0.1), (800, 0.9, 0.1), (1100, 0.92, 0.08), (1400, 0.94, 0.06)]
    np.testing.assert_allclose(loads, wanted)


def test_a_controller_that_follows_and_a_measurement_inside() -> None:
    result = verified(TABLE, readings(), GAP)
    assert result.loc[0, "followed"]
    assert result.loc[0, "inside"] == 1.0
    np.testing.assert_allclose(result.loc[0, "predicted"], 0.975)


def test_the_controllers_own_meter_may_differ_a_little() -> None:
    # 2 % of 600 W is 12 W, along the line 0.003 of D1; beside it one PWM count
    assert verified(TABLE, readings(D1=[0.853]), GAP).loc[0, "followed"]
    assert not verified(TABLE, readings(D1=[0.86]), GAP).loc[0, "followed"]


def test_a_measurement_outside_the_interval_is_told() -> None:
    assert verified(TABLE, readings(efficiency=[0.970]), GAP).loc[0, "inside"] == 0.0


def test_a_table_without_predictions_is_only_measured() -> None:
    result = verified(TABLE[["P_W", "D1", "D2"]], readings(), GAP)
    assert "inside" not in result
    assert result.loc[0, "measured"] == 0.975
