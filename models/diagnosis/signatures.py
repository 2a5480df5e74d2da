"""Signatures: how every effect, and every everyday spread, moves the whole vector of readings."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.common_mode import CommonModes
from models.diagnosis.heat_lag import PARTS, Heated, History, heat_lags
from models.diagnosis.inaccuracy import inaccuracy, of_laws
from models.diagnosis.lines import Key, Lines, key_of
from models.diagnosis.near_limit import curvature
from models.diagnosis.observations import CHANNELS, Observations
from models.diagnosis.predictions import Predictions, Repeated, Variant, ending, read, table_of
from models.diagnosis.rounding import step_of_output
from models.diagnosis.thresholds import State
from models.diagnosis.variants import APART, INPUTS, P2_NOISE, UNREAD, Variants, is_everyday, step_of
from sim.effects.base import Effect
from sim.effects.catalogue import CATALOGUE
from sim.effects.parameter_effect import ParameterEffect
from sim.model import Model
from sim.parameters import Converter
from sim.simulate import Case, Result, simulate_each

Array = NDArray[np.float64]

_ROOT_3 = 3**0.5
NOT_READ = ", not read"  # behind a condition's name, where that is a spread
_COLLINEAR = 0.9999
_CROSSED = 5  # readings on the far side of a threshold that make it more than an outlier
_SILENT = 1e-3  # over all readings, in their units: above the solver's tolerance, below every noise
_FOLD = 2e-3  # of a half period: ten times what a smooth D0 bends over them
# Assumption: of a law's doubt over the whole map, where readings agree with it from place to place
_STAYS = 0.5
_FAINT = 1.0  # sigmas over all readings
_LAG = 0.1  # of the step from the row before: what is left of it when a bench takes its heat for settled


@dataclass(frozen=True, slots=True, kw_only=True)
class Signature:
    """Change of every reading (M,) per unit of an effect's headline value, at fixed other values.

    ``entry`` is the effect as the converter at hand has it; ``everyday`` is one sigma of the headline value that the
    everyday spreads of the effect's own parts look like.
    """

    entry: Effect
    other: dict[str, float] = field(default_factory=dict)
    slope: Array
    everyday: float = 0.0

    @property
    def effect(self) -> str:
        """The effect's name."""
        return self.entry.name

    @property
    def key(self) -> Key:
        """The effect's name with its other values: what tells it from its other variants."""
        return key_of(self.effect, self.other)

    def values(self, headline: float) -> dict[str, float]:
        """The effect's values with this headline."""
        return {self.entry.headline.name: headline, **self.other}


@dataclass(frozen=True, slots=True, kw_only=True)
class Signatures:
    """Baseline prediction (M,), effects' signatures, and the spreads' directions (K, M), one sigma each.

    The first directions are the ``modes`` of the converter's parts; then come the effects that have an everyday
    tolerance of their own, by name, the instruments, and ``lags`` of heat that lags behind: all that a bench may have
    of it where it ``is_slow``.
    ``input_sigma`` (M,) is how far the noise of the measured P2, at which the model runs, moves a prediction;
    ``bends`` (q, M) are further directions, one sigma each, where efficiency is alone: what a link inductance off
    bends near the limit about the baseline; or, about a cause that leads, by what its slope differs and what it bends.
    ``per_watt`` (M,) is the change for one watt more at the output. ``inaccuracy`` (3, M) is that of the simulation,
    of the input power such a share as ``doubt`` says, of other channels as ``others_doubt``; what each loss part's
    law, one of ``laws`` (parts, M), may be off by over the whole map then stands beneath.
    ``conditions`` are what voltages and a room do, (M,) by column, one sigma each of such that nobody read; ``unread``
    are those that nobody read: no spreads but where readings say so.
    ``near`` is the baseline's simulation at ``rows`` of the frame, for variants to start from along ``lines``;
    ``told`` is what variants say there; ``state`` (by row of the frame) is what thresholds are of.
    """

    baseline: Array
    effects: tuple[Signature, ...]
    modes: CommonModes
    spread_names: tuple[str, ...]
    spreads: Array
    input_sigma: Array
    bends: Array
    per_watt: Array
    inaccuracy: Array
    laws: Array
    conditions: Mapping[str, Array] = field(default_factory=dict)
    unread: tuple[str, ...] = ()
    lags: int = 0
    is_slow: bool = False
    doubt: float = 1.0
    others_doubt: float = 1.0
    rows: NDArray[np.intp] | None = None
    near: Result | None = None
    lines: Lines | None = None
    told: Predictions = field(default_factory=Predictions)
    state: State = field(default_factory=State)

    def start(self, observations: Observations, baseline: Model) -> tuple[Result, Lines | None]:
        """The baseline's simulation at the rows with readings, and the lines there."""
        if self.near is None or self.rows is None or self.lines is None:
            return observations.reference(baseline), None
        used = np.searchsorted(self.rows, np.unique(observations.row))
        return self.near.take(used), self.lines.take(used)

    def doubted(self, observations: Observations, doubt: float, others: float = 1.0) -> Self:
        """The same with the input power wrong by such a share of what the simulation may be off, others by another."""
        share = np.where(observations.of("efficiency"), doubt / self.doubt, others / self.others_doubt)
        smooth, at_edges, cut_short = self.inaccuracy[:3]
        whole_map = _STAYS * self.laws if doubt < _STAYS else self.laws[:0]
        less = np.concatenate([np.stack([share * smooth, share * at_edges, cut_short]), whole_map])
        return replace(self, inaccuracy=less, doubt=doubt, others_doubt=others)

    def leaving_out(self, effects: Collection[str]) -> Self:
        """The same without these effects as causes; what they have of an everyday tolerance stays."""
        return replace(self, effects=tuple(s for s in self.effects if s.effect not in effects))

    @property
    def doubted_conditions(self) -> list[str]:
        """The conditions that nobody read, where readings say that they were other than nominal."""
        return [name.removesuffix(NOT_READ) for name in self.spread_names if name.endswith(NOT_READ)]

    @property
    def slow(self) -> Array:
        """The directions (L, M) of heat that lags behind."""
        return self.spreads[len(self.spreads) - self.lags :]

    def lagging(self, share: float) -> Self:
        """The same with such a share of the heat that lags behind."""
        rest = len(self.spreads) - self.lags
        spreads = np.concatenate([self.spreads[:rest], share * self.slow])
        return replace(self, spreads=spreads, is_slow=share >= 1.0)

    def distinct(self, sigma: Array) -> Self:
        """The same with the fewest directions of lagging heat: those that move readings by a ``sigma`` (M,) in all."""
        rest = len(self.spreads) - self.lags
        _, lengths, axes = np.linalg.svd(self.slow / sigma, full_matrices=False)
        kept = lengths > _FAINT
        slow = lengths[kept, None] * axes[kept] * sigma
        names = tuple(f"heat that lags behind, {k}" for k in range(1, len(slow) + 1))
        return replace(
            self,
            spreads=np.concatenate([self.spreads[:rest], slow]),
            spread_names=(*self.spread_names[:rest], *names),
            lags=len(slow),
        )

    def doubting_conditions(self) -> Self:
        """The same with what nobody read as spreads: nominal no more."""
        rest, names = len(self.spreads) - self.lags, tuple(name + NOT_READ for name in self.unread)
        spreads = [self.spreads[:rest], *(self.conditions[name][None] for name in self.unread), self.slow]
        return replace(
            self,
            spreads=np.concatenate(spreads),
            spread_names=(*self.spread_names[:rest], *names, *self.spread_names[rest:]),
            unread=(),
        )

    def own_spreads(self, *names: str) -> NDArray[np.intp]:
        """Which directions are the everyday spread of the very parameters that effects change together, (k,)."""
        return _own_spreads(names, self.spread_names, self.modes.elsewhere)

    def moved(self, parts: Array, larger: Array | float = 1.0) -> Array:
        """How readings (M,) move on straight lines, parts (K,) off by so many sigmas, axes ``larger`` (K,) times."""
        return np.asarray((larger * self.modes.along(parts)) @ self.spreads[: parts.size])

    def finite(self) -> NDArray[np.bool_]:
        """Readings (M,) that every variant can predict: the others lie at the edge of what can be carried."""
        slopes = np.stack([s.slope for s in self.effects])
        whole = np.concatenate(
            [self.baseline[None], self.input_sigma[None], slopes, self.spreads, self.bends]
        )
        return np.asarray(np.all(np.isfinite(whole), axis=0))

    def take(self, readings: NDArray[np.bool_]) -> "Signatures":
        """The signatures of some of the readings."""
        return replace(
            self,
            baseline=self.baseline[readings],
            effects=tuple(replace(s, slope=s.slope[readings]) for s in self.effects),
            spreads=self.spreads[:, readings],
            input_sigma=self.input_sigma[readings],
            bends=self.bends[:, readings],
            per_watt=self.per_watt[readings],
            inaccuracy=self.inaccuracy[:, readings],
            laws=self.laws[:, readings],
            conditions={name: shift[readings] for name, shift in self.conditions.items()},
        )


@lru_cache(maxsize=10_000)
def _own_spreads(
    names: tuple[str, ...], spread_names: tuple[str, ...], elsewhere: frozenset[str]
) -> NDArray[np.intp]:
    entries = map(CATALOGUE.__getitem__, names)
    paths = [path for e in entries if isinstance(e, ParameterEffect) for path in e.paths]
    own = {*names, *paths} - elsewhere
    found = np.array([k for k, name in enumerate(spread_names) if name in own], dtype=np.intp)
    found.setflags(write=False)
    return found


def signatures(
    observations: Observations,
    baseline: Model,
    *,
    among: Collection[str] | None = None,
    near: Result | None = None,
    repeated: Repeated | None = None,
    history: History | None = None,
) -> Signatures:
    """Simulate the baseline, every effect at a small step, and every spread at one sigma, in one call.

    ``among`` are the effects that are asked for, all by default. ``near`` is a simulation of the rows with readings to
    start from. Rows that are ``repeated`` are not simulated again where that is known. Without a ``history`` all rows
    have settled.
    """
    asked = Variants.of(observations, baseline, among)
    used, row = np.unique(observations.row, return_inverse=True)
    near, at_end = near or observations.reference(baseline), dict[Variant, Case]()
    end_s, lines = float(np.max(np.asarray(observations.points.time_s))), None
    if repeated is None:
        if observations.processes > 1:  # what to measure next is asked for then
            at_end = ending(asked.cases, end_s)
        cases = [*asked.cases.values(), *at_end.values()]
        results = simulate_each(cases, near, processes=observations.processes)
        tables, lines = list(map(table_of, results)), asked.lines(results)
    else:
        tables = repeated.tables(asked.cases, near)
    tables, last = tables[: len(asked.cases)], tables[len(asked.cases) :]
    base, *others = (read(table, observations, row) for table in tables)
    moved = asked.moved(others)
    every = [
        Signature(entry=a.entry, other=a.other, slope=(after - base) / step_of(a.entry))
        for a, after in zip(asked.effects, moved.effects, strict=True)
    ]
    (V1, V2), input_sigma, per_watt = _errors_of_inputs(observations, moved.inputs[:INPUTS] - base)
    shifts = dict(zip(UNREAD, (V1, V2, *(moved.inputs[INPUTS:] - base)), strict=False))
    everyday = {
        s.effect: s.slope * s.entry.headline.tolerance
        for s in every
        if is_everyday(s.entry, asked.spreads, s.other)
    }
    everyday |= _instrument_spreads(observations, baseline.converter, base, per_watt)
    everyday |= {"measured V1": V1, "measured V2": V2}
    lags = dict[str, Array]()
    if history is not None:
        cores = {f"T_{s.entry.core_of}_C": s.slope for s in every if s.entry.core_of}
        lags = heat_lags(observations, history, _heated(asked, tables, moved.spreads - base, row, cores))
    everyday |= lags
    modes = CommonModes.of(asked.spreads, baseline.converter)
    simulated = tables[: 1 + len(asked.effects) + len(asked.spreads)]
    state = State.of(observations.points.take(used), simulated, asked.usual())
    return Signatures(
        baseline=base,
        effects=tuple(s for s in every if not _imitates(s, every)),
        modes=modes,
        spread_names=(*modes.names, *everyday),
        spreads=np.concatenate([modes.axes @ (moved.spreads - base), np.stack(list(everyday.values()))]),
        input_sigma=input_sigma,
        bends=curvature(base, moved.spreads[list(asked.limit)], moved.limit),
        per_watt=per_watt,
        inaccuracy=inaccuracy(observations, near, baseline.converter),
        laws=of_laws(observations, near),
        conditions={name: np.nan_to_num(UNREAD[name] * shifts[name]) for name in asked.conditions},
        unread=tuple(name for name in asked.conditions if name in observations.unread),
        lags=len(lags),
        rows=used,
        near=near,
        lines=lines,
        told=Predictions.of(used, asked.cases, tables).ending(list(at_end), last, end_s),
        state=state.spread(used, len(observations.frame)),
    )


def _heated(
    asked: Variants, tables: Sequence[Array], moved: Array, row: NDArray[np.intp], cores: Mapping[str, Array]
) -> Iterator[Heated]:
    """The parts whose temperature a spread sets; ``tables`` (C, N) are of variants, ``moved`` (K, M) of spreads.

    ``cores`` are slopes (M,) over the relative loss of a core, by the channel of its temperature.
    """
    place = {channel.column: k for k, channel in enumerate(CHANNELS)}
    for k, spread in enumerate(asked.spreads):
        if (column := PARTS.get(spread.path)) is not None:
            here_C, there_C = (t[place[column]] for t in (tables[0], tables[1 + len(asked.effects) + k]))
            core = cores.get(column, 0.0)
            yield Heated(column=column, step_K=(there_C - here_C)[row], moved=moved[k], core=core)


def _imitates(signature: Signature, others: list[Signature]) -> bool:
    """True for a threshold that few readings cross: the effect is then another one, none at all, or an outlier."""
    if not signature.entry.threshold:
        return False
    slope = np.nan_to_num(signature.slope)
    touched = int(np.count_nonzero(np.abs(slope) * signature.entry.headline.prior > _SILENT))
    if touched < _CROSSED:
        return True
    length = float(np.linalg.norm(slope))
    if length * signature.entry.headline.prior < _SILENT:
        return True
    for other in others:
        if not other.entry.threshold:
            beside = np.nan_to_num(other.slope)
            if abs(float(slope @ beside)) > _COLLINEAR * length * float(np.linalg.norm(beside)):
                return True
    return False


def _errors_of_inputs(observations: Observations, moved: Array) -> tuple[tuple[Array, Array], Array, Array]:
    """What errors of the measured inputs do to the prediction: of V1 and V2, of P2; and what a watt more does.

    ``moved`` (5, M) is what other inputs change, in the order of :mod:`models.diagnosis.variants`. The noise of P2 is
    already in the replicates of the input power, which follows it, and its rounding in that power's own; there it is
    zero. It is NaN for a D0 that bends sharply over power: where two edges pass each other at light load D0 jumps for
    little.
    """
    V1, V2, P2, more, less = moved
    folded = observations.of("D0") & ~(np.abs(more + less) < _FOLD)
    power = np.asarray(observations.points.power_W)[observations.row]
    rounded = step_of_output(observations) / np.sqrt(12) / np.where(power > 0, P2_NOISE * power, np.inf)
    P2 = np.where(folded, np.nan, P2) * np.hypot(1.0, rounded)
    follows = observations.of("efficiency") | observations.of("P_link1_W") | observations.of("P_link2_W")
    per_watt = (more - less) / np.where(power > 0, 2 * APART * power, np.inf)
    return (V1, V2), np.where(follows & ~folded, 0.0, np.abs(P2)), np.nan_to_num(per_watt)


def _instrument_spreads(
    observations: Observations, converter: Converter, expected: Array, per_watt: Array
) -> dict[str, Array]:
    """One-sigma directions of what instruments inside their specification may be off by, (M,) by name.

    Gains of the dc ports and the input's offset are the tolerances of the effects of that name. Beside them the
    output is good to 0.05 % of range and of reading, which every prediction at the measured P2 follows by ``per_watt``
    (M,), and an ac power to 0.3 % of reading and 0.2 % of range; a uniform error of
    that width has a sigma of width over root three. A temperature sensor is taken as good to half a kelvin,
    and shows some of the row before.
    Assumption: the power range in use is three quarters of the rated power, as overrange allows.
    """
    power = np.asarray(observations.points.power_W)[observations.row]
    efficiency, range_W = observations.of("efficiency"), 0.75 * converter.rated_power_W
    dc, ac = 5e-4 / _ROOT_3, 3e-3 / _ROOT_3
    offset_W, ac_offset_W = dc * range_W, 2e-3 / _ROOT_3 * range_W
    table = {
        "analyzer port 2 offset": offset_W * per_watt,
        "analyzer port 2 gain": np.where(efficiency, 0.0, dc * power * per_watt),  # there it is analyzer_gain
        "ac current gain": np.where(observations.of("I_L_rms_A"), ac * np.abs(expected), 0.0),
    }
    for link in ("P_link1_W", "P_link2_W"):
        table[f"{link} gain"] = np.where(observations.of(link), ac * power, 0.0)
        table[f"{link} offset"] = np.where(observations.of(link), ac_offset_W, 0.0)
    for sensor in ("T_heatsink_C", "T_transformer_C", "T_inductor_C"):
        table[f"{sensor} offset"] = np.where(observations.of(sensor), 0.5, 0.0)
        table[f"{sensor} lag"] = _LAG * _from_before(observations, sensor)
    return table


def _from_before(observations: Observations, name: str) -> Array:
    """How far each reading of a channel lies below the one before it in time, (M,); 0 without time."""
    drop, readings = np.zeros(observations.value.size), np.flatnonzero(observations.of(name))
    time_s = np.asarray(observations.points.time_s)[observations.row[readings]]
    if readings.size and np.ptp(time_s) > 0.0:
        ordered = readings[np.argsort(time_s, kind="stable")]
        drop[ordered[1:]] = -np.diff(observations.value[ordered])
    return drop
