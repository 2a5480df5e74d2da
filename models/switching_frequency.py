"""The switching frequency that a table states of its rows: no channel of a diagnosis, yet one that decides all of them.

Nothing in a row of powers tells at which frequency the bench switched; at another one than the model's, the link
inductance and the dead time come out wrong instead. A column that states it is therefore compared with the model.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from models.other_names import bare, unit_in

_CALLED = (
    "fs", "f_s", "fsw", "f_sw", "f_switch", "f_switching", "switching_frequency", "switching_freq", "switch_frequency",
    "pwm_frequency", "f_pwm", "fpwm", "schaltfrequenz",
)  # fmt: skip
_VAGUELY = ("frequency", "freq", "f", "frequenz")  # of the mains or of an element's zero crossings as well
_VAGUE = 10.0  # times the model's: beyond, a vague name means another frequency
_UNITS = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6}
_NO_HERTZ = 1000.0  # no converter of these switches as slowly: a bare number below it is in kHz
_SAME = 0.01  # a frequency that differs by less is not what a diagnosis sees


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedFrequency:
    """A value that stands in a column of switching frequencies: in which row it stands first, and as what."""

    column: str
    row: int
    value: str
    frequency_Hz: float

    @property
    def sure(self) -> bool:
        """Whether the column's name means the switching frequency and nothing else."""
        return bare(self.column) in _CALLED

    def differs_from(self, model_Hz: float) -> bool:
        """Whether rows at this frequency are of another converter than one that switches at the model's."""
        ratio = self.frequency_Hz / model_Hz
        meant = self.sure or 1 / _VAGUE < ratio < _VAGUE
        return meant and abs(ratio - 1.0) > _SAME


def stated_frequencies(frame: pd.DataFrame, rows: Iterable[int]) -> tuple[StatedFrequency, ...]:
    """Every value of every column that states a switching frequency, once each; ``rows`` (N,) numbers the rows."""
    numbers = np.fromiter(rows, dtype=np.intp)
    found = []
    for column in map(str, frame.columns):
        if bare(column) not in (*_CALLED, *_VAGUELY):
            continue
        values = pd.to_numeric(frame[column].astype(str).str.replace(",", "."), errors="coerce")
        for value in values[values > 0].unique():
            factor = _UNITS.get(unit_in(column) or "", 1e3 if value < _NO_HERTZ else 1.0)
            row = int(numbers[int(np.flatnonzero(values == value)[0])])
            found.append(
                StatedFrequency(
                    column=column, row=row, value=f"{value:g}", frequency_Hz=float(value * factor)
                )
            )
    return tuple(found)
