"""What is stored, for those who look: commands, reports, a live screen. Reading never blocks a campaign."""

from typing import Any

import pandas as pd
from sqlalchemy import Column, Integer, RowMapping, Select, case, func, select

from bench.errors import StateError
from bench.process import Owner
from bench.states import LIVE, PointState, shown_state
from bench.store.database import Database
from bench.store.tables import (
    HARDWARE,
    NUMBERS,
    VIRTUAL,
    campaigns,
    events,
    live,
    points,
    readings,
    sessions,
)

Row = dict[str, Any]


class Reader:
    """Reads campaigns, points and readings."""

    def __init__(self, database: Database) -> None:
        self._db = database

    def campaign(self, campaign_id: int) -> Row:
        """One campaign as in ``campaigns``; StateError when there is none."""
        rows = self._campaigns(_counted().where(campaigns.c.id == campaign_id))
        if not rows:
            known = ", ".join(str(item["id"]) for item in self.campaigns()) or "none yet"
            raise StateError(f"there is no campaign {campaign_id} in {self._db.url}; known: {known}")
        return rows[0]

    def campaigns(self) -> list[Row]:
        """All campaigns, oldest first.

        Beside the stored columns each has ``accepted`` and ``rejected`` counted, ``shown`` (its true ``State``:
        ``interrupted`` where the process that ran it is gone) and ``is_live`` (a process runs it now).
        """
        return self._campaigns(_counted().order_by(campaigns.c.id))

    def _campaigns(self, query: Select[Any]) -> list[Row]:
        with self._db.reading() as db:
            rows = [dict(row) for row in db.execute(query).mappings()]
        for row in rows:
            owner = Owner.stored(row)
            alive = owner is not None and owner.lives(row.pop("heard_of") or row["created"])
            row["shown"] = shown_state(row["state"], alive=alive)
            row["is_live"] = row["shown"] in LIVE
        return rows

    def sessions(self, campaign_id: int) -> list[RowMapping]:
        """The starts and resumes of a campaign, oldest first: the provenance of its rows."""
        query = select(sessions).where(sessions.c.campaign_id == campaign_id).order_by(sessions.c.id)
        with self._db.reading() as db:
            return list(db.execute(query).mappings())

    def measurement_table(self, campaign_id: int) -> pd.DataFrame:
        """The accepted rows, one line each, in the order of the plan; columns nobody measured are left out.

        The column ``lab`` says where they come from: ``virtual`` or ``hardware``.
        """
        measured = [readings.c[name] for name in (*NUMBERS, "settled", "quality")]
        query = select(*_identity(), *measured).join(points, readings.c.point_id == points.c.id)
        return self._table(campaign_id, query, PointState.ACCEPTED)

    def rejected_table(self, campaign_id: int) -> pd.DataFrame:
        """The rejected rows likewise, with the set point and what there is of a reading, and a column ``reason``."""
        measured = [
            func.coalesce(readings.c[name], points.c[name]).label(name)
            if name in points.c
            else readings.c[name]
            for name in (*NUMBERS, "settled", "quality")
        ]
        query = select(*_identity(), *measured, points.c.reason)
        joined = query.select_from(points).join(readings, readings.c.point_id == points.c.id, isouter=True)
        return self._table(campaign_id, joined, PointState.REJECTED)

    def _table(self, campaign_id: int, query: Select[Any], state: PointState) -> pd.DataFrame:
        """The points of a campaign in that state, in the order of the plan, without columns that are empty."""
        lab = VIRTUAL if self.campaign(campaign_id)["virtual"] else HARDWARE
        wanted = query.where(points.c.campaign_id == campaign_id, points.c.state == state)
        with self._db.reading() as db:
            rows = db.execute(wanted.order_by(points.c.position))
            table = pd.DataFrame(rows.all(), columns=list(rows.keys()))
        return table.dropna(axis="columns", how="all").assign(lab=lab) if len(table) else table

    def provenance(self, campaign_id: int) -> pd.DataFrame:
        """Per accepted row of ``measurement_table``, in its order: the session that measured it, unfolded."""
        told = ("started", "host", "process", "seed", "config_hash", "versions", "instruments")
        query = (
            select(points.c.point, points.c.repeat, *(sessions.c[name] for name in told))
            .join(readings, readings.c.point_id == points.c.id)
            .join(sessions, readings.c.session_id == sessions.c.id)
            .where(points.c.campaign_id == campaign_id, points.c.state == "accepted")
            .order_by(points.c.position)
        )
        with self._db.reading() as db:
            return pd.DataFrame(db.execute(query).all(), columns=["point", "repeat", *told])

    def predictions(self, campaign_id: int) -> pd.DataFrame:
        """All points with their state, reason and predicted columns (prefix ``predicted_``)."""
        self.campaign(campaign_id)
        query = select(points).where(points.c.campaign_id == campaign_id).order_by(points.c.position)
        with self._db.reading() as db:
            rows = [dict(row) for row in db.execute(query).mappings()]
        for row in rows:
            row |= {f"predicted_{name}": value for name, value in row.pop("predicted").items()}
        return pd.DataFrame(rows)

    def point(self, point_id: int) -> RowMapping | None:
        """One point's row."""
        with self._db.reading() as db:
            return db.execute(select(points).where(points.c.id == point_id)).mappings().first()

    def samples(self, campaign_id: int) -> dict[int, list[dict[str, float]]]:
        """The single analyzer updates behind every row, by point id."""
        query = select(readings.c.point_id, readings.c.samples).where(readings.c.campaign_id == campaign_id)
        with self._db.reading() as db:
            return {int(row.point_id): row.samples for row in db.execute(query)}

    def events(self, campaign_id: int, *, after: int = 0) -> list[RowMapping]:
        """What happened, in order; ``after`` the event of that id."""
        query = select(events).where(events.c.campaign_id == campaign_id, events.c.id > after)
        with self._db.reading() as db:
            return list(db.execute(query.order_by(events.c.id)).mappings())

    def settled(self, campaign_id: int) -> int:
        """How many of the rows measured had settled in time."""
        measured = (readings.c.campaign_id == campaign_id, readings.c.settled.is_(True))
        with self._db.reading() as db:
            return int(db.execute(select(func.count()).select_from(readings).where(*measured)).scalar() or 0)

    def time_s(self, campaign_id: int) -> float:
        """Campaign time of the last thing that is stored of it."""
        query = select(func.max(events.c.time_s)).where(events.c.campaign_id == campaign_id)
        with self._db.reading() as db:
            return float(db.execute(query).scalar() or 0.0)


def _counted() -> Select[Any]:
    counted = [
        func.coalesce(func.sum(case((points.c.state == state, 1), else_=0)), 0).cast(Integer).label(state)
        for state in ("accepted", "rejected")
    ]
    heard = (
        select(live.c.written).where(live.c.campaign_id == campaigns.c.id).scalar_subquery().label("heard_of")
    )
    totals = select(points.c.campaign_id, *counted).group_by(points.c.campaign_id).subquery()
    numbers = [func.coalesce(totals.c[state], 0).label(state) for state in ("accepted", "rejected")]
    joined = campaigns.outerjoin(totals, totals.c.campaign_id == campaigns.c.id)
    return select(campaigns, *numbers, heard).select_from(joined)


def _identity() -> list[Column[Any]]:
    """What names a row of a campaign."""
    return [points.c[name] for name in ("point", "repeat", "kind")]
