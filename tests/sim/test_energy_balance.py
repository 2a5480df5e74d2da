"""Energy at the feasible points of the grid: terminal waveforms against parts, input less output against all parts."""

import numpy as np
import pytest

from sim.bridges import part_names
from sim.fixed_point import operate
from sim.prototype import prototype
from sim.simulate import Result
from sim.station import OperatingState

BEFORE, BEHIND = part_names(prototype())
IN_CIRCUIT = [k for k in (*BEFORE, *BEHIND) if k.endswith("_conduction")]
IN_CIRCUIT += ["inductor_copper", "transformer_copper", "link_resistance"]


@pytest.fixture(scope="module")
def state(baseline_grid: Result) -> OperatingState:
    every = np.flatnonzero(baseline_grid.feasible)[::5]
    outcome = operate(prototype(), baseline_grid.points.take(every))
    assert outcome.reached.all()
    return outcome.state


def test_what_the_circuit_carries_is_what_its_terminals_lose(state: OperatingState) -> None:
    orbit, losses = state.regulated.orbit, state.balance.losses
    between_W = orbit.input_power_W() - orbit.output_power_W()
    carried_W = sum(losses[part] for part in IN_CIRCUIT)
    # the bar is 1e-6 of P1; closed forms of the same integrals leave rounding and a closing error of 1e-10
    assert np.max(np.abs(between_W - carried_W) / state.balance.P1_W) < 1e-9


def test_input_power_is_that_of_the_terminals_and_lumped_parts(state: OperatingState) -> None:
    losses = state.balance.losses
    lumped = [part for part in BEFORE if part not in IN_CIRCUIT] + ["inductor_core", "transformer_core"]
    P1_W = state.regulated.orbit.input_power_W() + sum(losses[part] for part in lumped)
    assert np.max(np.abs(P1_W / state.balance.P1_W - 1)) < 1e-9


def test_demanded_power_is_what_leaves(state: OperatingState) -> None:
    between_W = state.balance.P1_W - state.balance.P2_W
    lost_W = sum(state.balance.losses.values())
    assert np.max(np.abs(between_W - lost_W) / state.balance.P1_W) < 1e-12
