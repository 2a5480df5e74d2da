"""Readings of a sensor that stuck on the way: one value for many rows on end, whatever the load.

A thermometer of whole kelvins, or a sweep that hardly changes, repeats itself too: a stretch counts as stuck where
it is longer than the rest of its column could make it by chance, though the rows that it covers should differ.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations
from models.diagnosis.plausibility import RejectedColumn

Array = NDArray[np.float64]

_MOVES = 5.0  # noise floors that a channel should move by over a stretch
_LEAST = 8  # readings of a stretch
_CHANCE = 1e-6  # of such a stretch where successive readings are equal as often as in the rest of the column


def held(
    observations: Observations, expected: Array, rows: Sequence[int]
) -> tuple[NDArray[np.bool_], list[RejectedColumn]]:
    """Readings (M,) of stretches that are stuck, and a reason for each column that has one.

    ``expected`` (M,) is what the baseline says, ``rows`` which row of the table each of the frame was.
    """
    stuck, found = np.zeros(observations.value.size, dtype=bool), []
    known = np.isfinite(expected)
    time_s = np.asarray(observations.points.time_s)[observations.row]
    for k, channel in enumerate(observations.channels):
        at = np.flatnonzero(known & (observations.channel == k))
        at = at[np.argsort(time_s[at], kind="stable")]
        stretch = at[_longest(observations.value[at])]
        if stretch.size == at.size or np.ptp(expected[stretch]) < _MOVES * channel.floor:
            continue
        if stretch.size < _LEAST or not _unlikely(observations.value[at], stretch.size):
            continue
        stuck[stretch] = True
        first, last = (rows[observations.row[k]] for k in (stretch[0], stretch[-1]))
        reason = (
            f"reads {observations.value[stretch[0]]:g} in {stretch.size} rows on end, from row {first} to row {last}, "
            "whatever the load: the sensor stuck; only these readings of it are left out"
        )
        found.append(RejectedColumn(column=channel.column, reason=reason))
    return stuck, found


def _longest(values: Array) -> slice:
    """The longest stretch of equal values.

    >>> _longest(np.array([1.0, 2.0, 2.0, 2.0, 1.0]))
    slice(1, 4, None)
    """
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [values.size]])
    k = int(np.argmax(np.diff(bounds)))
    return slice(int(bounds[k]), int(bounds[k + 1]))


def _unlikely(values: Array, length: int) -> bool:
    """Whether the rest repeats itself too seldom for a stretch of that length."""
    equal = int(np.count_nonzero(np.diff(values) == 0.0)) - (length - 1)
    often = (equal + 1) / (values.size - length + 2)
    return values.size * min(often, 1.0) ** (length - 1) < _CHANCE
