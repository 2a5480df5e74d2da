"""A circuit simulator that we did not write reaches the simulator's state, from the circuit file alone."""

from dataclasses import replace
from pathlib import Path

import pytest

from bench.model_file import read_model
from experiments.peers.ngspice import NgspiceFailed, installed, run_ngspice
from sim.model import Model
from sim.netlist import SETTLED, Settling, netlist
from sim.operating_points import Points
from sim.parameters import Conduction, FullBridge
from sim.simulate import simulate

ROOT = Path(__file__).parents[2]
POINT = Points(D1=0.8, D2=0.1, power_W=800.0)


@pytest.fixture(scope="module")
def measured() -> dict[str, float]:
    if not installed():
        pytest.skip("missing program: ngspice")
    return run_ngspice(netlist(Model.baseline(), POINT, Settling(settle_periods=16)))


def test_the_circuit_settled(measured: dict[str, float]) -> None:
    assert measured[SETTLED.lower()] == pytest.approx(measured["i_l_rms_a"], rel=5e-4)
    assert abs(measured["i_l_mean_a"]) < 0.02  # of 3.2 A: adds in quadrature, 2e-5 of the rms


def test_ngspice_has_the_same_current_and_power(measured: dict[str, float]) -> None:
    ours = simulate(Model.baseline(), POINT)
    assert measured["i_l_rms_a"] == pytest.approx(ours["I_L_rms_A"][0], rel=5e-3)  # the bar
    assert measured["p2_w"] == pytest.approx(800.0, rel=5e-3)


def test_ngspice_loses_as_much_in_the_primarys_channels(measured: dict[str, float]) -> None:
    ours = simulate(Model.baseline(), POINT)
    for kind in ("primary_outer", "primary_inner", "primary_clamp"):
        name = f"loss_{kind}_conduction_W"
        assert measured[name.lower()] == pytest.approx(ours[name][0], rel=0.02)  # the bar


def test_another_converters_circuit_runs_too() -> None:
    if not installed():
        pytest.skip("missing program: ngspice")
    model = read_model(ROOT / "docs" / "examples" / "two_level_dab.toml")
    point = Points(D1=0.9, D2=0.1, power_W=800.0, V1_V=400.0, V2_V=48.0)
    found = run_ngspice(netlist(model, point, Settling(settle_periods=20)))
    # 16 A on the secondary and 0.3 A of magnetizing current, which the solver keeps out of the resistances
    assert found["i_l_rms_a"] == pytest.approx(simulate(model, point)["I_L_rms_A"][0], rel=0.01)
    assert found["p2_w"] == pytest.approx(800.0, rel=0.01)


def test_a_secondary_with_thresholds_and_little_magnetizing_inductance_is_the_same_circuit() -> None:
    if not installed():
        pytest.skip("missing program: ngspice")
    base = read_model(ROOT / "docs" / "examples" / "two_level_dab.toml").converter
    switch = base.secondary.switch
    drop = Conduction(threshold_V=1.0, resistance_Ohm=0.002)  # of 48 V
    secondary = FullBridge(switch=replace(switch, synchronous=False, on=drop, reverse=drop))
    transformer = replace(base.transformer, magnetizing_H=10 * base.inductor.inductance_H)
    model = Model(converter=replace(base, secondary=secondary, transformer=transformer))
    point = Points(D1=0.9, D2=0.1, power_W=400.0, V1_V=400.0, V2_V=48.0)
    found = run_ngspice(netlist(model, point, Settling(settle_periods=20)))
    # the bar; with thresholds by the link current both are off by 2.4 %
    assert found["i_l_rms_a"] == pytest.approx(simulate(model, point)["I_L_rms_A"][0], rel=5e-3)
    assert found["p2_w"] == pytest.approx(400.0, rel=5e-3)


def test_a_circuit_that_does_not_run_is_told() -> None:
    if not installed():
        pytest.skip("missing program: ngspice")
    with pytest.raises(NgspiceFailed, match="measured nothing"):
        run_ngspice("* nothing\nR1 a 0 1\n.end\n")
