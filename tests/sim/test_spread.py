"""Everyday spreads: real parameters, positive sigmas, and no shift at none."""

from dataclasses import replace

import pytest

from sim.parameters import leaves
from sim.prototype import prototype
from sim.spread import Spread, everyday_spread

SPREADS = everyday_spread(prototype())


@pytest.mark.parametrize("spread", SPREADS, ids=[s.path for s in SPREADS])
def test_a_spread_is_of_a_parameter_that_exists(spread: Spread) -> None:
    assert isinstance(leaves(prototype())[spread.path], float)
    assert spread.sigma > 0


@pytest.mark.parametrize("spread", SPREADS, ids=[s.path for s in SPREADS])
def test_no_sigma_is_no_change(spread: Spread) -> None:
    assert spread.shifted(prototype(), 0.0) == prototype()


@pytest.mark.parametrize("spread", SPREADS, ids=[s.path for s in SPREADS])
def test_a_sigma_changes_that_parameter_and_no_other(spread: Spread) -> None:
    before, after = leaves(prototype()), leaves(spread.shifted(prototype(), 1.0))
    assert [path for path in before if before[path] != after[path]] == [spread.path]
    step = spread.sigma * (before[spread.path] if spread.relative else 1.0)
    assert after[spread.path] - before[spread.path] == pytest.approx(step)


@pytest.mark.parametrize("sigmas", [-2.5, 2.5])
@pytest.mark.parametrize("spread", SPREADS, ids=[s.path for s in SPREADS])
def test_what_passes_inspection_is_a_possible_converter(spread: Spread, sigmas: float) -> None:
    spread.shifted(prototype(), sigmas)  # the parameters' own checks decide


def test_a_resistance_is_spread_by_what_it_means_to_a_converter() -> None:
    large = replace(prototype(), V1_V=600.0, V2_V=280.0, rated_power_W=20e3)
    one, own = ({s.path: s.sigma for s in everyday_spread(c)} for c in (prototype(), large))
    # V1^2 / P
    assert own["link_resistance_Ohm"] == pytest.approx(0.4 * one["link_resistance_Ohm"], rel=1e-12)
    assert own["output_cable_Ohm"] == pytest.approx(0.4 * one["output_cable_Ohm"], rel=1e-12)  # V2^2 / P
    assert own["auxiliary_power_W"] == pytest.approx(10 * one["auxiliary_power_W"], rel=1e-12)
    assert own["dead_time_s"] == one["dead_time_s"]


def test_no_parameter_is_spread_twice() -> None:
    assert len({spread.path for spread in SPREADS}) == len(SPREADS)


def test_every_toleranced_value_of_the_data_files_is_spread() -> None:
    paths = {spread.path for spread in SPREADS}
    for place in ("primary.outer", "primary.inner", "primary.clamp", "secondary.switch"):
        for name in ("on.resistance_Ohm", "capacitance.zero_bias_F", "recovery.charge_C", "thermal_K_per_W"):
            assert f"{place}.{name}" in paths


def test_a_resistance_bends_by_as_much_as_its_device_states_or_any_does() -> None:
    plain = prototype()
    (usual,) = (s for s in SPREADS if s.path == "primary.inner.on.resistance_bend_per_K2")
    assert (usual.sigma, usual.relative) == (1.5e-5, False)
    own = plain.primary.inner.tolerances | {"on.resistance_bend_per_K2": 0.3}
    stated = replace(
        plain, primary=replace(plain.primary, inner=replace(plain.primary.inner, tolerances=own))
    )
    (found,) = (s for s in everyday_spread(stated) if s.path == usual.path)
    assert (found.sigma, found.relative) == (0.3, True)
