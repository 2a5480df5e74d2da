"""What the paper's experiments share: labs, campaigns, learners' lessons, the gates of Fig. 2."""

from pathlib import Path

import numpy as np
import pytest

from experiments.fig_02_waveforms import gates
from experiments.fig_07_more_inputs import _rows_of
from experiments.harness.settings import Settings
from experiments.study import labs
from experiments.study.lessons import Errors, over_labs
from experiments.study.modulations import lines
from sim.modulation import outside_modulation


def test_every_lab_hides_two_effects_and_no_two_labs_are_the_same() -> None:
    hidden = [tuple(labs.laboratory(number).hidden) for number in range(labs.LABS)]
    assert all(len(set(names)) == 2 for names in hidden)
    assert len(set(hidden)) == labs.LABS


def test_a_quick_run_has_whole_campaigns_of_three_labs() -> None:
    quick = Settings(out=Path(), scale=0.1)
    assert (len(labs.lab_numbers(quick)), labs.campaign_points(quick)) == (3, 1000)
    assert len(labs.lab_numbers(Settings(out=Path()))) == 12 >= 10


def test_a_campaign_is_measured_once_in_a_folder(small: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    table = labs.campaign(small.out, 0, 160)
    monkeypatch.setattr(labs, "_campaign", lambda *_: pytest.fail("measured again"))
    assert labs.campaign(small.out, 0, 160).equals(table)
    loads = labs.loads_of(table)
    assert len(loads) > 150
    # the noise-free reading is what the readings scatter around, slow drifts of this lab included
    assert (loads["efficiency"] - loads["true"]).abs().mean() < 1e-3


def test_a_mean_over_labs_weighs_labs_alike() -> None:
    def error(lab: int, read: float) -> Errors:
        nothing = {"train": 1, "true": 0.0, "accuracy": 0.0, "floor": 0.0}
        return Errors(lab=lab, split=0, kind="d2ea", read=read, **nothing)  # type: ignore[arg-type]

    mean, spread = over_labs([error(0, 1.0), error(0, 3.0), error(1, 5.0)], "read")
    assert (mean, spread) == (3.5, pytest.approx(np.sqrt(4.5)))


@pytest.mark.parametrize("modulation", ["sps", "dps", "eps"])
def test_candidates_of_a_modulation_are_what_it_has(modulation: str) -> None:
    assert (outside_modulation(modulation, *lines(modulation)) == "").all()


def test_gates_make_the_bridges_voltages() -> None:
    drawn = gates(0.2, 0.7, 0.3, np.linspace(0.0, 2.0, 2000, endpoint=False))
    leg = drawn["S1"] * drawn["S2"] - drawn["S3"] * drawn["S4"]
    other = drawn["S5"] * drawn["S6"] - drawn["S7"] * drawn["S8"]
    vp, vs = (leg - other) / 2, drawn["Q1"] - (1 - drawn["Q4"])
    # of 2000 positions, an edge may be one too early or too late: four edges of each bridge
    assert [np.mean(vp == level) for level in (1, 0, -1)] == pytest.approx([0.35, 0.3, 0.35], abs=2e-3)
    assert [np.mean(vs == level) for level in (1, 0, -1)] == pytest.approx([0.35, 0.3, 0.35], abs=2e-3)


def test_rows_are_told_by_the_power_that_was_set() -> None:
    import pandas as pd

    points = np.array([[0.1, 0.1, 900.0], [0.2, 0.2, 300.0], [0.3, 0.3, 600.0]])
    assert _rows_of(pd.DataFrame({"P_set_W": [600.0, 900.0]}), points).tolist() == [2, 0]
