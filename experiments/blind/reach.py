r"""What a design could tell apart, computed from the truth: the trial generator's isolability.

A lab of nominal parts is measured with perfect instruments, and again with every part, instrument and effect moved
a little: how each moves all readings. Readings are whitened with what is not known of an honest bench,

.. math:: C = \operatorname{diag}(\sigma^2) + J J^T

where the columns of J are one sigma of every part, of everyday drifts, of the instruments' specified errors, and
the difference between the lab's laws and the simulator's at nominal parts, which nobody can take for an effect.
An effect that bends is a plane: its shifts at both ends of the range that labs draw from. A part that bends a reading,
at the most that can be carried or where an edge turns soft, is moved to both sides: the straight part is its
column, the other one is noise of that reading. What an ordinary lab cannot run at all is not counted.
What stands in a lab is the departure of a part from its design, of which nobody can say how much was hidden: the
shift is that from the same lab with these parts as designed (:func:`without`), and a bench whose own parts are as far
off is a rival too (:func:`departure`).

None of it is known to the diagnosis, and nothing of the diagnosis is used here.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache, partial
from operator import attrgetter
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from drivers.mocks.lab.hidden import EVERYDAY, HIDDEN, hide
from drivers.mocks.lab.instruments import FACTOR, GAIN, OFFSET_A, OFFSET_W, TEMPERATURE_OFFSET_K
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import SUPPLY_V, Schedule, Settled, schedule, settle, survey
from experiments.blind.sight import Sight
from experiments.harness.lab_data import REFERENCE_EVERY, random_set_points
from models.screening import LOADED_KINDS
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.operating_points import Points
from sim.prototype import prototype
from sim.simulate import simulate
from sim.spread import Spread, everyday_spread, shifted_together

Array = NDArray[np.float64]
Each = Callable[[Callable[[Laboratory], Array], Iterable[Laboratory]], Iterable[Array]]

CHANNELS = (
    "P1_W", "D0", "I_L_rms_A", "P_link1_W", "P_link2_W", "T_heatsink_C", "T_transformer_C", "T_inductor_C",
)  # fmt: skip
EFFICIENCY_ONLY = ("P1_W",)
POINTS = 100
_OF_PORT_1 = {"input_gain": ("voltage_gain", "current_gain"), "input_offset_A": ("offset_A",)}
_ROOT_3, _UPDATES = 3**0.5, 8
# What a bench holds its terminal voltages to, one sigma, and the share of it that an analyzer's reading leaves unseen
_OUTPUT_HELD, _SUPPLY_HELD_V = 5e-4, 0.1
_MISREAD = FACTOR * GAIN[1]  # of the reading
_UNSEEN = np.array([[_MISREAD / _OUTPUT_HELD], [_MISREAD * SUPPLY_V / _SUPPLY_HELD_V]])
# noise of one row, of reading: the input's and the output's (efficiency is judged), current, ac power
_NOISE = {"P1_W": 1.4e-4, "I_L_rms_A": 2e-4, "P_link1_W": 4e-4, "P_link2_W": 4e-4}
_COUNT = 1 / 2500  # of D0, as a controller reports it
_RESOLUTION = {"D0": _COUNT / 12**0.5, "T_heatsink_C": 0.1, "T_transformer_C": 0.1, "T_inductor_C": 0.1}


def hideable() -> list[str]:
    """Effects that are in the catalogue and that a lab can hide, in the catalogue's order."""
    return [name for name in CATALOGUE if name in HIDDEN]


@lru_cache(maxsize=16)
def design(seed: int, points: int = POINTS) -> Schedule:
    """The set points of a design, in random order with a reference every eight: one object for all who ask."""
    D1, D2, power_W = random_set_points(points, np.random.default_rng([seed, 10])).T
    return schedule(D1, D2, power_W, reference_every=REFERENCE_EVERY)


def readings(table: pd.DataFrame) -> pd.Series:
    """All finite readings of a table, by time and channel."""
    idle = ~table["kind"].isin(LOADED_KINDS)
    standby = table["kind"] == "standby"
    values = table.set_index("time_s")[list(CHANNELS)]
    values = values.mask(standby.to_numpy()[:, None] & (np.array(CHANNELS) != "P1_W"))
    values.loc[idle.to_numpy(), "P_link2_W"] = np.nan  # nothing to be told from it without load
    return pd.Series(values.stack().dropna())


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """All directions of one design, by reading; ``sigma`` is the noise of each, ``bent`` what parts bend it by.

    ``voltages`` (2, M) are those of the terminals as a bench holds them; an analyzer that reads them leaves a part.
    ``nominal`` (M,) is what a lab of nominal parts reads.
    """

    index: "pd.Index[Any]"
    nominal: Array
    sigma: Array
    bent: Array
    nuisance: Array
    voltages: Array
    effects: Mapping[str, Array]

    def unknown(self, *, voltages_read: bool = True) -> Array:
        """One-sigma directions of what is not known of an honest bench, (K, M)."""
        return np.concatenate([self.nuisance, (_UNSEEN if voltages_read else 1.0) * self.voltages])

    def sight(
        self,
        shift: pd.Series,
        channels: Sequence[str] = CHANNELS,
        only: Sequence[str] | None = None,
        *,
        voltages_read: bool = True,
        plain: pd.Series | None = None,
    ) -> Sight:
        """What can be seen of a shift, by the readings it has, in some channels; ``only`` these effects' planes.

        ``plain`` is what the lab reads without it and without noise; by default as a nominal one.
        """
        here = shift.reindex(self.index)
        keep = here.notna().to_numpy() & self.index.get_level_values(1).isin(channels)
        nuisance = self.unknown(voltages_read=voltages_read)[:, keep]
        C = np.diag(self.sigma[keep] ** 2 + self.bent[keep] ** 2) + nuisance.T @ nuisance
        factor = cholesky(C, lower=True)

        def white(rows: Array) -> Array:
            return np.asarray(solve_triangular(factor, rows.T, lower=True))

        wanted = self.effects if only is None else only
        planes = {name: white(self.effects[name][:, keep]) for name in wanted}
        own = np.zeros_like(self.nominal)
        if plain is not None:
            own = np.nan_to_num(plain.reindex(self.index).to_numpy(dtype=float) - self.nominal)
        shift_and_own = np.stack([here.to_numpy(dtype=float), own])[:, keep]
        seen, own = white(shift_and_own).T
        return Sight(shift=seen, own=own, planes=planes, each=white(np.eye(len(C))))

    def with_planes(self, shifts: Mapping[str, Sequence[pd.Series]]) -> Self:
        """The same with what these effects do taken from shifts of one lab.

        A reading that an effect cannot run tells nothing of it: it is free to be anything, a row more of the plane.
        """
        planes = dict(self.effects)
        for name, both in shifts.items():
            plane = np.stack([there.reindex(self.index).to_numpy(dtype=float) for there in both])
            runs = np.all(np.isfinite(plane), axis=0)
            planes[name] = np.concatenate([np.where(runs, plane, 0.0), np.eye(runs.size)[~runs]])
        return replace(self, effects=planes)


def reach_of(seed: int, points: int = POINTS) -> Reach:
    """The reach of a design, in a lab of nominal parts."""
    return worked_out(design(seed, points))


_known: dict[bytes, Reach] = {}


def worked_out(plan: Schedule, each: Each = map) -> Reach:
    """The reach of a schedule among all effects, worked out once or :func:`handed_over` by another process."""
    key = _key(plan)
    if key not in _known:
        _known[key] = reach(plan, each=each)
    return _known[key]


def handed_over(plan: Schedule, known: Reach) -> None:
    """Take a reach for that of a schedule from now on."""
    _known[_key(plan)] = known


def _key(plan: Schedule) -> bytes:
    return np.stack([plan.D1, plan.D2, plan.power_W, plan.time_s]).tobytes()


def reach(plan: Schedule, names: Sequence[str] | None = None, each: Each = map) -> Reach:
    """The reach of any schedule, among all effects or those named; ``each`` runs the labs, as ``map`` does."""
    lab = Laboratory.nominal().without_noise()
    origin = settle(lab, plan)
    base_table = survey(lab, plan, seed=0, samples=1, settled=origin)
    base = readings(base_table)
    everyday, values = list(_everyday(lab)), {name: HIDDEN[name].drawn for name in names or hideable()}
    others = [other for both in everyday for other in both] + (held := list(_voltages(lab)))
    others += [hiding(lab, {name: value}) for name, drawn in values.items() for value in drawn]
    shifts = iter(each(partial(_shift, plan, origin, base), others))
    sides = [[next(shifts) for _ in both] for both in everyday]
    nuisance = [0.5 * (side[0] - side[1]) if len(side) == 2 else side[0] for side in sides]
    bends = np.abs([0.5 * (side[0] + side[1]) for side in sides if len(side) == 2])
    rounded = _COUNT * _of(base, "D0")  # whole counts do not bend it
    bent = np.linalg.norm(np.maximum(bends - rounded, 0.0), axis=0)
    voltages = np.stack([next(shifts) for _ in held])
    runs = np.isfinite(bent) & np.all(np.isfinite([*nuisance, *voltages]), axis=0)
    nuisance += _instruments(base, base_table)
    nuisance.append(_laws(base, base_table))
    effects = {name: np.nan_to_num([next(shifts)[runs] for _ in drawn]) for name, drawn in values.items()}
    return Reach(
        index=base.index[runs],
        nominal=base.to_numpy(dtype=float)[runs],
        sigma=_noise(base)[runs],
        bent=bent[runs],
        nuisance=np.stack(nuisance)[:, runs],
        voltages=voltages[:, runs],
        effects=effects,
    )


def _shift(plan: Schedule, origin: Settled, base: pd.Series, lab: Laboratory) -> Array:
    """What a lab reads beside the one that settled at ``origin`` and read ``base`` (M,); NaN where it does not run."""
    there = readings(survey(lab, plan, seed=0, samples=1, settled=settle(lab, plan, origin)))
    return np.asarray((there.reindex(base.index) - base).to_numpy(dtype=float))


def hiding(lab: Laboratory, values: Mapping[str, float]) -> Laboratory:
    """A lab with catalogue effects hidden in it, everything else as it was."""
    converter, quirks = hide(lab.converter, values, lab.quirks)
    return replace(lab, converter=converter, quirks=quirks)


def without(lab: Laboratory, names: Collection[str]) -> Laboratory:
    """A lab with nothing hidden, and with the very parts that catalogue effects change as the design has them.

    What stands in a lab is a part's departure from its design: nobody can tell how much of it was hidden.
    """
    nominal, (parts, quirks) = Laboratory.nominal(), _own(names)
    back = [
        (replace(part, sigma=_at(nominal, part.path) - _at(lab, part.path), relative=False), 1.0)
        for part in parts
    ]
    errors: dict[str, Any] = {
        error: {**getattr(lab.errors, error), 1: 0.0}
        for quirk in quirks
        for error in _OF_PORT_1.get(quirk, ())
    }
    return replace(
        lab,
        converter=shifted_together(lab.converter, back),
        quirks=replace(lab.quirks, **{name: getattr(nominal.quirks, name) for name in quirks}),
        errors=replace(lab.errors, **errors),
    )


def departure(lab: Laboratory, name: str) -> float:
    """How many of their own sigmas the parts that an effect changes are off in a lab; infinite where it changes none.

    A bench whose parts happen to be so far off shows the very same readings; the columns of J say so on a line.
    """
    nominal, (parts, _) = Laboratory.nominal(), _own([name])
    sigmas = [
        (_at(lab, part.path) - _at(nominal, part.path))
        / (part.sigma * (_at(nominal, part.path) if part.relative else 1.0))
        for part in parts
    ]
    return float(np.linalg.norm(sigmas)) if sigmas else float("inf")


def _own(names: Collection[str]) -> tuple[list[Spread], list[str]]:
    """The parts with an everyday spread, and the quirks, that effects change; a foreign effect has none."""
    nominal = Laboratory.nominal()
    touched = hiding(nominal, {name: HIDDEN[name].drawn[1] for name in names if name in HIDDEN})
    parts = [
        spread
        for spread in everyday_spread(nominal.converter)
        if _at(touched, spread.path) != _at(nominal, spread.path)
    ]
    both = ((f.name, getattr(touched.quirks, f.name)) for f in fields(touched.quirks))
    return parts, [quirk for quirk, value in both if value != getattr(nominal.quirks, quirk)]


def _at(lab: Laboratory, path: str) -> float:
    return float(attrgetter(path)(lab.converter))


def _everyday(lab: Laboratory) -> Iterator[tuple[Laboratory, ...]]:
    """The lab with each part off by one sigma to both sides, with each drift to one."""
    for spread in everyday_spread(lab.converter):
        sides = (1.0, -1.0) if np.isinf(spread.lower) else (1.0,)  # a resistance may end at none
        yield tuple(replace(lab, converter=spread.shifted(lab.converter, side)) for side in sides)
    for name, sigma in EVERYDAY.items():
        yield (replace(lab, quirks=replace(lab.quirks, **{name: sigma})),)


def _voltages(lab: Laboratory) -> Iterator[Laboratory]:
    """The lab with each terminal voltage one sigma off where it is held."""
    yield replace(lab, errors=replace(lab.errors, output_sense=_OUTPUT_HELD))
    yield replace(lab, errors=replace(lab.errors, supply_V=_SUPPLY_HELD_V))


def _of(base: pd.Series, *channels: str) -> Array:
    return base.index.get_level_values(1).isin(channels).astype(float)


def _instruments(base: pd.Series, table: pd.DataFrame) -> list[Array]:
    """One-sigma directions of instruments inside the lab's specification."""
    value = base.to_numpy(dtype=float)
    P2_W = table.set_index("time_s")["P2_W"].reindex(base.index.get_level_values(0)).to_numpy(dtype=float)
    input_W = _of(base, "P1_W")
    loaded = input_W * (P2_W > 0)
    found = [
        input_W * value * GAIN[1] / _ROOT_3,
        input_W * SUPPLY_V * OFFSET_A[1] / _ROOT_3,
        loaded * P2_W * GAIN[2] / _ROOT_3,
        loaded * prototype().V2_V * OFFSET_A[2] / _ROOT_3,
    ]
    for element, channel in ((3, "P_link1_W"), (4, "P_link2_W")):
        found += [
            _of(base, channel) * value * GAIN[element] / _ROOT_3,
            _of(base, channel) * OFFSET_W[element] / _ROOT_3,
        ]
    found.append(_of(base, "I_L_rms_A") * value * FACTOR * GAIN[3])
    return found + [
        _of(base, sensor) * TEMPERATURE_OFFSET_K for sensor in CHANNELS if sensor.startswith("T_")
    ]


def _laws(base: pd.Series, table: pd.DataFrame) -> Array:
    """The lab's readings less the simulator's, both of nominal parts, at rows that carry load."""
    loaded = table[table["kind"].isin(LOADED_KINDS)]
    points = Points(D1=loaded["D1"].to_numpy(), D2=loaded["D2"].to_numpy(), power_W=loaded["P2_W"].to_numpy())
    simulated = simulate(Model.baseline(), points)
    columns = {channel: np.asarray(simulated[channel]) for channel in CHANNELS}
    there = readings(loaded.assign(**columns))
    return np.asarray(np.nan_to_num((base - there).reindex(base.index).to_numpy(dtype=float)))


def _noise(base: pd.Series) -> Array:
    """Standard deviation of one row's reading, the mean of eight updates."""
    value = np.abs(base.to_numpy(dtype=float))
    sigma = np.zeros(value.size)
    for channel, share in _NOISE.items():
        sigma += _of(base, channel) * np.maximum(value * share / _UPDATES**0.5, 1e-3)
    for channel, resolution in _RESOLUTION.items():
        sigma += _of(base, channel) * resolution
    return sigma


def shift_between(hiding_table: pd.DataFrame, plain_table: pd.DataFrame) -> pd.Series:
    """What was hidden does to the readings of one lab: both tables have the same noise, which cancels."""
    return (readings(hiding_table) - readings(plain_table)).dropna()
