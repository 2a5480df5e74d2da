"""A whole campaign of a virtual lab at once: which rows it shows."""

import numpy as np

from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import noise_free_efficiency, schedule, survey


def test_a_row_that_runs_only_while_it_is_cold_is_not_shown() -> None:
    lab = Laboratory.nominal().without_noise()
    power_W = np.arange(2050.0, 2250.0, 0.5)
    warm = noise_free_efficiency(lab, np.ones_like(power_W), np.zeros_like(power_W), power_W)
    most_W = float(power_W[np.isfinite(warm)].max())
    asked_W = most_W * np.array([0.5, 1.0, 1.001, 1.02])  # cold parts carry a few thousandths more
    plan = schedule(np.ones(4), np.zeros(4), asked_W, standby=0, no_load=0)
    assert survey(lab, plan, seed=1)["P_set_W"].tolist() == [asked_W[0], *asked_W[:2]]
