"""What a campaign does at this moment, for a live screen: one row per campaign, written over and over.

These writes are seen at once by every reader and are not forced to the disk: losing the last of them loses nothing
that was measured.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from sqlalchemy import insert, select, update

from bench.store.database import Database
from bench.store.row import finite, utc
from bench.store.tables import live


@dataclass(frozen=True, slots=True, kw_only=True)
class Settling:
    """How a point settles: seconds so far, when it is given up, and what still moves."""

    elapsed_s: float
    window_s: float
    limit_s: float
    moving: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkReport:
    """One instrument's link: age of its last reading on the bench's clock, its exchanges, and how many failed."""

    resource: str
    age_s: float | None
    exchanges: int
    failures: int
    last_error: str = ""

    @property
    def quality(self) -> float:
        """Share of exchanges that went well; 1 before the first."""
        return 1.0 - self.failures / self.exchanges if self.exchanges else 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """What is going on.

    ``phase`` is ``checking``, ``setting``, ``settling``, ``measuring``, ``waiting``, ``paused``, ``recovering``
    or ``off``; ``readings`` are columns of the measurement table; ``faults`` is why the bench was stopped.
    """

    phase: str
    time_s: float
    point_id: int | None = None
    readings: Mapping[str, float] = field(default_factory=dict)
    settling: Settling | None = None
    instruments: Mapping[str, LinkReport] = field(default_factory=dict)
    faults: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenMoment:
    """A moment as it was last written: ``written`` is UTC, ISO 8601. Readings that are missing are None."""

    written: str
    phase: str
    time_s: float
    point_id: int | None
    readings: dict[str, float | None]
    settling: Settling | None
    instruments: dict[str, LinkReport]
    faults: tuple[str, ...]


class Live:
    """Writes and reads the present moment of campaigns."""

    def __init__(self, database: Database) -> None:
        self._db = database

    def write(self, campaign_id: int, moment: Moment) -> None:
        """Put a moment in the place of the one before."""
        values: dict[str, Any] = {
            "written": utc(),
            "time_s": moment.time_s,
            "point_id": moment.point_id,
            "phase": moment.phase,
            "readings": finite(moment.readings),
            "settling": None if moment.settling is None else asdict(moment.settling),
            "instruments": {name: asdict(report) for name, report in moment.instruments.items()},
            "faults": list(moment.faults),
        }
        with self._db.passing() as db:
            done = db.execute(update(live).where(live.c.campaign_id == campaign_id).values(**values))
            if not done.rowcount:
                db.execute(insert(live).values(campaign_id=campaign_id, **values))

    def read(self, campaign_id: int) -> SeenMoment | None:
        """The last moment of a campaign; None when it never came so far."""
        with self._db.reading() as db:
            row = db.execute(select(live).where(live.c.campaign_id == campaign_id)).mappings().first()
        if row is None:
            return None
        return SeenMoment(
            written=row["written"],
            phase=row["phase"],
            time_s=row["time_s"],
            point_id=row["point_id"],
            readings=dict(row["readings"] or {}),
            settling=Settling(**row["settling"]) if row["settling"] else None,
            instruments={name: LinkReport(**told) for name, told in (row["instruments"] or {}).items()},
            faults=tuple(row["faults"] or ()),
        )
