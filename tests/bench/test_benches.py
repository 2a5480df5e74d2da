"""Who owns a bench and whether it is safe, on either database; what a live screen reads."""

import math

import pytest

from bench.campaign import run_campaign
from bench.errors import BenchTaken, BenchUnsafe, CampaignStopped, StateError
from bench.job import Job
from bench.plan import Kind, PlannedPoint
from bench.process import Owner
from bench.progress import Progress
from bench.states import PointState, State, shown_state
from bench.store import BenchState, LinkReport, Moment, Provenance, Settling, Store, StoredReading
from tests.bench.fake_bench import FakeInstruments, bench_config, campaign_config, predict

DEAD = Owner(host=Owner.here().host, process=Owner.here().process, began="long ago")
PROVENANCE = Provenance(config={}, config_hash="0" * 64, virtual=True, bench="b")


def campaign_of(store: Store) -> int:
    return store.create_campaign("c", PROVENANCE, [])


def taken(store: Store, owner: Owner, *, energised: bool = False) -> int:
    campaign_id = campaign_of(store)
    store.benches.take("b", virtual=True, campaign_id=campaign_id, owner=owner)
    if energised:
        store.benches.energise("b", {"name": "b"})
    return campaign_id


def test_a_bench_has_one_owner_at_a_time(store: Store) -> None:
    taken(store, Owner.here())
    with pytest.raises(BenchTaken, match=r"campaign 1 .* has the bench 'b'"):
        taken(store, Owner.here())


def test_a_dead_owner_keeps_nobody_out_and_what_it_left_on_is_told(store: Store) -> None:
    taken(store, DEAD, energised=True)
    assert store.benches.all()[0].state is BenchState.UNCONFIRMED
    found = store.benches.take("b", virtual=True, campaign_id=campaign_of(store), owner=Owner.here())
    assert found is not None
    assert found.state is BenchState.UNCONFIRMED


def test_a_bench_is_on_until_it_was_seen_off(store: Store) -> None:
    campaign_id = taken(store, Owner.here(), energised=True)
    assert store.benches.all()[0].state is BenchState.ON
    store.benches.release("b", campaign_id)  # does nothing while it is on
    assert store.benches.all()[0].state is BenchState.ON
    store.benches.seen_off("b", "PWM off")
    store.benches.release("b", campaign_id)
    assert (store.benches.all()[0].state, store.benches.all()[0].owner) == (BenchState.OFF, None)


def test_unsafe_refuses_everybody_until_an_operator_clears_it(store: Store) -> None:
    taken(store, Owner.here(), energised=True)
    store.benches.latch("b", "load NOT confirmed off")
    with pytest.raises(BenchUnsafe, match="load NOT confirmed off"):
        store.benches.refuse("b")
    store.benches.seen_off("b", "off")  # being off by now does not acknowledge it
    with pytest.raises(BenchUnsafe):
        taken(store, Owner.here())
    store.benches.clear("b", "seen off by the operator")
    taken(store, Owner.here())


def test_there_must_be_something_to_clear(store: Store) -> None:
    with pytest.raises(StateError, match="nothing to clear: the bench 'b' is not known"):
        store.benches.clear("b", "seen off")


def test_a_step_cannot_be_taken_twice(store: Store) -> None:
    campaign_id = campaign_of(store)
    store.move(campaign_id, State.PLANNED, State.CHECKING, time_s=0.0)
    with pytest.raises(StateError, match="somebody else has moved it"):
        store.move(campaign_id, State.PLANNED, State.CHECKING, time_s=0.0)


def test_a_point_is_set_settled_measured_and_judged_once_and_in_this_order(store: Store) -> None:
    row = PlannedPoint(point=0, repeat=0, kind=Kind.LOAD, D1=0.8, D2=0.1, power_W=500.0)
    campaign_id = store.create_campaign("c", PROVENANCE, [row])
    point_id = store.unfinished(campaign_id)[0]["id"]
    reading = StoredReading(numbers={"P1_W": 510.0, "P2_W": math.inf}, settled=True, quality="good")
    for state in (PointState.SETTLED, PointState.ACCEPTED):
        with pytest.raises(StateError, match="cannot become"):
            store.advance(campaign_id, point_id, state)
    store.advance(campaign_id, point_id, PointState.SET)
    store.advance(campaign_id, point_id, PointState.SETTLED)
    store.add_reading(campaign_id, point_id, reading)
    with pytest.raises(StateError, match="cannot become measured"):
        store.add_reading(campaign_id, point_id, reading)
    store.advance(campaign_id, point_id, PointState.ACCEPTED)
    with pytest.raises(StateError, match="cannot become rejected"):
        store.advance(campaign_id, point_id, PointState.REJECTED)
    stored = store.stored_reading(point_id)
    assert (stored["P1_W"], stored["P2_W"]) == (510.0, None)  # what is infinite is no measurement


@pytest.mark.parametrize("quality", ["stale", "overrange", "no_data"])
def test_nothing_measured_is_stored_of_a_row_that_is_not_good(store: Store, quality: str) -> None:
    row = PlannedPoint(point=0, repeat=0, kind=Kind.LOAD, D1=0.8, D2=0.1, power_W=500.0)
    campaign_id = store.create_campaign("c", PROVENANCE, [row])
    point_id = store.unfinished(campaign_id)[0]["id"]
    store.advance(campaign_id, point_id, PointState.SET)
    store.advance(campaign_id, point_id, PointState.SETTLED)
    numbers = {"D1": 0.8, "P1_W": 510.0, "P2_W": 9.91e37}
    store.add_reading(campaign_id, point_id, StoredReading(numbers=numbers, settled=True, quality=quality))
    stored = store.stored_reading(point_id)
    assert (stored["D1"], stored["P1_W"], stored["P2_W"]) == (0.8, None, None)


def test_a_campaign_whose_process_died_is_shown_interrupted(store: Store) -> None:
    campaign_id = campaign_of(store)
    assert store.campaign(campaign_id)["shown"] is State.PLANNED
    store.take_over(campaign_id, State.PLANNED, owner=DEAD)
    row = store.campaign(campaign_id)
    assert (row["shown"], row["is_live"]) == (State.INTERRUPTED, False)
    assert shown_state("failed", alive=False) is State.FAILED


def test_another_machine_is_believed_for_the_length_of_a_lease() -> None:
    elsewhere = Owner(host="elsewhere", process=1, began="1")
    assert elsewhere.lives("2999-01-01T00:00:00+00:00")
    assert not elsewhere.lives("2020-01-01T00:00:00+00:00")
    assert not elsewhere.lives(None)


def test_a_moment_comes_back_as_it_was_written(store: Store) -> None:
    campaign_id = campaign_of(store)
    link = LinkReport(resource="/dev/x", age_s=0.5, exchanges=10, failures=1, last_error="late")
    settling = Settling(elapsed_s=4.0, window_s=20.0, limit_s=600.0, moving="P1 drifts")
    told = Moment(
        phase="settling", time_s=12.0, readings={"V1_V": 300.0, "D0": math.nan}, settling=settling,
        instruments={"analyzer": link}, faults=("output lost",),
    )  # fmt: skip
    assert store.live.read(campaign_id) is None
    for _ in range(2):
        store.live.write(campaign_id, told)
    seen = store.live.read(campaign_id)
    assert seen is not None
    assert (seen.phase, seen.settling, seen.faults) == ("settling", settling, ("output lost",))
    assert seen.readings == {"V1_V": 300.0, "D0": None}
    assert seen.instruments["analyzer"].quality == 0.9


def test_a_running_campaign_tells_the_live_screen(store: Store) -> None:
    fake, phases = FakeInstruments(), set()
    job = Job.prepare(campaign_config(), bench_config(), predict=predict)

    def watch(progress: Progress) -> None:
        if (moment := store.live.read(1)) is not None:
            phases.add(moment.phase)
        if progress.done == 5:
            raise CampaignStopped("enough")

    with pytest.raises(CampaignStopped):
        run_campaign(job, store, fake.clock, around=fake.around(), progress=watch)
    last = store.live.read(1)
    assert last is not None
    assert (last.phase, last.faults) == ("off", ("enough",))
    assert set(last.instruments) == {"analyzer", "supply", "load", "controller"}
    assert phases
