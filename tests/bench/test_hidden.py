"""Sizes of hidden effects as an operator writes them."""

import pytest

from bench.errors import InputError
from bench.hidden import parse_hidden


def test_a_size_that_is_no_number_is_said_with_what_is_allowed() -> None:
    with pytest.raises(InputError, match="'abc' is not a number; allowed is EFFECT or EFFECT=VALUE"):
        parse_hidden(["link_resistance=abc"])


def test_hidden_effects_are_checked_all_at_once() -> None:
    assert parse_hidden(["link_resistance=0.05"]) == {"link_resistance": 0.05}
    with pytest.raises(InputError, match="link_resistance=5"):  # Ohm: far beyond what the catalogue has
        parse_hidden(["link_resistance=5"])
    with pytest.raises(InputError) as caught:
        parse_hidden(["link_resistanse", "link_resistance=lots"])
    assert len(caught.value.problems) == 2


def test_foreign_families_can_be_hidden_where_a_lab_is_made_and_nowhere_else() -> None:
    assert parse_hidden(["dc_link_esr=0.3", "edge_ringing"], foreign=True) == {
        "dc_link_esr": 0.3,
        "edge_ringing": None,
    }
    with pytest.raises(InputError, match="dc_link_esr"):
        parse_hidden(["dc_link_esr=0.3"])
    with pytest.raises(InputError, match="0 or more"):
        parse_hidden(["dc_link_esr=-1"], foreign=True)
