"""Numbers as text, in whichever form a table has them: decimal points or commas, thousands together or apart.

Most cells tell their own form: ``0,8064`` has a decimal comma, ``814.2275`` a decimal point, ``1,406.8`` and
``1.406,8`` have both signs, the last being the decimal one. A cell such as ``1,039`` may be either. It is read as the
others of its column are, or the table's where these do not tell. With the other sign than those it has its thousands
apart, if it goes on from the largest number without any, as 1.039 does from 998. What even so may be either is refused.
An analyzer's codes for no data, ``9.91E+37``, have a form of their own and tell nothing.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

NO_DATA = 9.0e37  # an analyzer's binary codes for no data (9.91E+37) and overrange (9.9E+37) are finite
_MINUS = "\N{MINUS SIGN}"  # what word processors and some locales write before a number
_POINT, _COMMA = ".", ","
_OTHER = {_POINT: _COMMA, _COMMA: _POINT}
_NAMES = {_POINT: "a decimal point", _COMMA: "a decimal comma"}
_IN_SPACES = re.compile(r"[+-]?[1-9]\d{0,2}([\s'\u2019]\d{3})+([.,]\d*)?")  # 1 406,8 or 1'406.8
_BOTH = {
    _COMMA: re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+,\d*"),  # 1.406,8
    _POINT: re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+\.\d*"),  # 1,406.8
}
_DECIMAL = {  # not a date, 20.11.2026
    _COMMA: re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?"),
    _POINT: re.compile(r"[+-]?(\d+\.\d*|\.\d+)([eE][+-]?\d+)?"),
}
_GROUPED = {  # by that sign
    _COMMA: re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+"),
    _POINT: re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+"),
}
_NOT_PYTHONS = re.compile(r"[,\s'\u2019\N{MINUS SIGN}]|\.\d*\.")
_WHOLE = re.compile(r"[+-]?\d+([eE][+-]?\d+)?")
_A_THOUSAND = 1000.0


class AmbiguousNumberError(ValueError):
    """A number that may be two, a thousand apart: names its cell, both readings and the cell that tells otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cell:
    column: str
    line: int
    value: str

    def __str__(self) -> str:
        return f"line {self.line}, {self.column} = {self.value}"


@dataclass(slots=True, kw_only=True)
class _Votes:
    """What the cells of one column tell: by decimal sign those that are sure, by the sign in them those that may be
    either, how large the numbers are that have no thousands apart, and by which sign others surely have them."""

    sure: dict[str, list[_Cell]] = field(default_factory=lambda: {_POINT: [], _COMMA: []})
    either: dict[str, list[_Cell]] = field(default_factory=lambda: {_POINT: [], _COMMA: []})
    sizes: list[float] = field(default_factory=list)
    groups: set[str] = field(default_factory=set)

    @property
    def majority(self) -> str | None:
        """The decimal sign of most cells that are sure; None where there are as many of both."""
        points, commas = (len(self.sure[sign]) for sign in (_POINT, _COMMA))
        return None if points == commas else _POINT if points > commas else _COMMA


def in_one_form(columns: Mapping[str, pd.Series], lines: Sequence[int]) -> dict[str, list[str | None]]:
    """Columns of text (N,), which stand on ``lines`` (N,), with every number as Python has it; the rest as it is.

    Raises
    ------
    AmbiguousNumberError
        A number may be two, and nothing in its column or in the table tells which.

    >>> numbers = {"D1": ["0,8", "0,75"], "P2_W": ["998", "1.039"]}
    >>> in_one_form({name: pd.Series(cells) for name, cells in numbers.items()}, [2, 3])
    {'D1': ['0.8', '0.75'], 'P2_W': ['998', '1039']}
    """
    if _are_pythons(columns):
        return {name: list(cells) for name, cells in columns.items()}
    plain = {name: [_plain(cell) for cell in cells] for name, cells in columns.items()}
    votes = {name: _votes(name, cells, lines) for name, cells in plain.items()}
    table = _of_the_table(list(votes.values()))
    signs = {name: _decimal_sign(each, table) for name, each in votes.items()}
    return {
        name: [cell if cell is None else _read(cell, signs[name]) for cell in cells]
        for name, cells in plain.items()
    }


def _are_pythons(columns: Mapping[str, pd.Series]) -> bool:
    """Whether all numbers of a table are as Python has them, which many tables tell at a glance."""
    cells = [cell for column in columns.values() for cell in column if isinstance(cell, str)]
    return not _NOT_PYTHONS.search("|".join(cells)) and any(_sure_sign(cell) == _POINT for cell in cells)


def _plain(cell: object) -> str | None:
    """A cell without thousands that stand apart by what is no decimal sign, and with the minus sign of computers."""
    if not isinstance(cell, str):
        return None
    cell = cell.replace(_MINUS, "-")
    return re.sub(r"[\s'\u2019]", "", cell) if _IN_SPACES.fullmatch(cell) else cell


def _number(cell: str) -> str:
    """A number without the sign of per cent behind it."""
    return cell.removesuffix("%").rstrip()


def _sure_sign(number: str) -> str | None:
    """The decimal sign of a number that can be read in one way only."""
    for sign in (_COMMA, _POINT):
        others = _GROUPED[_OTHER[sign]].fullmatch(number)
        if _BOTH[sign].fullmatch(number) or (others and number.count(_OTHER[sign]) > 1):
            return sign
        if _DECIMAL[sign].fullmatch(number) and not _GROUPED[sign].fullmatch(number):
            return sign
    return None


def _votes(column: str, cells: Sequence[str | None], lines: Sequence[int]) -> _Votes:
    votes = _Votes()
    for cell, line in zip(cells, lines, strict=True):
        number = _number(cell or "")
        if _is_a_code(number):
            continue
        there = _Cell(column=column, line=line, value=cell or "")
        if sign := _sure_sign(number):
            votes.sure[sign].append(there)
            if _DECIMAL[sign].fullmatch(number):
                votes.sizes.append(_size(number, sign))
            else:
                votes.groups.add(_OTHER[sign])
        elif _WHOLE.fullmatch(number):
            votes.sizes.append(_size(number, _POINT))
        for sign in (_POINT, _COMMA):
            if _may_be_either(number, sign):
                votes.either[sign].append(there)
    return votes


def _may_be_either(number: str, sign: str) -> bool:
    return _GROUPED[sign].fullmatch(number) is not None and number.count(sign) == 1


def _size(number: str, sign: str) -> float:
    return abs(float(number.replace(sign, _POINT)))


def _is_a_code(number: str) -> bool:
    """Whether this is what an analyzer sends for no data, in whatever form."""
    try:
        return abs(float(number.replace(_COMMA, _POINT))) >= NO_DATA
    except ValueError:
        return False


def _of_the_table(votes: Sequence[_Votes]) -> _Votes:
    """What a table's columns tell together: a cell of each, of the sign that it has."""
    table = _Votes()
    for each in votes:
        if sign := each.majority:
            table.sure[sign].append(each.sure[sign][0])
    return table


def _decimal_sign(column: _Votes, table: _Votes) -> str | None:
    """The decimal sign of a column's numbers; None where none of them has any."""
    mixed = all(column.sure.values())
    sign = column.majority or _without_a_majority(column, table)
    if sign is None:
        return None
    apart = column.either[_OTHER[sign]]
    if apart and (mixed or not _go_on(apart, column, sign)):
        raise AmbiguousNumberError(_said(apart[0], _beside(apart[0], column, table)))
    return sign


def _without_a_majority(column: _Votes, table: _Votes) -> str | None:
    """The decimal sign of a column in which as many cells, or none, are sure of either; None where it has none."""
    signs = [sign for sign in (_POINT, _COMMA) if column.either[sign]]
    if any(column.sure.values()) or len(signs) == len(_OTHER):
        return table.majority or _COMMA  # a point that is sure is read beside it
    if not signs:
        return None
    (own,) = signs
    is_alone = not any(column.sizes)
    if own == table.majority or (is_alone and own == _POINT and table.majority is None):
        return own
    return _OTHER[own] if is_alone or _go_on(column.either[own], column, _OTHER[own]) else own


def _go_on(apart: Sequence[_Cell], column: _Votes, sign: str) -> bool:
    """Whether numbers have their thousands apart, as others of the column do, or to be no farther from those."""
    if _OTHER[sign] in column.groups:
        return True
    others = [*column.sizes, *(_size(_number(cell.value), sign) for cell in column.either[sign])]
    largest = max(others, default=0.0)
    if not 0.0 < largest < _A_THOUSAND:  # such a one would have its thousands apart as well
        return False
    decimals = [_size(_number(cell.value), _OTHER[sign]) for cell in apart]
    together = min(max(value / largest, largest / value) for value in decimals)
    return min(decimals) * _A_THOUSAND / largest < together


def _beside(cell: _Cell, column: _Votes, table: _Votes) -> _Cell | None:
    """A cell that has the other sign than this one."""
    other = _POINT if _COMMA in cell.value else _COMMA
    return next(iter((*column.sure[other], *column.either[other], *table.sure[other])), None)


def _said(cell: _Cell, beside: _Cell | None) -> str:
    own = _COMMA if _COMMA in cell.value else _POINT
    with_decimals, apart = _read(_number(cell.value), own), _read(_number(cell.value), _OTHER[own])
    other = f", and {beside} has {_NAMES[_OTHER[own]]}" if beside else ""
    return (
        f"{cell}: this may be {with_decimals}, or {apart} with its thousands apart{other}. Write the numbers of that "
        "column without a sign between thousands, and all with the same decimal sign"
    )


def _read(cell: str, sign: str | None) -> str:
    """A cell as Python has its number, where the decimal sign is that one; what is no such number stays as it is.

    >>> _read("1.406,82", ","), _read("1,406", "."), _read("97,5 %", ","), _read("29.03.2026", ",")
    ('1406.82', '1406', '97.5 %', '29.03.2026')
    """
    number = _number(cell)
    if _is_a_code(number):
        return cell.replace(_COMMA, _POINT)
    if sign is None:
        return cell
    other = _OTHER[sign]
    if _BOTH[sign].fullmatch(number) or _GROUPED[other].fullmatch(number):
        cell, number = cell.replace(other, ""), number.replace(other, "")
    return cell.replace(sign, _POINT) if sign == _COMMA and _DECIMAL[sign].fullmatch(number) else cell


def as_number(given: pd.Series) -> pd.Series:
    """A column as float64, NaN where there is no number; a sign of per cent behind a number is none of its own."""
    if given.dtype == object or pd.api.types.is_string_dtype(given):
        given = given.astype(object).where(given.notna(), None)
        given = given.map(lambda said: said.strip().removesuffix("%") if isinstance(said, str) else said)
    return pd.to_numeric(given, errors="coerce").astype(np.float64)
