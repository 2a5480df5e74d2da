"""Campaigns that wait: due or not, once or again and again, on either database."""

from datetime import UTC, datetime, timedelta

import pytest

from bench.config import CampaignConfig
from bench.errors import BenchUnsafe, CampaignStopped, InputError, StateError
from bench.progress import Progress
from bench.queueing import Worker
from bench.store import Store
from tests.bench.fake_bench import BENCH, CAMPAIGN, FakeInstruments, bench_config, campaign_config, predict

NOON = datetime(2026, 12, 1, 12, 0, tzinfo=UTC)


def add(store: Store, *, due: datetime | None = None, every_s: float | None = None) -> int:
    campaign = campaign_config().model_dump(mode="json")
    return store.queue.add(campaign, bench_config().settings(), due=due, every_s=every_s)


def worker(store: Store, fake: FakeInstruments, now: datetime = NOON, **more: object) -> Worker:
    around = fake.around()
    return Worker(  # type: ignore[arg-type]
        store=store, now=lambda: now, clock_of=lambda _: fake.clock, around=around, predict=predict, **more
    )


def test_an_entry_waits_for_its_time(store: Store) -> None:
    add(store, due=NOON + timedelta(hours=1))
    fake = FakeInstruments()
    assert worker(store, fake).run_due() == 0
    assert worker(store, fake, NOON + timedelta(hours=1)).run_due() == 1
    assert [entry.state for entry in store.queue.all()] == ["done"]
    assert store.campaign(1)["state"] == "done"


def test_an_entry_without_a_time_is_due_at_once_and_once(store: Store) -> None:
    add(store)
    fake = FakeInstruments()
    assert [worker(store, fake).run_due() for _ in range(2)] == [1, 0]


def test_one_that_repeats_waits_for_its_next_time_and_skips_those_missed(store: Store) -> None:
    add(store, due=NOON, every_s=3600.0)
    worker(store, FakeInstruments(), NOON + timedelta(minutes=150)).run_due()
    (entry,) = store.queue.all()
    assert (entry.state, entry.runs, entry.due) == ("waiting", 1, NOON + timedelta(hours=3))


def test_a_campaign_that_a_dead_worker_left_goes_on(store: Store) -> None:
    add(store)
    fake = FakeInstruments()

    def die(progress: Progress) -> None:
        if progress.done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        worker(store, fake, progress=die).run_due()
    worker(store, fake).run_due()
    assert [(row["state"], row["accepted"]) for row in store.campaigns()] == [("done", 11)]


def test_one_that_fails_says_why_and_the_next_one_runs(store: Store) -> None:
    add(store)
    add(store)
    fake, seen = FakeInstruments(), []

    def fail(progress: Progress) -> None:
        seen.append(progress)
        if len(seen) == 3:
            raise CampaignStopped("something broke")

    assert worker(store, fake, progress=fail).run_due() == 2
    first, second = sorted(store.queue.all(), key=lambda entry: entry.id)
    assert (first.state, first.said) == ("failed", "failed: something broke")
    assert second.state == "done"


def test_an_unsafe_bench_ends_the_work_and_the_entry_waits(store: Store) -> None:
    add(store)
    with pytest.raises(BenchUnsafe):
        worker(store, FakeInstruments(broken={"supply off"})).run_due()
    with pytest.raises(BenchUnsafe, match="d2ea clear"):
        worker(store, FakeInstruments()).run_due()
    assert [entry.state for entry in store.queue.all()] == ["waiting"]


def test_the_queue_outlives_the_process(url: str) -> None:
    with Store(url) as store:
        add(store, due=NOON)
    with Store(url) as again:
        assert [(e.name, e.bench, e.due) for e in again.queue.all()] == [("six points", "fake bench", NOON)]
        again.queue.remove(1)
        with pytest.raises(StateError, match="no entry 1"):
            again.queue.remove(1)


@pytest.mark.parametrize(
    ("every", "seconds"), [("90 min", 5400.0), ("6h", 21600.0), ("1 d", 86400.0), (30, 30.0)]
)
def test_a_period_is_a_number_and_a_unit(every: object, seconds: float) -> None:
    assert campaign_config(schedule={"every": every}).schedule.every == seconds


@pytest.mark.parametrize("every", ["often", "6 weeks", "-1 h", 0])
def test_another_period_is_refused(every: object) -> None:
    with pytest.raises(InputError, match=r"schedule\.every"):
        campaign_config(schedule={"every": every})


def test_what_is_stored_of_a_campaign_can_be_read_back() -> None:
    campaign = campaign_config(schedule={"start_at": NOON, "every": "6 h"})
    assert CampaignConfig.model_validate(campaign.model_dump(mode="json")) == campaign
    assert {"name", "plan"} <= set(CAMPAIGN)
    assert "database" not in bench_config(**{**BENCH, "database": "sqlite:///x"}).settings()


def test_a_bench_that_does_not_carry_the_plan_is_named_as_the_one_of_its_entry(store: Store) -> None:
    bench = bench_config(converter={"start_D1": 0.1, "start_D2": 0.5}).settings()
    store.queue.add(campaign_config().model_dump(mode="json"), bench, due=None, every_s=None)
    worker(store, FakeInstruments()).run_due()
    (entry,) = store.queue.all()
    assert entry.said is not None
    assert entry.said.startswith("failed: bench of queue entry 1: converter.start_D1")
