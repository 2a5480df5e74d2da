"""When the rows of a measurement table were taken: seconds since the earliest, from whatever its column ``time_s`` has.

Seconds, seconds of a clock, dates and times of day are taken; what cannot be any of these is left empty, with a
sentence that says so. A time that is not known is better than a wrong one, and single gaps are filled from the rows
around.
"""

import numpy as np
import pandas as pd

from models.clock_text import read_times
from models.number_forms import as_number

LONGEST_S = 1e8  # three years: a campaign that begins later counts its time from elsewhere
MOST_APART_S = 86_400.0  # between rows of a campaign: more are milliseconds
LEAST_APART_S = 0.1  # of settled readings that last: less are minutes, hours or a spreadsheet's days
TIMES_OF_DAY = ("2026-11-20T22:14:05", "20.11.2026 22:14:05", "11/20/2026 10:14:05 PM", "22:14:05")
_MOST_UNREAD = 0.2  # of what stands in the column: the rest would be filled from rows too far off
_MOST_FALLS = 0.2  # of the steps from row to row: more are rows in any order
_LISTED = 5  # rows at which it falls


def counted_from_the_start(raw: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """The table with times of day, or seconds of a clock, as seconds since its earliest row; what is to be said of it.

    A cell that is not read stays as it is, unless more than a fifth are none: then the column is empty.
    """
    column = raw["time_s"]
    given, doubt = _seconds(column)
    is_text = doubt is not None
    wrong = doubt or _unread(column, given) or _stands_still(column, given) or _no_seconds(given, is_text)
    if wrong:
        return raw.assign(time_s=np.nan), [f"time_s: {wrong}"]
    falls = _falls(given)
    if not is_text and not (given.min() < 0 or given.min() > LONGEST_S):
        return raw, falls
    what = "times of day" if is_text else "the seconds of a clock"
    first = column[given.notna()].iloc[0]
    said = f"time_s: {what} (the first row's is {first}), taken as seconds since the earliest"
    return raw.assign(time_s=(given - given.min()).where(given.notna(), column)), [said, *falls]


def _seconds(column: pd.Series) -> tuple[pd.Series, str | None]:
    """The column (N,) as numbers; where it is rather text as times, and a doubt of those, which may be empty."""
    number = as_number(column)
    if pd.api.types.infer_dtype(column) in ("datetime64", "datetime"):
        number = number.mask(number.notna())  # nanoseconds of a calendar
    text = column[number.isna()].dropna()
    if len(text) <= number.notna().sum():
        return number, None
    read = read_times(text)
    if not read.doubt and np.isfinite(read.seconds).sum() < number.notna().sum():
        return number, None
    doubt = f"{read.doubt}, so it is left empty; write the dates like {TIMES_OF_DAY[0]}" if read.doubt else ""
    return pd.Series(read.seconds, index=text.index).reindex(column.index), doubt


def _unread(column: pd.Series, given: pd.Series) -> str:
    """Why times of which too many are not read cannot be taken; empty where they can."""
    unread = np.flatnonzero(given.isna() & column.notna())
    there = int(column.notna().sum())
    most = max(1.0, _MOST_UNREAD * there)  # one may be a row of units
    if not unread.size or (unread.size <= most and unread.size < there):
        return ""
    return (
        f"{unread.size} of {there} values are no times (row {unread[0] + 1}: {column.iloc[unread[0]]}), more than a "
        f"fifth, so it is left empty; allowed are seconds, or times of day like {', '.join(TIMES_OF_DAY)}"
    )


def _stands_still(column: pd.Series, given: pd.Series) -> str:
    moments = given.dropna().unique()
    if moments.size != 1 or len(given) == 1:
        return ""
    there = column[given.notna()].iloc[0]
    one = f"{there:g}" if isinstance(there, float) else there
    return f"reads {one} in all rows: time does not go on, so it is left empty"


def _no_seconds(given: pd.Series, is_text: bool) -> str:
    """Why numbers (N,) cannot be seconds; empty where they may be: rows of a campaign follow within a day."""
    moments = np.unique(given.dropna())
    if is_text or moments.size < 2:
        return ""
    apart_s = float(np.median(np.diff(moments)))
    if LEAST_APART_S <= apart_s < MOST_APART_S:
        return ""
    apart = f"rows are {float(f'{apart_s:.3g}'):g} s apart (median)"
    if apart_s < LEAST_APART_S:
        return (
            f"{apart}, less than any reading takes to settle, so it is left empty; if these are hours, "
            "d2ea import --column time_s=time_s*3600 converts it; if a spreadsheet's days, *86400 does"
        )
    return (
        f"{apart}, more than a day, so it is left empty; if these are milliseconds, "
        "d2ea import --column time_s=time_s*0.001 converts it"
    )


def _falls(given: pd.Series) -> list[str]:
    """That time falls from a row to the next, where it does so now and then: an order that rows were taken in has none.

    >>> _falls(pd.Series([0.0, 30.0, 60.0, 90.0, 0.0, 30.0, 60.0, 90.0]))
    ['time_s falls at row 5 by 90 s: rows not in order, a clock that was set back, or several sweeps?']
    """
    known = np.flatnonzero(given.notna())
    step_s = np.diff(given.to_numpy()[known])
    falls = np.flatnonzero(step_s < 0)
    if not 0 < falls.size <= _MOST_FALLS * step_s.size:
        return []
    first, *others = (int(row) + 1 for row in known[falls + 1])
    listed = ", ".join(map(str, others[:_LISTED])) + ", …" * (len(others) > _LISTED)
    also = f" (and at row {listed})" if others else ""
    return [
        f"time_s falls at row {first} by {-step_s[falls[0]]:.4g} s{also}: rows not in order, a clock that was set "
        "back, or several sweeps?"
    ]
