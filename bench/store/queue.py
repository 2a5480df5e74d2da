"""Campaigns that wait for their time, or for their bench; they survive every restart.

An entry is due when its time has come, at once when it has none. Each run has a key of its own, made of the entry
and the number of the run, so a worker that dies between taking an entry and noting it does not run it twice.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import delete, insert, select, update

from bench.errors import StateError
from bench.store.database import Database
from bench.store.row import new_id, utc
from bench.store.tables import queue

WAITING, DONE, FAILED = "waiting", "done", "failed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A campaign in the queue; ``due`` is UTC, None for as soon as the bench is free."""

    id: int
    name: str
    bench: str
    campaign_config: Mapping[str, Any]
    bench_config: Mapping[str, Any]
    due: datetime | None
    every_s: float | None
    runs: int
    state: str
    said: str | None
    campaign_id: int | None

    @property
    def key(self) -> str:
        """Of the campaign that its next run makes."""
        return f"queue {self.id} run {self.runs + 1}"

    def following(self, now: datetime) -> datetime | None:
        """When it runs again: the first of its times after ``now``; None when it does not repeat."""
        if self.every_s is None:
            return None
        first, step = self.due or now, timedelta(seconds=self.every_s)
        missed = max(0, (now - first) // step)
        return first + (missed + 1) * step


class Queue:
    """The campaigns that wait in one database."""

    def __init__(self, database: Database) -> None:
        self._db = database

    def add(
        self,
        campaign_config: Mapping[str, Any],
        bench_config: Mapping[str, Any],
        *,
        due: datetime | None = None,
        every_s: float | None = None,
    ) -> int:
        """Put a campaign on a bench into the queue; returns the entry's id."""
        values = {
            "name": campaign_config["name"],
            "bench": bench_config["name"],
            "campaign_config": dict(campaign_config),
            "bench_config": dict(bench_config),
            "added": utc(),
            "due": None if due is None else due.astimezone(UTC).isoformat(),
            "every_s": every_s,
            "runs": 0,
            "state": WAITING,
        }
        with self._db.durable() as db:
            return new_id(db.execute(insert(queue).values(**values)))

    def all(self) -> list[Entry]:
        """Every entry, those due first first."""
        with self._db.reading() as db:
            rows = db.execute(select(queue).order_by(queue.c.id)).mappings().all()
        return sorted(map(_entry, rows), key=lambda e: (e.state != WAITING, e.due or _EVER, e.id))

    def due(self, now: datetime, bench: str | None = None) -> list[Entry]:
        """The entries whose time has come, on one bench or on all."""
        waiting = [entry for entry in self.all() if entry.state == WAITING]
        return [e for e in waiting if (e.due is None or e.due <= now) and bench in (None, e.bench)]

    def finish(self, entry: Entry, *, now: datetime, said: str, ok: bool, campaign_id: int | None) -> None:
        """Note a run: the entry is done, or waits for its next time."""
        following = entry.following(now)
        state = WAITING if following is not None else DONE if ok else FAILED
        values = {
            "runs": entry.runs + 1,
            "state": state,
            "said": said,
            "campaign_id": campaign_id,
            "due": None if following is None else following.isoformat(),
        }
        with self._db.durable() as db:
            db.execute(
                update(queue).where(queue.c.id == entry.id, queue.c.runs == entry.runs).values(**values)
            )

    def remove(self, entry_id: int) -> None:
        """Take an entry out; StateError when there is none."""
        with self._db.durable() as db:
            gone = db.execute(delete(queue).where(queue.c.id == entry_id)).rowcount
        if not gone:
            known = ", ".join(str(entry.id) for entry in self.all()) or "none"
            raise StateError(f"there is no entry {entry_id} in the queue; known: {known}")


_EVER = datetime.min.replace(tzinfo=UTC)


def _entry(row: Any) -> Entry:
    told = ("id", "name", "bench", "campaign_config", "bench_config", "every_s", "runs", "state", "said",
            "campaign_id")  # fmt: skip
    due = None if row["due"] is None else datetime.fromisoformat(row["due"])
    return Entry(due=due, **{key: row[key] for key in told})
