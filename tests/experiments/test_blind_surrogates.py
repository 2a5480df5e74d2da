"""How efficiency models of labs are judged: what is lost at their optima, load by load, and where they measure."""

from dataclasses import dataclass
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.distance import pdist

from drivers.mocks.lab.laboratory import Laboratory
from experiments.blind import chosen_points
from experiments.blind.surrogates import LOADS_W, SURROGATE_PART, regret
from experiments.blind.trial import BlindTrial
from experiments.harness.lab_data import random_set_points
from models.dataset import Measurements


def test_a_load_that_is_not_carried_at_the_optimum_is_a_miss_of_its_own() -> None:
    """It is counted, the other loads' losses are told all the same, and a load that a lab never carries is none."""
    models = dict.fromkeys(("calibrated", "d2ea", "experiment_only", "simulation_only"), 0.005)
    lost: dict[str, float | None] = {f"{load_W}": 0.004 for load_W in range(200, 2000, 100)} | {"300": None}
    record = {"error": models, "bound": 0.003, "regret": lost, "verdict": "named"}
    weaker = record | {"regret": {name: x for name, x in lost.items() if x is not None and int(name) < 1800}}
    labs = [
        BlindTrial(row="surrogate", seed=seed, hidden=((name, 0.5),))
        for seed, name in ((1, "skin_effect"), (2, "leakage_inductance"))
    ]

    class Finished:
        def records(self, *_: object) -> list[tuple[BlindTrial, dict[str, Any]]]:
            many = record | {"regret": dict.fromkeys(lost, 0.001)}
            return [(labs[0], {"40": record, "400": many}), (labs[1], {"40": weaker, "400": weaker})]

    outcome = SURROGATE_PART.run(Finished())  # type: ignore[arg-type]
    goals = {goal.name: goal for goal in outcome.goals}
    stopped = "surrogate: loads that the lab does not carry at its optimum, {} points"
    assert goals[stopped.format(40)].value == 1
    assert not goals[stopped.format(40)].met
    assert goals[stopped.format(400)].met
    assert goals["surrogate: lost at its optimum, 40 points, worst load and lab"].value == 0.004
    by_load = {row[0]: row[1:] for row in outcome.tables[-1].rows}
    assert by_load[400.0][3:] == (0.004, "leakage_inductance", 2)
    assert by_load[1900.0][3:] == (0.001, "skin_effect", 1)
    assert by_load[2000.0] == (None,) * 6


def test_what_a_model_loses_is_told_of_the_loads_that_the_lab_carries() -> None:
    @dataclass(frozen=True)
    class Hill:
        """Efficiency with its top at a D1, up to a power; below it the model has nothing from a power on."""

        top: float
        most_W: float

        def predict(self, D1: Any, D2: Any, power_W: Any) -> Any:
            value = 0.97 - (np.asarray(D1) - self.top) ** 2 - np.asarray(D2) ** 2
            return np.where(np.asarray(power_W) <= self.most_W, value, np.nan)

    truth, timid = Hill(0.6, 1800.0), Hill(0.65, 1500.0)
    best = np.where(LOADS_W <= 1800.0, 0.97, np.nan)
    lost = regret(timid, truth, best)  # type: ignore[arg-type]
    assert list(lost) == [f"{load_W:g}" for load_W in LOADS_W if load_W <= 1800.0]
    assert [name for name, x in lost.items() if x is None] == ["1600", "1700", "1800"]
    assert lost["1000"] == pytest.approx(0.25, abs=0.02)  # points: the lattice's last steps are 0.0013 apart


def test_a_campaign_begins_far_apart_and_goes_on_where_the_optimum_is_decided(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = list[Measurements]()

    @dataclass(frozen=True)
    class Decided:
        """What is told of every table: the same place decides."""

        place = np.array([[0.7, 0.2, 600.0]])

        @classmethod
        def of(cls, *_: object) -> "Decided":
            return cls()

        def chosen(self, count: int) -> list[int]:
            return [0] * count

    def noted(measurements: Measurements) -> SimpleNamespace:
        asked.append(measurements)
        return SimpleNamespace(calibrated=SimpleNamespace(worth_a_try=lambda loads_W: np.empty((0, 3))))

    monkeypatch.setattr(chosen_points, "RivalHills", Decided)
    monkeypatch.setattr(chosen_points, "diagnose", noted)
    chosen_points.measured(Laboratory.draw(seed=5), 14, LOADS_W, seed=5)
    tables = [m.loaded() for m in asked]
    # a reference with the first and with the ninth
    assert [len(table) for table in tables] == [4, 5, 6, 7, 8, 9, 11, 12, 13, 14]
    place = tables[-1].loc[tables[-1]["kind"] == "load", ["D1", "D2", "P_set_W"]].to_numpy()
    np.testing.assert_allclose(
        place[3:], np.tile(Decided.place, (9, 1)), atol=5e-4
    )  # counts of the modulator
    first, random = place[:3], random_set_points(3, np.random.default_rng(6))
    span = (0.7, 0.6, 1800.0)
    assert pdist(first / span).min() > 2 * pdist(random / span).min()
    for earlier, later in pairwise(asked):  # what was read stays as it was
        pd.testing.assert_frame_equal(earlier.frame, later.frame.iloc[: len(earlier.frame)])
