"""One contract for every effect of the catalogue: off is off, smooth, bounded, in its own stage."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from sim.effects.base import Effect
from sim.effects.catalogue import CATALOGUE, effect
from sim.model import Model
from sim.parameters import Converter, FullBridge, ParameterError, leaves
from sim.prototype import prototype
from sim.simulate import Points, Result, simulate, simulate_many
from sim.spread import everyday_spread

STAGES = {
    "circuit": {
        "link_resistance", "skin_effect", "leakage_inductance", "inductor_saturation", "magnetizing_inductance",
        "dead_time",
        "gate_delay_skew",
    },
    "semiconductors": {
        "igbt_saturation_voltage", "sic_on_resistance", "clamp_diode_drop", "turn_off_energy_primary",
        "turn_off_energy_secondary", "output_capacitance", "reverse_recovery",
    },
    "magnetics": {"core_loss_transformer", "core_loss_inductor"},
    "supply, wiring": {
        "auxiliary_power", "fan_step", "cable_resistance_input", "cable_resistance_output",
    },
    "thermal, time": {"thermal_resistance", "warm_up_drift", "ambient_drift"},
    "measurement, command": {"analyzer_gain", "analyzer_offset", "analyzer_range_step", "duty_offset"},
}  # fmt: skip
_INNER, _OUTER, _CLAMP = "primary.inner", "primary.outer", "primary.clamp"
_LOW = "secondary.switch"
CHANGES = {
    "link_resistance": {"link_resistance_Ohm"},
    "skin_effect": {"inductor.winding.ac_extra", "transformer.winding.ac_extra"},
    "leakage_inductance": {"inductor.inductance_H"},
    "inductor_saturation": {"inductor.saturation"},
    "magnetizing_inductance": {"transformer.magnetizing_H"},
    "dead_time": {"dead_time_s"},
    "gate_delay_skew": {"secondary_delay_s"},
    "igbt_saturation_voltage": {f"{_INNER}.on.threshold_V"},
    "sic_on_resistance": {f"{_OUTER}.on.resistance_Ohm", f"{_LOW}.on.resistance_Ohm"},
    "clamp_diode_drop": {f"{_CLAMP}.on.threshold_V", f"{_CLAMP}.on.resistance_Ohm"},
    "turn_off_energy_primary": {f"{_OUTER}.turn_off.energy_J", f"{_INNER}.turn_off.energy_J"},
    "turn_off_energy_secondary": {f"{_LOW}.turn_off.energy_J"},
    "output_capacitance": {f"{_OUTER}.capacitance.zero_bias_F", f"{_LOW}.capacitance.zero_bias_F"},
    "reverse_recovery": {f"{place}.recovery.charge_C" for place in (_CLAMP, _OUTER, _LOW)},
    "core_loss_transformer": {"transformer.core.k"},
    "core_loss_inductor": {"inductor.core.k"},
    "auxiliary_power": {"auxiliary_power_W"},
    "cable_resistance_input": {"input_cable_Ohm"},
    "cable_resistance_output": {"output_cable_Ohm"},
    "thermal_resistance": {"heatsink_K_per_W"},
}
METHODS = ("converter", "set_points", "added_loss_W", "observe")
# unit in which a change of each column counts: what a good bench can just see
SEEN = {"P1_W": 0.05, "D0": 1e-4, "T_heatsink_C": 0.1, "T_inductor_C": 0.1, "T_transformer_C": 0.1}
COUNT = 64  # so many that the few points at a bend do not decide
STEP = 0.2  # of the prior: small, and far above the solver's tolerances
EVERY = pytest.mark.parametrize("entry", CATALOGUE.values(), ids=list(CATALOGUE))
SMOOTH = pytest.mark.parametrize(
    "entry", [e for e in CATALOGUE.values() if not e.threshold], ids=lambda e: e.name
)


def points() -> Points:
    """Loads over an hour, and a standby, all of them away from the edges of what can run."""
    rng = np.random.default_rng(21)
    count = COUNT
    return Points(
        D1=rng.uniform(0.6, 0.95, count),
        D2=rng.uniform(0.05, 0.3, count),
        power_W=rng.uniform(250, 1100, count),
        time_s=np.linspace(0, 3600, count),
        pwm=np.arange(count) > 0,
    )


def set_to(entry: Effect, value: float) -> Model:
    return Model.baseline().with_effect(entry.name, **{entry.headline.name: value})


def columns(result: Result) -> np.ndarray:
    return np.concatenate([np.nan_to_num(result[name]) / unit for name, unit in SEEN.items()])


@pytest.fixture(scope="module")
def baseline() -> Result:
    """The baseline alone, from no warm start."""
    return simulate(Model.baseline(), points())


@pytest.fixture(scope="module")
def results() -> dict[str, list[Result]]:
    """Of each effect: off, half a small step, a small step, one prior; and the baseline under ""."""
    models = [Model.baseline()]
    for entry in CATALOGUE.values():
        off, prior = entry.headline.off, entry.headline.prior
        models += [set_to(entry, off + share * prior) for share in (0.0, STEP / 2, STEP, 1.0)]
    baseline, *rest = simulate_many(models, points())
    return {"": [baseline]} | {name: rest[4 * k : 4 * k + 4] for k, name in enumerate(CATALOGUE)}


def test_the_catalogue_has_every_name_under_its_stage() -> None:
    found: dict[str, set[str]] = {stage: set() for stage in STAGES}
    for entry in CATALOGUE.values():
        found[entry.stage].add(entry.name)
    assert found == STAGES


@EVERY
def test_off_returns_the_very_objects_it_was_given(entry: Effect) -> None:
    given, values, state = points(), entry.off_values(), {"P1_W": np.ones(COUNT)}
    converter = Model.baseline().converter
    assert entry.converter(converter, values) is converter
    assert entry.set_points(given, values) is given
    assert entry.observe(given, state, values) is state


def large() -> Converter:
    """A converter that is no multiple of the prototype in any quantity."""
    one = Model.baseline().converter
    transformer = replace(one.transformer, magnetizing_H=3.1e-3)
    return replace(one, V1_V=640.0, V2_V=410.0, rated_power_W=21e3, transformer=transformer)


@EVERY
def test_the_prototype_has_it_as_it_is_listed(entry: Effect) -> None:
    assert entry.at(Model.baseline().converter) is entry


@EVERY
def test_off_is_off_at_a_converter_of_another_size(entry: Effect) -> None:
    converter = large()
    own = entry.at(converter)
    assert own.converter(converter, own.off_values()) is converter
    assert own.headline.lower <= own.headline.off <= own.headline.upper


@EVERY
def test_what_is_in_watts_amperes_ohms_or_henries_goes_by_the_converters_size(entry: Effect) -> None:
    sizes = {p.unit: p.at(large()).prior / p.prior for p in entry.parameters}
    for unit, factor in sizes.items():
        assert (factor != 1.0) == (unit in ("W", "A", "Ohm", "H")), unit


def test_an_analyzers_ranges_are_those_about_the_current_of_the_converter() -> None:
    own = effect("analyzer_range_step").at(large())  # 33 A: on its range of 50 A
    assert own.parameters[1].scan == (10.0, 20.0, 50.0, 100.0)


@EVERY
def test_off_leaves_every_result_bit_identical(entry: Effect, baseline: Result) -> None:
    off = Model.baseline().with_effect(entry.name, **entry.off_values())
    other = simulate(off, points())
    for name, column in baseline.values.items():
        np.testing.assert_array_equal(column, other[name], err_msg=name)


@EVERY
def test_it_says_whether_it_follows_the_time(entry: Effect) -> None:
    at = points()
    model = set_to(entry, entry.headline.off + STEP * entry.headline.prior)
    now, later = (
        simulate_many([model], at)[0],
        simulate_many([model], replace(at, time_s=np.asarray(at.time_s)[::-1]))[0],
    )
    # of both solutions 1e-6 of the power and 0.2 mK: some hundredths of what a good bench can just see
    assert np.any(np.abs(columns(now) - columns(later)) > 0.1) == entry.over_time


@EVERY
def test_its_prior_changes_something(entry: Effect, results: dict[str, list[Result]]) -> None:
    change = columns(results[entry.name][3]) - columns(results[""][0])
    assert np.abs(change).max() > 1.0


@EVERY
def test_its_prior_keeps_every_point_running(entry: Effect, results: dict[str, list[Result]]) -> None:
    assert results[entry.name][3].feasible.all()


@SMOOTH
def test_two_halves_of_a_small_step_agree(entry: Effect, results: dict[str, list[Result]]) -> None:
    off, half, whole = (columns(r) for r in results[entry.name][:3])
    first, second = half - off, whole - half
    # a jump makes them differ by their own size, curvature over a fifth of a prior by a tenth; summed over
    # the points, because D0 of a single one may bend where two edges pass each other
    assert np.abs(second - first).sum() < 0.1 * (np.abs(first).sum() + np.abs(second).sum())


@EVERY
def test_it_changes_one_stage_only(entry: Effect) -> None:
    own = [name for name in METHODS if getattr(type(entry), name) is not getattr(Effect, name)]
    assert len(own) == 1, own


@EVERY
def test_it_changes_the_parameters_it_is_about_and_no_others(entry: Effect) -> None:
    before = leaves(Model.baseline().converter)
    after = leaves(set_to(entry, entry.headline.off + entry.headline.prior).altered_converter())
    assert {path for path in before if before[path] != after[path]} == CHANGES.get(entry.name, set())


@EVERY
@pytest.mark.parametrize("side", ["lower", "upper"])
def test_bounds_are_refused_beyond_and_run_within(entry: Effect, side: str) -> None:
    for p in entry.parameters:
        bound = getattr(p, side)
        beyond = math.nextafter(bound, math.inf if side == "upper" else -math.inf)
        model = Model.baseline().with_effect(entry.name, **{p.name: bound})
        model.altered_converter()  # the parameters' own checks agree that this is possible
        with pytest.raises(ParameterError, match=rf"{entry.name}\.{p.name} is .*allowed"):
            Model.baseline().with_effect(entry.name, **{p.name: beyond})


@EVERY
@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_refused(entry: Effect, wrong: float) -> None:
    with pytest.raises(ParameterError, match="allowed"):
        set_to(entry, wrong)


@EVERY
def test_parameters_have_units_and_scales_inside_their_bounds(entry: Effect) -> None:
    for p in entry.parameters:
        assert p.unit
        assert p.lower <= p.off <= p.upper
        assert p.prior > p.tolerance >= 0
        assert p.off + p.prior <= p.upper
        assert all(p.lower <= value <= p.upper for value in p.scan)


@EVERY
def test_it_says_what_is_wrong_and_what_to_check(entry: Effect) -> None:
    for sentence in (entry.says, entry.says_at(entry.headline.lower), entry.check_on_bench):
        assert len(sentence.split()) >= 5
        assert not sentence.endswith(".")
        assert "  " not in sentence


_ONE_WAY = re.compile(r"\b(more|less|higher|lower|longer|shorter|later|hotter|cooler|rises?|falls?)\b")


@EVERY
def test_a_sentence_that_says_which_way_says_the_other_way_below_off(entry: Effect) -> None:
    """A resistance that comes out too low is not told as too high."""
    head = entry.headline
    above, below = (_ONE_WAY.findall(entry.says_at(value)) for value in (head.upper, head.lower))
    if not entry.threshold and head.lower < head.off:
        assert bool(above) == bool(below)
        assert not above or entry.says_at(head.lower) != entry.says_at(head.upper)
    assert entry.says_at(head.off) == entry.says_at(head.upper) == entry.says


@EVERY
def test_an_effect_lists_the_values_to_try_beside_its_headline(entry: Effect) -> None:
    further = entry.parameters[1:]
    assert all(p.scan for p in further)
    assert not entry.threshold or further
    assert len(entry.variants()) == math.prod(len(p.scan) for p in further)
    assert entry.threshold or all(
        p.off in p.scan for p in further
    )  # the variant that every bench has a little of


def test_the_error_for_an_unknown_name_names_the_nearest() -> None:
    with pytest.raises(ParameterError, match="did you mean 'core_loss_inductor'"):
        effect("core_loss_inductors")


def test_a_name_near_nothing_is_refused_with_all_names() -> None:
    with pytest.raises(ParameterError, match=r"'zzzz'; known: ambient_drift, .*warm_up_drift"):
        effect("zzzz")


def test_a_short_dead_time_is_shortened_to_nothing_at_most():
    fast = replace(Model.baseline().converter, dead_time_s=100e-9)
    shorter = Model(converter=fast).with_effect("dead_time", error_s=-250e-9)
    result = simulate(shorter, Points(D1=0.9, D2=0.1, power_W=700.0))
    assert np.isfinite(result["P1_W"]).all()


@pytest.mark.parametrize("threshold_V", [0.03, 0.3])
def test_a_saturation_voltage_is_searched_no_further_than_there_is_one(threshold_V: float) -> None:
    """Beside parts at three sigmas as well: a switch with next to no threshold ended a diagnosis."""
    inner = replace(
        prototype().primary.inner, on=replace(prototype().primary.inner.on, threshold_V=threshold_V)
    )
    small = replace(prototype(), primary=replace(prototype().primary, inner=inner))
    entry = effect("igbt_saturation_voltage").at(small)
    assert -threshold_V <= entry.headline.lower <= -0.5 * threshold_V
    spread = next(s for s in everyday_spread(small) if s.path == "primary.inner.on.threshold_V")
    weak = spread.shifted(small, -3.0)
    lowest = entry.converter(weak, {"voltage_V": entry.headline.lower})
    assert 0.0 <= lowest.primary.inner.on.threshold_V < 0.5 * threshold_V + 1e-12
    assert effect("igbt_saturation_voltage").at(prototype()) is effect("igbt_saturation_voltage")


def test_a_dead_time_is_searched_no_further_than_a_fast_converter_has_room_for() -> None:
    """Beside a dead time at three sigmas as well: 500 kHz, where 250 ns are the most."""
    fast = replace(prototype(), frequency_Hz=500e3, dead_time_s=100e-9)
    entry = effect("dead_time").at(fast)
    assert 100e-9 < entry.headline.upper < 150e-9
    spread = next(s for s in everyday_spread(fast) if s.path == "dead_time_s")
    late = entry.converter(spread.shifted(fast, 3.0), {"error_s": entry.headline.upper})
    assert late.dead_time_s <= 250e-9
    with pytest.raises(ParameterError, match=r"dead_time_s.*up to a quarter of the half period"):
        effect("dead_time").converter(fast, {"error_s": effect("dead_time").headline.upper})
    assert effect("dead_time").at(prototype()) is effect("dead_time")


def test_a_choke_that_saturates_already_is_searched_for_less_than_all_of_it() -> None:
    soft = replace(prototype(), inductor=replace(prototype().inductor, saturation=0.5))
    upper = effect("inductor_saturation").at(soft).headline.upper
    assert 0.25 < upper < 0.4
    assert effect("inductor_saturation").at(prototype()) is effect("inductor_saturation")


def _with_inner(converter: Converter, **on: float) -> Converter:
    inner = converter.primary.inner
    return replace(
        converter, primary=replace(converter.primary, inner=replace(inner, on=replace(inner.on, **on)))
    )


def test_a_saturation_voltage_is_that_of_igbts_and_an_on_resistance_that_of_fets() -> None:
    """Wherever they are: the prototype's inner switches are IGBTs, all others FETs."""
    of_drop, of_resistance = effect("igbt_saturation_voltage"), effect("sic_on_resistance")
    inner_R, inner_V0 = "primary.inner.on.resistance_Ohm", "primary.inner.on.threshold_V"
    assert of_drop.present(prototype()) == [inner_V0]
    assert inner_R not in of_resistance.present(prototype())
    all_fets = _with_inner(prototype(), threshold_V=0.0)
    assert inner_R in of_resistance.present(all_fets)
    with pytest.raises(ParameterError, match="igbt_saturation_voltage does not apply"):
        of_drop.converter(all_fets, {"voltage_V": 0.1})
    igbt = prototype().primary.inner
    two_level = replace(
        prototype(),
        primary=FullBridge(switch=igbt),
        secondary=FullBridge(switch=igbt),
        modulation="tps",
    )
    assert of_drop.present(two_level) == ["primary.switch.on.threshold_V", "secondary.switch.on.threshold_V"]
    assert of_resistance.present(two_level) == []
