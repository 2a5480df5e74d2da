"""Temperatures in degrees Fahrenheit or kelvin: what they are in degC, and the signs by which such a column is told.

Other units of a table are factors; these begin elsewhere as well. Without a model only the unlikely can be told: a part
that no winding outlasts is in kelvin, a room in which nobody stays may be in degrees Fahrenheit.
"""

import re
from typing import TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

PREFIX, ROOM = "T_", "T_ambient_C"  # of all temperatures of the measurement table, and which is the room's
HOTTEST_C = 200.0  # of parts that last: above, and in a cold room in kelvin anyway
WARM_ROOM_C = 45.0  # above it, a room may be one of 7 to 85 degC told in degrees Fahrenheit
UNITS = {"degC": (1.0, 0.0), "degF": (1 / 1.8, -32 / 1.8), "K": (1.0, -273.15)}  # times the reading, plus
_SPELLED = {"°F": "degF", "degF": "degF", "F": "degF", "K": "K", "Kelvin": "K", "kelvin": "K"}
_AT_THE_END = re.compile(rf"(?P<name>.*\S) in (?P<unit>{'|'.join(UNITS)})")

Values = TypeVar("Values", float, NDArray[np.float64], pd.Series)


def in_degC(reading: Values, unit: str) -> Values:
    """A temperature in degC from one in ``unit``, of :data:`UNITS`.

    >>> round(in_degC(95.0, "degF"), 9), round(in_degC(298.15, "K"), 9)
    (35.0, 25.0)
    """
    times, plus = UNITS[unit]
    return reading * times + plus


def unit_of_temperature(word: str | None) -> str | None:
    """The unit that a header or a row of units means by a word, where it is not degC.

    >>> unit_of_temperature("°F"), unit_of_temperature("°C")
    ('degF', None)
    """
    return _SPELLED.get(word or "")


def without_unit(text: str) -> tuple[str, str | None]:
    """A name and the unit behind it, if there is one.

    >>> without_unit("T_hs/°F in degF"), without_unit("T_hs/°F")
    (('T_hs/°F', 'degF'), ('T_hs/°F', None))
    """
    found = _AT_THE_END.fullmatch(text)
    return (found["name"], found["unit"]) if found else (text, None)


def conversion(column: str, unit: str) -> str:
    """How a column of that name is taken in that unit.

    >>> conversion("T_heatsink_C", "K")
    'd2ea import --column "T_heatsink_C=T_heatsink_C in K" converts it'
    """
    return f"d2ea import {_option(column, unit)} converts it"


def said_of_units(frame: pd.DataFrame) -> list[str]:
    """What is to be said of temperatures (N,) that look like kelvin or degrees Fahrenheit, a sentence each.

    >>> said_of_units(pd.DataFrame({"T_inductor_C": [318.0, 320.0]}))  # doctest: +NORMALIZE_WHITESPACE
    ['T_inductor_C: median 319, above 200 degC: this looks like kelvin;
     d2ea import --column "T_inductor_C=T_inductor_C in K" converts it']
    """
    medians = {
        str(column): float(frame[column].median())
        for column in frame.columns
        if str(column).startswith(PREFIX) and frame[column].notna().any()
    }
    kelvin = [
        f"{column}: median {median:.4g}, above {HOTTEST_C:g} degC: this looks like kelvin; {conversion(column, 'K')}"
        for column, median in medians.items()
        if median > HOTTEST_C
    ]
    room = medians.get(ROOM, 0.0)
    if not WARM_ROOM_C < room <= HOTTEST_C:
        return kelvin
    alike = [column for column, median in medians.items() if room <= median <= HOTTEST_C]
    options = " ".join(_option(column, "degF") for column in alike)
    fahrenheit = (
        f"{ROOM}: median {room:.4g}, warm for a room: as degrees Fahrenheit it is {in_degC(room, 'degF'):.3g} degC; "
        f"if it is that, d2ea import {options} converts {'it' if len(alike) == 1 else 'them'}"
    )
    return [*kelvin, fahrenheit]


def _option(column: str, unit: str) -> str:
    return f'--column "{column}={column} in {unit}"'
