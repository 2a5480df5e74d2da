"""The command that reads a table under other names, as far as it can be guessed, and what is missing from it still."""

import math
from collections.abc import Mapping, Sequence

import pandas as pd

from models.other_names import OtherName, as_option, factor_of, meant, units_below
from models.screening import KNOWN_COLUMNS, NUMERIC_COLUMNS, OPTIONAL_COLUMNS

EITHER = ("P1_W", "efficiency")  # one of them is required
_PORTS = {"P1_W": ("V1_V", "I1_A"), "P2_W": ("V2_V", "I2_A")}


def guessed(missing: Sequence[str], there: Sequence[str]) -> dict[str, str]:
    """Which of the columns ``there`` is meant by those that are ``missing``, and by others that are not there."""
    foreign = [column for column in there if column not in KNOWN_COLUMNS]
    either = list(EITHER) if "P1_W" in missing else []
    wanted = [column for column in missing if column != "P1_W"]
    others = (*EITHER, "kind", *OPTIONAL_COLUMNS)
    optional = [column for column in others if column not in there and column not in either]
    near = meant(wanted, [*either, *optional], foreign)
    if either and not any(column in near for column in either):
        near |= meant(either[:1], (), [column for column in foreign if column not in near.values()])
    return near


def or_efficiency(column: str, near: Mapping[str, str]) -> str | None:
    """What is meant by a column, where efficiency will do for input power."""
    return near.get(column) or (near.get("efficiency") if column == "P1_W" else None)


def suggested(
    file: str | None,
    raw: pd.DataFrame,
    given: Sequence[OtherName],
    missing: Sequence[str],
    near: Mapping[str, str],
) -> str:
    """The command with the options that were ``given`` and those that are guessed, on a line of its own.

    What is ``missing`` still is said behind it: a command is there to be typed as it stands.
    """
    units = units_below(raw)
    options = [each.as_option() for each in given]
    options += [as_option(ours, theirs, units.get(theirs)) for ours, theirs in near.items()]
    options += in_other_units(raw, given)
    command = " ".join(["d2ea import", *([f'"{file}"'] if file else []), *options])
    foreign = any(column not in KNOWN_COLUMNS for column in raw.columns)
    lines = [f"; other names and units are taken by\n{command}" if options and foreign else ""]
    named = {column: column for column in raw.columns if column in KNOWN_COLUMNS}
    named |= {**near, **{each.ours: each.theirs for each in given}}
    for column in missing:
        how = _product(column, named, units) or (_placeholder(column) if foreign else "")
        if how and not or_efficiency(column, near):
            called = " or ".join(EITHER) if column == "P1_W" else column
            lines.append(f"still missing: {called}. {how}")
    return "\n".join(lines)


def in_other_units(raw: pd.DataFrame, given: Sequence[OtherName]) -> list[str]:
    """Options for columns under our own names whose units, in a row below the header, are others."""
    taken = {each.ours for each in given}
    return [
        as_option(column, column, unit)
        for column, unit in units_below(raw).items()
        if column in NUMERIC_COLUMNS
        and column not in taken
        and as_option(column, column, unit) != as_option(column, column)
    ]


def _placeholder(column: str) -> str:
    return (
        f'Add --column "{column}=THEIRS*FACTOR", with what this table calls it, and what makes its unit ours if that '
        "is another"
    )


def _product(power: str, named: Mapping[str, str], units: Mapping[str, str]) -> str:
    """How a port's power is had from its voltage and current; empty unless both are there.

    >>> _product("P1_W", {"V1_V": "Vin [V]", "I1_A": "Iin [mA]"}, {})
    "Add a column P1_W to the table: 'Vin [V]' times 'Iin [mA]' times 0.001, a dc port's power in W"
    """
    if power not in _PORTS or not set(_PORTS[power]) <= set(named):
        return ""
    theirs = [named[column] for column in _PORTS[power]]
    factor = math.prod(
        factor_of(ours, name, units.get(name)) for ours, name in zip(_PORTS[power], theirs, strict=True)
    )
    times = [*map(repr, theirs), *([f"{factor:g}"] if factor != 1.0 else [])]
    return f"Add a column {power} to the table: {' times '.join(times)}, a dc port's power in W"
