"""Reading for all who look: each row once, nothing when nothing is new, words when there is no database."""

from pathlib import Path

from bench.dashboard.watcher import FORGET_S, Watcher
from bench.store import Store
from tests.bench.dashboard.stored import measure, running_campaign


class Clock:
    """A clock that is set by hand."""

    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_each_judged_row_is_read_once_and_in_order() -> None:
    with Store("sqlite://") as store:
        campaign = running_campaign(store, 5)
        watcher = Watcher(store, now_s=Clock())
        watcher.look()
        assert watcher.feed(campaign) is None  # asked for: read at the next look
        for number in range(5):
            measure(store, campaign, [number])
            watcher.look()
            feed = watcher.feed(campaign)
            assert feed is not None
            assert [row["P_set_W"] for row in feed.rows] == [300.0 + 200.0 * k for k in range(number + 1)]


def test_nothing_new_is_the_same_object() -> None:
    with Store("sqlite://") as store:
        campaign = running_campaign(store)
        watcher = Watcher(store, now_s=Clock())
        watcher.look()
        watcher.feed(campaign)
        watcher.look()
        first = watcher.feed(campaign)
        watcher.look()
        assert watcher.feed(campaign) is first


def test_a_campaign_that_nobody_looks_at_is_forgotten() -> None:
    with Store("sqlite://") as store:
        campaign, clock = running_campaign(store), Clock()
        watcher = Watcher(store, now_s=clock)
        watcher.look()
        watcher.feed(campaign)
        watcher.look()
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
