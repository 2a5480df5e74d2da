"""Columns that cannot be what their name says: stuck sensors, other units, another convention, swapped leads.

A diagnosis believes every channel. One that is plainly something else would be explained by physics, so it is left
out here and said, with what to do about it. Judged on the rows that carry power, against the baseline's prediction.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations
from models.screening import ROOM_C
from models.temperature_units import HOTTEST_C, WARM_ROOM_C, conversion
from sim.model import Model
from sim.operating_points import Points
from sim.parameters import Converter
from sim.simulate import can_run

Array = NDArray[np.float64]

_KILO_APART = 300.0  # between the rated power and the largest measured one: more is a unit's thousand
_HELD = 1.25  # of a nominal voltage: the supply and the controller hold them
_MOST_OFF = 3.0  # of what the simulation expects: more is another unit
_COLDER_K = 3.0  # than the room: more than two sensors disagree by
_FAR_NEARER = 0.25  # of the distance to what is expected: a part is hardly ever so far off
# kelvin of rise are as many degrees Fahrenheit; half of what would be an error of that size
_FAHRENHEIT = (1.8, 0.3)
_TURNED = 0.3  # of what is expected: no effect makes that of a sign
_STUCK = 1e-9  # relative: not even the last digit moves
_MOVES = 5.0  # noise floors that a channel should move over the campaign before it is called stuck
_ENOUGH = 6  # readings to judge a column by
_OFTEN = 0.05  # of the rows: fewer are slips
_SHIFT = 0.02  # of a half period: how well D0's other zero is met
_LINK = ("P_link1_W", "P_link2_W")
_NEARLY_ALL, _ALL = 0.9, 0.98  # of the rows: measured ones are carried, but for a few near the limit
_CARRIED = 0.5  # of the rows: fewer that the model can run are another converter, or swapped columns


class ImplausibleTable(ValueError):
    """The table as a whole cannot be of this converter; says which column, and what is allowed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RejectedColumn:
    """Why a whole column was left out."""

    column: str
    reason: str

    def as_plain(self) -> dict[str, str]:
        """For the JSON answer."""
        return {"column": self.column, "reason": self.reason}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Column:
    """Readings of one channel on loaded rows, what the baseline expects there, D1, D2 and the room there, (n,)."""

    name: str
    floor: float
    measured: Array
    expected: Array
    D1: Array
    D2: Array
    ambient_C: Array


def allowed_for(column: str, converter: Converter) -> tuple[float, float]:
    """What a condition of a bench may be with this converter: terminal voltages in V, the room in degC."""
    nominal = {"V1_V": converter.V1_V, "V2_V": converter.V2_V}
    return (nominal[column] / _HELD, nominal[column] * _HELD) if column in nominal else ROOM_C


def check_inputs(observations: Observations, converter: Converter) -> None:
    """Refuse tables whose efficiency is filled in, or whose power, voltages or room cannot be of this converter.

    Raises
    ------
    ImplausibleTable
        One efficiency everywhere, powers in kilowatts, a terminal voltage far from nominal, or a room that no bench
        stands in.
    """
    loaded = observations.loaded
    _refuse_one_efficiency(observations)
    most_W, rated_W = float(np.max(np.asarray(observations.points.power_W)[loaded])), converter.rated_power_W
    if most_W < rated_W / _KILO_APART:
        raise ImplausibleTable(
            f"P2_W: {most_W:g} at most, where this converter's rated power is {rated_W:g} W: is it in kilowatts? "
            "d2ea import --column P2_W=P2_W*1000 converts it, P1_W alike. Or is the model that of another converter?"
        )
    for name, nominal in (("V1_V", converter.V1_V), ("V2_V", converter.V2_V)):
        typical = float(np.median(np.asarray(getattr(observations.points, name))[loaded]))
        low, high = allowed_for(name, converter)
        if not low < typical < high:
            raise ImplausibleTable(
                f"{name}: median {typical:g}, but this converter's is {nominal:g} V; {low:.0f} to {high:.0f} V is "
                "allowed. Is the column in another unit, or the model that of another converter?"
            )
    ambient = float(np.median(np.asarray(observations.points.ambient_C)[loaded]))
    if not ROOM_C[0] <= ambient <= ROOM_C[1]:
        raise ImplausibleTable(
            f"T_ambient_C: median {ambient:g}; {ROOM_C[0]:g} to {ROOM_C[1]:g} degC is allowed. Is it in kelvin? "
            + conversion("T_ambient_C", "K")
        )
    _refuse_a_room_that_nothing_confirms(observations, ambient)


def _refuse_a_room_that_nothing_confirms(observations: Observations, ambient_C: float) -> None:
    """A room that is warm for people, without a part's temperature beside it; or warmer than the parts in it."""
    frame = observations.frame[observations.loaded]
    if "T_ambient_C" not in frame:
        return
    parts = [c.column for c in observations.channels if c.column.startswith("T_")]
    if not parts and ambient_C > WARM_ROOM_C:
        raise ImplausibleTable(
            f"T_ambient_C: median {ambient_C:g}, and no temperature of a part beside it; "
            f"alone, up to {WARM_ROOM_C:g} degC is believed. Is it in degrees Fahrenheit? "
            f"{conversion('T_ambient_C', 'degF')}. Leave it out, or add T_heatsink_C"
        )
    for name in parts:
        colder_K = -float((frame[name] - frame["T_ambient_C"]).median())
        if colder_K > _COLDER_K:
            raise ImplausibleTable(
                f"T_ambient_C, {name}: the part is {colder_K:.3g} K colder than its room (median), which none that "
                "carries power is. Is one of them in degrees Fahrenheit, or are they exchanged?"
            )


def _refuse_one_efficiency(observations: Observations) -> None:
    """Input power or efficiency that is the same at set points that differ was not measured there."""
    loaded = observations.frame[observations.loaded]
    if len(loaded) < _ENOUGH or len(loaded[["D1", "D2", "P2_W"]].drop_duplicates()) < _ENOUGH:
        return
    for name in ("P1_W", "efficiency"):
        first = float(loaded[name].iloc[0])
        if np.ptp(loaded[name]) <= _STUCK * abs(first):
            raise ImplausibleTable(
                f"{name}: reads {first:g} in all {len(loaded)} rows, at set points that differ: a stuck reading, or a "
                "constant filled in"
            )


def check_set_points(observations: Observations, baseline: Model) -> None:
    """Refuse tables of which the model can run less than half, or only most where it could run all of them read anew.

    Raises
    ------
    ImplausibleTable
        Says whether D1 and D2 would do in another convention.
    """
    points = observations.points.take(np.flatnonzero(observations.loaded))
    carried = float(np.mean(can_run(baseline, points)))
    if carried >= _NEARLY_ALL:
        return
    others = {hint: _carried(baseline, points, D1, D2) for hint, D1, D2 in _conventions(points)}
    hint = max(others, key=lambda said: others[said])
    if others[hint] < _ALL and (carried >= _CARRIED or others[hint] <= 2 * carried):
        if carried >= _CARRIED:
            return
        hint = "is the model file that of this converter, and P2_W in watts?"
    rows = f"{round(carried * len(points))} of {len(points)} rows"
    raise ImplausibleTable(f"D1, D2, P2_W: the model can carry the power of only {rows}; {hint}")


def _conventions(points: Points) -> Iterator[tuple[str, Array, Array]]:
    """What columns called D1 and D2 may be instead, asked in words, and D1 and D2 (N,) where they are that."""
    D1, D2 = np.asarray(points.D1), np.asarray(points.D2)
    yield "with D1 and D2 exchanged it could: are the columns exchanged?", D2, D1
    doubled = (
        "with both doubled it could: are they shares of a whole period, where D1 and D2 are of half a one? "
        "d2ea import --column D1=D1*2 --column D2=D2*2 converts them"
    )
    yield doubled, 2 * D1, 2 * D2
    yield (
        "with 1 - D2 for D2 it could: is it the width of the secondary's pulse, where D2 is the share without voltage?",
        D1,
        1 - D2,
    )
    yield (
        "with 1 - D1 for D1 it could: is it the share without voltage, where D1 is the width of the primary's pulse?",
        1 - D1,
        D2,
    )


def _carried(baseline: Model, points: Points, D1: Array, D2: Array) -> float:
    """Of how many rows, a share, a model carries the power with other D1 and D2; none where they are no duty ratios."""
    if np.min([D1, D2]) < 0.0 or np.max([D1, D2]) > 1.0:
        return 0.0
    return float(np.mean(can_run(baseline, replace(points, D1=D1, D2=D2))))


def implausible(
    observations: Observations, expected: Array
) -> tuple[NDArray[np.bool_], list[RejectedColumn]]:
    """Readings (M,) of columns that cannot be what they are called, and why; ``expected`` (M,) is the baseline's.

    Raises
    ------
    ImplausibleTable
        Temperatures of the room and of a part that look like degrees Fahrenheit.
    """
    p = observations.points
    D1, D2, ambient_C = (np.asarray(x)[observations.row] for x in (p.D1, p.D2, p.ambient_C))
    judged = observations.loaded[observations.row] & np.isfinite(expected)
    rejected = []
    for k, channel in enumerate(observations.channels):
        at = judged & (observations.channel == k)
        if at.sum() < _ENOUGH:
            continue
        column = _Column(
            name=channel.column,
            floor=channel.floor,
            measured=observations.value[at],
            expected=expected[at],
            D1=D1[at],
            D2=D2[at],
            ambient_C=ambient_C[at],
        )
        _refuse_fahrenheit(column)
        reason = next((said for judge in _JUDGES if (said := judge(column)) is not None), None)
        if reason is not None:
            rejected.append(RejectedColumn(column=channel.column, reason=reason))
    if {r.column for r in rejected}.isdisjoint(_LINK):
        rejected += _crossed(observations, expected)
    names = {r.column for r in rejected}
    places = [k for k, c in enumerate(observations.channels) if c.column in names]
    return np.isin(observations.channel, places), rejected


def _refuse_fahrenheit(c: _Column) -> None:
    """Every prediction stands on the room's temperature: a wrong one is not left out but refused."""
    room_C = float(np.median(c.ambient_C))
    if not c.name.startswith("T_") or room_C < WARM_ROOM_C:
        return
    ratio = float(np.median((c.measured - c.ambient_C) / (c.expected - c.ambient_C)))
    if abs(ratio - _FAHRENHEIT[0]) < _FAHRENHEIT[1]:
        raise ImplausibleTable(
            f"T_ambient_C, {c.name}: a room of {room_C:g}, and a rise {ratio:.2f} times what the model expects: this "
            f"looks like degrees Fahrenheit; {conversion(c.name, 'degF')}, and T_ambient_C alike"
        )


def _stuck(c: _Column) -> str | None:
    spread = float(np.ptp(c.measured))
    if spread > _STUCK * max(abs(float(c.measured[0])), 1e-12) or np.ptp(c.expected) < _MOVES * c.floor:
        return None
    return f"reads {c.measured[0]:g} in all {c.measured.size} rows: a stuck sensor, or a constant filled in"


def _other_unit(c: _Column) -> str | None:
    if c.name.startswith("T_"):
        if float(np.median(c.measured)) > HOTTEST_C:
            return f"above {HOTTEST_C:g} degC in most rows: this looks like kelvin; {conversion(c.name, 'K')}"
        in_fahrenheit = np.median(np.abs(c.measured - (1.8 * c.expected + 32.0)))
        if in_fahrenheit < _FAR_NEARER * np.median(np.abs(c.measured - c.expected)):
            return f"is far nearer to what is expected in degrees Fahrenheit; {conversion(c.name, 'degF')}"
        return None
    if c.name == "D0" and (wrapped := _wrapped(c)) is not None:
        return wrapped
    if c.name == "D0" and (typical := float(np.median(np.abs(c.measured)))) > 1.0:
        return (
            f"{typical:.3g} in the median, without its sign: is it in degrees? D0 is in half periods of 180 degrees; "
            f"d2ea import --column D0=D0*{1 / 180:.6f} converts it"
        )
    if c.name in ("D0", "P1_W"):
        return None
    ratio = float(np.median(c.measured / c.expected))
    if 1 / _MOST_OFF < ratio < _MOST_OFF:
        return None
    if abs(ratio + 1.0) < _TURNED:
        return (
            f"{ratio:.3g} times what the model expects: is it counted the other way, a probe turned round? "
            f"d2ea import --column {c.name}={c.name}*-1 converts it"
        )
    unit = c.name.rsplit("_", 1)[-1]
    return f"{ratio:.3g} times what the model expects: is it in another unit? {c.name} is in {unit}"


def _wrapped(c: _Column) -> str | None:
    """Where some phases are a whole turn further: told from 0 to a turn, in half periods or degrees; D0 has a sign."""
    for turn, unit, said in ((2.0, 1.0, "half periods from 0 to 2"), (360.0, 180.0, "degrees from 0 to 360")):
        turned = (c.measured - unit * c.expected) / turn
        further = np.round(turned)
        if np.mean(further != 0.0) > _OFTEN and float(np.median(np.abs(turned - further))) * 2.0 < _SHIFT:
            factor = "" if unit == 1.0 else f", divided by {unit:g}"
            return (
                f"counts {said}, where D0 has a sign, positive where the primary leads: give the ones above "
                f"{turn / 2:g} less {turn:g}{factor}"
            )
    return None


def _other_zero(c: _Column) -> str | None:
    if c.name != "D0":
        return None
    apart = c.measured - c.expected
    off, mirrored = float(np.median(np.abs(apart))), float(np.median(np.abs(c.measured + c.expected)))
    if off > _SHIFT > mirrored and off > 2 * mirrored:
        return "is the negative of what is expected: this D0 is positive where the primary leads; give -D0"
    if off < _SHIFT:
        return None
    others = {
        "is 1 - D1 above what is expected: counted from S2's edge, where this D0 is from S1's; give D0 - (1 - D1)":
            c.expected + 1 - c.D1,
        "is the phase between the pulses' centres, where this D0 is between edges; give D0 - (1 + D2 - D1) / 2":
            c.expected + 0.5 * (1 + c.D2 - c.D1),
        "is pi times what is expected: in radians; give D0 / pi": np.pi * c.expected,
        "is half of what is expected: in whole periods; give 2 D0": 0.5 * c.expected,
    }  # fmt: skip
    missed = {said: float(np.median(np.abs(c.measured - other))) for said, other in others.items()}
    nearest = min(missed, key=lambda said: missed[said])
    return nearest if missed[nearest] < min(_SHIFT, _FAR_NEARER * off) else None


_JUDGES: tuple[Callable[[_Column], str | None], ...] = (_stuck, _other_unit, _other_zero)


def _crossed(observations: Observations, expected: Array) -> list[RejectedColumn]:
    """Both powers of the ac link where what is lost between them goes the other way: the elements are exchanged.

    Two elements inside their specification may show less than nothing between them, so whatever offsets and gains
    could do is taken out first.
    """
    first, second = (np.flatnonzero(observations.of(name)) for name in _LINK)
    both = np.intersect1d(observations.row[first], observations.row[second])
    both = both[observations.loaded[both]]
    if both.size < _ENOUGH:
        return []
    at, behind = (r[np.searchsorted(observations.row[r], both)] for r in (first, second))
    lost_W = np.stack([column[at] - column[behind] for column in (observations.value, expected)])
    errors = np.stack([np.ones(both.size), np.asarray(observations.points.power_W)[both]])
    basis, _ = np.linalg.qr(errors.T)
    measured_W, expected_W = lost_W - (lost_W @ basis) @ basis.T
    turned, straight = np.linalg.norm(measured_W + expected_W), np.linalg.norm(measured_W - expected_W)
    if turned >= _FAR_NEARER * straight:
        return []
    reason = "what is lost between P_link1_W and P_link2_W goes the wrong way over the set points; are they exchanged?"
    return [RejectedColumn(column=name, reason=reason) for name in _LINK]
