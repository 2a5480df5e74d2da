"""Heat that lags behind: what a slow part shows is no cause, no leftover and no noise."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.mocks.lab.laboratory import Inertia, Laboratory
from drivers.mocks.lab.survey import schedule, survey
from experiments.blind.trial import BlindTrial, efficiency_table, laboratory
from experiments.slow_bench_trials import inertia_of
from models.dataset import Measurements, load_measurements
from models.diagnosis.diagnose import diagnose
from models.diagnosis.found import Begun, _lagging
from models.diagnosis.heat_lag import TIME_CONSTANTS_S, Heated, History, heat_lags, lag_K, own_lags
from models.diagnosis.law import law_columns
from models.diagnosis.noise import Replicates, estimate_noise
from models.diagnosis.observations import Observations, observe
from models.diagnosis.signatures import Signatures, signatures
from models.diagnosis.usable import usable_readings
from sim.model import Model
from sim.prototype import prototype
from tests.models.diagnosis.virtual_campaign import set_points

ALONE = BlindTrial(row="slow", seed=470_014)
SLOW = Inertia(heatsink_s=400.0, inductor_s=900.0, transformer_s=1200.0)
ROWS = 30
RNG = np.random.default_rng(4)
SETTLED_C = RNG.uniform(30.0, 120.0, ROWS)
TIME_S = np.cumsum(RNG.uniform(60.0, 300.0, ROWS))


def campaign(
    hidden: dict[str, float | None], inertia: Inertia, *, seed: int = 5, again: int = 12
) -> Measurements:
    """60 rows every three minutes, and the first set point ``again`` in between."""
    D1, D2, power = set_points(60, seed)
    place = np.sort(np.concatenate([np.arange(D1.size), np.linspace(1, D1.size - 1, again)])).astype(int)
    repeated = np.diff(place, prepend=-1) == 0
    chosen = np.where(repeated, 0, place)
    lab = replace(Laboratory.draw(seed=seed, hidden=hidden), inertia=inertia)
    return load_measurements(survey(lab, schedule(D1[chosen], D2[chosen], power[chosen]), seed=seed))


def stepped(time_constant_s: float, step_s: float = 0.5) -> np.ndarray:
    """How far above where each row settles a part is at its end, by small steps of time."""
    above, now_C, now_s = [0.0], SETTLED_C[0], TIME_S[0]
    for then_s, settled_C in zip(TIME_S[1:], SETTLED_C[1:], strict=True):
        while now_s < then_s:
            h = min(step_s, then_s - now_s)
            now_C += (settled_C - now_C) * h / time_constant_s
            now_s += h
        above.append(now_C - settled_C)
    return np.array(above)


@pytest.mark.parametrize("time_constant_s", TIME_CONSTANTS_S)
def test_a_lag_is_that_of_a_first_order_part(time_constant_s: float) -> None:
    found = lag_K(SETTLED_C, TIME_S, time_constant_s)
    np.testing.assert_allclose(
        found, stepped(time_constant_s), atol=0.2
    )  # K; Euler's steps of 0.5 s in 240 s
    assert np.max(np.abs(found)) > 20.0


def test_rows_in_any_order_have_the_history_of_their_times() -> None:
    order = RNG.permutation(ROWS)
    np.testing.assert_allclose(
        lag_K(SETTLED_C[order], TIME_S[order], 900.0), lag_K(SETTLED_C, TIME_S, 900.0)[order], rtol=1e-12
    )  # rounding


def test_a_row_that_is_not_simulated_heats_nothing() -> None:
    holed = SETTLED_C.copy()
    holed[3] = np.nan
    found, rest = lag_K(holed, TIME_S, 900.0), np.arange(ROWS) != 3
    np.testing.assert_allclose(
        found[rest], lag_K(SETTLED_C[rest], TIME_S[rest], 900.0), rtol=1e-12
    )  # rounding
    assert found[3] == 0.0


def seen(inertia: Inertia = SLOW) -> tuple[Observations, History]:
    whole = observe(campaign({}, inertia).frame, prototype())
    return whole, History.of(whole, whole.reference(Model.baseline()))


def test_a_sensor_shows_its_parts_lag_whole_and_no_other_parts() -> None:
    whole, history = seen()
    part = Heated(
        column="T_inductor_C", step_K=np.ones(whole.value.size), moved=np.full(whole.value.size, 0.02)
    )
    found = heat_lags(whole, history, [part])
    before = history.courses_K("T_inductor_C")["T_inductor_C 600 s behind"]
    own, row = whole.of("T_inductor_C"), np.searchsorted(history.rows, whole.row)
    direction = found["T_inductor_C 600 s behind"]
    np.testing.assert_allclose(direction[own], 0.5 * before[row][own], rtol=1e-12)  # rounding
    power = whole.of("efficiency")
    small = 1.0 + 0.3**2  # a step of one kelvin tells the slope to that
    np.testing.assert_allclose(
        direction[power], 0.5 * 0.02 / small * before[row][power], rtol=1e-12
    )  # rounding
    assert not np.any(found["T_inductor_C 600 s behind, losses"][own])


def test_nobody_knows_what_a_bench_did_in_a_gap() -> None:
    times_s = np.array([0.0, 180.0, 360.0, 1080.0, 1260.0, 1500.0])  # one of 720 s; 240 s are none
    settled = dict.fromkeys(("T_heatsink_C", "T_inductor_C", "T_transformer_C"), SETTLED_C[:6])
    rises = dict.fromkeys(settled, 40.0)
    history = History(rows=np.arange(6), time_s=times_s, settled_C=settled, rise_K=rises)
    after = {name: course for name, course in history.courses_K("T_inductor_C").items() if "after" in name}
    ((name, course),) = after.items()
    assert name == "T_inductor_C after 1080 s"
    expected = 40.0 * np.exp(-np.array([0.0, 180.0, 420.0]) / 600.0)
    np.testing.assert_allclose(course, [0.0, 0.0, 0.0, *expected], rtol=1e-12)  # rounding


def test_rows_of_one_time_lag_behind_nothing() -> None:
    whole, _ = seen()
    at_once = replace(whole, points=replace(whole.points, time_s=0.0 * np.asarray(whole.points.time_s)))
    history = History.of(at_once, at_once.reference(Model.baseline()))
    part = Heated(column="T_inductor_C", step_K=np.ones(whole.value.size), moved=np.ones(whole.value.size))
    assert heat_lags(at_once, history, [part]) == {}


def test_what_a_cause_heats_lags_behind_in_its_own_part_alone() -> None:
    whole, _ = seen()
    own, used = whole.of("T_inductor_C"), np.unique(whole.row)
    warmer = np.where(own, 10.0 + whole.row % 7, 0.0)  # K for each unit
    found = own_lags(warmer, whole)
    assert len(found) == len(TIME_CONSTANTS_S)
    assert not np.any(found[:, ~own])
    rows = np.searchsorted(used, whole.row[own])
    more_K = np.full(used.size, np.nan)
    more_K[rows] = warmer[own]
    time_s = np.asarray(whole.points.time_s)[used]
    for column, time_constant_s in zip(found, TIME_CONSTANTS_S, strict=True):
        expected = 0.5 * lag_K(more_K, time_s, time_constant_s)[rows]
        np.testing.assert_allclose(column[own], expected, rtol=1e-12)  # rounding


def test_only_a_slow_bench_asks_for_it() -> None:
    whole, _ = seen()
    known = signatures(whole, Model.baseline())
    skin = [s for s in known.effects if s.effect == "skin_effect"]
    (_, plain), (_, slow) = (
        next(iter(law_columns(skin, whole, known.state, slow=slow))) for slow in (False, True)
    )
    np.testing.assert_array_equal(slow[: len(plain)], plain)
    assert len(slow) == len(plain) + 3 * len(TIME_CONSTANTS_S)
    assert every_lag().lagging(1.0).is_slow
    assert not every_lag().lagging(0.2).is_slow


def test_without_a_history_all_has_settled() -> None:
    whole, _ = seen()
    assert signatures(whole, Model.baseline()).lags == 0


def known(inertia: Inertia, hidden: dict[str, float | None] | None = None) -> Begun:
    rows = campaign(hidden or {}, inertia)
    usable = usable_readings(observe(rows.frame, prototype()), Model.baseline(), frozenset(), rows.rows)
    return Begun.of(usable, Model.baseline())


def test_replicates_tell_whether_parts_settle() -> None:
    at_once = Inertia(heatsink_s=1.0, inductor_s=1.0, transformer_s=1.0)
    assert known(at_once).usable.known.lags == 0
    slow = known(SLOW).usable.known
    assert slow.lags > 0
    assert len(slow.spread_names) == len(slow.spreads)
    assert slow.spread_names[-slow.lags] == "heat that lags behind, 1"


def test_what_lags_behind_is_no_noise() -> None:
    begun = known(SLOW)
    o, signs = begun.usable.observations, begun.usable.known
    slow = {n.channel: n.sigma for n in begun.noise}
    taken_for_it = {n.channel: n.sigma for n in estimate_noise(o, Replicates.of(o), o.value - signs.baseline)}
    for channel in ("T_heatsink_C", "T_transformer_C", "T_inductor_C"):
        assert taken_for_it[channel] > 2.0 * slow[channel]
        assert slow[channel] < 1.0  # K; sensors are good to 0.1


def every_lag() -> Signatures:
    whole, history = seen()
    return signatures(whole, Model.baseline(), history=history)


def test_a_share_of_the_lag_is_that_much_shorter() -> None:
    slow = every_lag()
    np.testing.assert_allclose(slow.lagging(0.5).slow, 0.5 * slow.slow, rtol=1e-12)  # rounding


def test_the_fewest_directions_have_the_covariance_of_all_but_for_a_sigma() -> None:
    slow, sigma = every_lag(), np.full(seen()[0].value.size, 0.1)
    few = slow.distinct(sigma)
    assert 0 < few.lags < slow.lags
    assert len(few.spread_names) == len(few.spreads)
    whole, less = ((s.slow / sigma).T @ (s.slow / sigma) for s in (slow, few))
    assert np.linalg.eigvalsh(whole - less)[-1] < 1.0  # squared sigmas
    np.testing.assert_array_equal(few.spreads[: -few.lags], slow.spreads[: -slow.lags])


def test_no_lag_leaves_no_direction() -> None:
    settled = every_lag().lagging(0.0).distinct(np.full(seen()[0].value.size, 0.1))
    assert settled.lags == 0
    assert len(settled.spread_names) == len(settled.spreads)


@pytest.mark.parametrize("again", [12, 0])
def test_a_slow_bench_with_nothing_hidden_is_consistent(again: int) -> None:
    assert diagnose(campaign({}, SLOW, again=again)).verdict.kind == "consistent"


def test_what_replicates_leave_open_all_readings_tell() -> None:
    """Of efficiency alone a dozen replicates say little of a part's heat; all rows together do."""
    lab = replace(laboratory(ALONE), inertia=inertia_of(ALONE.seed))
    rows = load_measurements(efficiency_table(survey(lab, ALONE.plan, seed=ALONE.seed)))
    usable = usable_readings(observe(rows.frame, prototype()), Model.baseline(), frozenset(), rows.rows)
    replicates = Replicates.of(usable.observations)
    tried = [_lagging(usable, share, replicates).log_likelihood for share in (0.0, 1.0)]
    assert abs(tried[1] - tried[0]) < 3.0  # in log likelihood: open
    assert Begun.of(usable, Model.baseline()).usable.known.lags > 0
    assert diagnose(rows).verdict.kind == "consistent"  # which was a thermal resistance before


@pytest.mark.parametrize(
    ("name", "value"), [("link_resistance", 0.08), ("sic_on_resistance", 0.8), ("core_loss_transformer", 2.0)]
)
def test_what_a_slow_bench_hides_is_named(name: str, value: float) -> None:
    assert diagnose(campaign({name: value}, SLOW)).verdict.named == (name,)
