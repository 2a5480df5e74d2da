"""The campaign database: the only place that writes campaign data.

Every step is one transaction, on the disk when the call returns (SQLite: WAL with synchronous = FULL).
"""

import importlib.metadata
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import pandas as pd
from sqlalchemy import (
    CursorResult,
    Engine,
    Insert,
    Integer,
    RowMapping,
    create_engine,
    event,
    func,
    insert,
    select,
    update,
)
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, NoSuchModuleError, SQLAlchemyError

from bench.errors import InputError, StateError
from bench.plan import PlannedPoint
from bench.tables import COLUMNS, NUMBERS, campaigns, diagnoses, events, metadata, models, points, readings

DEFAULT_URL = "sqlite:///d2ea-data/d2ea.sqlite"
BUSY_MS = 10_000  # another process (status, export) may hold the file for a moment
PACKAGES = ("d2ea-bench", "numpy", "scipy", "pandas", "xgboost-cpu", "pyserial", "pymodbus", "SQLAlchemy")


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Where a campaign's data come from."""

    config: Mapping[str, object]
    config_hash: str
    virtual: bool
    instruments: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredReading:
    """A measured row: numbers by column of the measurement table, and the updates behind it."""

    numbers: Mapping[str, float]
    settled: bool
    quality: str
    samples: Sequence[Mapping[str, float]] = ()


def database_url(option: str | None = None, configured: str | None = None) -> str:
    """The option, else the bench's own, else D2EA_DB, else a file in the working directory."""
    return option or configured or os.environ.get("D2EA_DB") or DEFAULT_URL


def versions() -> dict[str, str]:
    """Versions of this program, of Python and of the libraries that numbers depend on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


class Store:
    """An open campaign database."""

    def __init__(self, url: str) -> None:
        try:
            parsed = make_url(url)
            if parsed.get_backend_name() == "sqlite" and parsed.database not in (None, "", ":memory:"):
                Path(str(parsed.database)).parent.mkdir(parents=True, exist_ok=True)
            self._engine: Engine = create_engine(parsed)
            if self._engine.dialect.name == "sqlite":
                event.listen(self._engine, "connect", _durable)
            metadata.create_all(self._engine)
        except (ArgumentError, NoSuchModuleError, ModuleNotFoundError) as error:
            raise InputError.of("database", "URL", None, f"not an SQLAlchemy URL: {error}") from error
        except (SQLAlchemyError, OSError) as error:
            where = parsed.render_as_string(hide_password=True)
            raise InputError.of("database", "URL", where, f"cannot be opened: {error}") from error
        self.url = parsed.render_as_string(hide_password=True)

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- a campaign's life ----------------------------------------------------------------------

    def create_campaign(self, name: str, provenance: Provenance, *, planned: int, state: str) -> int:
        """A new campaign; returns its id."""
        with self._engine.begin() as db:
            return _new_id(db.execute(_campaign(name, provenance, planned=planned, state=state)))

    def set_state(self, campaign_id: int, state: str, *, time_s: float, detail: str = "") -> None:
        """The campaign's new state, and an event that says so."""
        with self._engine.begin() as db:
            db.execute(update(campaigns).where(campaigns.c.id == campaign_id).values(state=state))
            db.execute(_event(campaign_id, state, time_s=time_s, detail=detail))

    def end(self, campaign_id: int, state: str, *, power_off: str, error: str | None = None) -> None:
        """The campaign's last state, with how the bench was left and what went wrong."""
        with self._engine.begin() as db:
            values = {
                "state": state,
                "ended": _utc(),
                "power_off": power_off,
                "error": error,
                "request": None,
            }
            db.execute(update(campaigns).where(campaigns.c.id == campaign_id).values(**values))
            db.execute(_event(campaign_id, state, detail=error or power_off))

    def identify(self, campaign_id: int, instruments: Mapping[str, str]) -> None:
        """Which instruments answered."""
        with self._engine.begin() as db:
            values = {"instruments": dict(instruments)}
            db.execute(update(campaigns).where(campaigns.c.id == campaign_id).values(**values))

    def note(self, campaign_id: int, what: str, *, time_s: float | None = None, detail: str = "") -> None:
        """An event that is not a state."""
        with self._engine.begin() as db:
            db.execute(_event(campaign_id, what, time_s=time_s, detail=detail))

    # --- a point's life -------------------------------------------------------------------------

    def add_prediction(
        self, campaign_id: int, row: PlannedPoint, predicted: Mapping[str, float], *, time_s: float
    ) -> int:
        """What the simulator says of a point, before it is set; returns the point's id."""
        with self._engine.begin() as db:
            result = db.execute(
                insert(points).values(
                    campaign_id=campaign_id,
                    point=row.point,
                    repeat=row.repeat,
                    kind=row.kind.value,
                    D1=row.D1,
                    D2=row.D2,
                    P_set_W=row.power_W,
                    state="predicted",
                    predicted=_finite(predicted),
                )
            )
            point_id = _new_id(result)
            db.execute(_event(campaign_id, "predicted", point_id=point_id, time_s=time_s))
        return point_id

    def advance(
        self, campaign_id: int, point_id: int, state: str, *, time_s: float, reason: str | None = None
    ) -> None:
        """The point's new state."""
        with self._engine.begin() as db:
            db.execute(update(points).where(points.c.id == point_id).values(state=state, reason=reason))
            db.execute(_event(campaign_id, state, point_id=point_id, time_s=time_s, detail=reason or ""))

    def add_reading(self, campaign_id: int, point_id: int, reading: StoredReading) -> None:
        """The measured row of a point, which becomes ``measured``."""
        with self._engine.begin() as db:
            db.execute(insert(readings).values(_reading(campaign_id, point_id, reading)))
            db.execute(update(points).where(points.c.id == point_id).values(state="measured"))
            time_s = reading.numbers.get("time_s")
            db.execute(_event(campaign_id, "measured", point_id=point_id, time_s=time_s))

    # --- asked from another process -------------------------------------------------------------

    def ask(self, campaign_id: int, request: str | None) -> None:
        """Ask a running campaign to pause or abort; None lets it go on."""
        with self._engine.begin() as db:
            db.execute(update(campaigns).where(campaigns.c.id == campaign_id).values(request=request))
            db.execute(_event(campaign_id, f"asked: {request or 'go on'}"))

    def asked(self, campaign_id: int) -> str | None:
        """What the operator asks of the campaign now."""
        with self._engine.connect() as db:
            return db.execute(select(campaigns.c.request).where(campaigns.c.id == campaign_id)).scalar()

    # --- reading --------------------------------------------------------------------------------

    def campaign(self, campaign_id: int) -> RowMapping:
        """One campaign's row; StateError when there is none."""
        with self._engine.connect() as db:
            row = db.execute(select(campaigns).where(campaigns.c.id == campaign_id)).mappings().first()
        if row is None:
            known = ", ".join(str(item["id"]) for item in self.campaigns()) or "none yet"
            raise StateError(f"there is no campaign {campaign_id} in {self.url}; known: {known}")
        return row

    def campaigns(self) -> list[RowMapping]:
        """All campaigns, oldest first, with ``accepted`` and ``rejected`` counted."""
        counted = [
            func.coalesce(func.sum((points.c.state == state).cast(Integer)), 0).label(state)
            for state in ("accepted", "rejected")
        ]
        joined = campaigns.outerjoin(points, points.c.campaign_id == campaigns.c.id)
        query = select(campaigns, *counted).select_from(joined).group_by(campaigns.c.id)
        with self._engine.connect() as db:
            return list(db.execute(query.order_by(campaigns.c.id)).mappings())

    def measurement_table(self, campaign_id: int) -> pd.DataFrame:
        """The accepted rows, one line each, in the order measured; columns nobody measured are left out."""
        self.campaign(campaign_id)
        identity = [points.c[name] for name in ("point", "repeat", "kind")]
        measured = [readings.c[name] for name in (*NUMBERS, "settled", "quality")]
        query = (
            select(*identity, *measured)
            .join(points, readings.c.point_id == points.c.id)
            .where(readings.c.campaign_id == campaign_id, points.c.state == "accepted")
            .order_by(readings.c.id)
        )
        with self._engine.connect() as db:
            table = pd.DataFrame(db.execute(query).all(), columns=list(COLUMNS))
        return table.dropna(axis="columns", how="all") if len(table) else table

    def predictions(self, campaign_id: int) -> pd.DataFrame:
        """All points with their state, reason and predicted columns (prefix ``predicted_``)."""
        self.campaign(campaign_id)
        query = select(points).where(points.c.campaign_id == campaign_id).order_by(points.c.id)
        with self._engine.connect() as db:
            rows = [dict(row) for row in db.execute(query).mappings()]
        for row in rows:
            row |= {f"predicted_{name}": value for name, value in row.pop("predicted").items()}
        return pd.DataFrame(rows)

    def samples(self, campaign_id: int) -> dict[int, list[dict[str, float]]]:
        """The single analyzer updates behind every row, by point id."""
        query = select(readings.c.point_id, readings.c.samples).where(readings.c.campaign_id == campaign_id)
        with self._engine.connect() as db:
            return {int(row.point_id): row.samples for row in db.execute(query)}

    def events(self, campaign_id: int) -> list[RowMapping]:
        """What happened, in order."""
        query = select(events).where(events.c.campaign_id == campaign_id).order_by(events.c.id)
        with self._engine.connect() as db:
            return list(db.execute(query).mappings())

    # --- somebody else's measurements, models, diagnoses ------------------------------------------

    def import_table(self, name: str, table: pd.DataFrame, provenance: Provenance) -> int:
        """Measured rows as a campaign of their own, in one transaction; returns its id."""
        with self._engine.begin() as db:
            campaign = _campaign(name, provenance, planned=len(table), state="imported")
            campaign_id = _new_id(db.execute(campaign.values(ended=_utc(), process=None)))
            for order, row in enumerate(table.to_dict(orient="records")):
                values = {str(key): None if _missing(value) else value for key, value in row.items()}
                point = {"point": values.get("point", order), "repeat": values.get("repeat", 0)}
                point |= {"kind": values.get("kind") or "load", "predicted": {}, "state": "accepted"}
                point |= {key: values.get(key) for key in ("D1", "D2", "P_set_W")}
                point_id = _new_id(db.execute(insert(points).values(campaign_id=campaign_id, **point)))
                reading = StoredReading(
                    numbers={key: float(values[key] or 0) for key in NUMBERS if values.get(key) is not None},
                    settled=bool(values.get("settled", True)),
                    quality=str(values.get("quality") or "good"),
                )
                db.execute(insert(readings).values(_reading(campaign_id, point_id, reading)))
        return campaign_id

    def add_model(self, model: str, detail: Mapping[str, object], *, campaign_id: int | None = None) -> int:
        """Note a trained or extended model: its id in the registry, or its file."""
        values = {"model": model, "detail": dict(detail), "campaign_id": campaign_id, "created": _utc()}
        with self._engine.begin() as db:
            return _new_id(db.execute(insert(models).values(**values)))

    def add_diagnosis(self, verdict: Mapping[str, object], *, campaign_id: int | None = None) -> int:
        """Keep a verdict as it was given."""
        values = {"verdict": dict(verdict), "campaign_id": campaign_id, "created": _utc()}
        with self._engine.begin() as db:
            return _new_id(db.execute(insert(diagnoses).values(**values)))

    def diagnoses(self, campaign_id: int) -> list[RowMapping]:
        """The verdicts given on a campaign, oldest first."""
        query = select(diagnoses).where(diagnoses.c.campaign_id == campaign_id).order_by(diagnoses.c.id)
        with self._engine.connect() as db:
            return list(db.execute(query).mappings())


def _durable(connection: Any, _: object) -> None:
    """WAL lets others read while a campaign writes; FULL puts every commit on the disk."""
    cursor = connection.cursor()
    pragmas = ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON", f"busy_timeout = {BUSY_MS}")
    for pragma in pragmas:
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def _campaign(name: str, provenance: Provenance, *, planned: int, state: str) -> Insert:
    fixed = {"name": name, "state": state, "planned": planned, "created": _utc(), "process": os.getpid()}
    return insert(campaigns).values(**fixed, versions=versions(), **asdict(provenance))


def _event(
    campaign_id: int,
    what: str,
    *,
    point_id: int | None = None,
    time_s: float | None = None,
    detail: str = "",
) -> Insert:
    values = {"campaign_id": campaign_id, "event": what, "point_id": point_id, "time_s": time_s}
    return insert(events).values(**values, detail=detail, written=_utc())


def _reading(campaign_id: int, point_id: int, reading: StoredReading) -> dict[str, object]:
    numbers = {name: None if _missing(value) else float(value) for name, value in reading.numbers.items()}
    samples = [_finite(sample) for sample in reading.samples]
    return {
        "campaign_id": campaign_id,
        "point_id": point_id,
        "settled": reading.settled,
        "quality": reading.quality,
        "samples": samples,
        **numbers,
    }


def _finite(values: Mapping[str, float]) -> dict[str, float | None]:
    """JSON has no NaN: a missing number is null."""
    return {name: float(value) if math.isfinite(value) else None for name, value in values.items()}


def _missing(value: object) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))


def _new_id(result: CursorResult[Any]) -> int:
    key = result.inserted_primary_key
    assert key is not None, "every table here has a primary key"
    return int(key[0])


def _utc() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
