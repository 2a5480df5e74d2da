"""A campaign's life and that of each of its points, one durable transaction per step.

A step is a compare-and-set: it is taken only from a state that may lead there, so that no step is done twice and
none is left out, whoever tries. A point has at most one reading; a campaign asked for twice under one key is made
once. All points are in the ledger, as planned, before anything is switched on; those of a plan that grows, with why
they were chosen, before any of them is set.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sqlalchemy import Insert, RowMapping, bindparam, func, insert, select, update

from bench.errors import StateError
from bench.plan import PlannedPoint
from bench.process import Owner
from bench.states import FINISHED, PointState, State, before
from bench.store.database import Database
from bench.store.row import finite, missing, new_id, utc
from bench.store.tables import (
    CHOICE,
    CHOSEN,
    NUMBERS,
    SETTINGS,
    campaigns,
    events,
    points,
    readings,
    sessions,
    why,
)
from bench.versions import versions

GOOD = "good"
FAR = 9e37  # what analyzers put in the place of a number they do not have is above
# made once: a campaign asks it some hundred times a point
_ASKED = select(campaigns.c.request).where(campaigns.c.id == bindparam("campaign_id"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Where a campaign's data come from."""

    config: Mapping[str, object]
    config_hash: str
    virtual: bool
    instruments: Mapping[str, str] = field(default_factory=dict)
    bench: str | None = None
    key: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredReading:
    """A measured row: numbers by column of the measurement table, and the updates behind it."""

    numbers: Mapping[str, float]
    settled: bool
    quality: str
    samples: Sequence[Mapping[str, float]] = ()
    session_id: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Session:
    """One start or resume of a campaign: the provenance of what is measured in it."""

    campaign_id: int
    seed: int
    config_hash: str
    bench: Mapping[str, object]
    offset_s: float = 0.0


class Ledger:
    """Writes campaigns and points."""

    def __init__(self, database: Database) -> None:
        self._db = database

    # --- a campaign's life ----------------------------------------------------------------------

    def create_campaign(
        self, name: str, provenance: Provenance, plan: Sequence[PlannedPoint], *, said: str = ""
    ) -> int:
        """A new campaign with all its points as planned; returns its id, the old one for a known key."""
        with self._db.durable() as db:
            if provenance.key is not None:
                known = db.execute(select(campaigns.c.id).where(campaigns.c.key == provenance.key)).scalar()
                if known is not None:
                    return int(known)
            made = db.execute(campaign_row(name, provenance, planned=len(plan), state=State.PLANNED))
            campaign_id = new_id(made)
            rows = [_planned(campaign_id, k, row) for k, row in enumerate(plan)]
            if rows:
                db.execute(insert(points), rows)
            db.execute(event_row(campaign_id, State.PLANNED, detail=said))
        return campaign_id

    def grow(
        self, campaign_id: int, rows: Sequence[PlannedPoint], *, time_s: float, said: Sequence[str] = ()
    ) -> None:
        """More points as planned, behind the last one, each with an event that tells why; and what else is ``said``.

        All of it is there, or nothing: who dies in between has chosen nothing.
        """
        with self._db.durable() as db:
            last = db.execute(
                select(func.max(points.c.position)).where(points.c.campaign_id == campaign_id)
            ).scalar()
            first = 0 if last is None else int(last) + 1
            for line in said:
                db.execute(event_row(campaign_id, CHOICE, time_s=time_s, detail=line))
            for position, row in enumerate(rows, start=first):
                made = db.execute(insert(points).values(_planned(campaign_id, position, row)))
                chosen = event_row(campaign_id, CHOSEN, point_id=new_id(made), time_s=time_s, detail=row.why)
                db.execute(chosen)
            db.execute(
                update(campaigns).where(campaigns.c.id == campaign_id).values(planned=first + len(rows))
            )

    def move(self, campaign_id: int, old: State, new: State, *, time_s: float, detail: str = "") -> None:
        """From one state to the next; StateError when the campaign does not stand where it should."""
        with self._db.durable() as db:
            done = db.execute(
                update(campaigns)
                .where(campaigns.c.id == campaign_id, campaigns.c.state == old)
                .values(state=new)
            )
            if done.rowcount != 1:
                raise StateError(f"campaign {campaign_id} is not {old}: somebody else has moved it")
            db.execute(event_row(campaign_id, new, time_s=time_s, detail=detail))

    def end(
        self,
        campaign_id: int,
        state: State,
        *,
        power_off: str,
        error: str | None = None,
        time_s: float | None = None,
    ) -> None:
        """The campaign's last state, with how the bench was left and what went wrong."""
        values = {"state": state, "ended": utc(), "power_off": power_off, "error": error, "request": None}
        with self._db.durable() as db:
            db.execute(update(campaigns).where(campaigns.c.id == campaign_id).values(**values))
            db.execute(event_row(campaign_id, state, time_s=time_s, detail=error or power_off))

    def take_over(self, campaign_id: int, stored: State, *, owner: Owner) -> list[RowMapping]:
        """Make a stopped campaign this process's own; its rows that had begun are planned again.

        Returns the rows that were measured and never judged. StateError when somebody else was faster.
        """
        mine = {**owner.columns(), "request": None, "ended": None, "error": None, "power_off": None}
        with self._db.durable() as db:
            taken = db.execute(
                update(campaigns)
                .where(campaigns.c.id == campaign_id, campaigns.c.state == stored)
                .values(state=State.CHECKING, **mine)
            )
            if taken.rowcount != 1:
                raise StateError(f"campaign {campaign_id} is not {stored} any more: somebody else has it")
            begun = (points.c.campaign_id == campaign_id, points.c.state.in_(before(PointState.PLANNED)))
            for row in db.execute(select(points.c.id, points.c.state).where(*begun)).all():
                detail = f"was {row.state} when the campaign stopped; it is measured anew"
                db.execute(event_row(campaign_id, PointState.PLANNED, point_id=row.id, detail=detail))
            db.execute(update(points).where(*begun).values(state=PointState.PLANNED))
            db.execute(event_row(campaign_id, "resumed", detail=f"was {stored}; by {owner}"))
            measured = select(points).where(
                points.c.campaign_id == campaign_id, points.c.state == PointState.MEASURED
            )
            return list(db.execute(measured.order_by(points.c.position)).mappings())

    def begin_session(self, session: Session, *, owner: Owner) -> int:
        """A new session; returns its id."""
        values = {
            "campaign_id": session.campaign_id,
            "started": utc(),
            "seed": session.seed,
            "config_hash": session.config_hash,
            "bench": dict(session.bench),
            "versions": versions(),
            "instruments": {},
            "offset_s": session.offset_s,
        }
        with self._db.durable() as db:
            return new_id(db.execute(insert(sessions).values(**values, **owner.columns())))

    def identify(self, campaign_id: int, session_id: int, instruments: Mapping[str, str]) -> None:
        """Which instruments answered."""
        found = {"instruments": dict(instruments)}
        with self._db.durable() as db:
            db.execute(update(campaigns).where(campaigns.c.id == campaign_id).values(**found))
            db.execute(update(sessions).where(sessions.c.id == session_id).values(**found))

    def note(self, campaign_id: int, what: str, *, time_s: float | None = None, detail: str = "") -> None:
        """An event that is not a state."""
        with self._db.durable() as db:
            db.execute(event_row(campaign_id, what, time_s=time_s, detail=detail))

    # --- a point's life -------------------------------------------------------------------------

    def predict(
        self, campaign_id: int, predicted: Mapping[int, Mapping[str, float]], *, time_s: float
    ) -> None:
        """What the simulator says of the points, by their ids, before any of them is set."""
        with self._db.durable() as db:
            for point_id, columns in predicted.items():
                db.execute(update(points).where(points.c.id == point_id).values(predicted=finite(columns)))
            db.execute(event_row(campaign_id, "predicted", time_s=time_s, detail=f"{len(predicted)} points"))

    def advance(
        self,
        campaign_id: int,
        point_id: int,
        state: PointState,
        *,
        time_s: float | None = None,
        reason: str | None = None,
    ) -> None:
        """The point's new state; StateError when its present one does not lead there."""
        values: dict[str, object] = {"state": state, "reason": reason}
        if state is PointState.SET:
            values["attempts"] = points.c.attempts + 1
        with self._db.durable() as db:
            done = db.execute(
                update(points)
                .where(points.c.id == point_id, points.c.state.in_(before(state)))
                .values(**values)
            )
            if done.rowcount != 1:
                raise StateError(f"point {point_id} of campaign {campaign_id} cannot become {state} now")
            db.execute(event_row(campaign_id, state, point_id=point_id, time_s=time_s, detail=reason or ""))

    def plan_again(self, campaign_id: int, point_id: int, *, time_s: float) -> None:
        """A point whose measurement was disturbed is planned again; one still planned stays so."""
        begun = points.c.state.in_(before(PointState.PLANNED))
        with self._db.durable() as db:
            db.execute(update(points).where(points.c.id == point_id, begun).values(state=PointState.PLANNED))
            db.execute(event_row(campaign_id, PointState.PLANNED, point_id=point_id, time_s=time_s))

    def add_reading(self, campaign_id: int, point_id: int, reading: StoredReading) -> None:
        """The measured row of a point, which becomes ``measured``.

        What is not a number, or not vouched for, is not stored as one: of a row whose quality is not good the
        settings are kept, and nothing measured.
        """
        with self._db.durable() as db:
            done = db.execute(
                update(points)
                .where(points.c.id == point_id, points.c.state.in_(before(PointState.MEASURED)))
                .values(state=PointState.MEASURED)
            )
            if done.rowcount != 1:
                raise StateError(f"point {point_id} of campaign {campaign_id} cannot become measured now")
            db.execute(insert(readings).values(reading_row(campaign_id, point_id, reading)))
            time_s = reading.numbers.get("time_s")
            db.execute(event_row(campaign_id, PointState.MEASURED, point_id=point_id, time_s=time_s))

    def unfinished(self, campaign_id: int) -> list[RowMapping]:
        """The points still to be measured, in the order of the plan, with ``why`` where they were chosen."""
        open_ones = points.c.state.not_in([*FINISHED, PointState.MEASURED])
        query = select(points, why()).where(points.c.campaign_id == campaign_id, open_ones)
        with self._db.reading() as db:
            return list(db.execute(query.order_by(points.c.position)).mappings())

    def stored_reading(self, point_id: int) -> RowMapping:
        """The reading of a point that has one."""
        with self._db.reading() as db:
            row = db.execute(select(readings).where(readings.c.point_id == point_id)).mappings().first()
        if row is None:
            raise StateError(f"point {point_id} has no reading")
        return row

    # --- asked from another process -------------------------------------------------------------

    def ask(self, campaign_id: int, request: str | None) -> None:
        """Ask a running campaign to pause or abort; None lets it go on."""
        with self._db.durable() as db:
            db.execute(update(campaigns).where(campaigns.c.id == campaign_id).values(request=request))
            db.execute(event_row(campaign_id, f"asked: {request or 'go on'}"))

    def asked(self, campaign_id: int) -> str | None:
        """What the operator asks of the campaign now."""
        with self._db.reading() as db:
            return db.execute(_ASKED, {"campaign_id": campaign_id}).scalar()


def campaign_row(name: str, provenance: Provenance, *, planned: int, state: str) -> Insert:
    """The row of a new campaign, owned by this process."""
    fixed = {"name": name, "state": state, "planned": planned, "created": utc(), **Owner.here().columns()}
    told = {
        "config": dict(provenance.config),
        "config_hash": provenance.config_hash,
        "virtual": provenance.virtual,
        "instruments": dict(provenance.instruments),
        "bench": provenance.bench,
        "key": provenance.key,
    }
    return insert(campaigns).values(**fixed, **told, versions=versions())


def event_row(
    campaign_id: int,
    what: str,
    *,
    point_id: int | None = None,
    time_s: float | None = None,
    detail: str = "",
) -> Insert:
    """The row of an event."""
    told = event_values(campaign_id, what, point_id=point_id)
    return insert(events).values(**told | {"time_s": time_s, "detail": detail})


def event_values(campaign_id: int, what: str, *, point_id: int | None = None) -> dict[str, object]:
    """An event of a campaign or one of its points, without more to tell."""
    values = {"campaign_id": campaign_id, "event": what, "point_id": point_id, "time_s": None}
    return {**values, "detail": "", "written": utc()}


def reading_row(campaign_id: int, point_id: int, reading: StoredReading) -> dict[str, object]:
    """The row of a reading: only columns of the measurement table, only numbers that are measurements."""
    kept = NUMBERS if reading.quality == GOOD else SETTINGS
    numbers = {name: _measured(reading.numbers.get(name)) for name in kept}
    return {
        "campaign_id": campaign_id,
        "point_id": point_id,
        "session_id": reading.session_id,
        "settled": reading.settled,
        "quality": reading.quality,
        "samples": [finite(sample) for sample in reading.samples],
        **numbers,
    }


def _measured(value: float | None) -> float | None:
    if value is None or missing(value):
        return None
    number = float(value)
    return number if math.isfinite(number) and abs(number) < FAR else None


def _planned(campaign_id: int, position: int, row: PlannedPoint) -> dict[str, object]:
    return {
        "campaign_id": campaign_id,
        "position": position,
        "point": row.point,
        "repeat": row.repeat,
        "kind": row.kind.value,
        "D1": row.D1,
        "D2": row.D2,
        "P_set_W": row.power_W,
        "state": PointState.PLANNED,
        "attempts": 0,
        "predicted": {},
    }
