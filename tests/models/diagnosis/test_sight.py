"""What a design can see, and the corrections before any cause is weighed, on a linear bench."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.leftover import smooth_maps
from models.diagnosis.noise import corrected, estimate_noise
from models.diagnosis.sight import SEEN, sight
from models.diagnosis.signatures import Signature
from sim.effects.catalogue import effect
from tests.models.diagnosis.fabricated import loads, refinery

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


def test_a_single_reading_far_off_is_widened_and_the_others_are_not() -> None:
    observations = loads(np.linspace(300.0, 1500.0, READINGS))
    noise = estimate_noise(observations, np.zeros(READINGS))
    left = np.random.default_rng(1).standard_normal(READINGS)
    left[7] = 30.0
    sigma = corrected(observations, noise, SIGMA, left)
    assert sigma[7] > 8 * np.median(sigma)  # 30 sigmas, of which three are ordinary
    assert np.delete(sigma, 7).max() < 1.5 * np.median(sigma)


def test_leading_maps_hold_nearly_all_of_a_smooth_kernel() -> None:
    place = np.random.default_rng(2).uniform(0.0, 2.0, (READINGS, 3))
    maps = smooth_maps(place)
    assert len(maps) < READINGS
    assert np.mean(np.sum(maps**2, axis=0)) == pytest.approx(1.0, abs=0.02)  # of which 98 % are asked for
