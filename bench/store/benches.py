"""Who owns a bench, whether it may be switched on, and how it was last seen.

One row per bench, by its name. ``energised`` is stored before anything is switched on and taken back only when
the bench was seen off, so a process that dies leaves it standing. ``unsafe`` is a latch: set when a power-off
could not be confirmed, cleared by an operator alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from sqlalchemy import insert, select, update
from sqlalchemy.exc import IntegrityError

from bench.errors import BenchTaken, BenchUnsafe, StateError
from bench.process import Owner
from bench.store.database import Database
from bench.store.row import utc
from bench.store.tables import benches, live


class BenchState(StrEnum):
    """What is known of a bench."""

    OFF = "off"  # seen off by read-back
    ON = "on"  # a living campaign has switched it on
    UNCONFIRMED = "unconfirmed"  # a campaign that died had switched it on
    UNSAFE = "unsafe"  # a power-off could not be confirmed, and nobody has cleared it
    UNKNOWN = "unknown"  # nothing was ever switched on here


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchRow:
    """One bench as it is known now; ``owner`` is None when nobody has it, or its owner is dead."""

    name: str
    virtual: bool
    state: BenchState
    campaign_id: int | None
    owner: Owner | None
    unsafe: str | None
    unsafe_since: str | None
    said: str | None
    seen_off: str | None
    config: Mapping[str, Any] | None


class Benches:
    """Owners and safety states of the benches in one database."""

    def __init__(self, database: Database) -> None:
        self._db = database

    def all(self) -> list[BenchRow]:
        """Every bench that a campaign ever ran on."""
        heard = select(live.c.written).where(live.c.campaign_id == benches.c.campaign_id).scalar_subquery()
        with self._db.reading() as db:
            rows = db.execute(select(benches, heard.label("heard_of")).order_by(benches.c.name)).mappings()
            return [_seen(dict(row)) for row in rows]

    def find(self, name: str) -> BenchRow | None:
        """One bench."""
        return next((row for row in self.all() if row.name == name), None)

    def take(self, name: str, *, virtual: bool, campaign_id: int, owner: Owner) -> BenchRow | None:
        """Make the bench this campaign's own; returns how it was before, None for a new one.

        BenchUnsafe while UNSAFE is latched, BenchTaken while a living process has it.
        """
        known = self.find(name)
        _refuse(known, Claim(campaign_id=campaign_id, owner=owner))
        mine = {"campaign_id": campaign_id, **owner.columns()}
        with self._db.durable() as db:
            if known is None:
                fresh = {"name": name, "virtual": virtual, "energised": False, **mine}
                try:
                    db.execute(insert(benches).values(**fresh))
                except IntegrityError as error:
                    raise BenchTaken(f"another campaign has just taken the bench {name!r}") from error
                return None
            same = benches.c.campaign_id.is_not_distinct_from(known.campaign_id)
            done = db.execute(
                update(benches)
                .where(benches.c.name == name, benches.c.unsafe.is_(None), same)
                .values(virtual=virtual, **mine)
            )
            if done.rowcount != 1:
                raise BenchTaken(f"another campaign has just taken the bench {name!r}")
        return known

    def refuse(self, name: str, campaign_id: int | None = None) -> None:
        """Raise BenchUnsafe while UNSAFE is latched, BenchTaken while a living process has the bench.

        A campaign of this process that has the bench already is not refused its own.
        """
        mine = None if campaign_id is None else Claim(campaign_id=campaign_id, owner=Owner.here())
        _refuse(self.find(name), mine)

    def energise(self, name: str, config: Mapping[str, object]) -> None:
        """From now on the bench counts as switched on, whatever happens to this process."""
        with self._db.durable() as db:
            values = {"energised": True, "config": dict(config)}
            db.execute(update(benches).where(benches.c.name == name).values(**values))

    def seen_off(self, name: str, said: str) -> None:
        """The bench was read back as off."""
        with self._db.durable() as db:
            values = {"energised": False, "said": said, "seen_off": utc()}
            db.execute(update(benches).where(benches.c.name == name).values(**values))

    def latch(self, name: str, why: str) -> None:
        """The bench could not be seen off: UNSAFE until an operator clears it."""
        with self._db.durable() as db:
            values = {"unsafe": why, "unsafe_since": utc(), "said": why}
            db.execute(update(benches).where(benches.c.name == name).values(**values))

    def release(self, name: str, campaign_id: int) -> None:
        """Give the bench back, if this campaign still has it."""
        nobody = {"campaign_id": None, "host": None, "process": None, "began": None}
        mine = (benches.c.name == name, benches.c.campaign_id == campaign_id, benches.c.energised.is_(False))
        with self._db.durable() as db:
            db.execute(update(benches).where(*mine).values(**nobody))

    def clear(self, name: str, said: str) -> None:
        """An operator has seen the bench off and says so; StateError when there is nothing to clear."""
        known = self.find(name)
        if known is None or known.state not in (BenchState.UNSAFE, BenchState.UNCONFIRMED):
            state = "is not known here" if known is None else f"is {known.state}"
            raise StateError(f"there is nothing to clear: the bench {name!r} {state}")
        nobody = {"campaign_id": None, "host": None, "process": None, "began": None}
        values = {"energised": False, "unsafe": None, "unsafe_since": None, "said": said, "seen_off": utc()}
        with self._db.durable() as db:
            db.execute(update(benches).where(benches.c.name == name).values(**values, **nobody))


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """Who wants a bench."""

    campaign_id: int
    owner: Owner


def _refuse(known: BenchRow | None, claim: Claim | None) -> None:
    if known is None:
        return
    if known.state is BenchState.UNSAFE:
        raise BenchUnsafe(
            f"the bench {known.name!r} is UNSAFE since {known.unsafe_since}; once it is seen off: d2ea clear\n"
            f"{known.unsafe}"
        )
    if known.owner is None or (
        claim and (claim.campaign_id, claim.owner) == (known.campaign_id, known.owner)
    ):
        return
    raise BenchTaken(
        f"campaign {known.campaign_id} ({known.owner}) has the bench {known.name!r}; wait for it, or "
        f"d2ea abort {known.campaign_id}"
    )


def _seen(row: dict[str, Any]) -> BenchRow:
    owner = Owner.stored(row)
    alive = owner is not None and owner.lives(row["heard_of"])
    if row["unsafe"] is not None:
        state = BenchState.UNSAFE
    elif row["energised"]:
        state = BenchState.ON if alive else BenchState.UNCONFIRMED
    else:
        state = BenchState.OFF if row["seen_off"] else BenchState.UNKNOWN
    told = ("name", "virtual", "campaign_id", "unsafe", "unsafe_since", "said", "seen_off", "config")
    return BenchRow(state=state, owner=owner if alive else None, **{key: row[key] for key in told})
