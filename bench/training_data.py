"""Measured rows to train on, each with a name that leads back to where it was measured."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from bench.errors import InputError
from bench.store import Store
from models.screening import LOADED_KINDS


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingData:
    """Accepted rows that carry power, and as many ``names``; ``campaigns`` is empty for a file.

    ``data`` says where they are for people, ``virtual`` whether they are from a virtual lab (None: nobody said).
    """

    rows: pd.DataFrame
    names: tuple[str, ...]
    data: str
    virtual: bool | None
    campaigns: tuple[int, ...] = ()

    @classmethod
    def of_file(cls, path: Path, frame: pd.DataFrame) -> "TrainingData":
        """The loaded rows of a checked measurement table."""
        loaded = _loaded(frame)
        names = tuple(f"{path.name} row {number + 1}" for number in loaded.index)
        return cls(rows=loaded.reset_index(drop=True), names=names, data=str(path), virtual=None)

    @classmethod
    def of_campaigns(cls, store: Store, ids: Sequence[int]) -> "TrainingData":
        """The accepted, loaded rows of campaigns, in the order measured; rejected ones never get here.

        Raises InputError when campaigns of a virtual lab and of hardware are asked for together.
        """
        labs = {bool(store.campaign(id)["virtual"]) for id in ids}
        if len(labs) > 1:
            allowed = "measurements of a virtual lab and of hardware are never learnt from together"
            raise InputError.of("command line", "campaigns", list(ids), allowed)
        tables, names = [], []
        for id in ids:
            table = store.measurement_table(id)
            loaded = _loaded(table) if len(table) else table
            tables.append(loaded)
            names += [f"campaign {id} {_row(row)}" for row in loaded[["point", "repeat"]].to_dict("records")]
        some = [table for table in tables if len(table)]
        rows = pd.concat(some, ignore_index=True) if some else tables[0]
        numbers = ", ".join(map(str, ids))
        return cls(
            rows=rows,
            names=tuple(names),
            data=f"{store.url}, campaign{'s' * (len(ids) > 1)} {numbers}",
            virtual=labs.pop(),
            campaigns=tuple(ids),
        )

    def __len__(self) -> int:
        return len(self.rows)


def _loaded(table: pd.DataFrame) -> pd.DataFrame:
    return table[table["kind"].isin(LOADED_KINDS)].dropna(subset=["D1", "D2", "P2_W", "efficiency"])


def _row(row: Mapping[Hashable, object]) -> str:
    return f"point {row['point']} repeat {row['repeat']}"


def same_bench(store: Store, newest: int) -> tuple[int, ...]:
    """Campaigns on the bench of ``newest``, in the same kind of lab, up to it; imported ones stand alone."""
    rows = {row["id"]: row for row in store.campaigns()}
    bench = _bench(rows[newest]["config"])
    if bench is None:
        return (newest,)
    virtual = rows[newest]["virtual"]
    return tuple(
        id
        for id, row in sorted(rows.items())
        if id <= newest and row["virtual"] == virtual and _bench(row["config"]) == bench
    )


def _bench(config: dict[str, dict[str, object]]) -> object:
    """What makes two campaigns' benches the same one: its name and its converter."""
    bench = config.get("bench")
    return (bench.get("name"), bench.get("converter")) if bench else None
