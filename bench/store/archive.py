"""What is kept beside campaigns of one's own: somebody else's measurements, models, diagnoses."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sqlalchemy import RowMapping, insert, select

from bench.states import PointState, State
from bench.store.database import Database
from bench.store.ledger import Provenance, StoredReading, campaign_row, event_values, reading_row
from bench.store.row import missing, new_id, utc
from bench.store.tables import NUMBERS, diagnoses, events, models, points, readings


class Archive:
    """Keeps and lists them."""

    def __init__(self, database: Database) -> None:
        self._db = database

    def import_table(self, name: str, table: pd.DataFrame, provenance: Provenance) -> int:
        """Measured rows as a campaign of their own, in one transaction; returns its id."""
        with self._db.durable() as db:
            campaign = campaign_row(name, provenance, planned=len(table), state=State.IMPORTED)
            campaign_id = new_id(db.execute(campaign.values(ended=utc(), process=None)))
            rows = [_known(row) for row in table.to_dict(orient="records")]
            numbers = {name: _numbered(table, name) for name in ("point", "repeat")}
            told = [
                {"campaign_id": campaign_id, "position": k, **_point(row)}
                | {name: int(each[k]) for name, each in numbers.items()}
                for k, row in enumerate(rows)
            ]
            made = insert(points).returning(points.c.id, sort_by_parameter_order=True)
            ids = db.scalars(made, told).all()
            found = zip(ids, map(_reading, rows), strict=True)
            db.execute(insert(readings), [reading_row(campaign_id, id, reading) for id, reading in found])
            accepted = (event_values(campaign_id, PointState.ACCEPTED, point_id=id) for id in ids)
            db.execute(insert(events), list(accepted))
        return campaign_id

    def add_model(self, model: str, detail: Mapping[str, object], *, campaign_id: int | None = None) -> int:
        """Note a trained or extended model: its id in the registry, or its file."""
        values = {"model": model, "detail": dict(detail), "campaign_id": campaign_id, "created": utc()}
        with self._db.durable() as db:
            return new_id(db.execute(insert(models).values(**values)))

    def models(self, campaign_id: int | None = None) -> list[RowMapping]:
        """The models noted, oldest first: of one campaign, or all."""
        query = select(models).order_by(models.c.id)
        if campaign_id is not None:
            query = query.where(models.c.campaign_id == campaign_id)
        with self._db.reading() as db:
            return list(db.execute(query).mappings())

    def add_diagnosis(self, verdict: Mapping[str, object], *, campaign_id: int | None = None) -> int:
        """Keep a verdict as it was given."""
        values = {"verdict": dict(verdict), "campaign_id": campaign_id, "created": utc()}
        with self._db.durable() as db:
            return new_id(db.execute(insert(diagnoses).values(**values)))

    def diagnoses(self, campaign_id: int) -> list[RowMapping]:
        """The verdicts given on a campaign, oldest first."""
        query = select(diagnoses).where(diagnoses.c.campaign_id == campaign_id).order_by(diagnoses.c.id)
        with self._db.reading() as db:
            return list(db.execute(query).mappings())


def _known(row: Mapping[Any, Any]) -> dict[str, Any]:
    """A row of a measurement table, None where there is nothing."""
    return {str(key): None if missing(value) else value for key, value in row.items()}


def _numbered(table: pd.DataFrame, name: str) -> NDArray[np.intp]:
    """A column of whole numbers; names of its own instead are numbered as they come, and so are rows without it."""
    if name not in table:
        return np.arange(len(table)) if name == "point" else np.zeros(len(table), dtype=np.intp)
    values = pd.to_numeric(table[name], errors="coerce")
    if np.isfinite(values).all() and (values % 1 == 0).all():
        return values.to_numpy(dtype=np.intp)
    return pd.factorize(table[name], use_na_sentinel=False)[0]


def _point(row: Mapping[str, Any]) -> dict[str, object]:
    """What was set in an imported row."""
    set_point = {key: row.get(key) for key in ("D1", "D2", "P_set_W")}
    fixed = {"state": PointState.ACCEPTED, "attempts": 0, "predicted": {}}
    return {"kind": row.get("kind") or "load", **fixed, **set_point}


def _reading(row: Mapping[str, Any]) -> StoredReading:
    """What was measured in it."""
    return StoredReading(
        numbers={key: float(row[key]) for key in NUMBERS if row.get(key) is not None},
        settled=bool(row.get("settled", True)),
        quality=str(row.get("quality") or "good"),
    )
