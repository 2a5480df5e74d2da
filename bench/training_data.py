"""Measured rows to train on, each with a name that leads back to where it was measured."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.errors import InputError
from bench.store import Store
from models.dataset import Measurements
from models.screening import LOADED_KINDS

Places = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class TrainingData:
    """Accepted rows: a ``table`` of all of them, the ``place`` (N,) in it of those that carry power, N ``names``.

    ``data`` says where they are for people, ``virtual`` whether they are from a virtual lab (None: nobody said);
    ``campaigns`` is empty for a file. Of several campaigns, ``time_s`` of each goes on from the one before.
    """

    table: pd.DataFrame
    place: Places
    names: tuple[str, ...]
    data: str
    virtual: bool | None
    campaigns: tuple[int, ...] = ()

    @classmethod
    def of_file(cls, path: Path, measured: Measurements) -> Self:
        """The rows of a checked measurement table, named as the file counts them."""
        place = _loaded(measured.frame)
        names = tuple(f"{path.name} row {measured.rows[k]}" for k in place)
        return cls(table=measured.frame, place=place, names=names, data=str(path), virtual=measured.virtual)

    @classmethod
    def of_campaigns(cls, store: Store, ids: Sequence[int]) -> Self:
        """The accepted rows of campaigns, in the order measured; rejected ones never get here.

        Raises InputError when campaigns of a virtual lab and of hardware are asked for together.
        """
        labs = {bool(store.campaign(id)["virtual"]) for id in ids}
        if len(labs) > 1:
            allowed = "measurements of a virtual lab and of hardware are never learnt from together"
            raise InputError.of("command line", "campaigns", list(ids), allowed)
        tables: list[pd.DataFrame] = []
        for id in ids:
            table = store.measurement_table(id).assign(campaign=id)
            tables.append(_after(tables[-1], table) if tables else table)
        some = [table for table in tables if len(table)]
        joined = pd.concat(some, ignore_index=True) if some else tables[0]
        place = _loaded(joined)
        told = joined[["campaign", "point", "repeat"]].iloc[place].to_dict("records")
        names = [f"campaign {row['campaign']} point {row['point']} repeat {row['repeat']}" for row in told]
        numbers = ", ".join(map(str, ids))
        return cls(
            table=joined.drop(columns="campaign"),
            place=place,
            names=tuple(names),
            data=f"{store.url}, campaign{'s' * (len(ids) > 1)} {numbers}",
            virtual=labs.pop(),
            campaigns=tuple(ids),
        )

    @cached_property
    def rows(self) -> pd.DataFrame:
        """The rows that carry power."""
        return self.table.iloc[self.place].reset_index(drop=True)

    def __len__(self) -> int:
        return len(self.place)

    def beside_idle(self, chosen: Places) -> pd.DataFrame:
        """Some of the rows that carry power, and all that do not, in the order measured."""
        kept = np.ones(len(self.table), dtype=bool)
        kept[np.delete(self.place, chosen)] = False
        return self.table[kept].reset_index(drop=True)


def _loaded(table: pd.DataFrame) -> Places:
    """Where the rows are that carry power, with all that there is to learn from."""
    known = table[["D1", "D2", "P2_W", "efficiency"]].notna().all(axis=1)
    return np.flatnonzero(table["kind"].isin(LOADED_KINDS) & known)


def _after(before: pd.DataFrame, table: pd.DataFrame) -> pd.DataFrame:
    """A campaign's table, its time going on from where that of another ended."""
    if "time_s" not in before or "time_s" not in table or not len(before):
        return table
    return table.assign(time_s=table["time_s"] + before["time_s"].max())


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
