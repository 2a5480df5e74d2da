"""Near the most that D1 and D2 carry: which rows take part, and what is known of how they bend."""

import multiprocessing
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from models.dataset import load_measurements
from models.diagnosis import usable as usable_rows
from models.diagnosis.covariance import noiseless_covariance
from models.diagnosis.diagnose import diagnose
from models.diagnosis.geometry import Geometry
from models.diagnosis.hypotheses import Fit, Term
from models.diagnosis.left_out import not_usable
from models.diagnosis.near_limit import (
    LEAST_SPARE,
    answers_about,
    first_looks,
    margin,
    power_to_spare,
    still_to_spare,
)
from models.diagnosis.observations import Observations, observe
from models.diagnosis.refinery import Refinery
from models.diagnosis.usable import LEAST_ROWS, TooFewPoints, Usable, usable_readings
from models.diagnosis.whitener import Whitener
from sim.model import Model
from sim.prototype import prototype
from sim.simulate import can_run, lossless_most_W, simulate
from sim.spread import shifted_together
from tests.models.diagnosis.fabricated import white_leftovers
from tests.models.diagnosis.virtual_campaign import simulated_campaign

BASELINE = Model.baseline()
SOLVED_W = 1e-3  # two solutions, each good to 2e-7 of 2 kW
ALONE = ["kind", "D1", "D2", "P2_W", "P1_W", "efficiency"]


@pytest.fixture(scope="module")
def everything() -> Observations:
    return observe(simulated_campaign(BASELINE, seed=1, count=40), prototype())


@pytest.fixture(scope="module")
def alone() -> Observations:
    """The same of efficiency alone."""
    return observe(simulated_campaign(BASELINE, seed=1, count=40)[ALONE], prototype())


@pytest.fixture(scope="module")
def usable(everything: Observations) -> Usable:
    return usable_of(everything)


def usable_of(whole: Observations) -> Usable:
    return usable_readings(whole, BASELINE, frozenset(), range(len(whole.frame)))


def refinery_of(usable: Usable) -> Refinery:
    """One that takes readings to scatter by a watt."""
    known, o = usable.known, usable.observations
    covariance = noiseless_covariance(o, known).noisier(np.ones(o.value.size))
    geometry = Geometry.of(Whitener.of(covariance), known.spreads, white_leftovers(o.value.size))
    return Refinery(known=known, observations=o, baseline=BASELINE, geometry=geometry)


def with_cause(usable: Usable, name: str, value: float) -> Fit:
    """An effect alone at a value, on its line."""
    signature = next(s for s in usable.known.effects if s.effect == name)
    term = Term(signature=signature, value=value, sigma=0.01, slope=signature.slope)
    return replace(
        Fit.nothing(usable.observations.value.size), terms=(term,), shift=term.distance * term.slope
    )


def test_where_efficiency_is_alone_readings_nearer_the_edge_take_part(
    alone: Observations, everything: Observations
) -> None:
    assert margin(alone) < margin(everything)
    rows = [set(o.row[power_to_spare(o, BASELINE, margin(o))]) for o in (alone, everything)]
    assert rows[0] > rows[1]


def test_rows_whose_limit_hardly_moves_are_the_same_without_a_simulation(usable: Usable) -> None:
    """Whatever an effect does to losses and pulses, as far as it goes; parts off by two sigma beside it."""
    o, modes, parts = usable.observations, usable.known.modes, np.random.default_rng(7)
    entries = {s.effect: s.entry for s in usable.known.effects}
    for name, entry in entries.items():
        for value in (entry.headline.lower, entry.headline.upper):
            spreads = zip(modes.spreads, parts.choice([-2.0, 2.0], len(modes)).tolist(), strict=True)
            model = Model(converter=shifted_together(prototype(), spreads))
            model = model.with_effect(name, **{entry.headline.name: value})
            found = still_to_spare(o, BASELINE, model, usable.margin)
            np.testing.assert_array_equal(found, power_to_spare(o, model, LEAST_SPARE), err_msg=name)


def test_rows_without_power_have_it_to_spare() -> None:
    frame = simulated_campaign(BASELINE, seed=1, count=12)
    idle = pd.DataFrame(
        {"kind": ["standby", "no_load"], "D1": 0.9, "D2": 0.1, "P2_W": 0.0, "P1_W": [0.5, 4.0]}
    )
    o = observe(pd.concat([frame, idle], ignore_index=True), prototype())
    without = np.flatnonzero(o.frame["P2_W"] == 0.0)
    assert set(without) <= set(o.row)
    np.testing.assert_array_equal(power_to_spare(o, BASELINE, 20.0), np.isin(o.row, without))


def test_what_a_link_inductance_bends_is_known_of_all_readings_together(alone: Observations) -> None:
    """Whether one is smaller than nominal is one thing that all of them tell: no noise of each."""
    kept = usable_of(alone)
    o, known = kept.observations, kept.known
    inductance = known.spread_names.index("inductor.inductance_H")
    spread = known.modes.spreads[inductance]
    ((less, _),) = o.solved([Model(converter=spread.shifted(prototype(), -1.0))])
    missed = less - (known.baseline - known.spreads[inductance])  # by a line through one sigma
    assert np.abs(missed).max() > 0.5  # W, some times the noise of a reading
    np.testing.assert_allclose(known.bends, 0.5 * missed[None], atol=SOLVED_W)
    common = noiseless_covariance(o, known).common
    np.testing.assert_array_equal(common, np.concatenate([known.spreads, known.bends]))


def test_beside_other_channels_nothing_bends(everything: Observations) -> None:
    assert usable_of(everything).known.bends.shape[0] == 0


def test_a_first_look_is_at_all_rows_by_however_many_processes(alone: Observations) -> None:
    expected = alone.reference(BASELINE)["P1_W"]
    for processes in (1, 2):
        spare, of_all = first_looks(replace(alone, processes=processes), BASELINE)
        np.testing.assert_array_equal(spare, power_to_spare(alone, BASELINE, margin(alone)))
        np.testing.assert_allclose(of_all["P1_W"], expected, rtol=1e-9)  # rounding


def test_a_single_process_looks_without_a_fork(alone: Observations, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        multiprocessing.get_context("fork").Process, "start", lambda self: pytest.fail("a fork was started")
    )
    first_looks(replace(alone, processes=1), BASELINE)


def test_answers_about_a_cause_are_those_of_its_own_model(alone: Observations) -> None:
    usable = usable_of(alone)
    o, known = usable.observations, usable.known
    spread = known.modes.spreads[known.spread_names.index("inductor.inductance_H")]
    model = BASELINE.with_effect("link_resistance", resistance_Ohm=0.1)
    slope, bend = answers_about(o, model, spread, None)
    seen = [
        o.predicted(o.reference(Model(converter=spread.shifted(prototype(), k), effects=model.effects)))
        for k in (-1.0, 0.0, 1.0)
    ]
    np.testing.assert_allclose(seen[0], seen[1] - slope + bend, atol=SOLVED_W)
    np.testing.assert_allclose(seen[2], seen[1] + slope + bend, atol=SOLVED_W)


@pytest.mark.parametrize("channels", ["everything", "alone"])
def test_rows_that_a_cause_leaves_no_power_to_spare_take_no_part(
    channels: str, request: pytest.FixtureRequest
) -> None:
    whole = request.getfixturevalue(channels)
    usable = usable_of(whole)
    refinery = refinery_of(usable)
    fit = with_cause(usable, "leakage_inductance", 0.12)
    found = usable.as_explained(refinery, fit)
    assert found is not usable
    model, p = refinery.model(fit, refinery.spreads(fit)), whole.points
    spare = replace(p, power_W=p.power_W * (1 + LEAST_SPARE))
    carried = np.flatnonzero(can_run(model, spare) | ~np.asarray(p.pwm, dtype=bool))
    expected = np.intersect1d(usable.observations.row, carried)
    assert expected.size < np.unique(usable.observations.row).size
    np.testing.assert_array_equal(np.unique(found.observations.row), expected)
    assert found.known.baseline.size == found.known.spreads.shape[1] == found.observations.value.size
    # what takes no part near the limit is still of use to a surrogate
    lost = np.setdiff1d(usable.observations.row, expected)
    np.testing.assert_array_equal(np.unique(found.edge.row), np.union1d(usable.edge.row, lost))
    rows = [row for row in not_usable(whole.frame, usable, found.observations) if row["column"] == "P2_W"]
    listed = {row["row"]: row["reason"] for row in rows}
    first = set(usable.edge.row.tolist())
    assert set(listed) == set(lost.tolist()) | first
    assert all(("beside the first explanation" in listed[row]) == (row not in first) for row in listed)


@pytest.mark.parametrize("channels", ["everything", "alone"])
def test_a_cause_that_takes_no_power_changes_nothing(channels: str, request: pytest.FixtureRequest) -> None:
    usable = usable_of(request.getfixturevalue(channels))
    fit = with_cause(usable, "auxiliary_power", 3.0)
    assert usable.as_explained(refinery_of(usable), fit) is usable


def test_a_channel_that_loses_all_its_rows_is_none(everything: Observations) -> None:
    """D0 read only where the cause leaves no power to spare."""
    usable = usable_of(everything)
    refinery, fit = refinery_of(usable), with_cause(usable, "leakage_inductance", 0.12)
    kept = usable.as_explained(refinery, fit).observations.row
    read = ~usable.observations.of("D0") | ~np.isin(usable.observations.row, kept)
    few = replace(usable, observations=usable.observations.take(read), known=usable.known.take(read))
    found = few.as_explained(refinery_of(few), with_cause(few, "leakage_inductance", 0.12))
    names = [c.name for c in usable.observations.channels]
    assert [c.name for c in found.observations.channels] == [name for name in names if name != "D0"]
    assert found.observations.channel.max() == len(found.observations.channels) - 1


def test_a_row_that_does_not_run_with_another_inductance_takes_no_part(
    alone: Observations, monkeypatch: pytest.MonkeyPatch
) -> None:
    usable = usable_of(alone)

    def answers(o: Observations, *_: object) -> np.ndarray:
        return np.where(o.row == o.row[5], np.nan, np.ones((2, o.value.size)))

    monkeypatch.setattr(usable_rows, "answers_about", answers)
    refinery, fit = refinery_of(usable), with_cause(usable, "duty_offset", -0.05)
    model = refinery.model(fit, refinery.spreads(fit))
    spare = power_to_spare(usable.observations, model, LEAST_SPARE)
    assert spare[5]
    found = usable.as_explained(refinery, fit)
    expected = set(usable.observations.row[spare]) - {usable.observations.row[5]}
    assert set(found.observations.row) == expected
    assert np.all(np.isfinite(found.known.bends))


def test_without_a_cause_nothing_changes(alone: Observations, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the parts' spreads would leave to spare."""
    usable = usable_of(alone)
    monkeypatch.setattr(usable_rows, "still_to_spare", lambda o, *_: o.row != o.row[5])
    assert usable.as_explained(refinery_of(usable), Fit.nothing(usable.observations.value.size)) is usable


def test_where_too_few_rows_would_be_left_all_stay(everything: Observations) -> None:
    rows = np.flatnonzero(everything.loaded)[-LEAST_ROWS:]
    usable = usable_of(everything)
    few = np.isin(usable.observations.row, rows)
    usable = replace(usable, observations=usable.observations.take(few), known=usable.known.take(few))
    fit, refinery = with_cause(usable, "leakage_inductance", 0.2), refinery_of(usable)
    model = refinery.model(fit, refinery.spreads(fit))
    assert not np.all(power_to_spare(usable.observations, model, LEAST_SPARE))
    assert usable.as_explained(refinery, fit) is usable


def test_with_efficiency_alone_readings_bend_as_the_cause_has_it(alone: Observations) -> None:
    usable = usable_of(alone)
    refinery = refinery_of(usable)
    fit = with_cause(usable, "duty_offset", -0.05)
    found = usable.as_explained(refinery, fit)
    o, known = found.observations, found.known
    inductance = known.spread_names.index("inductor.inductance_H")
    model = refinery.model(fit, refinery.spreads(fit))
    slope, bend = answers_about(o, model, known.modes.spreads[inductance], None)
    np.testing.assert_allclose(known.bends, [slope - known.spreads[inductance], bend], atol=SOLVED_W)
    assert np.abs(known.bends[0]).max() > 0.1  # W: the slope is another beside the cause


def test_what_a_link_inductance_off_is_a_cause_of_bends_as_at_first(alone: Observations) -> None:
    usable = usable_of(alone)
    found = usable.as_explained(refinery_of(usable), with_cause(usable, "leakage_inductance", 0.12))
    kept = np.isin(usable.observations.row, found.observations.row)
    np.testing.assert_array_equal(found.known.bends, usable.known.bends[:, kept])


def test_readings_of_one_frame_are_put_together_by_their_channels(everything: Observations) -> None:
    D0 = everything.of("D0")
    others = everything.take(~D0).in_use()
    both = others.and_also(everything.take(D0).in_use())
    names = [c.name for c in everything.channels]
    channel = np.array([names.index(c.name) for c in both.channels])[both.channel]
    order = np.lexsort((both.row, channel))
    np.testing.assert_array_equal(both.value[order], everything.value)
    np.testing.assert_array_equal(both.row[order], everything.row)


def test_a_diagnosis_goes_by_the_rows_that_its_first_cause_carries() -> None:
    """An inductance 12 % too large: it takes the twelve that the baseline had to spare."""
    model = BASELINE.with_effect("leakage_inductance", relative_error=0.12)
    frame = simulated_campaign(model, seed=1, count=40)
    first = set(usable_of(observe(frame, prototype())).observations.row.tolist())
    measurements = load_measurements(frame)
    found = diagnose(measurements)
    rows = set(found.observations.row.tolist())
    assert rows < first
    assert found.refinery.observations is found.observations
    lost = {measurements.rows[k] for k in first - rows}
    assert lost <= {row["row"] for row in found.rejected if row["column"] == "P2_W"}
    assert found.verdict.stated == ("leakage_inductance",)


@pytest.mark.parametrize(
    ("cause", "values", "directions"),
    [("duty_offset", {"offset": -0.02}, 2), ("link_resistance", {"resistance_Ohm": 0.1}, 1)],
)
def test_a_diagnosis_of_efficiency_alone_weighs_again_what_takes_power_from_rows(
    cause: str, values: dict[str, float], directions: int
) -> None:
    """A shorter pulse leaves a row less than three per cent; a resistance takes none below that."""
    frame = simulated_campaign(BASELINE.with_effect(cause, **values), seed=1, count=40)[ALONE]
    found = diagnose(load_measurements(frame))
    assert found.verdict.stated == (cause,)
    assert found.refinery.known.bends.shape == (directions, found.observations.value.size)


def test_a_table_of_which_no_row_has_power_to_spare_is_refused_in_words() -> None:
    """Every row at 97 % of the most that its D1 and D2 carry without losses, and none without load."""
    points = observe(simulated_campaign(BASELINE, seed=1, count=40), prototype()).points
    points = replace(points, power_W=0.97 * lossless_most_W(BASELINE, points))
    tight = ~can_run(BASELINE, replace(points, power_W=1.12 * points.power_W))
    full = simulate(BASELINE, points.take(np.flatnonzero(tight)))
    frame = pd.DataFrame({name: full[name] for name in ("P1_W", "P2_W", "efficiency", "D0")})
    with pytest.raises(TooFewPoints, match=r"^0 of \d+ loaded rows .* at least 12\. Make sure"):
        usable_of(observe(frame.assign(kind="load", D1=full.points.D1, D2=full.points.D2), prototype()))
