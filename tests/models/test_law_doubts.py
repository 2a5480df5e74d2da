"""What the model's own laws may be wrong by: small where little is lost, alike where swings are cut as short."""

from dataclasses import replace

import numpy as np
import pytest

from models.calibrated import PLAIN, Leftover
from models.eddy_doubts import PARTS
from models.law_doubts import COLUMNS, law_covariance, law_doubts
from sim.harmonics import eddy_share
from sim.losses import missing_losses
from sim.model import Model
from sim.prototype import prototype
from sim.simulate import Points, simulate

FLATTENS, IN_SWINGS, FIRST_REST, FIRST_MISSING = 3, 4, 5, 9  # of both, the primary's edges come first
FAR = (np.zeros((2, 2)), np.zeros((2, 2)))  # points that have nothing in common on the map


def cut(missing: float, edge: int = 0) -> np.ndarray:
    """A point with an edge that misses a share of its swing, good to 0.5 W."""
    doubts = np.zeros(COLUMNS)
    doubts[FIRST_REST + edge], doubts[FIRST_MISSING + edge] = 0.5, missing
    return doubts


def test_swings_cut_as_short_are_off_by_as_much_anywhere_on_the_map() -> None:
    same, other = (np.stack([cut(0.4), cut(share)]) for share in (0.4, 0.9))
    np.testing.assert_allclose(law_covariance(same, same, FAR), 0.25)
    assert law_covariance(other, other, FAR)[0, 1] < 0.02  # two and a half lengths apart


def test_edges_of_a_bridge_have_one_curve_and_add_up() -> None:
    first, second, both = cut(0.4), cut(0.4, 1), cut(0.4) + cut(0.4, 1)
    secondary = cut(0.4, 2)
    found = law_covariance(np.stack([first, second, both, secondary]), first[None], (np.zeros((4, 1)),) * 2)
    np.testing.assert_allclose(found[:, 0], [0.25, 0.25, 0.5, 0.0])


def test_a_soft_edge_is_as_sure_as_the_laws() -> None:
    light = Points(D1=np.linspace(0.3, 1.0, 8), D2=0.1, power_W=200.0)
    doubts = law_doubts(simulate(Model.baseline(), light), Model.baseline())
    rest_W, missing = doubts[:, FIRST_REST:FIRST_MISSING], doubts[:, FIRST_MISSING:]
    assert np.any(rest_W > 0.0)
    assert not np.any(rest_W[missing == 0.0])


def test_a_clamped_leg_that_is_hard_all_the_way_is_doubted_by_as_much_as_two_sound_formulas_differ() -> None:
    """Half of charge times voltage, as if capacitances were constant, and the energies of their curves."""
    model = Model.baseline()
    places = Points(D1=np.array([0.8488, 0.80224, 0.7]), D2=np.array([0.125, 0.173, 0.2]), power_W=400.0)
    result = simulate(model, places)
    assert np.all(result["missing_primary_rise"] == 1.0)
    bridge, half_V = model.converter.primary, 0.5 * model.converter.V1_V
    charge_C = sum(d.capacitance.charge_C(half_V) for d in (bridge.outer, bridge.inner, bridge.clamp))
    legs, a_period = 2, 2
    constant_W = legs * a_period * model.converter.frequency_Hz * 0.5 * charge_C * half_V
    voltages = model.converter.V1_V, model.converter.V2_V
    (by_curves_W,) = missing_losses(model.converter, np.ones((4, 1)), *voltages)[0]
    doubted_W = law_doubts(result, model)[:, FIRST_REST]
    np.testing.assert_allclose(doubted_W, constant_W - by_curves_W, rtol=0.3)  # an assumption, to a third


def test_doubts_have_no_steps_where_a_swing_begins_to_be_cut_and_where_nothing_of_it_is_left() -> None:
    across = Points(D1=np.linspace(0.6, 0.9, 401), D2=0.2, power_W=400.0)  # two edges go from soft to hard
    doubts = law_doubts(simulate(Model.baseline(), across), Model.baseline())
    missing = doubts[:, FIRST_MISSING:]
    assert {0, 2} == set(np.flatnonzero((missing.min(axis=0) < 0.01) & (missing.max(axis=0) > 0.99)))
    # 0.03 W is an eighth of what closing on all of a swing is doubted by, and from point to point a tenth is missed
    assert np.max(np.abs(np.diff(doubts[:, :FIRST_MISSING], axis=0))) < 0.03


def test_added_eddy_currents_are_doubted_by_half_of_what_flattening_takes_away() -> None:
    """By two simulations, of windings with what an effect adds and without; what is modelled has no such doubt."""
    places = Points(
        D1=np.array([1.0, 0.98, 0.9, 0.6]), D2=0.05, power_W=np.array([1800.0, 1800.0, 900.0, 400.0])
    )
    plain = Model.baseline()
    lossy = plain.with_effect("skin_effect", extra_at_fs=0.1)
    with_, without = (simulate(model, places) for model in (lossy, plain))
    added_W = sum(with_[f"loss_{part}_copper_W"] - without[f"loss_{part}_copper_W"] for part in PARTS)
    share = eddy_share(prototype(), places.with_voltages_of(prototype()), with_["D0"])
    found = law_doubts(with_, lossy)[:, FLATTENS]
    # what they add warms the windings, which lose up to a tenth of it more by their dc resistance
    np.testing.assert_allclose(found, added_W * 0.5 * (1.0 / share - 1.0), rtol=0.12)
    assert found[0] > 1.2 * found[1]  # where pulses are as wide as they go
    assert not np.any(law_doubts(without, plain)[:, [FLATTENS, IN_SWINGS]])


def test_hot_windings_that_lose_less_are_cooler_and_lose_less_again() -> None:
    """Beside a simulation of windings with as much less as flattens at that place."""
    plain = Model.baseline()
    hot = Points(D1=np.array([1.0]), D2=0.05, power_W=np.array([1900.0]))
    lossy = plain.with_effect("skin_effect", extra_at_fs=1.0)
    with_ = simulate(lossy, hot)
    (share,) = eddy_share(prototype(), hot.with_voltages_of(prototype()), with_["D0"])
    less = simulate(plain.with_effect("skin_effect", extra_at_fs=1.0 - 0.5 * (1.0 / share - 1.0)), hot)
    lost_W = [sum(found[f"loss_{part}_copper_W"][0] for part in PARTS) for found in (with_, less)]
    # to first order: they are 4 K cooler then. Without that the doubt is three quarters of this.
    assert law_doubts(with_, lossy)[0, FLATTENS] == pytest.approx(lost_W[0] - lost_W[1], rel=0.05)


def test_added_eddy_currents_may_help_in_swings_or_not() -> None:
    """Beside the catalogue's own resistance in series, as much as they add at the temperatures that windings have.

    The last place has soft edges, and is doubted by what turning off an ampere less makes.
    """
    on_ridges = Points(
        D1=np.array([0.83, 0.80, 0.77, 0.93, 0.50]), D2=np.array([0.155, 0.185, 0.205, 0.045, 0.05]),
        power_W=np.array([500.0, 500.0, 500.0, 500.0, 1000.0]),
    )  # fmt: skip
    plain = Model.baseline()
    beside = plain.with_effect("skin_effect", extra_at_fs=1.0)
    result = simulate(beside, on_ridges)
    windings = plain.converter.inductor.winding, plain.converter.transformer.winding
    added_Ohm = sum(w.at(result[f"T_{part}_C"]) for w, part in zip(windings, PARTS, strict=True))
    doubted_W = law_doubts(result, beside)[:, IN_SWINGS]
    for k, resistance_Ohm in enumerate(added_Ohm):
        place = on_ridges.take(np.array([k]))
        in_series = simulate(
            plain.with_effect("link_resistance", resistance_Ohm=float(resistance_Ohm)), place
        )
        lost_W = [
            sum(w for name, w in found.values.items() if name.endswith(("switching_W", "recovery_W")))
            for found in (in_series, result.take(np.array([k])))
        ]
        # W: the link's resistance does not warm the windings, which moves currents by less than a thousandth
        assert doubted_W[k] == pytest.approx(lost_W[0].item() - lost_W[1].item(), abs=1e-3)
    assert np.all(doubted_W[:4] > 0.02)  # W: 0.004 to 0.012 points of efficiency


def test_what_eddy_currents_do_in_swings_is_one_error_all_over_the_map() -> None:
    doubts = np.zeros((2, COLUMNS))
    doubts[:, IN_SWINGS] = 0.05, -0.02
    for alike, expected in ((1.0, 1.16), (0.0, 1.0)):
        found = law_covariance(doubts, doubts, (np.zeros((2, 2)), np.full((2, 2), alike)), doubt=0.1)
        assert found[0, 1] == pytest.approx(-1e-3 * expected)


def test_eddy_currents_are_off_alike_everywhere_and_a_little_otherwise_elsewhere() -> None:
    doubts = np.zeros((2, COLUMNS))
    doubts[:, FLATTENS] = 0.2, 0.4
    for alike, expected in ((1.0, 1.16), (0.0, 1.0)):
        found = law_covariance(doubts, doubts, (np.full((2, 2), alike), np.zeros((2, 2))), doubt=0.1)
        assert found[0, 1] == pytest.approx(0.08 * expected)


def test_smooth_laws_are_doubted_by_a_share() -> None:
    doubts = np.zeros((2, COLUMNS))
    doubts[:, 0] = 0.2
    alike = np.ones((2, 2)), np.zeros((2, 2))
    np.testing.assert_allclose(law_covariance(doubts, doubts, alike, doubt=0.5), 0.01)


def test_a_loss_that_grows_is_doubted_more() -> None:
    found = simulate(Model.baseline(), Points(D1=np.full(2, 0.9), D2=0.1, power_W=np.array([400.0, 1800.0])))
    light, heavy = law_doubts(found, Model.baseline())
    assert 0.0 < light[0] < heavy[0] < 0.05 * 60.0  # W: five per cent of what is lost there, at most


def test_an_offset_in_watts_follows_the_rated_power_and_what_is_smooth_the_loss() -> None:
    empty = Leftover(place=np.empty((0, PLAIN)), weight=np.empty(0), noise_W=np.empty(0), length=np.ones(4))
    same, twice = (empty.of(replace(prototype(), rated_power_W=rated_W)) for rated_W in (2000.0, 4000.0))
    assert [twice.offset_W, same.offset_W] == pytest.approx([2 * empty.offset_W, empty.offset_W])
    assert (twice.smooth, twice.rough, twice.gain) == (empty.smooth, empty.rough, empty.gain)
    light, heavy = (np.array([[0.9, 0.1, 1000.0, 0.0, loss_W]]) for loss_W in (10.0, 30.0))
    no_analyzer = replace(empty, offset_W=0.0, gain=0.0)
    found = [no_analyzer.covariance(place, place).item() for place in (light, heavy)]
    assert found[1] == pytest.approx(9 * found[0])
