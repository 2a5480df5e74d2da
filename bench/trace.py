"""From an entry of a table back to measurements: entry → model → dataset → the measured rows nearest to it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from bench.errors import StateError
from bench.lut_file import model_of
from bench.store import Store
from bench.training_data import TrainingData
from bench.wording import per_cent
from models.held_blocks import CELL
from models.registry import Origin, Registry

NEAREST = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """What leads from an entry to its measurements, one line per step; ``virtual`` as the data are."""

    lines: tuple[str, ...]
    virtual: bool


def trace_entry(file: Path, table: pd.DataFrame, power_W: float, *, registry: Registry, db: str) -> Trace:
    """The chain behind the entry nearest to ``power_W``.

    Raises InputError or RegistryError when the model is not named or gone; that its measurements are gone is one
    of the lines.
    """
    entry = table.iloc[int((table["P_W"] - power_W).abs().argmin())]
    record = registry.show(model_of(file))
    origin = registry.origin(record.id)
    lines = [
        f"entry: {file}, {entry['P_W']:g} W: D1 = {entry['D1']:.4f}, D2 = {entry['D2']:.4f}",
        f"model: {record.id} ({record.kind}), made {record.created[:19]}, in {registry.root / record.id}",
        f"data: {record.data or 'not recorded'}; SHA-256 {record.data_sha256}",
        f"fitted to {len(origin.fitted)} measured rows, judged on {len(origin.held_out)} others",
    ]
    return Trace(lines=(*lines, *_nearest(entry, origin, db)), virtual=bool(record.virtual))


def _nearest(entry: pd.Series, origin: Origin, db: str) -> list[str]:
    try:
        rows = measured_rows(origin.fitted, db)
    except StateError as error:
        return [f"its measurements cannot be looked at: {error}"]
    if not len(rows):
        return ["its measurements are in no database: d2ea models show --rows names them"]
    place = rows[["D1", "D2", "P2_W"]].to_numpy(dtype=np.float64)
    away = np.linalg.norm((place - entry[["D1", "D2", "P_W"]].to_numpy(dtype=np.float64)) / CELL, axis=1)
    return [
        f"near it: {row['name']}: D1 = {row['D1']:.4f}, D2 = {row['D2']:.4f}, {row['P2_W']:.1f} W, "
        f"measured {per_cent(row['efficiency'], 3)}"
        for row in rows.iloc[np.argsort(away)[:NEAREST]].to_dict("records")
    ]


def measured_rows(names: tuple[str, ...], db: str) -> pd.DataFrame:
    """The rows of campaigns among ``names``, with their name; StateError when a campaign is gone."""
    wanted = set(names)
    ids = sorted({int(name.split()[1]) for name in names if name.startswith("campaign ")})
    if not ids:
        return pd.DataFrame()
    with Store(db) as store:
        data = TrainingData.of_campaigns(store, ids)
    rows = data.rows.assign(name=data.names)
    return rows[rows["name"].isin(wanted)].reset_index(drop=True)
