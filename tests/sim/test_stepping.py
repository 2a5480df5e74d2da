"""The converter stepped through time: charge, energy and symmetry, and the exact orbit by another way."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.model import Model
from sim.operating_points import Points
from sim.parameters import ParameterError
from sim.solved import solve_points
from sim.stepping import Output, Settled, Stepper, Steps, at_rest, settle
from tests.sim.orbits import Case, random_case, solve

Array = NDArray[np.float64]
COARSE = Steps(in_dead_time=60, in_half_period=150)


@pytest.fixture(scope="module")
def settled() -> tuple[Case, Settled]:
    """Points over the whole rising branch, settled from rest."""
    case = random_case(24, seed=31)
    return case, settle(Stepper(circuit=case.circuit, steps=COARSE), case.edges)


def test_every_point_closes_from_rest(settled: tuple[Case, Settled]) -> None:
    assert np.max(settled[1].open_A) < 1e-5  # where the settling stops


def test_the_energy_that_enters_leaves_or_heats(settled: tuple[Case, Settled]) -> None:
    case, s = settled
    c, i = case.circuit, s.trace.current_A
    into, out = s.input_W, s.output_W(c.turns_ratio)
    path = np.where(np.abs(s.trace.vp_V) <= 0.5 * c.V1_V, 2, np.where(s.trace.vp_V * i > 0, 0, 1))
    V0, R = (np.choose(path, [c.forward[k], c.reverse[k], c.zero[k]]) for k in (0, 1))
    im = s.trace.magnetizing_A
    dropped_V = np.sign(i) * V0 + R * i - c.behind_Ohm * im
    across_V = s.trace.vp_V - c.turns_ratio * s.trace.vs_V - dropped_V  # the inductor's
    resisted = R * i**2 + c.behind_Ohm * ((i - im) ** 2 - i**2)
    heat = s.trace.mean(V0 * np.abs(i) + resisted + c.eddy_s * across_V**2 / c.inductance_H)
    # a current that passes zero has the wrong drop for a part of a step of 170 ns
    np.testing.assert_allclose(into - out, heat, atol=0.02)


def test_the_exact_orbit_has_the_same_current(settled: tuple[Case, Settled]) -> None:
    case, s = settled
    # 5 mA are 4 ns of 300 V: what an equivalent step of a hundred ns may miss
    np.testing.assert_allclose(s.rms_A, case.rms_A, rtol=1e-3, atol=5e-3)


def test_halved_steps_change_nothing_that_counts() -> None:
    case = random_case(6, seed=32)
    coarse, fine = (
        settle(Stepper(circuit=case.circuit, steps=steps), case.edges)
        for steps in (Steps(), Steps(in_dead_time=320, in_half_period=800))
    )
    np.testing.assert_allclose(coarse.rms_A, fine.rms_A, rtol=3e-4)  # a third of the bar for the comparison


def test_without_load_the_capacitor_takes_what_the_bridge_delivers() -> None:
    case = solve(np.array([0.8]), np.array([0.1]), np.array([0.2]))
    stepper = Stepper(circuit=case.circuit, output=Output(capacitance_F=1e-3), steps=COARSE)
    start = at_rest(case.circuit, case.edges)
    until = case.circuit.half_period_s
    end, trace = stepper.run(start, until, np.mod(case.edges, 1.0) * until)
    into_A = case.circuit.turns_ratio * (trace.current_A - trace.magnetizing_A)
    delivered = trace.mean(trace.vs_V * into_A) * until
    gained = 0.5e-3 * (end.output_V**2 - start.output_V**2)
    np.testing.assert_allclose(gained, delivered, rtol=1e-4)  # Heun's rule in steps of 170 ns


def test_a_load_draws_constant_power() -> None:
    output = Output(capacitance_F=1e-3, load_W=1400.0)
    assert output.slope(np.array([0.0]), np.array([140.0])) == pytest.approx(-1e4)


def test_the_state_half_a_period_earlier_is_the_mirror() -> None:
    case = solve(np.array([0.8]), np.array([0.1]), np.array([0.2]))
    state = replace(at_rest(case.circuit, case.edges), link_A=np.array([2.0]))
    twice = state.mirrored(case.circuit.half_period_s).mirrored(case.circuit.half_period_s)
    assert twice.link_A == pytest.approx(2.0)
    assert twice.time_s == pytest.approx(-2 * case.circuit.half_period_s)


def test_too_few_nodes_are_refused() -> None:
    with pytest.raises(ParameterError, match="at least 2 nodes"):
        Steps(in_dead_time=1)


def test_a_saturating_inductor_has_the_exact_orbit_too() -> None:
    model = Model.baseline().with_effect("inductor_saturation", relative_drop=0.3)
    solved = solve_points(model, Points(D1=np.array([1.0, 0.9]), D2=0.05, power_W=np.array([1900.0, 1500.0])))
    plain = solve_points(Model.baseline(), solved.points)
    settled = settle(Stepper(circuit=solved.circuit, steps=COARSE), solved.edges)
    np.testing.assert_allclose(settled.rms_A, solved.result["I_L_rms_A"], rtol=2e-3)  # steps of 170 ns
    assert np.all(np.abs(plain.result["I_L_rms_A"] / settled.rms_A - 1) > 5e-3)  # and it matters
