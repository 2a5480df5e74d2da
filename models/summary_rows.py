"""Rows that sum a table up, such as its average or its maximum: told by a word where the other rows have a number.

Loggers and spreadsheets write them below a table or below each of its parts. Their numbers look like a reading's, so
that only what they are called tells them apart. A column that is a number, a date or a time in nearly all rows holds
such a word in a few. A word that is known to mean a summary is enough anywhere; another one where the column numbers
the rows, or at the table's end. A column of remarks, empty or text in most rows, is asked for known words at the end
only; what an instrument writes where it has no reading is no word.
"""

import re
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Rows = NDArray[np.bool_]

_WORDS = frozenset(
    (
        "average", "averages", "avg", "avrg", "mean", "median", "max", "maximum", "min", "minimum", "std", "stdev",
        "std dev", "stddev", "standard deviation", "sd", "sigma", "sum", "total", "totals", "subtotal", "rms",
        "peak to peak", "p-p", "pk-pk", "count", "variance", "summary", "statistics", "mittelwert", "mittel", "mw",
        "durchschnitt", "maximalwert", "minimalwert", "standardabweichung", "stdabw", "stabw", "summe", "gesamt",
        "spannweite", "anzahl", "varianz", "effektivwert", "moyenne", "médiane", "écart-type", "écart type", "somme",
        "étendue", "media", "promedio", "massimo", "minimo", "máximo", "mínimo", "deviazione standard", "desviación",
        "suma", "somma", "totale", "gemiddelde", "medel", "medelvärde", "średnia", "ø", "µ", "μ", "σ", "Σ".lower(),
    )
)  # fmt: skip
_A_NUMBER = re.compile(r"[-+\N{MINUS SIGN}]?[.,]?\d")  # or a date or a time, for all that follows it
_NO_READING = re.compile(  # what instruments and spreadsheets write for that; all that begins with # or < or > as well
    r"[^\w]*|[#<>].*|[-+]*(over|ovr|o\.?l|overload|overflow|overrange|over range|ovld|under|under range|ur|inf|"
    r"infinity|nan|qnan|n/?a|none|null|nil|missing|no data|nodata|no value|error|err|fail|failed|fault|open|short|"
    r"invalid|off|on|sat|bad|unknown|true|false|ok|yes|no|fehler|ungültig|leer|erreur|vide)[-.!]*"
)
_NEARLY_ALL = 3  # numbers to a word: a sweep of twelve rows may have four words below
_COUNTS = 0.9  # of a column's numbers are whole where it numbers the rows
KNOWN, UNKNOWN = (
    "a summary, not a reading",
    "a number stands there in nearly all rows, so this is taken for a summary, not a reading; if it is one, write a "
    "number there, or nothing",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SummaryRows:
    """Which ``rows`` (N,) of a table sum it up, the ``column`` that says so, and in which words to say it."""

    column: str
    rows: Rows
    reason: str


def summary_rows(
    raw: pd.DataFrame, numeric: Collection[str], text: Collection[str]
) -> tuple[SummaryRows, ...]:
    """Rows with a word where a number is due; ``text`` are columns of words, ``numeric`` those checked as numbers.

    In a ``numeric`` column only words that are known count: what else is no number there is left empty or told.

    >>> table = pd.DataFrame({"Point": ["1", "2", "3", "4", "Average"], "P2_W": [500, 600, 700, 800, 650]})
    >>> [(each.column, each.rows.nonzero()[0].tolist()) for each in summary_rows(table, ["P2_W"], [])]
    [('Point', [4])]
    """
    found = []
    for column in raw.columns:
        if column in text or pd.api.types.is_numeric_dtype(raw[column]):
            continue
        cells = _cells(raw[column])
        known = _known(cells)
        others = np.zeros(len(raw), dtype=bool) if column in numeric else _other_words(cells) & ~known
        found += [
            SummaryRows(column=str(column), rows=rows, reason=reason)
            for rows, reason in ((known, KNOWN), (others, UNKNOWN))
            if rows.any()
        ]
    return tuple(found)


def _cells(column: pd.Series) -> pd.Series:
    """What stands there, in small letters and without what surrounds it; nothing where it is missing."""
    return column.astype(object).where(column.notna(), "").astype(str).str.strip(" \t:.()[]*").str.lower()


def _numbers(cells: pd.Series) -> Rows:
    return np.array([_A_NUMBER.match(cell) is not None for cell in cells], dtype=bool)


def _words(cells: pd.Series) -> Rows:
    """Text that is neither a number nor what stands for none."""
    return np.array(
        [not (_A_NUMBER.match(cell) or _NO_READING.fullmatch(cell)) for cell in cells], dtype=bool
    )


def _known(cells: pd.Series) -> Rows:
    """Words for a summary among numbers; among remarks, or in an else empty column, those at the end."""
    summed = np.array([cell in _WORDS for cell in cells], dtype=bool)
    if _numbers(cells).sum() > summed.sum():
        return summed
    is_label = (_words(cells) & ~summed).sum() <= summed.sum()
    return _at_the_end(summed & is_label)


def _other_words(cells: pd.Series) -> Rows:
    """Words of which nothing is known, few among numbers: anywhere where these number the rows, else at the end."""
    words, numbers = _words(cells), _numbers(cells)
    if numbers.sum() < _NEARLY_ALL * words.sum():
        return np.zeros(len(cells), dtype=bool)
    whole = cells[numbers].str.fullmatch(r"\d+(\.0)?").mean()
    return words if whole >= _COUNTS else words & _at_the_end(words)


def _at_the_end(rows: Rows) -> Rows:
    """The last of the rows, as far as there is no other below."""
    return np.flip(np.logical_and.accumulate(np.flip(rows)))
