"""Signatures: small steps that stay possible, and slopes that predict what the simulator does."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.observations import Observations, observe
from models.diagnosis.signatures import Signatures, signatures
from models.diagnosis.variants import step_of
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.prototype import prototype
from sim.spread import everyday_spread
from tests.models.diagnosis.virtual_campaign import simulated_campaign


@pytest.fixture(scope="module")
def observations() -> Observations:
    frame = simulated_campaign(Model.baseline(), seed=1, count=16)
    return observe(frame[frame["P2_W"] < 1000.0], prototype())  # well below what D1 and D2 can carry


@pytest.fixture(scope="module")
def known(observations: Observations) -> Signatures:
    return signatures(observations, Model.baseline())


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_step_stays_inside_the_bounds(name: str) -> None:
    head = CATALOGUE[name].headline
    assert step_of(CATALOGUE[name]) != 0
    assert head.lower <= head.off + step_of(CATALOGUE[name]) <= head.upper


@pytest.mark.parametrize("name", CATALOGUE)
@pytest.mark.parametrize("sigmas", [-3.0, 3.0])
def test_every_effect_can_stand_beside_every_spread(name: str, sigmas: float) -> None:
    head, converter = CATALOGUE[name].headline, prototype()
    own = getattr(CATALOGUE[name], "paths", ())  # the effect takes the place of these parameters' spreads
    for spread in everyday_spread(converter):
        if spread.path not in own:
            converter = spread.shifted(converter, sigmas)  # as far as a diagnosis lets a spread go
    for value in (head.lower, head.upper):
        Model(converter=converter).with_effect(name, **{head.name: value}).altered_converter()


def test_the_baseline_is_what_was_measured(observations: Observations, known: Signatures) -> None:
    assert known.finite().all()
    # both calls solve to 1e-6 of the power
    np.testing.assert_allclose(known.baseline, observations.value, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "channel"),
    [
        ("link_resistance", "efficiency"),
        ("auxiliary_power", "efficiency"),
        ("analyzer_gain", "efficiency"),
        ("gate_delay_skew", "D0"),
        ("thermal_resistance", "T_heatsink_C"),
    ],
)
def test_a_slope_predicts_another_small_step(
    observations: Observations, known: Signatures, name: str, channel: str
) -> None:
    (signature,) = (s for s in known.effects if s.effect == name)
    step, mask = 0.5 * step_of(signature.entry), observations.of(channel)
    ((seen, _),) = observations.solved([Model.baseline().with_effect(name, **signature.values(step))])
    moved, said = (seen - known.baseline)[mask], signature.slope[mask] * step
    # what is not linear in half a step of a fifth of the prior is a few per cent of the largest move
    np.testing.assert_allclose(said, moved, atol=0.05 * np.max(np.abs(moved)))


def test_an_offset_of_the_output_power_moves_what_is_predicted_at_it(known: Signatures) -> None:
    offset = known.spreads[known.spread_names.index("analyzer port 2 offset")]
    sigma_W = 5e-4 / 3**0.5 * 0.75 * prototype().rated_power_W  # of the range in use, uniform
    np.testing.assert_allclose(offset, sigma_W * known.per_watt, rtol=1e-12)  # rounding


def test_both_dc_ports_are_good_to_the_same_share_of_their_range(known: Signatures) -> None:
    directions = dict(zip(known.spread_names, known.spreads, strict=True))
    input_W = np.max(np.abs(directions["analyzer_offset"]))
    output_W = np.max(np.abs(directions["analyzer port 2 offset"])) / np.max(np.abs(known.per_watt))
    assert input_W == pytest.approx(output_W, rel=0.05)  # the catalogue's figure has two digits


def test_an_everyday_spread_of_all_parts_together_is_a_direction_beside_theirs(known: Signatures) -> None:
    (signature,) = (s for s in known.effects if s.effect == "reverse_recovery")
    own = known.own_spreads("reverse_recovery")
    names = [known.spread_names[k] for k in own]
    # what the parts' own spreads have in common, and the tolerance of them all
    assert names == ["reverse_recovery", "reverse_recovery"]
    np.testing.assert_array_equal(known.spreads[own[1]], signature.entry.headline.tolerance * signature.slope)


def test_a_threshold_that_no_reading_crosses_is_no_candidate(
    observations: Observations, known: Signatures
) -> None:
    hottest_C = float(observations.frame["T_heatsink_C"].max())
    tried = [s.other["threshold_C"] for s in known.effects if s.effect == "fan_step"]
    assert all(threshold_C < hottest_C for threshold_C in tried)
    scan = CATALOGUE["fan_step"].parameters[1].scan
    assert any(threshold_C > hottest_C for threshold_C in scan)  # so the rule had something to do


def test_what_is_left_out_has_no_signature(observations: Observations) -> None:
    few = observe(observations.frame.head(3), prototype())
    found = {s.effect for s in signatures(few, Model.baseline()).leaving_out({"skin_effect"}).effects}
    smooth = {name for name, entry in CATALOGUE.items() if not entry.threshold}
    assert found & smooth == smooth - {"skin_effect"}


def test_every_spread_has_a_direction(known: Signatures) -> None:
    assert len(known.spread_names) == len(known.spreads)
    lengths = np.linalg.norm(known.spreads, axis=1)
    silent = [name for name, length in zip(known.spread_names, lengths, strict=True) if length == 0]
    # what only a hard edge shows, these points need not show
    assert all(".turn_on." in name or ".recovery." in name for name in silent)
    assert np.all(np.isfinite(lengths))


def test_how_well_a_simulated_temperature_is_known_follows_the_room(
    observations: Observations, known: Signatures
) -> None:
    room_K = CATALOGUE["ambient_drift"].headline.tolerance * np.asarray(observations.points.time_s) / 3600
    sigma_K = known.state.sigma["T_heatsink_C"]
    assert np.all(sigma_K >= 0.99 * room_K)  # losses follow temperature a little
    later = replace(
        observations, points=replace(observations.points, time_s=observations.points.time_s + 72e3)
    )
    twenty_hours_K = signatures(later, Model.baseline(), among=()).state.sigma["T_heatsink_C"]
    # likewise
    np.testing.assert_allclose(twenty_hours_K**2 - sigma_K**2, (room_K + 2.0) ** 2 - room_K**2, rtol=0.1)


def test_every_bench_warms_up_a_little_on_a_straight_line(known: Signatures) -> None:
    courses = {s.other["time_constant_s"]: s for s in known.effects if s.effect == "warm_up_drift"}
    straight = courses[CATALOGUE["warm_up_drift"].off_values()["time_constant_s"]]
    assert len(courses) == 4
    np.testing.assert_array_equal(
        known.spreads[known.spread_names.index("warm_up_drift")],
        straight.entry.headline.tolerance * straight.slope,
    )


def test_the_current_of_readings_ahead_is_as_wrong_as_that_of_measured_ones(
    observations: Observations, known: Signatures
) -> None:
    ahead = replace(observations, value=np.ones(observations.value.size))  # what nobody has read yet
    place = known.spread_names.index("ac current gain")
    expected = signatures(ahead, Model.baseline()).spreads[place]
    assert np.max(expected) > 3e-3  # A: of some amperes
    np.testing.assert_allclose(known.spreads[place], expected, rtol=1e-12)  # rounding
