"""Columns that a table has under other names, or in other units, than the measurement table's."""

import difflib
import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from models.number_forms import as_number
from models.screening import KNOWN_COLUMNS, NUMERIC_COLUMNS
from models.temperature_units import PREFIX, in_degC, unit_of_temperature, without_unit

_IN_OURS = {"kW": 1e3, "mW": 1e-3, "kV": 1e3, "mV": 1e-3, "mA": 1e-3, "%": 1e-2, "percent": 1e-2, "‰": 1e-3,
            "permille": 1e-3, "ms": 1e-3, "min": 60.0, "minutes": 60.0, "h": 3600.0, "hours": 3600.0}  # fmt: skip
_IN_HALF_PERIODS = {"deg": 1 / 180, "°": 1 / 180, "degrees": 1 / 180, "Grad": 1 / 180, "rad": 1 / math.pi}
_DUTIES = ("D0", "D1", "D2")
_UNITS = {
    *_IN_OURS,
    *_IN_HALF_PERIODS,
    "W",
    "V",
    "A",
    "s",
    "Hz",
    "kHz",
    "°C",
    "degC",
    "°F",
    "degF",
    "F",
    "K",
    "1",
    "-",
}
_OUR_UNITS = ("_W", "_V", "_A", "_C", "_s")
_UNIT = re.compile(  # at the end of a header: in brackets, or after a space, a stroke or an underscore
    r"\s*[\[(]\s*(?P<bracketed>[^\])]*?)\s*[\])]\s*$|"
    r"[ _/:]+(?:in )?(?P<bare>[km]?[WV]|m?A|ms|[kM]?Hz|s|%|percent|°[CF]|deg[CF]|K|F)\s*$|"
    # behind a word for time only: P_min is a least power
    r"(?:(?<=[Tt]ime)|(?<=[Ee]lapsed)|(?<=[Zz]eit)|(?<=[Tt]emps))[ _/:]+(?:in )?(?P<of_time>min|minutes|h|hours)\s*$"
)
_EXCHANGED = re.compile(r"\b(?P<ours>[PVI][12]_[WVA])=(?P<other>(?!(?P=ours))[PVI][12]_[WVA])(?!\*)")
# what other people's tables call it, without the unit and in lower case
_ALSO_CALLED = {
    "D1": ("duty", "duty_1", "duty_ratio", "duty_cycle", "tastgrad", "rapport_cyclique"),
    "D2": ("inner_phase_shift", "innere_phase", "phasenversatz", "déphasage"),
    "P1_W": (
        "pin", "p_in", "input_power", "power_in", "eingangsleistung", "p_ein", "pein", "puissance_d'entrée",
        "puissance_entrée", "puissance_absorbée",
    ),
    "P2_W": (
        "pout", "p_out", "output_power", "power_out", "ausgangsleistung", "p_aus", "paus", "load", "load_power",
        "puissance_de_sortie", "puissance_sortie", "puissance_utile",
    ),
    # analyzers number theirs
    "efficiency": ("eta", "η", "eff", "wirkungsgrad", "eta1", "eta_1", "η1", "eff1", "rendement"),
    "point": ("sample",),
    # a date alone is the last choice
    "time_s": (
        "timestamp", "datetime", "date_time", "date/time", "elapsed_time", "elapsed", "zeit", "zeitstempel", "uhrzeit",
        "horodatage", "temps", "heure", "t", "datum", "date",
    ),
    "V1_V": (
        "u1", "vin", "v_in", "uin", "u_in", "input_voltage", "eingangsspannung", "u_ein", "uein", "tension_d'entrée",
    ),
    "V2_V": (
        "u2", "vout", "v_out", "uout", "u_out", "output_voltage", "ausgangsspannung", "u_aus", "uaus",
        "tension_de_sortie",
    ),
    "I1_A": ("iin", "i_in", "input_current", "eingangsstrom", "i_ein", "iein", "courant_d'entrée"),
    "I2_A": ("iout", "i_out", "output_current", "ausgangsstrom", "i_aus", "iaus", "courant_de_sortie"),
    "I_L_rms_A": ("irms", "i_rms", "il_rms", "ilrms", "irms_l", "rms_current", "irms_drossel", "drosselstrom"),
    "T_heatsink_C": (
        "heatsink", "heatsink_temperature", "theatsink", "t_hs", "temp_hs", "temphs", "theat", "t_heat", "heat_sink",
        "kühlkörper", "kühlkörpertemperatur", "t_kühlkörper", "température_radiateur", "température_du_radiateur",
        "radiateur",
    ),
    "kind": ("row_kind", "art", "zeilenart"),
    "T_ambient_C": (
        "ambient", "ambient_temperature", "t_amb", "tamb", "temp_amb", "t_umgebung", "umgebung", "umgebungstemperatur",
        "température_ambiante",
    ),
}  # fmt: skip


class OtherNameError(ValueError):
    """A name that cannot be taken: says which, and what is allowed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherName:
    """A column of the measurement table is ``factor`` times the one that the table calls ``theirs``; of a temperature
    the one in ``unit``."""

    ours: str
    theirs: str
    factor: float = 1.0
    unit: str | None = None

    @classmethod
    def parse(cls, text: str) -> "OtherName":
        """From ``OURS=THEIRS``, ``OURS=THEIRS*FACTOR`` or, of a temperature, ``OURS=THEIRS in UNIT``.

        Raises
        ------
        OtherNameError
            Not of that form, a column that the measurement table does not have, or a factor that is none.
        """
        ours, equals, rest = (part.strip() for part in text.partition("="))
        named, unit = without_unit(rest) if ours.startswith(PREFIX) else (rest, None)
        theirs, times, factor = (part.strip() for part in named.rpartition("*"))
        if unit or not times:
            theirs, factor = named, "1"
        if not (ours and equals and theirs):
            raise OtherNameError(
                f"{text!r}: allowed is OURS=THEIRS, OURS=THEIRS*FACTOR, or of a temperature OURS=THEIRS in degF or in K"
            )
        if ours not in KNOWN_COLUMNS:
            raise OtherNameError(
                f"{text!r}: {ours!r} is no column of the measurement table; they are: {', '.join(KNOWN_COLUMNS)}"
            )
        return cls(ours=ours, theirs=theirs, factor=_factor(text, factor, ours), unit=unit)

    def as_option(self) -> str:
        """As it was given to d2ea import.

        >>> OtherName.parse("P1_W=Pin (kW)*1000").as_option()
        '--column "P1_W=Pin (kW)*1000"'
        """
        return f'--column "{self.ours}={self.source()}"'

    def source(self) -> str:
        """Their column with what is behind it, so that it is read as it stands here."""
        if self.ours.startswith(PREFIX) and (self.unit or without_unit(self.theirs)[1]):
            return f"{self.theirs} in {self.unit or 'degC'}"
        return f"{self.theirs}*{self.factor:g}" if self.factor != 1.0 or "*" in self.theirs else self.theirs

    def converted(self, given: pd.Series) -> pd.Series:
        """Their values in our unit; what is no number stays as it is."""
        if self.factor == 1.0 and self.unit is None:
            return given
        number = as_number(given)
        ours = in_degC(number, self.unit) if self.unit else number * self.factor
        return ours.astype(object).where(number.notna(), given)


def _factor(text: str, factor: str, ours: str) -> float:
    try:
        value = float(factor)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value == 0:
        raise OtherNameError(
            f"{text!r}: factor is {factor!r}; allowed is a number other than 0, such as 0.01"
        )
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
    frame = raw.drop(columns=[name.theirs for name in names], errors="ignore")
    for name in names:
        there = ", ".join(str(column) for column in raw.columns)
        if name.theirs not in raw.columns:
            raise OtherNameError(f"there is no column {name.theirs!r}; there are: {there}")
        if name.ours in frame.columns:
            raise OtherNameError(f"column {name.ours!r} is there already, beside {name.theirs!r}")
        frame = frame.assign(**{name.ours: name.converted(raw[name.theirs])})
    return frame


def converting(said: str, names: Sequence[OtherName]) -> str:
    """What is said of a column, with the option that converts it as it is to be typed for this table.

    >>> pin = OtherName(ours="P1_W", theirs="Pin (kW)", factor=10.0)
    >>> converting("d2ea import --column P1_W=P1_W*100 converts it", [pin])
    'd2ea import --column "P1_W=Pin (kW)*1000" converts it'
    >>> pout = OtherName(ours="P2_W", theirs="Pout")
    >>> converting("d2ea import --column P1_W=P2_W --column P2_W=P1_W exchanges them", [pin, pout])
    'd2ea import --column "P1_W=Pout" --column "P2_W=Pin (kW)*10" exchanges them'
    """
    said = _EXCHANGED.sub(lambda pair: _of_another(pair, names), said)
    for name in names:
        ours = re.escape(name.ours)
        option = re.search(rf"{ours}={ours}\*(-?[\d.]+)", said)
        if option:
            typed = f'"{name.ours}={name.theirs}*{name.factor * float(option[1]):g}"'
            said = said.replace(option[0], typed)
        said = said.replace(f"{name.ours}={name.ours} in ", f"{name.ours}={name.theirs} in ")
    return said


def _of_another(pair: re.Match[str], names: Sequence[OtherName]) -> str:
    """``OURS=OTHER``, with what this table calls that other column, in the unit that it has there."""
    name = next((name for name in names if name.ours == pair["other"]), None)
    if name is None:
        return pair[0]
    return f'"{pair["ours"]}={name.source()}"'


def meant(required: Sequence[str], optional: Sequence[str], there: Sequence[str]) -> dict[str, str]:
    """Which of a table's columns is meant by each of ours, as far as one seems to be; none is meant twice.

    A column is meant where its name is the same but for unit and case, or is one that others use; of the required ones
    also where our name is a word of it, or the two are alike.

    >>> meant(["P2_W", "P1_W"], ["D0"], ["pout_mW", "pin_mW", "D0 [-]"])
    {'P2_W': 'pout_mW', 'P1_W': 'pin_mW', 'D0': 'D0 [-]'}
    >>> meant(["D1", "P2_W"], ["D0"], ["Tastgrad D1", "P_2", "D_0"])
    {'D1': 'Tastgrad D1', 'P2_W': 'P_2'}
    """
    left = {bare(column): column for column in reversed(there)}
    found = {}
    for asked, find in (((*required, *optional), _same), (required, _a_word_of_it), (required, _alike)):
        for ours in asked:
            if ours not in found and (name := find(ours, list(left))):
                found[ours] = left.pop(name)
    return {ours: found[ours] for ours in (*required, *optional) if ours in found}


def _same(ours: str, names: Sequence[str]) -> str | None:
    called = (ours.lower(), _quantity(ours).lower(), *map(_in_plain_letters, _ALSO_CALLED.get(ours, ())))
    return next((name for name in called if name in names), None)


def _a_word_of_it(ours: str, names: Sequence[str]) -> str | None:
    return next((name for name in names if _quantity(ours).lower() in name.split("_")), None)


def _alike(ours: str, names: Sequence[str]) -> str | None:
    return next(iter(difflib.get_close_matches(ours.lower(), names, n=1, cutoff=0.5)), None)


def units_below(raw: pd.DataFrame) -> dict[str, str]:
    """Units by column, where a table's first row holds them instead of numbers; else empty.

    >>> units_below(pd.DataFrame({"No": ["", "1"], "P1": ["kW", "0.6"], "ETA1": ["%", "98.1"]}))
    {'P1': 'kW', 'ETA1': '%'}
    >>> units_below(pd.DataFrame({"P1": ["[kW]", "0.6"]}))
    {'P1': 'kW'}
    >>> units_below(pd.DataFrame({"D1": ["1"], "P1": ["kW"]}))
    {'P1': 'kW'}
    >>> units_below(pd.DataFrame({"range": ["h"], "P1": ["0.6"]}))
    {}
    """
    first = raw.iloc[0].dropna().astype(str).str.strip() if len(raw) else pd.Series(dtype=str)
    words = first[first.ne("") & first.ne("1")]  # 1 is the unit of what has none
    if pd.to_numeric(words.str.replace(",", "."), errors="coerce").notna().any():
        return {}
    units = {str(column): str(word).strip("[]() ") for column, word in words.items()}
    return {column: unit for column, unit in units.items() if unit in _UNITS}


def as_option(ours: str, theirs: str, below: str | None = None) -> str:
    """What to give d2ea import for a column; with the factor where its unit, in the header or ``below`` it, is another.

    >>> as_option("P2_W", "P2 (kW)"), as_option("P2_W", "Pout/W")
    ('--column "P2_W=P2 (kW)*1000"', '--column "P2_W=Pout/W"')
    >>> as_option("efficiency", "ETA1", "%")
    '--column "efficiency=ETA1*0.01"'
    >>> as_option("D2", "phase [deg]")
    '--column "D2=phase [deg]*0.00555556"'
    >>> as_option("T_heatsink_C", "T_hs/°F")
    '--column "T_heatsink_C=T_hs/°F in degF"'
    """
    if ours.startswith(PREFIX):
        unit = unit_of_temperature(_unit(ours, theirs, below))
        return OtherName(ours=ours, theirs=theirs, unit=unit).as_option()
    return OtherName(ours=ours, theirs=theirs, factor=factor_of(ours, theirs, below)).as_option()


def factor_of(ours: str, theirs: str, below: str | None = None) -> float:
    """What makes a column ours, by the unit in its header or ``below`` it; 1 where that is none of another.

    >>> factor_of("I1_A", "Iin [mA]")
    0.001
    """
    known = _IN_OURS | (_IN_HALF_PERIODS if ours in _DUTIES else {})
    return known.get(_unit(ours, theirs, below) or "", 1.0)


def _unit(ours: str, theirs: str, below: str | None) -> str | None:
    """The unit in a header, else the one below it; of our own names, all of which end in theirs, the one below."""
    return below if theirs == ours else unit_in(theirs) or below


def _quantity(ours: str) -> str:
    """Our name without its unit."""
    return next((ours.removesuffix(unit) for unit in _OUR_UNITS if ours.endswith(unit)), ours)


def unit_in(header: str) -> str | None:
    """The unit at the end of a header, if there is one.

    >>> unit_in("fs [kHz]"), unit_in("P_in/W"), unit_in("time min"), unit_in("P1_min")
    ('kHz', 'W', 'min', None)
    """
    unit = _UNIT.search(header)
    return (unit["bracketed"] or unit["bare"] or unit["of_time"]) if unit else None


def bare(column: str) -> str:
    """A header without its unit, in small letters without accents, in one word.

    >>> bare("Température ambiante (°C)")
    'temperature_ambiante'
    """
    return _in_plain_letters(_UNIT.sub("", column).strip().lower().replace(" ", "_"))


def _in_plain_letters(word: str) -> str:
    apart = unicodedata.normalize("NFKD", word.replace("\N{RIGHT SINGLE QUOTATION MARK}", "'"))
    return "".join(letter for letter in apart if not unicodedata.combining(letter))
