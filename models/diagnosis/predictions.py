"""What every variant of a baseline says of every channel, kept for rows that are measured again.

The same row at another time has other readings only where something follows the time; nothing else is simulated anew.
What follows the time is known as well of the end of the campaign, when rows are measured again, where a command waits.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import CHANNELS, Observations
from sim.effects.catalogue import effect
from sim.simulate import Case, Result, simulate_each

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
Variant = tuple[object, ...]


def table_of(result: Result) -> Array:
    """All channels of a simulation, (C, N)."""
    return np.stack([result[c.column] for c in CHANNELS])


def read(table: Array, observations: Observations, row: Rows) -> Array:
    """Of a table (C, N) every reading, (M,), whose places are ``row`` (M,)."""
    place = np.array([CHANNELS.index(c) for c in observations.channels])
    return np.asarray(table[place[observations.channel], row])


@dataclass(frozen=True, slots=True, kw_only=True)
class Predictions:
    """Tables (C, N) at the ``rows`` (N,) of the frame of every variant that follows no time, by its key.

    ``at_end`` are those of some others, all at the time ``end_s``.
    """

    rows: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    tables: Mapping[Variant, Array] = field(default_factory=dict)
    at_end: Mapping[Variant, Array] = field(default_factory=dict)
    end_s: float = np.nan

    @classmethod
    def of(cls, rows: Rows, variants: Mapping[Variant, Case], tables: Sequence[Array]) -> Self:
        """What is worth keeping of tables in the variants' order."""
        pairs = zip(variants.items(), tables, strict=True)
        return cls(rows=rows, tables={key: table for (key, case), table in pairs if not _over_time(case)})

    def ending(self, keys: Sequence[Variant], tables: Sequence[Array], end_s: float) -> Self:
        """The same with tables of variants by their keys at the end of the campaign."""
        return replace(self, at_end=dict(zip(keys, tables, strict=True)), end_s=end_s)

    def of_time(self, cases: Collection[Case]) -> Mapping[Variant, Array]:
        """What holds at the times at which these cases are."""
        times = [np.asarray(points.time_s) == self.end_s for _, points in cases]
        return {**self.tables, **self.at_end} if np.all(np.concatenate(times)) else self.tables


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeated:
    """Points of which each is the one at ``rows`` (K,) of the frame at another time, -1 where it is none of them."""

    known: Predictions
    rows: Rows

    def take(self, chosen: Rows) -> "Repeated":
        """Some of the points."""
        return Repeated(known=self.known, rows=self.rows[chosen])

    def tables(self, variants: Mapping[Variant, Case], near: Result) -> list[Array]:
        """Tables (C, K) of variants at these points, from a simulation ``near`` them."""
        place = np.searchsorted(self.known.rows, self.rows)
        new, every = np.flatnonzero(self.rows < 0), np.arange(self.rows.size)
        known = self.known.of_time(variants.values())
        found = {key: known[key].take(place, axis=1, mode="clip") for key in variants if key in known}
        for keys, at in ((list(found), new), ([key for key in variants if key not in found], every)):
            if keys and at.size:
                cases = [(model, points.take(at)) for model, points in map(variants.__getitem__, keys)]
                for key, result in zip(keys, simulate_each(cases, near.take(at)), strict=True):
                    found.setdefault(key, np.empty((len(CHANNELS), every.size)))[:, at] = table_of(result)
        return [found[key] for key in variants]


def ending(variants: Mapping[Variant, Case], end_s: float) -> dict[Variant, Case]:
    """Of variants those that follow the time, at the end of a campaign."""
    return {
        key: (model, replace(points, time_s=np.full(len(points), end_s)))
        for key, (model, points) in variants.items()
        if _over_time((model, points))
    }


def _over_time(case: Case) -> bool:
    model, _ = case
    return any(effect(name).over_time for name in model.effects)
