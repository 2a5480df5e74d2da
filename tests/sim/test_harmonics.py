"""Harmonics in closed form, against a discrete Fourier transform of the same square waves."""

from dataclasses import replace

import numpy as np
import pytest

from sim.harmonics import eddy_share, share_left
from sim.model import Model
from sim.operating_points import Points
from sim.parameters import Converter
from sim.prototype import prototype
from sim.simulate import simulate, simulate_many

D0, D1, D2 = np.array([0.05, 0.2, -0.3]), np.array([1.0, 0.45, 0.7]), np.array([0.0, 0.5, 0.15])
POINTS = Points(D1=D1, D2=D2, power_W=1000.0).with_voltages_of(prototype())


def inductor_V(samples: int) -> np.ndarray:
    """The voltage across the inductance in one period, sampled in the middle of equal steps, (N, samples)."""
    place = 2.0 * (np.arange(samples) + 0.5) / samples  # in half periods

    def pulse(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """+1 from begin to end, both in half periods, and -1 half a period later."""
        shifted = (place - begin[:, None]) % 2.0
        width = (end - begin)[:, None]
        return (shifted < width).astype(float) - ((shifted >= 1.0) & (shifted < 1.0 + width))

    n = prototype().transformer.turns_ratio
    primary = np.asarray(POINTS.V1_V)[..., None] * pulse(np.zeros_like(D1), D1)
    return primary - n * np.asarray(POINTS.V2_V)[..., None] * pulse(D0 + D2, D0 + 1.0)


def flattening_at(corner: float) -> Converter:
    winding = replace(prototype().inductor.winding, flattens_at_harmonic=corner)
    return replace(prototype(), inductor=replace(prototype().inductor, winding=winding))


def share(corner: float) -> np.ndarray:
    return eddy_share(flattening_at(corner), POINTS, D0)


@pytest.mark.parametrize("corner", [5.0, 15.0])
def test_the_share_is_that_of_a_fourier_transform_of_the_sampled_waves(corner: float) -> None:
    spectrum = np.fft.rfft(inductor_V(20_000))[:, 1:]
    k = np.arange(1, 1 + spectrum.shape[1])
    square = np.abs(spectrum) ** 2
    expected = (1 + corner**-2) * (square / (1.0 + (k / corner) ** 2)).sum(axis=1) / square.sum(axis=1)
    # an edge is moved by half a sample at most, of the width of the narrowest pulse 5e-4
    np.testing.assert_allclose(share(corner), expected, rtol=2e-3)


def test_nothing_is_missing_where_nothing_flattens_and_more_the_lower_it_does() -> None:
    shares = [share(corner) for corner in (1e9, 15.0, 5.0)]
    np.testing.assert_allclose(
        shares[0], 1.0, rtol=1e-8
    )  # a corner's own distance: eight times its reciprocal at most
    assert np.all(np.diff(shares, axis=0) < 0.0)


def test_where_nothing_is_switched_there_is_no_share() -> None:
    found = eddy_share(prototype(), POINTS, np.array([0.05, np.nan, -0.3]))
    assert np.isnan(found).tolist() == [False, True, False]


def test_bridges_that_cancel_each_other_everywhere_have_a_share_of_nothing() -> None:
    edges = np.array([0.0, -0.2, 0.0, -0.2])[:, None]
    assert share_left(edges, np.array([280.0]), np.array([280.0]), 15.0) == pytest.approx(1.0 + 15.0**-2)


def test_variants_may_flatten_at_harmonics_of_their_own() -> None:
    """A parameter space over it: simulated together as one by one."""
    places = Points(D1=np.array([1.0, 0.7]), D2=np.array([0.05, 0.3]), power_W=np.array([1500.0, 400.0]))
    models = [Model(converter=flattening_at(corner)) for corner in (5.0, 15.0)]
    together = simulate_many(models, places)
    for model, found in zip(models, together, strict=True):
        # a state is found to 2e-7 of the power
        np.testing.assert_allclose(found["P1_W"], simulate(model, places)["P1_W"], rtol=1e-6)
    assert np.all(together[0]["P1_W"] < together[1]["P1_W"] - 1e-3)
