"""What is kept beside campaigns of one's own: somebody else's measurements, models, diagnoses."""

from collections.abc import Mapping

import pandas as pd
from sqlalchemy import RowMapping, insert, select

from bench.states import PointState, State
from bench.store.database import Database
from bench.store.ledger import Provenance, StoredReading, campaign_row, event_row, reading_row
from bench.store.row import missing, new_id, utc
from bench.store.tables import NUMBERS, diagnoses, models, points, readings


class Archive:
    """Keeps and lists them."""

    def __init__(self, database: Database) -> None:
        self._db = database

    def import_table(self, name: str, table: pd.DataFrame, provenance: Provenance) -> int:
        """Measured rows as a campaign of their own, in one transaction; returns its id."""
        with self._db.durable() as db:
            campaign = campaign_row(name, provenance, planned=len(table), state=State.IMPORTED)
            campaign_id = new_id(db.execute(campaign.values(ended=utc(), process=None)))
            for order, row in enumerate(table.to_dict(orient="records")):
                values = {str(key): None if missing(value) else value for key, value in row.items()}
                point = {"point": values.get("point", order), "repeat": values.get("repeat", 0)}
                point |= {"kind": values.get("kind") or "load", "predicted": {}, "attempts": 0}
                point |= {"state": PointState.ACCEPTED, "position": order}
                point |= {key: values.get(key) for key in ("D1", "D2", "P_set_W")}
                point_id = new_id(db.execute(insert(points).values(campaign_id=campaign_id, **point)))
                reading = StoredReading(
                    numbers={key: float(values[key] or 0) for key in NUMBERS if values.get(key) is not None},
                    settled=bool(values.get("settled", True)),
                    quality=str(values.get("quality") or "good"),
                )
                db.execute(insert(readings).values(reading_row(campaign_id, point_id, reading)))
                db.execute(event_row(campaign_id, PointState.ACCEPTED, point_id=point_id))
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
