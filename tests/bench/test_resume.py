"""A campaign that stopped goes on from its ledger, on either database: nothing lost, nothing twice, the bench off."""

import pandas as pd
import pytest

from bench.campaign import resume_campaign, run_campaign
from bench.errors import BenchUnsafe, CampaignStopped, StateError
from bench.job import Job
from bench.progress import Progress
from bench.states import State
from bench.store import BenchState, Store
from drivers.errors import LinkLost
from tests.bench.fake_bench import FakeInstruments, bench_config, campaign_config, predict

ROWS = 11  # 1 standby, 1 no load, 3 references, 6 points


def job() -> Job:
    return Job.prepare(campaign_config(), bench_config(), predict=predict)


def stopped_after(done: int, fake: FakeInstruments, store: Store) -> None:
    """A campaign that its operator stopped after so many rows."""

    def watch(progress: Progress) -> None:
        if progress.done == done and progress.said == "accepted":
            raise CampaignStopped("enough for today")

    with pytest.raises(CampaignStopped):
        run_campaign(job(), store, fake.clock, around=fake.around(), progress=watch)


def resumed(fake: FakeInstruments, store: Store) -> pd.DataFrame:
    stored = Job.stored(store, store.campaign(1), predict=predict)
    resume_campaign(1, store, fake.clock, job=stored, around=fake.around())
    return store.measurement_table(1)


def test_a_stopped_campaign_goes_on_where_it_was(store: Store) -> None:
    fake = FakeInstruments()
    stopped_after(4, fake, store)
    before = store.measurement_table(1)
    table = resumed(fake, store)
    assert len(before) == 4
    assert len(table) == ROWS
    pd.testing.assert_frame_equal(table[before.columns].head(4), before, check_dtype=False)
    assert store.campaign(1)["state"] == State.DONE


def test_a_resumed_campaign_keeps_its_plan_and_its_predictions(store: Store) -> None:
    fake = FakeInstruments()
    stopped_after(4, fake, store)
    before = store.predictions(1)
    resumed(fake, store)
    same = ["position", "point", "repeat", "D1", "D2", "P_set_W", "predicted_efficiency"]
    pd.testing.assert_frame_equal(store.predictions(1)[same], before[same])


def test_time_goes_on_from_where_it_stopped(store: Store) -> None:
    fake = FakeInstruments()
    stopped_after(4, fake, store)
    assert (resumed(fake, store)["time_s"].diff().dropna() > 0).all()


def test_every_row_tells_the_session_that_measured_it(store: Store) -> None:
    fake = FakeInstruments()
    stopped_after(4, fake, store)
    resumed(fake, store)
    provenance = store.provenance(1)
    assert provenance["started"].nunique() == 2
    assert len(provenance) == ROWS
    assert provenance["instruments"].iloc[-1] == {"analyzer": "fake bench 1 0"}
    assert {"python", "numpy", "revision"} <= set(provenance["versions"].iloc[0])


def test_a_point_that_had_begun_is_measured_anew(store: Store) -> None:
    fake = FakeInstruments()
    stopped_after(4, fake, store)
    point_id = store.unfinished(1)[0]["id"]
    store.advance(1, point_id, "set")  # type: ignore[arg-type]  # as the ledger of a process that died has it
    resumed(fake, store)
    steps = [event["event"] for event in store.events(1) if event["point_id"] == point_id]
    assert steps == ["set", "planned", "set", "settled", "measured", "accepted"]


def test_a_campaign_that_is_done_or_unknown_cannot_be_resumed(store: Store) -> None:
    fake = FakeInstruments()
    run_campaign(job(), store, fake.clock, around=fake.around())
    with pytest.raises(StateError, match="campaign 1 is done"):
        resume_campaign(1, store, fake.clock)
    with pytest.raises(StateError, match="no campaign 9"):
        resume_campaign(9, store, fake.clock)


def test_the_same_key_never_makes_two_campaigns(store: Store) -> None:
    fake = FakeInstruments()

    def stop(progress: Progress) -> None:
        if progress.done == 2:
            raise CampaignStopped("enough for today")

    with pytest.raises(CampaignStopped):
        run_campaign(job(), store, fake.clock, around=fake.around(), progress=stop, key="night 1")
    run_campaign(job(), store, fake.clock, around=fake.around(), key="night 1")
    assert [row["accepted"] for row in store.campaigns()] == [ROWS]


def test_unsafe_is_latched_until_it_is_cleared(store: Store) -> None:
    fake = FakeInstruments()
    fake.broken = {"load off"}
    with pytest.raises(BenchUnsafe):
        run_campaign(job(), store, fake.clock, around=fake.around())
    fake.broken = set()
    with pytest.raises(BenchUnsafe, match="d2ea clear"):
        run_campaign(job(), store, fake.clock, around=fake.around())
    assert len(store.campaigns()) == 1  # refused before anything was written
    store.benches.clear("fake bench", "seen off by the operator")
    assert len(resumed(fake, store)) == ROWS
    assert store.benches.all()[0].state is BenchState.OFF


def test_a_disturbed_link_costs_a_try_and_no_point(store: Store) -> None:
    fake = FakeInstruments()
    disturbed: list[str] = []

    def watch(progress: Progress) -> None:
        if progress.done == 4 and progress.said == "" and not disturbed:
            disturbed.append("once")
            fake.failing["read"] = LinkLost("unplugged")

    outcome = run_campaign(job(), store, fake.clock, around=fake.around(), progress=watch)
    assert outcome.accepted == ROWS
    assert [e["event"] for e in store.events(1)].count("disturbed") == 1
    assert fake.off


def test_a_link_that_stays_lost_stops_the_campaign_with_the_bench_off(store: Store) -> None:
    fake = FakeInstruments()
    with pytest.raises(LinkLost):
        run_campaign(
            job(),
            store,
            fake.clock,
            around=fake.around(),
            progress=lambda progress: fake.broken.add("read") if progress.done == 4 else None,
        )
    assert fake.off
    assert store.campaign(1)["accepted"] == 4
