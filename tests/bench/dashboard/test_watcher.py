"""Reading for all who look: each row once, nothing when nothing is new, words when there is no database."""

from pathlib import Path

import pandas as pd

from bench.dashboard.watcher import FORGET_S, Watcher
from bench.states import State
from bench.store import Provenance, Store
from tests.bench.dashboard.stored import measure, running_campaign

TABLE = pd.DataFrame({"D1": [0.8, 0.9], "D2": [0.1, 0.0], "P2_W": [500.0, 800.0], "efficiency": [0.97, 0.98]})


class Clock:
    """A clock that is set by hand."""

    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_each_judged_row_is_read_once_and_in_order(store: Store) -> None:
    campaign = running_campaign(store, 5)
    watcher = Watcher(store, now_s=Clock())
    watcher.look()
    for number in range(5):
        measure(store, campaign, [number])
        watcher.look()
        feed = watcher.feed(campaign)
        assert feed is not None
        assert feed.rows.P_set_W.tolist() == [300.0 + 200.0 * k for k in range(number + 1)]


def test_nothing_new_is_the_same_object(store: Store) -> None:
    campaign = running_campaign(store)
    watcher = Watcher(store, now_s=Clock())
    watcher.look()
    watcher.feed(campaign)
    watcher.look()
    first = watcher.feed(campaign)
    watcher.look()
    assert watcher.feed(campaign) is first


def test_imported_measurements_are_rows_like_others(store: Store) -> None:
    campaign = store.import_table("theirs", TABLE, Provenance(config={}, config_hash="0", virtual=False))
    watcher = Watcher(store, now_s=Clock())
    watcher.look()
    feed = watcher.feed(campaign)
    assert feed is not None
    assert feed.rows.efficiency.tolist() == [0.97, 0.98]


def test_a_campaign_that_nobody_looks_at_is_forgotten(store: Store) -> None:
    campaign, clock = running_campaign(store), Clock()
    store.import_table("newest", TABLE, Provenance(config={}, config_hash="0", virtual=True))
    store.end(campaign, State.DONE, power_off="all off")
    watcher = Watcher(store, now_s=clock)
    watcher.look()
    assert watcher.feed(campaign) is None  # asked for: read at the next look
    watcher.look()
    assert watcher.feed(campaign) is not None
    clock.now_s = FORGET_S + 1
    watcher.look()
    assert watcher.feed(campaign) is None


def test_a_database_that_is_gone_is_said_and_what_was_known_stays(tmp_path: Path) -> None:
    with Store(f"sqlite:///{tmp_path}/x.sqlite") as store:
        clock = Clock()
        campaign = running_campaign(store)
        watcher = Watcher(store, now_s=clock)
        watcher.look()
        for file in tmp_path.iterdir():
            file.unlink()
        clock.now_s = 10.0
        watcher.look()
        assert "is gone" in str(watcher.overview.problem)
        assert watcher.overview.newest == campaign
