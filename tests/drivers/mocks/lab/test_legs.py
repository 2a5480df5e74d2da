"""The lab's bridges: energy closes in every one of them, and they differ in what the physics says they do."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.model_file import read_model
from drivers.mocks.lab.laboratory import Electrical, Laboratory
from drivers.mocks.lab.laws import Laws
from drivers.mocks.lab.legs import Edges, Junctions, _closing_J, channel_Ohm, primary_legs
from sim.model import Model
from sim.parameters import Capacitance
from sim.prototype import prototype
from sim.simulate import Points, simulate
from sim.soft_switching import residual_energy
from tests.drivers.mocks.lab.laboratories import nominal

D1, D2, POWER_W = np.array([0.8, 0.7]), np.array([0.15, 0.3]), np.array([400.0, 900.0])


def settled(lab: Laboratory) -> Electrical:
    return lab.settled(D1, D2, POWER_W, np.full(2, 300.0), np.zeros(2))[0]


def test_a_channel_bends_as_its_die_was_drawn() -> None:
    """A parabola through what two temperatures and the die's bend say, against its three points."""
    on = nominal().converter.secondary.switch.on
    at_C, ohm = np.array([25.0, 125.0, 175.0]), on.resistance_Ohm
    np.testing.assert_allclose(channel_Ohm(on, at_C) / ohm, [1.0, 1.32, 1.59], atol=0.005)  # two digits
    drawn = replace(on, resistance_bend_per_K2=2.0 * on.resistance_bend_per_K2)
    np.testing.assert_allclose(channel_Ohm(drawn, at_C) / ohm, [1.0, 1.32, 1.70], atol=0.005)


def test_clamp_diodes_rest_where_legs_are_shifted() -> None:
    assert (settled(nominal().driven_by("tps")).losses.by_kind["clamp"] == 0).all()
    assert (settled(nominal()).losses.by_kind["clamp"] > 0).all()


@pytest.mark.parametrize("modulation", ["hybrid", "tps"])
def test_lab_and_simulator_agree_where_only_their_formulas_differ(modulation: str) -> None:
    now = settled(nominal().driven_by(modulation))
    simulated = simulate(Model.baseline(modulation), Points(D1=D1, D2=D2, power_W=POWER_W))
    # 0.3 points: laws of temperature, switching and core that are written twice; a missing leg costs more
    np.testing.assert_allclose(POWER_W / now.drawn_W, simulated["efficiency"], atol=0.003)


def test_closing_on_constant_capacitances_loses_what_one_knows_by_heart() -> None:
    one, other = (Capacitance(zero_bias_F=C, junction_V=1e9, grading=0.5) for C in (100e-12, 300e-12))
    swing_V = np.array([50.0, 150.0])
    lost_J = _closing_J([one], [other], swing_V)
    np.testing.assert_allclose(lost_J, 0.5 * 400e-12 * swing_V**2, rtol=1e-3)  # trapezoids of a straight line


def test_the_two_edges_of_a_leg_lose_what_its_charge_took_from_the_rail() -> None:
    """After both of them every junction is as it was: nothing is kept, so all that the rail gave is lost."""
    npc, swing_V = prototype().primary, np.array([100.0, 150.0])
    slow, fast = [npc.inner.capacitance, npc.clamp.capacitance], [npc.outer.capacitance]
    edges_J = _closing_J(slow, fast, swing_V), _closing_J(fast, slow, swing_V)
    given_C = sum(np.asarray(junction.charge_C(swing_V)) for junction in (*slow, *fast))
    np.testing.assert_allclose(sum(edges_J), given_C * swing_V, rtol=1e-12)  # rounding
    assert (edges_J[1] > 1.2 * edges_J[0]).all()  # junctions are not alike, so neither are the edges
    for lost_J, (charging, discharging) in zip(edges_J, ((slow, fast), (fast, slow)), strict=True):
        by_energy_J = residual_energy(charging, discharging, swing_V, 1.0)
        np.testing.assert_allclose(lost_J, by_energy_J, rtol=1e-3)  # quadrature against the antiderivative


def test_each_kind_of_switch_pays_for_the_edge_that_it_closes() -> None:
    """At no current and with nothing recovered, closing is all that an edge costs."""
    npc, link_V, none = prototype().primary, np.array([300.0]), np.zeros((2, 1))
    at = Junctions(outer=link_V * 0 + 60.0, inner=link_V * 0 + 60.0, clamp=link_V * 0 + 60.0)
    slow, fast = [npc.inner.capacitance, npc.clamp.capacitance], [npc.outer.capacitance]
    outer_J, inner_J = _closing_J(slow, fast, 0.5 * link_V), _closing_J(fast, slow, 0.5 * link_V)

    def paid(missing: float, modulation: str) -> dict[str, np.ndarray]:
        legs = primary_legs(replace(prototype(), modulation=modulation))
        edges = Edges(off_A=none, on_A=none, missing=none + missing, opposite_C=none, same_C=none)
        return legs.energies_J(at, link_V, edges, Laws())

    for modulation in ("hybrid", "tps"):  # two legs each, whole swings and what is left of the second half
        np.testing.assert_allclose(paid(1.0, modulation)["outer"], 2 * outer_J, rtol=1e-12)  # rounding
        np.testing.assert_allclose(paid(1.0, modulation)["inner"], 2 * inner_J, rtol=1e-12)
    np.testing.assert_allclose(paid(0.5, "hybrid")["inner"], 0.5 * inner_J, rtol=1e-12)
    assert not paid(0.5, "tps")["inner"].any()


def test_a_full_pulse_has_no_zero_state_to_differ_in() -> None:
    def drawn(modulation: str) -> np.ndarray:
        lab = nominal().driven_by(modulation)
        full = (np.ones(1), np.zeros(1), np.array([600.0]))
        return lab.settled(*full, np.full(1, 300.0), np.zeros(1))[0].drawn_W

    assert abs(drawn("sps") - drawn("hybrid"))[0] < 0.3  # W of 10 lost: the same edges, other devices at them


def test_a_lab_of_another_converter_agrees_with_its_simulation() -> None:
    model = read_model(Path("docs/examples/two_level_dab.toml"))
    lab = replace(nominal(), converter=model.converter)
    c, power_W = model.converter, np.array([400.0, 900.0])
    now = lab.settled(D1, D2, power_W, np.full(2, c.V1_V), np.zeros(2))[0]
    simulated = simulate(model, Points(D1=D1, D2=D2, power_W=power_W, V1_V=c.V1_V, V2_V=c.V2_V))
    assert now.running.all()
    np.testing.assert_allclose(power_W / now.drawn_W, simulated["efficiency"], atol=0.005)
