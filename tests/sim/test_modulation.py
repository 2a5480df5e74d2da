"""Edges and what they make of the bridges' voltages."""

import numpy as np
import pytest

from sim.modulation import centre_offset, hybrid_edges, infeasible_pulse, paper_D0

DEAD = 0.016  # 400 ns of 25 us


def wave(rise: float, time: np.ndarray) -> np.ndarray:
    return np.where(np.mod(time - rise, 2.0) < 1.0, 0.5, -0.5)


@pytest.mark.parametrize(("D0", "D1", "D2"), [(0.2, 0.7, 0.1), (-0.3, 0.4, 0.5), (0.4, 1.0, 0.0)])
def test_pulses_stand_where_the_conventions_say(D0: float, D1: float, D2: float) -> None:
    rises = hybrid_edges(np.array([D0]), np.array([D1]), np.array([D2]))[:, 0]
    time = (np.arange(20000) + 0.5) / 10000
    vp, vs = wave(rises[0], time) + wave(rises[1], time), wave(rises[2], time) + wave(rises[3], time)
    expected_vp = np.where(time < D1, 1.0, 0.0) - np.where((time >= 1) & (time < 1 + D1), 1.0, 0.0)
    place = np.mod(time - D0, 2.0)
    expected_vs = np.where((place >= D2) & (place < 1), 1.0, 0.0) - np.where(place >= 1 + D2, 1.0, 0.0)
    assert np.mean(vp != expected_vp) < 1e-3  # samples that fall on an edge
    assert np.mean(vs != expected_vs) < 1e-3


def test_phase_is_between_the_centres_of_the_pulses() -> None:
    D0, D1, D2 = 0.13, 0.6, 0.2
    centres = D1 / 2, (D0 + D2 + D0 + 1) / 2
    phase = D0 + centre_offset(np.array([D1]), np.array([D2]))
    assert phase.item() == pytest.approx(centres[1] - centres[0])


def test_the_papers_d0_counts_from_the_edge_before_the_zero_state() -> None:
    assert paper_D0(np.array([-0.2]), np.array([0.7])).item() == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("D1", "D2", "says"),
    [
        (0.5, 0.5, ""),
        (1.0, 0.0, ""),
        (DEAD, 1 - DEAD, ""),
        (0.0, 0.5, "primary pulse"),
        (1 - DEAD / 2, 0.5, "primary zero state"),
        (0.5, 1.0, "secondary pulse"),
        (0.5, DEAD / 2, "secondary zero state"),
        (1.01, 0.5, "D1 outside"),
        (0.5, -0.01, "D2 outside"),
    ],
)
def test_what_is_shorter_than_the_dead_time_is_refused(D1: float, D2: float, says: str) -> None:
    reason = infeasible_pulse(np.array([D1]), np.array([D2]), DEAD)[0]
    assert reason.startswith(says)
    assert bool(reason) == bool(says)
