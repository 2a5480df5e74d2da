"""Times as loggers, spreadsheets and people of several countries write them: with a date or without, in seconds.

A date has its year first, or its month as a word; or it is three numbers, of which the day comes first where points are
between them. Between strokes or hyphens a number above 12 in any row tells which is the day; where none does, both
readings are tried, and where they differ nothing is read but the doubt is said. A clock without a date goes on over
midnight, one of minutes and seconds over the hour; what goes beyond that was counted from a start.
"""

import datetime
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Seconds = NDArray[np.float64]

_DAY_S, _HOUR_S = 86_400.0, 3600.0
_HALF = 0.5  # of a day or an hour: rows out of order lie closer, what begins anew lies farther
_HOURS_OF_HALF_A_DAY = _MONTHS_OF_A_YEAR = 12
_CENTURY, _A_CENTURY = 2000, 100
_TIME = re.compile(
    r"(?:(?P<date>\S.*?)(?:\s*[T,]\s*|\s+))?(?P<hours>\d{1,5}):(?P<minutes>[0-5]\d)(?::(?P<seconds>[0-5]\d(?:[.,]\d+)?))?"
    r"\s*(?P<half>[AaPp])?(?(half)\.?[Mm]\.?)\s*(?P<zone>[A-Z]{1,4}|[+-]\d{2}:?(?:\d{2})?)?"
)
_MINUTES = re.compile(r"(?P<minutes>\d{1,5}):(?P<seconds>[0-5]\d[.,]\d+)")
_YEAR_FIRST = re.compile(r"(?P<year>\d{4})(?P<between>[-/.])(?P<month>\d{1,2})(?P=between)(?P<day>\d{1,2})")
_IN_NUMBERS = re.compile(
    r"(?P<day>\d{1,2})(?P<between>[./-])(?P<month>\d{1,2})(?P=between)(?P<year>\d{4}|\d{2})"
)
_POINT, _HYPHEN = ".", "-"
_IN_WORDS = (
    re.compile(r"(?P<day>\d{1,2})[-./ ]*(?P<month>[^\W\d]{3,})[-./ ]*(?P<year>\d{4}|\d{2})"),
    re.compile(r"(?P<month>[^\W\d]{3,})\.? +(?P<day>\d{1,2}),? +(?P<year>\d{4})"),
)
_MONTHS = (  # how they begin, in small letters: English, German, French
    ("jan",), ("feb", "fév", "fev"), ("mar", "mär", "mrz"), ("apr", "avr"), ("may", "mai"), ("jun", "juin"),
    ("jul", "juil"), ("aug", "aoû", "aou"), ("sep",), ("oct", "okt"), ("nov",), ("dec", "dez", "déc"),
)  # fmt: skip
_EAST_H = {  # of Greenwich; only differences between rows count, so that one name for two zones does no harm
    "Z": 0, "UTC": 0, "GMT": 0, "WET": 0, "WEST": 1, "BST": 1, "CET": 1, "MEZ": 1, "CEST": 2, "MESZ": 2, "EET": 2,
    "EEST": 3, "MSK": 3, "IST": 5.5, "JST": 9, "KST": 9, "AEST": 10, "AEDT": 11, "EST": -5, "EDT": -4, "CST": -6,
    "CDT": -5, "MST": -7, "MDT": -6, "PST": -8, "PDT": -7,
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadTimes:
    """``seconds`` (N,) from whichever start, NaN where nothing was read; ``doubt`` says why nothing was that may be."""

    seconds: Seconds
    doubt: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Date:
    """Day, month and year as they are written; ``is_open`` where the first two may be the other way round."""

    day: int
    month: int
    year: int
    is_open: bool = False

    def ordinal(self, month_first: bool) -> float:
        """Its number among all days; NaN where there is no such day."""
        turned = self.is_open and month_first
        day, month = (self.month, self.day) if turned else (self.day, self.month)
        try:
            return float(datetime.date(self.year, month, day).toordinal())
        except ValueError:
            return np.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class _Moment:
    """What is written in a cell: the clock, and a date where there is one."""

    text: str
    clock_s: float
    date: _Date | None = None
    minutes_only: bool = False


Moments = Sequence[_Moment | None]


def read_times(given: pd.Series) -> ReadTimes:
    """Times (N,) from text, or from what writes itself as such.

    >>> read_times(pd.Series(["11/12/2026 11:59:58 PM", "11/13/2026 12:00:03 AM"])).seconds.tolist()
    [63930211198.0, 63930211203.0]
    """
    moments = [
        _moment(text) for text in given.astype(object).where(given.notna(), "").astype(str).str.strip()
    ]
    dated = [moment if moment and moment.date else None for moment in moments]
    bare = [moment if moment and not moment.date else None for moment in moments]
    if sum(map(bool, bare)) > sum(map(bool, dated)):
        return ReadTimes(seconds=_of_a_clock(bare))
    return _of_a_calendar(dated)


def _moment(text: str) -> _Moment | None:
    """What a cell says; None where that is no time, or might be hours and minutes or minutes and seconds."""
    if short := _MINUTES.fullmatch(text):
        clock_s = 60.0 * int(short["minutes"]) + _number(short["seconds"])
        return _Moment(text=text, clock_s=clock_s, minutes_only=True)
    found = _TIME.fullmatch(text)
    if found is None:
        date = _date(text)
        return _Moment(text=text, clock_s=0.0, date=date) if date else None
    clock_s, east_s = _clock_s(found), _east_s(found["zone"])
    if not found["date"]:
        is_clear = found["seconds"] or found["half"]
        return (
            _Moment(text=text, clock_s=clock_s - east_s)
            if is_clear and np.isfinite(clock_s - east_s)
            else None
        )
    date = _date(found["date"])
    if date is None or not 0.0 <= clock_s < _DAY_S or not np.isfinite(east_s):
        return None
    return _Moment(text=text, clock_s=clock_s - east_s, date=date)


def _number(seconds: str | None) -> float:
    return float((seconds or "0").replace(",", "."))


def _clock_s(found: re.Match[str]) -> float:
    """Seconds of a clock, of twelve hours where it says which half of the day; NaN where there is no such hour."""
    hours = int(found["hours"])
    if half := (found["half"] or "").lower():
        if not 1 <= hours <= _HOURS_OF_HALF_A_DAY:
            return np.nan
        hours = hours % _HOURS_OF_HALF_A_DAY + (_HOURS_OF_HALF_A_DAY if half == "p" else 0)
    return hours * _HOUR_S + 60.0 * int(found["minutes"]) + _number(found["seconds"])


def _east_s(zone: str | None) -> float:
    """How far a zone's clocks are ahead, by its name or as it says; 0 without one, NaN where its name is not known."""
    if zone and zone[0] in "+-":
        ahead_s = int(zone[1:3]) * _HOUR_S + 60.0 * int(zone[3:].lstrip(":") or 0)
        return -ahead_s if zone[0] == "-" else ahead_s
    return _EAST_H.get(zone, np.nan) * _HOUR_S if zone else 0.0


def _date(text: str) -> _Date | None:
    if found := _YEAR_FIRST.fullmatch(text) or _IN_NUMBERS.fullmatch(text):
        day, month, year = (int(found[part]) for part in ("day", "month", "year"))
        year_first, between = found.re is _YEAR_FIRST, found["between"]
        if len(found["year"]) == len("26") and between == _HYPHEN:  # 26-11-20 has its year first, or last
            return None
        return _Date(day=day, month=month, year=_full(year), is_open=not year_first and between != _POINT)
    for form in _IN_WORDS:
        if found := form.fullmatch(text):
            month = next(
                (k for k, names in enumerate(_MONTHS, 1) if found["month"].lower().startswith(names)), 0
            )
            return (
                _Date(day=int(found["day"]), month=month, year=_full(int(found["year"]))) if month else None
            )
    return None


def _full(year: int) -> int:
    return year + _CENTURY if year < _A_CENTURY else year


def _of_a_calendar(moments: Moments) -> ReadTimes:
    """Seconds of dated moments, in the order of day and month that one of them tells."""
    open_dates = [(each, each.date) for each in moments if each and each.date and each.date.is_open]
    day_first = [each for each, date in open_dates if date.day > _MONTHS_OF_A_YEAR]
    month_first = [each for each, date in open_dates if date.month > _MONTHS_OF_A_YEAR]
    if day_first and month_first:
        nothing = np.full(len(moments), np.nan)
        doubt = f"{day_first[0].text} has its day first, and {month_first[0].text} its month"
        return ReadTimes(seconds=nothing, doubt=doubt)
    read, turned = (_of_dates(moments, first) for first in (bool(month_first), not month_first))
    if not open_dates or day_first or month_first or _same_apart(read, turned):
        return ReadTimes(seconds=read)
    each, date = open_dates[int(np.argmax([date.day != date.month for _, date in open_dates]))]
    readings = " or ".join(
        str(datetime.date.fromordinal(int(date.ordinal(month_first)))) for month_first in (False, True)
    )
    doubt = f"{each.text} may be {readings}, and no row has a day above {_MONTHS_OF_A_YEAR} to tell"
    return ReadTimes(seconds=np.full(len(moments), np.nan), doubt=doubt)


def _of_dates(moments: Moments, month_first: bool) -> Seconds:
    return np.array(
        [
            each.date.ordinal(month_first) * _DAY_S + each.clock_s if each and each.date else np.nan
            for each in moments
        ]
    )


def _same_apart(one: Seconds, other: Seconds) -> bool:
    """Whether two readings of the same times differ by when they begin only."""
    return bool(np.ptp((one - other)[np.isfinite(one)]) < 1.0)


def _of_a_clock(moments: Moments) -> Seconds:
    """Seconds of moments without a date; of those that begin anew each day, or hour, those of the next."""
    clock_s = np.array([each.clock_s if each else np.nan for each in moments])
    whole_s = _HOUR_S if all(each.minutes_only for each in moments if each) else _DAY_S
    if np.nanmax(clock_s) >= whole_s:
        return clock_s
    back = pd.Series(clock_s).ffill().diff() < -_HALF * whole_s
    return np.asarray(clock_s + whole_s * np.cumsum(back))
