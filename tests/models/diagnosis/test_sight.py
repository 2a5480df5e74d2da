"""What a design can see, on a linear bench."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.sight import SEEN, sight
from models.diagnosis.signatures import Signature
from sim.effects.catalogue import effect
from sim.prototype import prototype
from tests.models.diagnosis.fabricated import refinery

READINGS = 30
SIGMA = np.full(READINGS, 0.5)
FLAT, GROWING = np.ones(READINGS), np.linspace(5.0, 60.0, READINGS)


def test_the_smallest_visible_value_is_five_sigmas_of_its_signature() -> None:
    (seen,) = sight(
        refinery(np.zeros(READINGS), [Signature(entry=effect("link_resistance"), slope=GROWING)], SIGMA)
    )
    assert seen.smallest == pytest.approx(SEEN * 0.5 / np.linalg.norm(GROWING), rel=1e-9)  # closed form
    assert seen.visible
    assert seen.tied_with == ()


def test_effects_that_look_alike_are_tied_and_faint_ones_invisible() -> None:
    effects = [
        Signature(entry=effect("auxiliary_power"), slope=FLAT),
        Signature(entry=effect("analyzer_offset"), slope=300.0 * FLAT),
        Signature(entry=effect("link_resistance"), slope=1e-3 * GROWING),
    ]
    found = {s.effect: s for s in sight(refinery(np.zeros(READINGS), effects, SIGMA))}
    assert found["auxiliary_power"].tied_with == ("analyzer_offset",)
    assert not found["link_resistance"].visible
    assert (found["link_resistance"].parameter, found["link_resistance"].searched) == (
        "resistance_Ohm",
        False,
    )


def test_what_is_searched_goes_by_the_converters_size() -> None:
    """1 Ohm shows, which is searched in a converter of four times the input resistance only."""
    slope = SEEN * 0.5 * GROWING / np.linalg.norm(GROWING)
    entry = effect("link_resistance")
    high = entry.at(replace(prototype(), V1_V=2 * prototype().V1_V))
    for each, searched in ((entry, False), (high, True)):
        (seen,) = sight(refinery(np.zeros(READINGS), [Signature(entry=each, slope=slope)], SIGMA))
        assert seen.smallest == pytest.approx(1.0, rel=1e-9)  # closed form
        assert seen.searched is searched


def test_the_everyday_spread_of_an_effect_does_not_tie_it_to_others() -> None:
    effects = [
        Signature(entry=effect("link_resistance"), slope=GROWING),
        Signature(entry=effect("analyzer_offset"), slope=300.0 * np.cos(np.arange(READINGS))),
    ]
    # a whole Ohm on any ordinary day
    plain = refinery(np.zeros(READINGS), effects, SIGMA, spreads=GROWING[None])
    own = replace(plain.known, spread_names=("link_resistance_Ohm",))
    assert sight(plain)[0].visible is False
    assert sight(replace(plain, known=own))[0].tied_with == ()
    assert sight(replace(plain, known=own))[0].visible
