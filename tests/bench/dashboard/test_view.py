"""What is seen, from what is stored: words and levels, no browser."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from bench.dashboard import view
from bench.dashboard.progress import progress
from bench.dashboard.render import piece
from bench.dashboard.rows import NO_ROWS
from bench.dashboard.watcher import Feed, Watcher
from bench.states import State
from bench.store import Store
from tests.bench.dashboard.stored import BENCH, LINK, measure, moment_of, planned_points, running_campaign


def seen(store: Store, campaign: int) -> tuple[Watcher, Feed]:
    """A watcher that has looked, and what it holds of a campaign."""
    watcher = Watcher(store, now_s=iter(range(0, 10_000, 10)).__next__)
    watcher.look()
    watcher.feed(campaign)
    watcher.look()
    feed = watcher.feed(campaign)
    assert feed is not None
    return watcher, feed


def test_a_running_bench_says_so(store: Store) -> None:
    watcher, _ = seen(store, running_campaign(store))
    shown = view.banner(watcher.overview)
    assert (shown.level, shown.title) == ("running", f"Running: {BENCH}")


def test_unsafe_outranks_everything_and_says_what_to_do(store: Store) -> None:
    campaign = running_campaign(store)
    store.benches.latch(BENCH, "load NOT confirmed off")
    watcher, _ = seen(store, campaign)
    shown = view.banner(watcher.overview)
    assert shown.level == "unsafe"
    assert "load NOT confirmed off" in shown.said
    assert "by hand" in shown.todo


def test_a_bench_seen_off_says_when_and_how(store: Store) -> None:
    campaign = running_campaign(store)
    store.benches.seen_off(BENCH, "PWM off; load off; supply off")
    store.end(campaign, State.DONE, power_off="PWM off; load off; supply off")
    store.benches.release(BENCH, campaign)
    watcher, _ = seen(store, campaign)
    shown = view.banner(watcher.overview)
    assert shown.level == "off"
    assert "PWM off; load off; supply off" in shown.said


def test_progress_counts_rows_and_names_the_point(store: Store) -> None:
    campaign = running_campaign(store, 4)
    measure(store, campaign, [0, 1])
    measure(store, campaign, [2], bad="P2_W is 8 % off")
    store.live.write(campaign, moment_of(store, campaign, number=3))
    _, feed = seen(store, campaign)
    shown = progress(feed, datetime.now(UTC))
    assert (shown.done, shown.planned, shown.rejected, shown.share) == (3, 4, 1, 0.75)
    assert shown.point == "D1 0.800, D2 0.100, 1050 W"
    assert shown.settling == "12 s, given up after 600 s; still moving: heatsink drifts by −0.2 K/s"
    assert shown.settling_share == pytest.approx(0.6)
    assert shown.stale == ""


def test_a_plan_that_grows_is_shown_with_the_most_it_may_have_and_the_question_asked(store: Store) -> None:
    campaign = running_campaign(store, 4, plan={"points": 10, "adaptive": {"at_once": 4}})
    measure(store, campaign, [0, 1, 2, 3])
    new = replace(planned_points(4)[0], point=4, why="tells about core_loss")
    store.grow(campaign, [new], time_s=9.0, said=["verdict so far: group"])
    store.live.write(campaign, moment_of(store, campaign, number=4))
    _, feed = seen(store, campaign)
    shown = progress(feed, datetime.now(UTC))
    assert (shown.done, shown.planned, shown.at_most, shown.share) == (4, 10, True, 0.4)
    assert shown.left.startswith("at most ")
    assert shown.why == "tells about core_loss"


def test_a_campaign_that_is_silent_is_said(store: Store) -> None:
    campaign = running_campaign(store)
    store.live.write(campaign, moment_of(store, campaign))
    _, feed = seen(store, campaign)
    assert "no news for 1 min" in progress(feed, datetime.now(UTC) + timedelta(minutes=1)).stale


def test_limits_tell_what_is_above_and_what_is_missing(store: Store) -> None:
    campaign = running_campaign(store)
    store.live.write(campaign, moment_of(store, campaign))
    _, feed = seen(store, campaign)
    levels = {item.label: item.level for item in view.limits(feed.campaign, feed.moment)}
    assert levels["input current"] == "above"
    assert levels["input power"] == "near"
    assert levels["heatsink"] == "good"
    assert levels["output voltage"] == "missing"


def test_links_show_age_and_failures(store: Store) -> None:
    campaign = running_campaign(store)
    store.live.write(campaign, moment_of(store, campaign))
    _, feed = seen(store, campaign)
    assert feed.moment is not None
    later = datetime.fromisoformat(feed.moment.written) + timedelta(seconds=2)
    (link,) = view.links(feed.campaign, feed.moment, later)
    assert (link.age, link.failures, link.level) == ("2.5 s", "20 of 1000 failed", "near")
    assert link.last_error == "no reply in 1 s"


def test_last_readings_have_names_units_and_signs(store: Store) -> None:
    campaign = running_campaign(store)
    moment = moment_of(store, campaign)
    told = moment.readings | {"P2_W": 2091.5, "D0": -0.0625}
    store.live.write(campaign, replace(moment, readings=told, instruments=dict.fromkeys(view.SHOWN_OF, LINK)))
    _, feed = seen(store, campaign)
    shown = {link.name: link.reading for link in view.links(feed.campaign, feed.moment, datetime.now(UTC))}
    assert shown["analyzer"] == "input power 2150 W, output power 2092 W"
    assert shown["controller"] == "D0 −0.0625, heatsink 40 °C"


@pytest.mark.parametrize(
    ("rows", "said"),
    [([], "points"), ([0], "points, mean of 1 row"), ([0, 1], "points ± 1.000 (2 σ), mean of 2 rows")],
)
def test_the_mean_gap_says_of_how_many_rows(store: Store, rows: list[int], said: str) -> None:
    campaign = running_campaign(store)
    for number in rows:
        measure(store, campaign, [number], efficiency=0.97 + 0.01 * number)
    _, feed = seen(store, campaign)
    assert f"<small>{said}</small>" in piece("gap")(view.gap(feed.rows))


def test_the_gap_is_off_beyond_its_uncertainty_only(store: Store) -> None:
    campaign = running_campaign(store, 6)
    measure(store, campaign, [0, 1], efficiency=0.97)
    measure(store, campaign, [2], efficiency=0.972)
    measure(store, campaign, [3], efficiency=0.5, bad="the analyzer was in overrange")
    _, feed = seen(store, campaign)
    shown = view.gap(feed.rows)
    assert (shown.level, shown.points) == ("off", 3)
    assert shown.mean == "−0.933"
    assert view.gap(NO_ROWS).level == "nothing"


def test_what_happened_leaves_out_the_steps_of_points(store: Store) -> None:
    campaign = running_campaign(store)
    measure(store, campaign, [0])
    measure(store, campaign, [1], bad="too hot")
    _, feed = seen(store, campaign)
    lines = [(what, detail) for _, what, detail in view.happened(feed)]
    assert lines[0] == ("rejected", "D1 0.600, D2 0.100, 550 W: 97.000 %; too hot")
    assert lines[1] == ("accepted", "D1 0.500, D2 0.100, 300 W: 97.000 %")
    assert "settled" not in [what for what, _ in lines]


def test_a_virtual_lab_never_passes_for_hardware_nor_hardware_for_a_virtual_lab(store: Store) -> None:
    watcher, _ = seen(store, running_campaign(store))
    assert view.lab_of(watcher.overview) == "virtual"
    real = [row | {"virtual": False} for row in watcher.overview.campaigns]
    assert view.lab_of(replace(watcher.overview, campaigns=real)) == "hardware"
    assert view.lab_of(replace(watcher.overview, campaigns=[*watcher.overview.campaigns, *real])) == "both"


def test_a_link_that_nothing_was_told_of_has_no_quality() -> None:
    campaign = {"instruments": {"analyzer": "YOKOGAWA 760304"}}
    (link,) = view.links(campaign, None, datetime.now(UTC))  # type: ignore[arg-type]
    assert (link.quality, link.level) == ("–", "unknown")


def test_a_diagnosis_says_quantities_in_words_and_names_the_column_to_add() -> None:
    steps = [{"action": action, "separates": []} for action in ("no_load", "measure T_inductor_C too")]
    shown = piece("diagnosis")({"channels": ["D0", "P_link1_W"], "next": steps}, "")
    assert "channels D0, link power (element 3)." in shown
    assert "<td>no load</td>" in shown
    assert "<td>measure T_inductor_C too</td>" in shown


def test_a_number_stays_beside_its_unit() -> None:
    resistance = {"name": "resistance_Ohm", "value": 0.071, "ci95": [0.066, 0.077]}
    cause = {"effect": "link_resistance", "probability": 0.99, "parameters": [resistance]}
    assert "71\xa0mΩ (95\xa0%: 66 to 77)" in piece("diagnosis")({"causes": [cause]}, "")
