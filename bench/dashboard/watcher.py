"""Reads the database for all who look, so that eight viewers cost what one costs.

What changed is asked for by the number of the last event: a campaign of ten thousand points is read once, and then
only what is new. A campaign that nobody has looked at for a while is forgotten.
"""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from bench.dashboard.rows import NO_ROWS, Rows
from bench.errors import BenchError
from bench.store import BenchRow, Entry, Row, SeenMoment, Store

FORGET_S = 60.0  # of real time without a viewer
LIST_S = 1.0  # between two looks at the list of campaigns: it counts every point
TAIL = 80  # events kept; most are steps of points


@dataclass(frozen=True, slots=True, kw_only=True)
class Overview:
    """All campaigns and benches at one moment; ``problem`` says why they may be out of date."""

    campaigns: Sequence[Row] = ()
    benches: Sequence[BenchRow] = ()
    queue: Sequence[Entry] = ()
    problem: str | None = None
    version: int = 0

    @property
    def newest(self) -> int | None:
        """The campaign that runs now, else the last one."""
        live = [row["id"] for row in self.campaigns if row["is_live"]]
        return max(live or (row["id"] for row in self.campaigns), default=None)

    def campaign(self, campaign_id: int) -> Row | None:
        """One campaign's row."""
        return next((row for row in self.campaigns if row["id"] == campaign_id), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Feed:
    """One campaign: every judged row so far, the last ones and the last events in full, the moment, the verdict."""

    campaign: Row
    points: Mapping[int, Row]  # as planned, by id
    planned: Rows = NO_ROWS
    rows: Rows = NO_ROWS
    rejected: int = 0
    recent: Sequence[Row] = ()
    events: Sequence[Mapping[str, Any]] = ()
    moment: SeenMoment | None = None
    diagnosis: Mapping[str, Any] | None = None
    last_event: int = 0
    version: int = 0


@dataclass(slots=True)
class _Kept:
    feed: Feed
    looked_at_s: float


@dataclass(slots=True)
class Watcher:
    """Holds what was last read. ``look`` is called by one thread, everything else by any."""

    store: Store
    now_s: Callable[[], float] = time.monotonic
    overview: Overview = field(default_factory=Overview)
    _feeds: dict[int, _Kept] = field(default_factory=dict)
    _listed_s: float = float("-inf")
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def feed(self, campaign_id: int) -> Feed | None:
        """A campaign as last read; None when it has not been read yet (it will be) or is not there."""
        with self._lock:
            if (kept := self._feeds.get(campaign_id)) is None:
                if (row := self.overview.campaign(campaign_id)) is not None:
                    self._feeds[campaign_id] = _Kept(Feed(campaign=row, points={}), self.now_s())
                return None
            kept.looked_at_s = self.now_s()
            return kept.feed if kept.feed.version else None

    def look(self) -> None:
        """Read what is new; a database that cannot be read is said, and what was known stays."""
        try:
            self._look()
        except BenchError as error:
            self.overview = replace(self.overview, problem=str(error), version=self.overview.version + 1)

    def _look(self) -> None:
        now_s = self.now_s()
        if now_s - self._listed_s >= LIST_S:
            self._listed_s = now_s
            fresh = Overview(
                campaigns=self.store.campaigns(),
                benches=self.store.benches.all(),
                queue=self.store.queue.all(),
                version=self.overview.version,
            )
            if fresh != self.overview:
                self.overview = replace(fresh, version=fresh.version + 1)
        if self.overview.newest is not None:
            self.feed(self.overview.newest)  # what most people come for is there before they come
        with self._lock:
            kept = dict(self._feeds)
        for campaign_id, item in kept.items():
            if now_s - item.looked_at_s > FORGET_S:
                with self._lock:
                    self._feeds.pop(campaign_id, None)
            else:
                item.feed = self._read(campaign_id, item.feed)

    def _read(self, campaign_id: int, feed: Feed) -> Feed:
        """The feed with what is new in it; the same object when nothing is."""
        last = self.store.last_event(campaign_id)
        new = (
            self.store.events(campaign_id, after=max(feed.last_event, last - TAIL))
            if last > feed.last_event
            else []
        )
        moment = self.store.live.read(campaign_id)
        campaign = self.overview.campaign(campaign_id) or feed.campaign
        if feed.version and not new and moment == feed.moment and campaign == feed.campaign:
            return feed
        first = feed.version == 0
        diagnoses = self.store.diagnoses(campaign_id)
        replanned = first or any(entry["event"] in ("predicted", "resumed") for entry in new)
        if replanned:
            points = self.store.planned(campaign_id)
            feed = replace(feed, points={row["id"]: row for row in points}, planned=Rows.of(points))
        judged = self.store.judged(campaign_id, after=feed.last_event, until=last)
        return replace(
            feed,
            campaign=campaign,
            rows=feed.rows.and_then(Rows.of(judged)) if judged else feed.rows,
            rejected=feed.rejected + sum(row["state"] == "rejected" for row in judged),
            recent=[*feed.recent, *judged][-TAIL:],
            events=[*feed.events, *map(dict, new)][-TAIL:],
            moment=moment,
            diagnosis=dict(diagnoses[-1]) if diagnoses else None,
            last_event=last,
            version=feed.version + 1,
        )
