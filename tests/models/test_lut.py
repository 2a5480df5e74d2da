"""A table of D1 and D2 over load: what lies between its rows holds too."""

import numpy as np
import pandas as pd
import pytest

from models.feasibility import edge_gap_of
from models.lut import DIP, Surroundings, check_lines, make_lut, makeable
from models.optimise import OptimumTable
from sim.model import Model
from sim.modulation import EDGES
from sim.operating_points import Points
from sim.simulate import simulate

SIMULATOR = Model.baseline()


class TwoHills:
    """Efficient with narrow pulses, and with wide ones at more power; bad in between."""

    def predict(self, D1, D2, power_W):
        narrow, wide = 0.98 - 0.2 * np.abs(D1 - 0.45), 0.975 - 0.2 * np.abs(D1 - 0.9)
        return np.maximum(narrow - 1e-5 * power_W, wide)


AROUND = Surroundings(model=TwoHills(), simulator=SIMULATOR)


def optimum(power_W, D1, D2):
    """A table of optima as a search leaves it."""
    power_W, D1, D2 = (np.array(x, dtype=float) for x in (power_W, D1, D2))
    nothing = np.full(len(power_W), np.nan)
    return OptimumTable(
        power_W=power_W,
        D1=D1,
        D2=D2,
        predicted=nothing,
        regret=nothing,
        confirmed=np.isfinite(D1),
        optimiser="given",
        evaluations=0,
    )


@pytest.fixture(scope="module")
def jumping():
    """Optima that jump to and fro between the hills, and a load that nothing carries."""
    return make_lut(optimum([300, 400, 500, 600, 2500], [0.45, 0.9, 0.45, 0.9, np.nan], [0.0] * 5), AROUND)


def test_loads_that_nothing_carries_are_left_out(jumping):
    assert jumping.left_out_W == (2500.0,)
    assert jumping.power_W.tolist() == [300.0, 400.0, 500.0, 600.0]


class Absurd:
    """Sure of more power out than in, but with narrow pulses below 550 W."""

    def predict(self, D1, D2, power_W):
        return np.where((D1 < 0.5) & (power_W < 550.0), 0.97, 1.2)


def test_loads_that_no_candidate_carries_are_left_out():
    around = Surroundings(model=Absurd(), simulator=SIMULATOR)
    table = make_lut(optimum([300, 400, 500, 600, 700], [0.45, 0.45, 0.45, 0.9, 0.9], [0.0] * 5), around)
    assert table.power_W.tolist() == [300.0, 400.0, 500.0]
    assert table.left_out_W == (600.0, 700.0)
    assert np.isfinite(table.predicted).all()
    assert np.isfinite(table.price).all()
    with pytest.raises(ValueError, match="1 of 3 loads can be carried"):
        make_lut(optimum([500, 600, 700], [0.45, 0.9, 0.9], [0.0] * 3), around)


def test_no_line_is_unsound_where_a_table_without_one_exists(jumping):
    assert jumping.unsound == ()
    assert len(jumping.lines) == 3
    assert np.ptp(jumping.D1) == 0


def test_the_optima_by_themselves_would_have_been_unsound():
    rows = pd.DataFrame({"P_W": [300.0, 400.0, 500.0], "D1": [0.45, 0.9, 0.45], "D2": 0.0})
    lines = check_lines(rows, AROUND)
    assert all(line.dip > DIP and not line.sound for line in lines)
    assert "dips" in str(lines[0])


def test_a_line_to_where_no_power_is_carried_is_told():
    rows = pd.DataFrame({"P_W": [400.0, 1900.0], "D1": [0.9, 0.3], "D2": [0.0, 0.6]})
    (line,) = check_lines(rows, AROUND)
    assert not line.carries
    assert "power is not carried" in str(line)


def test_an_edge_that_is_soft_at_both_ends_only_is_told():
    zvs = lambda D1, D2, power_W: AROUND.ask(*(np.array([x]) for x in (D1, D2, power_W)))[1][0]  # noqa: E731
    ends = zvs(0.5, 0.0, 900.0) & zvs(0.5, 0.5, 1000.0)
    rows = pd.DataFrame({"P_W": [900.0, 1000.0], "D1": [0.5, 0.5], "D2": [0.0, 0.5]})
    lost = np.zeros_like(ends)
    for share in np.linspace(0.1, 0.9, 9):
        lost |= ends & ~zvs(0.5, 0.5 * share, 900 + 100 * share)
    (line,) = check_lines(rows, AROUND)
    assert [edge in line.lost_edges for edge in EDGES] == lost.tolist()


def test_rows_between_which_nothing_happens_are_kept():
    given = optimum([800, 900, 1000], [0.9, 0.92, 0.94], [0.0, 0.0, 0.0])
    table = make_lut(given, AROUND, half_width=0.002)
    # the rows may swap among neighbours where that is predicted to be better, by less than they may lose
    assert table.unsound == ()
    frame = table.frame()
    np.testing.assert_allclose(frame["predicted_high"] - frame["predicted_low"], 0.004, rtol=1e-9)


def test_one_load_is_no_table():
    with pytest.raises(ValueError, match="1 of 2 loads can be carried; a table needs two"):
        make_lut(optimum([500, 2500], [0.9, np.nan], [0.0, np.nan]), AROUND)


def test_a_prediction_above_one_is_not_believed():
    class Dreamer:
        def predict(self, D1, D2, power_W):
            return np.full(np.shape(D1), 1.02)

    value, _ = Surroundings(model=Dreamer(), simulator=SIMULATOR).ask(
        *(np.array([x]) for x in (0.9, 0.0, 500.0))
    )
    assert np.isnan(value[0])


def test_what_a_controller_can_make_is_what_the_simulator_can_run():
    gap = edge_gap_of(SIMULATOR)
    D1, D2 = makeable(np.linspace(0.97, 1.0, 61), np.linspace(0.0, 0.03, 61), gap)
    zero_states = np.concatenate([1 - D1, D2])
    assert np.all((zero_states == 0) | (zero_states >= gap - 1e-12))
    assert simulate(SIMULATOR, Points(D1=D1, D2=D2, power_W=np.full(61, 500.0))).feasible.all()


def test_a_zero_state_neither_comes_nor_goes_along_a_line():
    rows = pd.DataFrame({"P_W": [500.0, 600.0, 700.0], "D1": 0.9, "D2": [0.0, 0.02, 0.03]})
    first, second = check_lines(rows, AROUND)
    assert first.zero_state_appears
    assert not first.sound
    assert second.sound


def test_rows_with_and_without_a_zero_state_are_not_mixed():
    class Undecided:
        """At one load a zero state is better, at the others none."""

        def predict(self, D1, D2, power_W):
            return 0.97 + 0.9 * DIP * ((D2 > 0) == (np.abs(power_W - 600) < 50))

    around = Surroundings(model=Undecided(), simulator=SIMULATOR)
    chosen = make_lut(optimum([500, 600, 700], [0.9, 0.9, 0.9], [0.0, 0.3, 0.0]), around)
    assert chosen.D2.tolist() == [0.0, 0.0, 0.0]
    assert chosen.unsound == ()


def test_a_zero_state_that_a_longer_dead_time_swallows_is_not_used():
    gap = edge_gap_of(SIMULATOR)
    value, _ = AROUND.ask(np.array([0.9, 0.9]), np.array([1.05 * gap, 1.15 * gap]), np.array([500.0, 500.0]))
    assert np.isnan(value).tolist() == [True, False]
