"""Modulations, both ways of power, and two-level primaries: what must be equal, and what must differ."""

from dataclasses import replace

import numpy as np
import pytest

from sim.bridges import primary_scheme
from sim.circuit import Temperatures, build_circuit
from sim.fixed_point import operate
from sim.model import Model
from sim.operating_points import Points
from sim.parameters import Converter, FullBridge, ParameterError
from sim.prototype import prototype
from sim.regulation import regulate
from sim.simulate import Result, simulate
from tests.sim.orbits import circuit, edges_at, without_losses

SHIFTED = ("tps", "eps", "dps", "sps")


def two_level() -> Converter:
    return replace(prototype(), primary=FullBridge(switch=prototype().secondary.switch), modulation="tps")


def some_points(sign: float = 1.0, count: int = 40) -> Points:
    rng = np.random.default_rng(41)
    D1, D2 = rng.uniform(0.6, 0.95, count), rng.uniform(0.05, 0.3, count)
    return Points(D1=D1, D2=D2, power_W=sign * rng.uniform(250, 1000, count))


def of(modulation: str, points: Points) -> Result:
    return simulate(Model.baseline(modulation), points)


def test_full_pulses_are_the_same_under_every_shifted_modulation() -> None:
    points = Points(D1=1.0, D2=0.0, power_W=[400.0, 1200.0])
    results = [of(name, points) for name in SHIFTED]
    for result in results[1:]:
        for name, column in results[0].values.items():
            np.testing.assert_array_equal(column, result[name], err_msg=name)


@pytest.mark.parametrize(
    ("modulation", "D1", "D2", "runs"),
    [
        ("sps", 1.0, 0.0, True), ("sps", 0.9, 0.0, False), ("dps", 0.9, 0.1, True), ("dps", 0.9, 0.2, False),
        ("eps", 0.9, 0.0, True), ("eps", 1.0, 0.2, True), ("eps", 0.9, 0.2, False), ("tps", 0.9, 0.2, True),
    ],
)  # fmt: skip
def test_a_modulation_has_its_own_duty_ratios_only(modulation: str, D1: float, D2: float, runs: bool) -> None:
    result = of(modulation, Points(D1=D1, D2=D2, power_W=600.0))
    assert result.feasible[0] == runs
    assert runs or result.reason[0].startswith(modulation)


def test_the_zero_state_burns_in_other_devices() -> None:
    points = Points(D1=0.6, D2=0.2, power_W=600.0)
    clamped, shifted = of("hybrid", points), of("tps", points)
    assert clamped["loss_primary_clamp_conduction_W"][0] > 0.5  # W: 40 % of the time in diodes of 1.5 V
    assert shifted["loss_primary_clamp_conduction_W"][0] == 0.0
    assert shifted["loss_primary_outer_conduction_W"][0] > clamped["loss_primary_outer_conduction_W"][0]


def test_modulations_with_the_same_voltages_need_nearly_the_same_phase() -> None:
    points = some_points()
    # the legs' delays and a volt of drop differ: some nanoseconds of the 25 us
    np.testing.assert_allclose(of("tps", points)["D0"], of("hybrid", points)["D0"], atol=8e-3)


def test_a_whole_swing_moves_the_charge_of_both_half_swings() -> None:
    V1, V2 = np.array([300.0]), np.array([140.0])

    def charges_C(modulation: str) -> np.ndarray:
        converter = replace(prototype(), modulation=modulation)
        t = Temperatures.everywhere(converter, np.array([25.0]))
        return build_circuit(converter, t, V1, V2).charge_C[:2, 0]

    np.testing.assert_allclose(charges_C("tps"), np.full(2, charges_C("hybrid").sum()), rtol=1e-12)


def test_a_two_level_leg_has_no_middle_to_be_clamped_at() -> None:
    with pytest.raises(ParameterError, match=r"'hybrid'; a FullBridge as primary allows: tps, eps, dps, sps"):
        replace(two_level(), modulation="hybrid")


def test_a_two_level_primary_has_its_own_parts_that_add_up() -> None:
    result = simulate(Model(converter=two_level()), some_points())
    parts = [name for name in result.values if name.startswith("loss_")]
    assert "loss_primary_switching_W" in parts
    assert not any("clamp" in name for name in parts)
    lost_W = sum(result[name] for name in parts)
    np.testing.assert_allclose(lost_W, result["P1_W"] - result["P2_W"], atol=1e-9 * 1000)  # rounding of 1 kW


def test_a_channel_conducts_alike_in_every_state() -> None:
    scheme = primary_scheme(two_level())
    on = two_level().secondary.switch.on
    assert {c.law for path in (scheme.forward, scheme.reverse, scheme.zero) for c in path} == {on}
    assert [sum(c.count for c in path) for path in (scheme.forward, scheme.reverse, scheme.zero)] == [2, 2, 2]


@pytest.mark.parametrize("modulation", ["hybrid", "tps"])
def test_power_flows_back_on_the_mirrored_branch(modulation: str) -> None:
    points = some_points(-1.0)
    back = of(modulation, points)
    assert back.feasible.all()
    phase = back["D0"] + (1 + np.asarray(points.D2) - np.asarray(points.D1)) / 2
    assert np.all(phase < 0.02)
    assert np.all(phase > -0.5)
    np.testing.assert_allclose(back["P2_W"], points.power_W, rtol=1e-6)
    # what is put in at the secondary arrives at the primary but for the losses
    assert np.all((back["efficiency"] > 0.93) & (back["efficiency"] < 0.99))
    np.testing.assert_allclose(back["efficiency"], back["P1_W"] / back["P2_W"], rtol=1e-12)


def test_without_losses_both_ways_are_mirror_images() -> None:
    D1, D2 = np.repeat([0.9, 0.6, 1.0], 2), np.repeat([0.1, 0.3, 0.0], 2)
    lossless = circuit(6, without_losses(prototype()))
    target_W = np.tile([600.0, -600.0], 3)
    phase = regulate(lossless, edges_at(D1, D2, np.zeros(6)), target_W).phase
    np.testing.assert_allclose(phase[::2], -phase[1::2], atol=1e-6)  # 2e-7 of the power, over its slope


def test_an_igbt_secondary_closes_the_balance_and_depends_on_the_way_of_power() -> None:
    igbt = replace(prototype(), secondary=FullBridge(switch=prototype().primary.inner), modulation="hybrid")
    points = Points(D1=0.9, D2=0.1, power_W=[800.0, -800.0])
    outcome = operate(igbt, points.with_voltages_of(igbt))
    orbit, balance = outcome.state.regulated.orbit, outcome.state.balance
    conducted = [
        k for k in balance.losses if k.endswith(("_conduction", "_copper")) or k == "link_resistance"
    ]
    lost_W = sum(balance.losses[name] for name in conducted)
    gap_A = orbit.pieces.end_A[-1] + orbit.start_A  # what the link keeps of a half period that nearly closes
    kept_W = 2 * igbt.frequency_Hz * igbt.inductor.inductance_H * orbit.pieces.end_A[-1] * gap_A
    between_W = orbit.input_power_W() - orbit.output_power_W() - kept_W
    np.testing.assert_allclose(lost_W, between_W, rtol=1e-9)  # closed forms of the same integrals
    diode_W, channel_W = balance.losses["secondary_conduction"]
    assert diode_W != pytest.approx(channel_W, rel=0.01)  # forward through diodes, backward through channels
