"""What a live screen needs of one campaign, in pieces: what was planned, and each row once it is judged.

Asked for by the numbers of events, which only grow: nobody reads ten thousand rows to see one more.
"""

from sqlalchemy import func, select

from bench.states import FINISHED
from bench.store.database import Database
from bench.store.reader import Row
from bench.store.tables import events, points, readings, why

_SHOWN = ("P2_W", "efficiency", "u_efficiency", "time_s")


class Following:
    """Reads what has become known since one looked last."""

    def __init__(self, database: Database) -> None:
        self._db = database

    def last_event(self, campaign_id: int) -> int:
        """The number of the last event of a campaign; 0 while there is none."""
        query = select(func.max(events.c.id)).where(events.c.campaign_id == campaign_id)
        with self._db.reading() as db:
            return int(db.execute(query).scalar() or 0)

    def planned(self, campaign_id: int) -> list[Row]:
        """The set points in the order of the plan; ``predicted_efficiency`` and ``why`` are None where unknown."""
        asked = (points.c[name] for name in ("id", "kind", "D1", "D2", "P_set_W", "predicted"))
        query = select(*asked, why()).where(points.c.campaign_id == campaign_id).order_by(points.c.position)
        with self._db.reading() as db:
            rows = [dict(row) for row in db.execute(query).mappings()]
        for row in rows:
            row["predicted_efficiency"] = (row.pop("predicted") or {}).get("efficiency")
        return rows

    def judged(self, campaign_id: int, *, after: int = 0, until: int) -> list[Row]:
        """The rows accepted or rejected by events after one and up to another, in that order.

        D1 and D2 are those applied, where they were measured; ``judged`` is when, UTC.
        """
        told = [points.c[name] for name in ("id", "kind", "state", "reason", "P_set_W", "predicted")]
        measured = [readings.c[name] for name in _SHOWN]
        applied = [readings.c[name].label(f"{name}_applied") for name in ("D1", "D2")]
        query = (
            select(*told, points.c.D1, points.c.D2, *applied, *measured, events.c.written.label("judged"))
            .join(points, events.c.point_id == points.c.id)
            .outerjoin(readings, readings.c.point_id == points.c.id)
            .where(
                events.c.campaign_id == campaign_id,
                events.c.id > after,
                events.c.id <= until,
                events.c.event.in_([str(state) for state in FINISHED]),
            )
            .order_by(events.c.id)
        )
        with self._db.reading() as db:
            return [_shown(dict(row)) for row in db.execute(query).mappings()]


def _shown(row: Row) -> Row:
    for name in ("D1", "D2"):
        applied = row.pop(f"{name}_applied")
        row[name] = row[name] if applied is None else applied
    row["predicted_efficiency"] = (row.pop("predicted") or {}).get("efficiency")
    return row
