"""A converter of ten prototypes in parallel is diagnosed as one of them, in its own watts, ohms and amperes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.dataset import load_measurements
from models.diagnosis.bench_options import usual_sigma
from models.diagnosis.diagnose import diagnose
from models.diagnosis.observations import CHANNELS, observe
from models.diagnosis.signatures import signatures
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.parameters import Capacitance, Conduction, Converter, Diode, Recovery, Switch, SwitchingEnergy
from sim.prototype import prototype
from sim.simulate import Points, simulate
from tests.models.diagnosis.virtual_campaign import lab_campaign, simulated_campaign

COUNT = 10  # so many that the analyzer's range goes with them
BY_POWER = {
    SwitchingEnergy: ("energy_J", "reference_A"),
    Recovery: ("charge_C", "reference_A"),
    Capacitance: ("zero_bias_F",),
}
PER_POWER = {Conduction: ("resistance_Ohm",), Switch: ("thermal_K_per_W",), Diode: ("thermal_K_per_W",)}
# effect, and how much more its fitted value is of ten in parallel
FOUND = {"auxiliary_power": COUNT, "magnetizing_inductance": 1 / COUNT}


def _paralleled(part: Any) -> Any:
    if isinstance(part, Converter | Switch | Diode) or hasattr(part, "modulations"):
        fields = {name: getattr(part, name) for name in part.__dataclass_fields__}
        part = replace(part, **{name: _paralleled(value) for name, value in fields.items()})
    by = dict.fromkeys(BY_POWER.get(type(part), ()), float(COUNT))
    by |= dict.fromkeys(PER_POWER.get(type(part), ()), 1.0 / COUNT)
    return (
        replace(part, **{name: factor * getattr(part, name) for name, factor in by.items()}) if by else part
    )


def _wound(part: Any) -> Any:
    winding, core = part.winding, part.core
    return replace(
        part,
        winding=replace(winding, resistance_Ohm=winding.resistance_Ohm / COUNT),
        core=replace(core, volume_m3=core.volume_m3 * COUNT),
        thermal_K_per_W=part.thermal_K_per_W / COUNT,
    )


def ten_in_parallel() -> Converter:
    """The prototype with every current ten times as large, and every loss."""
    one = prototype()
    inductor, transformer = one.inductor, one.transformer
    return replace(
        _paralleled(one),
        name="ten prototypes in parallel, 20 kW",
        rated_power_W=COUNT * one.rated_power_W,
        link_resistance_Ohm=one.link_resistance_Ohm / COUNT,
        heatsink_K_per_W=one.heatsink_K_per_W / COUNT,
        inductor=replace(
            _wound(inductor),
            inductance_H=inductor.inductance_H / COUNT,
            saturation_A=inductor.saturation_A * COUNT,
        ),
        transformer=replace(_wound(transformer), magnetizing_H=transformer.magnetizing_H / COUNT),
    )


def test_ten_in_parallel_are_as_efficient_as_one() -> None:
    points = Points(D1=np.array([0.5, 0.8]), D2=np.array([0.1, 0.2]), power_W=np.array([400.0, 1100.0]))
    one = simulate(Model.baseline(), points)
    ten = simulate(Model(converter=ten_in_parallel()), replace(points, power_W=COUNT * points.power_W))
    # to the tolerance of the solver, 1e-6 of the power
    np.testing.assert_allclose(ten["efficiency"], one["efficiency"], rtol=3e-6)
    np.testing.assert_allclose(ten["I_L_rms_A"], COUNT * one["I_L_rms_A"], rtol=1e-4)


@pytest.mark.parametrize("name", FOUND)
def test_ten_in_parallel_have_the_same_causes_in_their_own_size(name: str) -> None:
    measured = lab_campaign({name: None}, seed=7, count=32)
    frame = measured.frame.copy()
    large = [column for column in frame if column.endswith(("_W", "_A"))]
    frame[large] *= COUNT
    one = diagnose(measured).verdict
    ten = diagnose(load_measurements(frame), Model(converter=ten_in_parallel())).verdict
    assert (one.kind, one.stated) == ("named", (name,))
    assert (ten.kind, ten.stated) == ("named", (name,))
    (a,), (b,) = ([c for c in verdict.causes if c.effect == name] for verdict in (one, ten))
    # a search that starts elsewhere by rounding ends within a hundredth of a prior scale
    least = 0.01 * CATALOGUE[name].headline.prior
    assert b.term.value == pytest.approx(FOUND[name] * a.term.value, abs=FOUND[name] * least)


def test_a_part_that_the_baseline_replaces_has_no_spread_of_its_own() -> None:
    baseline = Model.baseline().with_effect("magnetizing_inductance", inductance_H=1.02e-3)  # near its bound
    frame = simulated_campaign(baseline, seed=3, count=10)
    known = signatures(observe(load_measurements(frame).frame, baseline.converter), baseline)
    assert "transformer.magnetizing_H" not in known.spread_names


def test_what_a_reading_scatters_by_is_as_much_larger() -> None:
    power_W = np.array([0.0, 200.0, 2000.0])
    one, ten = (
        usual_sigma(CHANNELS, count * power_W, converter)
        for count, converter in ((1, prototype()), (COUNT, ten_in_parallel()))
    )
    larger = [COUNT if c.unit in ("W", "A") else 1 for c in CHANNELS]
    assert ten == pytest.approx(one * np.array(larger))
