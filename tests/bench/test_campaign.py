"""The campaign engine on a fake bench: order, states, and a bench that is off however it ends."""

from contextlib import nullcontext
from datetime import datetime
from pathlib import Path

import pytest

from bench.campaign import Surroundings, run_campaign
from bench.connect import BenchFaults
from bench.errors import (
    Aborted,
    BenchUnsafe,
    CampaignStopped,
    Interrupted,
    LimitReached,
    StateError,
)
from bench.instruments import Bench
from bench.job import Job
from bench.progress import Progress
from bench.safety import PowerOffReport, StepReport
from bench.states import TRANSITIONS, State, check_transition
from bench.store import Store
from drivers.errors import LinkLost
from tests.bench.fake_bench import (
    SIMULATED,
    TRUE,
    FakeInstruments,
    bench_config,
    campaign_config,
    job,
    predict,
    run,
)


def last_state(store: Store) -> str:
    return str(store.campaigns()[-1]["state"])


def test_runs_every_row_and_leaves_the_bench_off(store: Store) -> None:
    fake = FakeInstruments()
    outcome = run(fake, store)
    assert (outcome.accepted, outcome.rejected) == (11, 0)  # 1 standby, 1 no load, 3 references, 6 points
    assert outcome.settled == 11
    assert fake.off
    assert last_state(store) == State.DONE


def test_table_holds_what_was_measured(store: Store) -> None:
    fake = FakeInstruments()
    table = store.measurement_table(run(fake, store).campaign_id)
    assert list(table["kind"][:3]) == ["standby", "no_load", "reference"]
    loaded = table[table["kind"].isin(["load", "reference"])]
    # 8 W of fixed loss and up to 0.04 points of warming, at 200 W or more: at most 4 points below TRUE
    assert loaded["efficiency"].between(TRUE - 0.04, TRUE).all()
    assert table.loc[0, ["efficiency", "D1", "D0"]].isna().all()
    assert (table["time_s"].diff().dropna() > 0).all()


def test_prediction_is_stored_before_the_point_is_set(store: Store) -> None:
    fake = FakeInstruments()
    seen: list[list[str]] = []
    real = fake.set_modulation
    fake.set_modulation = lambda D1, D2: (seen.append(events_of(store)), real(D1, D2))[1]  # type: ignore[method-assign]
    run(fake, store)
    assert all("predicted" in events for events in seen)
    assert len(seen) == 19  # once for no load, and by way of the start for each of nine loaded rows


def events_of(store: Store) -> list[str]:
    return [str(event["event"]) for event in store.events(1)]


def test_every_step_of_a_point_is_stored_in_order(store: Store) -> None:
    run(FakeInstruments(), store)
    steps = [event["event"] for event in store.events(1) if event["point_id"] == 4]
    assert steps == ["set", "settled", "measured", "accepted"]


def test_power_changes_only_at_the_modulation_that_carries_all(store: Store) -> None:
    fake = FakeInstruments()
    points = [{"D1": 0.9, "D2": 0.1, "power_W": power} for power in (500, 1500, 300)]
    plan = {"kind": "points", "set_points": points, "order": "given", "standby": 0, "no_load": 0}
    run(fake, store, job(plan=plan))
    switched = [what for what in fake.done if what.startswith(("modulation", "load power"))]
    one = ["modulation 0.8 0", "load power", "modulation 0.9 0.1"]
    two, three = [[one[0], *["load power"] * n, one[2]] for n in (2, 3)]  # 1000 W up, 1200 W down, by 500 W
    assert switched == [*one, *two, *three]


def test_the_heartbeat_never_pauses_longer_than_a_beat_and_an_update(store: Store) -> None:
    fake = FakeInstruments()
    # far more than a beat from sample to sample
    slow = {"window_s": 45, "sample_every_s": 15, "limit_s": 300}
    run(fake, store, job(settling=slow))
    assert 0 < fake.longest_silence_s <= 2.0 + 0.5  # heartbeat_s and update_s of the fake bench


@pytest.mark.parametrize("call", ["read", "beat", "modulation", "load on", "supply on", "PWM on"])
def test_a_lost_link_anywhere_ends_with_the_bench_off(store: Store, call: str) -> None:
    fake = FakeInstruments(broken={call})
    with pytest.raises(LinkLost):
        run(fake, store)
    assert fake.off
    assert last_state(store) == State.FAILED
    assert "unplugged" in store.campaign(1)["error"]


def test_a_step_of_the_power_off_that_fails_does_not_stop_the_next(store: Store) -> None:
    fake = FakeInstruments()
    watch = lambda progress: fake.broken.update({"read", "load off"}) if progress.done == 4 else None  # noqa: E731
    with pytest.raises(BenchUnsafe, match="load NOT confirmed off"):
        run(fake, store, progress=watch)
    assert not fake.pwm
    assert not fake.supply_on
    assert last_state(store) == State.UNSAFE


def test_what_could_not_be_seen_off_is_told_once_a_line_each_and_after_what(store: Store) -> None:
    fake = FakeInstruments()
    watch = lambda progress: fake.broken.update({"read", "load off"}) if progress.done == 4 else None  # noqa: E731
    with pytest.raises(BenchUnsafe) as told:
        run(fake, store, progress=watch)
    assert str(told.value).splitlines() == [
        "PWM off",
        "load NOT confirmed off: load off: unplugged",
        "supply off",
        "discharge to 60 V or less",
        "after: LinkLost: read: unplugged",
    ]
    row, (bench,) = store.campaign(1), store.benches.all()
    assert row["error"] == "LinkLost: read: unplugged"
    assert row["power_off"] == bench.unsafe == str(told.value).rpartition("\n")[0]
    (first,) = [event["detail"] for event in store.events(1) if event["event"] == "not seen off"]
    assert "load NOT confirmed off: load off: unplugged" in first


def test_power_goes_off_as_pwm_load_supply(store: Store) -> None:
    fake = FakeInstruments()
    run(fake, store)
    assert [what for what in fake.done if what.endswith("off")][-3:] == ["PWM off", "load off", "supply off"]


def test_a_reported_fault_stops_the_campaign(store: Store) -> None:
    fake = FakeInstruments()

    def watch(progress: Progress) -> None:
        if progress.done == 5:
            fake.faults = ("overcurrent",)

    with pytest.raises(LimitReached, match="overcurrent"):
        run(fake, store, progress=watch)
    assert fake.off


@pytest.mark.parametrize(("speed", "told"), [(100.0, True), (1.0, False)])
def test_a_clock_that_outran_the_machine_says_how_to_slow_it(speed: float, told: bool, store: Store) -> None:
    fake = FakeInstruments()
    fast = Job.prepare(campaign_config(), bench_config(speed=speed), predict=predict)

    def watch(progress: Progress) -> None:
        if progress.done == 5:
            fake.faults = ("heartbeat_lost",)

    with pytest.raises(LimitReached, match="heartbeat_lost") as stopped:
        run(fake, store, fast, progress=watch)
    assert ("100 times as fast as real time" in str(stopped.value)) == told
    assert ("lower --speed" in str(stopped.value)) == told
    assert fake.off


def test_a_pwm_that_trips_by_itself_stops_the_campaign(store: Store) -> None:
    fake = FakeInstruments()

    def watch(progress: Progress) -> None:
        if progress.done == 5:
            fake.pwm = False

    with pytest.raises(LimitReached, match="PWM is off and should be on"):
        run(fake, store, progress=watch)
    assert fake.off


def test_abort_from_another_process_switches_off(store: Store) -> None:
    fake = FakeInstruments()
    with pytest.raises(Aborted):
        run(fake, store, progress=lambda progress: store.ask(1, "abort") if progress.done == 4 else None)
    assert fake.off
    assert last_state(store) == State.ABORTED


def test_ctrl_c_switches_off_and_is_recorded(store: Store) -> None:
    fake = FakeInstruments()

    def interrupt(progress: Progress) -> None:
        if progress.done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(fake, store, progress=interrupt)
    assert fake.off
    assert last_state(store) == State.ABORTED


def test_unsafe_outranks_an_interruption(store: Store) -> None:
    fake = FakeInstruments()

    def interrupt(progress: Progress) -> None:
        if progress.done == 4:
            fake.broken.add("load off")
            raise Interrupted("interrupted by the operator")

    with pytest.raises(BenchUnsafe, match="interrupted by the operator"):
        run(fake, store, progress=interrupt)
    assert last_state(store) == State.UNSAFE


def test_pause_switches_off_and_resume_goes_on(store: Store) -> None:
    fake = FakeInstruments()
    off_while_paused = []

    def watch(progress: Progress) -> None:
        if progress.done == 4 and progress.said == "accepted":
            store.ask(1, "pause")
        if progress.said.startswith("paused"):
            off_while_paused.append(fake.off)
            store.ask(1, None)

    outcome = run(fake, store, progress=watch)
    assert off_while_paused == [True]
    assert outcome.accepted == 11


def test_a_fault_found_by_the_check_ends_before_anything_is_switched_on(store: Store) -> None:
    fake = FakeInstruments(supply_on=True)
    connect = lambda config, _clock: nullcontext(fake.bench(config, ["supply: its output is on"]))  # noqa: E731
    with pytest.raises(BenchFaults, match="its output is on"):
        run_campaign(job(), store, fake.clock, around=Surroundings(connect=connect))
    assert fake.off  # what an earlier run left on
    assert "supply on" not in fake.done


def test_a_row_off_its_set_point_is_rejected_with_the_reason(store: Store) -> None:
    fake = FakeInstruments()
    measure = {"samples": 4, "voltage_tolerance": 1e-9}
    outcome = run(fake, store, job(measure=measure))
    assert outcome.accepted == 1  # standby has no output voltage to hold
    assert "is not held at 140 V" in store.predictions(1)["reason"].iloc[-1]
    assert len(store.measurement_table(1)) == 1
    rejected = store.rejected_table(1)
    assert len(rejected) == outcome.rejected == 10
    assert rejected["reason"].str.contains("is not held at 140 V").all()
    assert rejected.loc[rejected["kind"] == "load", ["D1", "D2", "P_set_W"]].notna().all(axis=None)
    assert not set(rejected["point"]) & set(store.measurement_table(1)["point"])


def test_a_point_that_does_not_settle_is_measured_and_says_so(store: Store) -> None:
    fake = FakeInstruments(noise=0.01)
    run(fake, store, job(settling={"window_s": 6, "sample_every_s": 2, "limit_s": 20}))
    table = store.measurement_table(1)
    assert not table.loc[table["kind"] == "load", "settled"].any()


def test_start_at_is_waited_for_on_the_clock(store: Store) -> None:
    fake = FakeInstruments()
    today = lambda: datetime(2026, 12, 1, 21, 0, 0)  # noqa: E731
    a_job = job(schedule={"start_at": datetime(2026, 12, 1, 22, 0, 0)})
    run_campaign(a_job, store, fake.clock, around=fake.around(today))
    first = next(event for event in store.events(1) if event["event"] == "checking")
    assert first["time_s"] == pytest.approx(3600.0)  # one hour, on a clock that only steps


def test_progress_carries_the_residual(store: Store) -> None:
    told: list[Progress] = []
    run(FakeInstruments(), store, progress=told.append)
    last = told[-1]
    assert last.residual == pytest.approx(last.measured - SIMULATED)  # type: ignore[operator]
    assert last.mean_residual is not None
    assert last.left_s == 0


def test_provenance_is_kept(store: Store) -> None:
    run(FakeInstruments(), store)
    row = store.campaign(1)
    assert row["virtual"] is True
    assert row["instruments"] == {"analyzer": "fake bench 1 0"}
    assert len(row["config_hash"]) == 64
    assert "numpy" in row["versions"]


def test_the_transition_table_is_closed_and_ends_are_final() -> None:
    assert set(TRANSITIONS) == set(State)
    with pytest.raises(StateError, match="cannot become"):
        check_transition(State.DONE, State.RUNNING)


def test_a_signal_in_the_middle_of_the_power_off_begins_it_again(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake, real, calls = FakeInstruments(), Bench.power_off, []

    def interrupted(bench: Bench) -> PowerOffReport:
        calls.append("power off")
        if len(calls) == 1:
            raise Aborted("interrupted by the operator")
        return real(bench)

    monkeypatch.setattr(Bench, "power_off", interrupted)
    run(fake, store)
    assert calls == ["power off"] * 2
    assert fake.off
    assert last_state(store) == State.DONE


def test_off_at_the_second_go_is_no_unsafe_bench(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    fake, real, reports = FakeInstruments(), Bench.power_off, []
    unseen = PowerOffReport(steps=(StepReport(step="load", confirmed=False, said="NOT confirmed off"),))

    def first_unseen(bench: Bench) -> PowerOffReport:
        reports.append(real(bench) if reports else unseen)
        return reports[-1]

    monkeypatch.setattr(Bench, "power_off", first_unseen)
    with pytest.raises(CampaignStopped, match="only at the second go"):
        run(fake, store, progress=lambda progress: store.ask(1, "pause") if progress.done == 4 else None)
    assert fake.off
    assert last_state(store) == State.FAILED


def test_an_unsafe_bench_outranks_a_database_that_is_gone(tmp_path: Path) -> None:
    fake = FakeInstruments()
    with Store(f"sqlite:///{tmp_path}/x.sqlite") as store:

        def lose_both(progress: Progress) -> None:
            if progress.done == 3:
                fake.broken.add("supply off")
                (tmp_path / "x.sqlite").rename(tmp_path / "away.sqlite")

        with pytest.raises(BenchUnsafe, match="supply NOT confirmed off"):
            run(fake, store, progress=lose_both)
    assert not fake.pwm
    assert not fake.load_on
