"""Operating points: what is set and demanded, as arrays."""

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.parameters import Converter, ParameterError, Quantity
from sim.stacking import pick

Array = NDArray[np.float64]


SEEN = ("seen_heatsink_C", "seen_I1_A")
VOLTAGES = ("V1_V", "V2_V")
_FLAGS = ("pwm", "held")


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """N operating points; every field is an array (N,) or a float for all.

    ``power_W`` is demanded at the output terminals, negative where they feed back. Voltages that are not given (NaN)
    are the nominal ones of the converter that runs there. ``V2_V`` is that of the output terminals, as an analyzer
    reads it; where ``held`` it is what the converter holds in front of its output cable, and so is a nominal one.
    ``pwm`` false is standby (supply on, bridges off).
    ``time_s`` counts from the campaign's start. ``seen_heatsink_C`` and ``seen_I1_A`` are what a bench read at the
    point, NaN where it did not: what has a threshold goes by them.
    """

    D1: Quantity
    D2: Quantity
    power_W: Quantity
    V1_V: Quantity = np.nan
    V2_V: Quantity = np.nan
    ambient_C: Quantity = 25.0
    time_s: Quantity = 0.0
    seen_heatsink_C: Quantity = np.nan
    seen_I1_A: Quantity = np.nan
    pwm: Quantity | NDArray[np.bool_] = True
    held: Quantity | NDArray[np.bool_] = False

    def __post_init__(self) -> None:
        arrays = np.broadcast_arrays(*(np.atleast_1d(getattr(self, f.name)) for f in fields(self)))
        for field, array in zip(fields(self), arrays, strict=True):
            kind = bool if field.name in _FLAGS else float
            object.__setattr__(self, field.name, np.array(array, dtype=kind))
        for field in fields(self):
            values = getattr(self, field.name)
            least = 0.0 if field.name in VOLTAGES else -np.inf
            unread = np.isnan(values) if field.name in (*SEEN, *VOLTAGES) else False
            wrong = np.flatnonzero(~(unread | (np.isfinite(values) & (values > least))))
            if wrong.size:
                allowed = "above 0 V" if least == 0.0 else "finite numbers"
                raise ParameterError(
                    f"Points.{field.name}[{wrong[0]}] is {values[wrong[0]]}; allowed: {allowed}"
                )

    def __len__(self) -> int:
        return int(np.size(self.D1))

    def take(self, chosen: NDArray[np.intp]) -> Self:
        """Some of the points."""
        return pick(self, chosen)

    def unseen(self) -> Self:
        """The same points before anything was read there."""
        return replace(self, **dict.fromkeys(SEEN, np.nan))

    def with_voltages_of(self, converter: Converter) -> Self:
        """The same points with every voltage: the converter's nominal ones where none was given.

        >>> from sim.prototype import prototype
        >>> Points(D1=0.9, D2=0.1, power_W=600.0, V1_V=310.0).with_voltages_of(prototype()).V2_V.tolist()
        [140.0]
        """
        open_ = {name: np.isnan(getattr(self, name)) for name in VOLTAGES}
        if not any(np.any(missing) for missing in open_.values()):
            return self
        return replace(
            self,
            **{
                name: np.where(missing, getattr(converter, name), getattr(self, name))
                for name, missing in open_.items()
            },
            held=self.held | open_["V2_V"],
        )

    def behind(self, cable_Ohm: Quantity) -> Self:
        """The same points with the voltage of the output terminals, behind a cable, where it is held in front of it.

        >>> at = Points(D1=0.9, D2=0.1, power_W=1390.0, V2_V=140.0, held=True)
        >>> at.behind(0.1).V2_V.tolist()  # 10 A
        [139.0]
        """
        root = np.sqrt(np.maximum(self.V2_V**2 - 4.0 * cable_Ohm * self.power_W, 0.0))
        return replace(self, V2_V=np.where(self.held, 0.5 * (self.V2_V + root), self.V2_V), held=False)

    @classmethod
    def join(cls, parts: "list[Points]") -> "Points":
        """Points of several sets, one after the other."""
        return cls(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)})


def grid(
    shape: tuple[int, int, int] = (25, 25, 20), *, lowest_W: float = 200.0, highest_W: float = 2000.0
) -> Points:
    """The paper's grid over D1, D2 in [0, 1] and power, end points included, at nominal voltages.

    >>> len(grid())
    12500
    """
    D1, D2, power = np.meshgrid(
        np.linspace(0, 1, shape[0]),
        np.linspace(0, 1, shape[1]),
        np.linspace(lowest_W, highest_W, shape[2]),
        indexing="ij",
    )
    return Points(D1=D1.ravel(), D2=D2.ravel(), power_W=power.ravel())


def efficiency(P1_W: Array, P2_W: Array) -> Array:
    """What arrives over what is put in: P2/P1 forward, P1/P2 where power flows back, NaN where nothing is put in.

    >>> efficiency(np.array([1000.0, -960.0, 5.0]), np.array([980.0, -1000.0, -2.0])).round(3).tolist()
    [0.98, 0.96, 0.0]
    """
    arrives, given = np.where(P2_W < 0, -P1_W, P2_W), np.where(P2_W < 0, -P2_W, P1_W)
    return np.asarray(np.maximum(arrives, 0.0) / np.where(given > 0, given, np.nan))


def grid_of(converter: Converter, shape: tuple[int, int, int] = (25, 25, 20)) -> Points:
    """The same grid for any converter: from a tenth of its rated power to all of it."""
    rated_W = converter.rated_power_W
    return grid(shape, lowest_W=0.1 * rated_W, highest_W=rated_W)


def carried(most_W: float, most: str = "at most") -> str:
    """What D1 and D2 carry, in words; less than half a watt, or power that only flows back, is none.

    >>> carried(812.4), carried(90.7, "less than"), carried(-3.2)
    ('D1 and D2 carry at most 812 W', 'D1 and D2 carry less than 91 W', 'D1 and D2 carry no power')
    """
    return f"D1 and D2 carry {most} {most_W:.0f} W" if most_W >= 0.5 else "D1 and D2 carry no power"
