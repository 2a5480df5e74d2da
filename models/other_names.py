"""Columns that a table has under other names, or in other units, than the measurement table's."""

import difflib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from models.screening import KNOWN_COLUMNS, NUMERIC_COLUMNS

_UNIT = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]\s*$")  # at the end of a header, in brackets
_OUR_UNITS = ("_W", "_V", "_A", "_C", "_s")
_IN_OURS = {"kW": 1e3, "mW": 1e-3, "kV": 1e3, "mV": 1e-3, "mA": 1e-3, "%": 1e-2, "percent": 1e-2, "ms": 1e-3,
            "min": 60.0, "h": 3600.0}  # fmt: skip


class OtherNameError(ValueError):
    """A name that cannot be taken: says which, and what is allowed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherName:
    """A column of the measurement table is ``factor`` times the one that the table calls ``theirs``."""

    ours: str
    theirs: str
    factor: float = 1.0

    @classmethod
    def parse(cls, text: str) -> "OtherName":
        """From ``OURS=THEIRS`` or ``OURS=THEIRS*FACTOR``.

        Raises
        ------
        OtherNameError
            Not of that form, a column that the measurement table does not have, or a factor that is none.
        """
        ours, equals, rest = (part.strip() for part in text.partition("="))
        theirs, times, factor = (part.strip() for part in rest.rpartition("*"))
        if not times:
            theirs, factor = rest, "1"
        if not (ours and equals and theirs):
            raise OtherNameError(f"{text!r}: allowed is OURS=THEIRS or OURS=THEIRS*FACTOR")
        if ours not in KNOWN_COLUMNS:
            raise OtherNameError(
                f"{text!r}: {ours!r} is no column of the measurement table; they are: {', '.join(KNOWN_COLUMNS)}"
            )
        return cls(ours=ours, theirs=theirs, factor=_factor(text, factor, ours))


def _factor(text: str, factor: str, ours: str) -> float:
    try:
        value = float(factor)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value == 0:
        raise OtherNameError(f"{text!r}: factor is {factor!r}; allowed is a number other than 0")
    if value != 1.0 and ours not in NUMERIC_COLUMNS:
        raise OtherNameError(f"{text!r}: {ours} is no number, so it has no factor")
    return value


def renamed(raw: pd.DataFrame, names: Sequence[OtherName]) -> pd.DataFrame:
    """The table with those columns under their own names and in their units; what is no number stays as it is.

    Raises
    ------
    OtherNameError
        The table has no such column, or has the one that it would become.
    """
    frame = raw.copy()
    for name in names:
        there = ", ".join(str(column) for column in raw.columns)
        if name.theirs not in raw.columns:
            raise OtherNameError(f"there is no column {name.theirs!r}; there are: {there}")
        if name.ours in raw.columns and name.ours != name.theirs:
            raise OtherNameError(f"column {name.ours!r} is there already, beside {name.theirs!r}")
        values = raw[name.theirs]
        if name.factor != 1.0:
            number = pd.to_numeric(values, errors="coerce")
            values = (number * name.factor).astype(object).where(number.notna(), values)
        frame = frame.drop(columns=name.theirs).assign(**{name.ours: values})
    return frame


def nearest(ours: str, there: Sequence[str], *, surely: bool = False) -> str | None:
    """The column that is meant by one of the measurement table: the same but for unit and case, else the most alike.

    >>> nearest("P2_W", ["D2 [-]", "P2 (kW)"]), nearest("P2_W", ["P_2"]), nearest("P2_W", ["P_2"], surely=True)
    ('P2 (kW)', 'P_2', None)
    """
    names = {_bare(column): column for column in reversed(there)}
    quantity = next((ours.removesuffix(unit) for unit in _OUR_UNITS if ours.endswith(unit)), ours)
    for same in (ours.lower(), quantity.lower()):
        if same in names:
            return names[same]
    near = [] if surely else difflib.get_close_matches(ours.lower(), list(names), n=1, cutoff=0.5)
    return names[near[0]] if near else None


def as_option(ours: str, theirs: str) -> str:
    """What to give d2ea import for a column; with the factor where the header's unit is another one.

    >>> as_option("P2_W", "P2 (kW)")
    '--column "P2_W=P2 (kW)*1000"'
    """
    unit = _UNIT.search(theirs)
    factor = _IN_OURS.get(unit[1]) if unit else None
    times = f"*{factor or 1:g}" if factor or "*" in theirs else ""
    return f'--column "{ours}={theirs}{times}"'


def _bare(column: str) -> str:
    return _UNIT.sub("", column).strip().lower().replace(" ", "_")
