"""The circuit file: gates with dead time, every device at its temperature, and what it refuses."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sim.model import Model
from sim.netlist import Settling, netlist
from sim.operating_points import Points
from sim.parameters import ParameterError
from sim.prototype import prototype

POINT = Points(D1=0.8, D2=0.1, power_W=800.0)
PULSE = re.compile(r"^V(g\w+) g\w+ 0 PULSE\(0 1 (\S+) (\S+) \S+ (\S+) (\S+)\)", re.MULTILINE)


def on_times(text: str) -> dict[str, tuple[float, float]]:
    """When each gate begins to open and has closed, in microseconds of one period of 50."""
    found = {name: [float(x) * 1e6 for x in numbers] for name, *numbers in PULSE.findall(text)}
    return {
        name: (start % period, (start + 2 * ramp + width) % period)
        for name, (start, ramp, width, period) in found.items()
    }


@pytest.mark.parametrize(("one", "other"), [("g1", "g3"), ("g2", "g4"), ("gq1", "gq2"), ("gq3", "gq4")])
def test_complementary_switches_leave_the_dead_time(one: str, other: str) -> None:
    times = on_times(netlist(Model.baseline(), POINT))
    for first, second in ((one, other), (other, one)):
        gap = (times[second][0] - times[first][1]) % 50.0
        assert gap == pytest.approx(1e6 * prototype().dead_time_s, abs=1e-3)  # printed to nine digits


def test_the_outer_switch_is_on_for_the_pulse_less_the_dead_time() -> None:
    start, stop = on_times(netlist(Model.baseline(), POINT))["g1"]
    assert (stop - start) % 50.0 == pytest.approx(0.8 * 25.0 - 0.4, abs=1e-3)


def test_an_effect_of_the_model_is_in_the_circuit() -> None:
    plain, longer = (on_times(netlist(model, POINT)) for model in (
        Model.baseline(), Model.baseline().with_effect("dead_time", error_s=50e-9),
    ))  # fmt: skip
    shift = longer["g1"][0] - plain["g1"][0]
    assert shift == pytest.approx(0.05, abs=1e-3)


def test_the_start_is_not_the_simulators_orbit() -> None:
    text = netlist(Model.baseline(), POINT)
    start_A = float(re.findall(r"^Llink .* IC=(\S+)", text, re.MULTILINE)[0])
    from sim.solved import solve_points

    assert abs(start_A - solve_points(Model.baseline(), POINT).orbit.start_A[0]) > 1e-3


def test_a_point_that_cannot_run_is_refused_with_the_reason() -> None:
    with pytest.raises(ParameterError, match="1900 W cannot run: D1 and D2 carry"):
        netlist(Model.baseline(), Points(D1=0.5, D2=0.5, power_W=1900.0))


def test_two_points_are_refused() -> None:
    with pytest.raises(ParameterError, match="one operating point; got 2"):
        netlist(Model.baseline(), Points(D1=np.array([0.8, 0.9]), D2=0.1, power_W=800.0))


def test_periods_and_steps_must_be_positive() -> None:
    with pytest.raises(ParameterError, match="longest_step is 0"):
        Settling(longest_step=0.0)


def test_what_is_only_a_capacitance_does_not_conduct_beside_a_large_drop() -> None:
    text = netlist(Model.baseline(), POINT)
    for IS, N in re.findall(r"^\.model c_\w+ D\(IS=(\S+) N=(\S+)", text, re.MULTILINE):
        assert float(IS) * np.exp(60.0 / (float(N) * 0.02585)) < 1e-9  # 60 V: more than any device drops


def test_the_shunts_of_the_nodes_are_small_beside_a_small_switchs_capacitance() -> None:
    base = prototype()
    switch = base.secondary.switch
    tiny = replace(switch, capacitance=replace(switch.capacitance, zero_bias_F=50e-12))
    small = replace(base, secondary=replace(base.secondary, switch=tiny))
    shunt_F = float(re.findall(r"cshunt=(\S+)", netlist(Model(converter=small), POINT))[0])
    assert shunt_F <= 1e-3 * tiny.capacitance.charge_C(140.0) / 140.0 * 1.001  # printed to three digits
