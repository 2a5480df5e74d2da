"""A campaign as one vector: every channel of every row, and what a model says of the same vector."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from models.screening import LOADED_KINDS
from sim.model import Model
from sim.operating_points import Points
from sim.parameters import Converter
from sim.simulate import Result, reference, simulate_each
from sim.size import size

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One measured quantity: its column, unit, the least noise to believe, and the model's own accuracy.

    ``floor`` is the smallest standard deviation of one reading (resolution, unsettled heat). ``accuracy`` is
    how well the simulation itself can be trusted beside its loss laws, one sigma, smooth over the operating range.
    Both, and ``watt``, are stated for the prototype; :meth:`of` scales them.
    """

    name: str
    column: str
    unit: str
    floor: float = field(compare=False)
    accuracy: float = field(compare=False)
    # how much one watt of unmodelled loss moves it, for the leftover
    watt: float = field(default=1.0, compare=False)

    def of(self, converter: Converter) -> Self:
        """The channel at a converter of another size."""
        goes_by = {"W": "power", "A": "input_current"}.get(self.unit)
        own = size(goes_by, converter) if goes_by else 1.0
        watt = self.watt * own / size("power", converter)
        return replace(self, floor=self.floor * own, accuracy=self.accuracy * own, watt=watt)


# Assumption: floors are about the last digit of what analyzers, controllers and thermocouples report; accuracies are
# feared, and taken for less where the readings show it (:mod:`models.diagnosis.setting`).
CHANNELS: tuple[Channel, ...] = (
    Channel(name="efficiency", column="P1_W", unit="W", floor=0.01, accuracy=0.05),
    Channel(name="D0", column="D0", unit="Th", floor=1.5e-4, accuracy=3e-4, watt=5e-4),
    Channel(name="I_L_rms_A", column="I_L_rms_A", unit="A", floor=1e-3, accuracy=4e-3, watt=3e-3),
    Channel(name="P_link1_W", column="P_link1_W", unit="W", floor=0.05, accuracy=0.1),
    Channel(name="P_link2_W", column="P_link2_W", unit="W", floor=0.05, accuracy=0.1),
    Channel(name="T_heatsink_C", column="T_heatsink_C", unit="degC", floor=0.2, accuracy=0.2),
    Channel(name="T_transformer_C", column="T_transformer_C", unit="degC", floor=0.3, accuracy=0.3, watt=3.0),
    Channel(name="T_inductor_C", column="T_inductor_C", unit="degC", floor=0.3, accuracy=0.3, watt=3.0),
)
_IN_STANDBY = {"efficiency"}
_WITHOUT_LOAD = {
    "efficiency",
    "D0",
    "I_L_rms_A",
    "P_link1_W",
    "T_heatsink_C",
    "T_transformer_C",
    "T_inductor_C",
}
_DEAD_V = 1.0  # an output below this is off
_AMBIENT_C = 25.0  # Assumption: of a room whose temperature nobody noted
_COARSE, _OF_A_PLAN = 0.01, 20  # of a half period; values of D1 or D2 that a plan may set
_CONDITIONS = ("V1_V", "V2_V", "T_ambient_C")
# conditions that are held, and such as change by small steps
VOLTAGES, _BETWEEN_ROWS = ("V1_V", "V2_V"), ("T_ambient_C", "time_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class Observations:
    """M readings: ``channel`` (M,) indexes ``channels``, ``row`` (M,) the rows of ``frame``; ``value`` (M,).

    ``loaded`` are those rows of the frame that carry power. ``rated_W`` is the converter's power; ``processes`` share a
    large simulation of them. ``found`` are conditions that nobody read, where readings have told what they were.
    """

    frame: pd.DataFrame
    loaded: NDArray[np.bool_]
    points: Points
    channels: tuple[Channel, ...]
    channel: NDArray[np.intp]
    row: NDArray[np.intp]
    value: Array
    rated_W: float
    processes: int = 1
    found: Mapping[str, float] = field(default_factory=dict)

    def of(self, name: str) -> NDArray[np.bool_]:
        """Mask (M,) of one channel's readings."""
        return np.array([c.name == name for c in self.channels])[self.channel]

    @property
    def unread(self) -> list[str]:
        """Conditions that nobody read in any row: they are taken for granted."""
        return _unread(self.frame)

    @property
    def efficiency_alone(self) -> bool:
        """Whether nothing but efficiency was measured."""
        return len(self.channels) == 1

    def take(self, readings: NDArray[np.bool_]) -> Self:
        """Some of the readings; the frame keeps all its rows."""
        return replace(
            self,
            channel=self.channel[readings],
            row=self.row[readings],
            value=self.value[readings],
        )

    def in_use(self) -> Self:
        """The same readings without the channels that have none left."""
        used, channel = np.unique(self.channel, return_inverse=True)
        return replace(self, channels=tuple(self.channels[k] for k in used), channel=channel.astype(np.intp))

    def without(self, columns: Iterable[str]) -> Self:
        """The same without the channels of these columns; itself where it has none of them."""
        left = [name for name in set(columns) if any(c.column == name for c in self.channels)]
        if not left:
            return self
        kept = np.array([c.column not in left for c in self.channels])[self.channel]
        return self.take(kept).in_use()

    def and_also(self, others: Self) -> Self:
        """These readings and others of the same frame, of all channels of either."""
        channels = tuple(dict.fromkeys([*self.channels, *others.channels]))
        place = [np.array([channels.index(c) for c in o.channels], dtype=np.intp) for o in (self, others)]
        return replace(
            self,
            channels=channels,
            channel=np.concatenate([place[0][self.channel], place[1][others.channel]]),
            row=np.concatenate([self.row, others.row]),
            value=np.concatenate([self.value, others.value]),
        )

    def where(self, found: Mapping[str, float], converter: Converter) -> Self:
        """The same with conditions that nobody read at these values, by column, instead of nominal ones."""
        points = replace(points_of(self.frame.assign(**found), converter), held=self.points.held)
        return replace(self, points=points, found=dict(found))

    def mistrusting(self, columns: Iterable[str]) -> Self:
        """The same without what a threshold would go by of columns that cannot be what they are called."""
        if "T_heatsink_C" not in columns:
            return self
        return replace(self, points=replace(self.points, seen_heatsink_C=np.nan))

    def predicted(self, result: Result) -> Array:
        """What a simulation of the rows with readings says of every reading, (M,)."""
        _, row = np.unique(self.row, return_inverse=True)
        table = np.stack([result[c.column] for c in self.channels])
        return np.asarray(table[self.channel, row])

    def reference(self, model: Model) -> Result:
        """A simulation of the rows with readings, for variants to start from."""
        return reference(model, self.points.take(np.unique(self.row)))

    def results(
        self, models: Sequence[Model], near: Result | None = None, starts: Sequence[Array | None] = ()
    ) -> list[Result]:
        """A simulation of the rows with readings by each model, in one call; ``starts`` are unknowns (n, N).

        ``near`` is a :meth:`reference` of these very readings.
        """
        at = self.points.take(np.unique(self.row))
        return simulate_each([(model, at) for model in models], near, starts, self.processes)

    def solved(
        self, models: Sequence[Model], near: Result | None = None, starts: Sequence[Array | None] = ()
    ) -> list[tuple[Array, Array]]:
        """Of :meth:`results` the prediction of every reading, (M,), and the unknowns (n, N) that were solved for."""
        return [(self.predicted(result), result.state) for result in self.results(models, near, starts)]


def points_of(frame: pd.DataFrame, converter: Converter) -> Points:
    """The set points of a measurement table, as applied: measured P2, V1, V2, ambient, time where present.

    What was not measured is :func:`taken_for_granted`.
    """

    def column(name: str, default: float) -> Array:
        if name not in frame:
            return np.full(len(frame), default)
        given = frame[name].to_numpy(dtype=float)
        if name in _BETWEEN_ROWS:
            given = _between_rows(given)
        elif name in VOLTAGES:
            carrying = given[np.isfinite(given) & frame["kind"].isin(LOADED_KINDS).to_numpy()]
            given = np.where(np.isfinite(given), given, np.median(carrying) if carrying.size else default)
        return np.where(np.isfinite(given), given, default)

    kind = frame["kind"].to_numpy()
    standby, idle = kind == "standby", kind == "no_load"
    V1, V2 = column("V1_V", converter.V1_V), column("V2_V", converter.V2_V)
    heatsink_C, I1 = column("T_heatsink_C", np.nan), column("P1_W", np.nan) / np.where(V1 > 0, V1, np.nan)
    return Points(
        D1=np.where(standby, 1.0, column("D1", 1.0)),
        D2=np.where(standby, 0.0, column("D2", 0.0)),
        power_W=np.where(standby | idle, 0.0, column("P2_W", 0.0)),
        V1_V=V1,
        V2_V=np.where(standby | (idle & (V2 < _DEAD_V)), converter.V2_V, V2),
        ambient_C=column("T_ambient_C", _AMBIENT_C),
        time_s=column("time_s", 0.0),
        seen_heatsink_C=np.where(np.isfinite(heatsink_C), heatsink_C, np.nan),
        seen_I1_A=np.where(np.isfinite(I1), I1, np.nan),
        pwm=~standby,
        held="V2_V" in _unread(frame),
    )


def _unread(frame: pd.DataFrame) -> list[str]:
    """Conditions that no row of a measurement table has."""
    return [name for name in _CONDITIONS if name not in frame or bool(frame[name].isna().all())]


def _between_rows(given: Array) -> Array:
    """Values (N,) with those that are missing on straight lines between the rows around them; all NaN where all are."""
    known = np.flatnonzero(np.isfinite(given))
    return np.interp(np.arange(given.size), known, given[known]) if known.size else given


def nominal_conditions(converter: Converter) -> dict[str, float]:
    """What a simulation takes for conditions that a measurement table does not have."""
    return {"V1_V": converter.V1_V, "V2_V": converter.V2_V, "T_ambient_C": _AMBIENT_C}


def taken_for_granted(frame: pd.DataFrame, converter: Converter) -> list[str]:
    """What a simulation takes for the conditions that a measurement table does not have, a sentence each.

    >>> from sim.prototype import prototype
    >>> given = pd.DataFrame({"V1_V": [299.8, 299.9], "T_ambient_C": [24.0, np.nan]})
    >>> for sentence in taken_for_granted(given, prototype()):
    ...     print(sentence)
    V2_V is not in the table: taken as 140 V
    T_ambient_C is missing in 1 of 2 rows: taken from the rows around
    """
    unread = _unread(frame)
    said = [
        f"{name} is not in the table: taken as {value:g} {'°C' if name == 'T_ambient_C' else 'V'}"
        for name, value in nominal_conditions(converter).items()
        if name in unread
    ]
    if all(_may_be_rounded(frame, name) for name in ("D1", "D2")):
        said.append(
            f"D1 and D2 are multiples of {_COARSE:g}: if they were rounded to that, D0 and the link current are off by "
            "more than noise, in what looks like timing; write them with four decimals"
        )
    for names, taken in (
        (VOLTAGES, "as the median of the others"),
        (_BETWEEN_ROWS, "from the rows around"),
    ):
        for name in names:
            missing = int(frame[name].isna().sum()) if name in frame else 0
            if 0 < missing < len(frame):
                said.append(f"{name} is missing in {missing} of {len(frame)} rows: taken {taken}")
    return said


def _may_be_rounded(frame: pd.DataFrame, name: str) -> bool:
    """Whether a duty ratio may have lost its digits: on a coarse grid, at more values than a plan's own grid has."""
    values = np.unique(frame[name].dropna().to_numpy(dtype=float)) if name in frame else np.empty(0)
    steps = values / _COARSE
    return values.size > _OF_A_PLAN and bool(np.all(np.abs(steps - np.round(steps)) < 1e-6))


def observe(frame: pd.DataFrame, converter: Converter, processes: int = 1) -> Observations:
    """Every finite reading of every known channel; a row's channels depend on its kind."""
    frame = frame.reset_index(drop=True)
    present = tuple(c.of(converter) for c in CHANNELS if c.column in frame and frame[c.column].notna().any())
    kind, loaded = frame["kind"].to_numpy(), frame["kind"].isin(LOADED_KINDS).to_numpy()
    channel, row, value = [], [], []
    for k, c in enumerate(present):
        readings = frame[c.column].astype(float).to_numpy()
        usable = np.isfinite(readings) & (
            loaded
            | ((kind == "standby") & (c.name in _IN_STANDBY))
            | ((kind == "no_load") & (c.name in _WITHOUT_LOAD))
        )
        rows = np.flatnonzero(usable)
        channel.append(np.full(rows.size, k))
        row.append(rows)
        value.append(readings[rows])
    return Observations(
        frame=frame,
        loaded=loaded,
        points=points_of(frame, converter),
        channels=present,
        channel=np.concatenate(channel).astype(np.intp),
        row=np.concatenate(row).astype(np.intp),
        value=np.concatenate(value),
        rated_W=converter.rated_power_W,
        processes=processes,
    )
