"""What a hidden effect is judged against: the same lab with the parts in question as designed."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.mocks.lab.laboratory import Laboratory
from experiments.blind.reach import departure, hideable, hiding, without
from experiments.blind.sight import Sight

LAB = Laboratory.draw(seed=100_001)
NOMINAL = Laboratory.nominal()


def test_a_part_that_is_hidden_and_off_by_itself_counts_with_both() -> None:
    plain = without(hiding(LAB, {"leakage_inductance": 0.05}), ["leakage_inductance"])
    inductor = replace(LAB.converter.inductor, inductance_H=NOMINAL.converter.inductor.inductance_H)
    # to the rounding of one subtraction
    assert plain.converter.inductor.inductance_H == pytest.approx(inductor.inductance_H, rel=1e-12)
    assert replace(plain.converter, inductor=inductor) == replace(LAB.converter, inductor=inductor)
    assert plain.errors == LAB.errors


def test_an_instruments_own_offset_is_part_of_its_offset() -> None:
    plain = without(LAB, ["analyzer_offset"])
    assert plain.errors.offset_A == {**LAB.errors.offset_A, 1: 0.0}
    assert plain.converter == LAB.converter


def test_a_drift_of_the_room_is_part_of_its_drift() -> None:
    plain = without(LAB, ["ambient_drift"])
    assert LAB.quirks.ambient_K_per_h != 0.0
    assert plain.quirks == replace(LAB.quirks, ambient_K_per_h=0.0)


@pytest.mark.parametrize("name", hideable())
def test_nothing_else_of_a_nominal_lab_changes(name: str) -> None:
    assert without(NOMINAL, [name]) == NOMINAL


def test_what_no_catalogue_has_leaves_a_lab_as_it_is() -> None:
    assert without(LAB, ["dc_link_esr"]) == LAB


def test_what_a_part_takes_back_of_a_hidden_error_is_not_there() -> None:
    off = (LAB.converter.inductor.inductance_H / NOMINAL.converter.inductor.inductance_H) - 1
    there = departure(hiding(LAB, {"leakage_inductance": 0.05}), "leakage_inductance")
    assert there == pytest.approx((1.05 * (1 + off) - 1) / 0.01, rel=1e-9)  # rounding


def test_of_two_parts_each_has_to_be_off() -> None:
    found = departure(hiding(NOMINAL, {"core_loss_transformer": 0.7}), "core_loss_transformer")
    assert found == pytest.approx(10.0, rel=1e-9)  # 7 % a sigma
    assert departure(hiding(NOMINAL, {"sic_on_resistance": 0.5}), "sic_on_resistance") > 10.0


def test_what_is_no_part_departs_from_nothing() -> None:
    assert departure(LAB, "fan_step") == float("inf")


@pytest.mark.parametrize(("own", "shown"), [(0.0, 6.0), (3.0, 6.0 * 2**0.5), (-2.0, 12.0**0.5), (-4.0, 0.0)])
def test_what_other_parts_add_or_take_back_of_it_counts(own: float, shown: float) -> None:
    """Six sigmas of likelihood, and what the lab's parts do along them; what they do across says nothing."""
    sight = Sight(shift=np.array([6.0, 0.0]), own=np.array([own, 5.0]), planes={}, each=np.eye(2))
    assert sight.beyond_ordinary == pytest.approx(shown, abs=1e-12)  # rounding
