r"""What to measure next: the points and actions that tell the remaining explanations apart, best per minute.

For two explanations i and j that fit what was measured, a reading with noise sigma separates them by
:math:`d_{ij} = |y_i - y_j| / \sigma`, summed in squares over channels. Steps are chosen one after the other: each is
worth :math:`\sum p_i p_j \exp(-D_{ij}^2/2) \, d_{ij}^2 / 2` per minute, with :math:`D_{ij}` what the steps before
it separate already. Where no step can, the channel is named that would.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.evidence import Hypothesis
from models.diagnosis.observations import CHANNELS, Channel, Observations
from models.diagnosis.refinery import Refinery
from sim.model import Model
from sim.operating_points import Points
from sim.simulate import can_run, simulate_many

Array = NDArray[np.float64]

MOST_STEPS = 10
SEPARATED = 4.0  # sigmas at which the worse of two explanations keeps less than one part in a thousand
_LEAST = 0.01  # probability from which an explanation takes part
_MOST_RIVALS = 6
_WORTH_DOING = 0.5  # sigmas
_POINT_MIN, _STANDBY_MIN, _REBUILD_MIN = 4.0, 1.5, 15.0
_AMBIENT_K, _DEAD_TIME_s = 15.0, 200e-9
_SIGMA = {
    "P1_W": 1.5e-4, "P_link1_W": 5e-4, "P_link2_W": 5e-4, "I_L_rms_A": 5e-4, "D0": 2e-4,
    "T_heatsink_C": 0.3, "T_inductor_C": 0.4, "T_transformer_C": 0.4,
}  # fmt: skip
_OF_READING = ("P1_W", "P_link1_W", "P_link2_W", "I_L_rms_A")
_LEAST_SIGMA = {"P1_W": 0.05, "P_link1_W": 0.2, "P_link2_W": 0.2, "I_L_rms_A": 2e-3}
_PORT_1 = ("analyzer_gain", "analyzer_offset", "analyzer_range_step")
_WINDING_Ohm = 1e-3  # what four wires are good to


@dataclass(frozen=True, slots=True, kw_only=True)
class NextMeasurement:
    """An action, the effects it separates, by how many sigmas, the bench minutes it takes, and its set point."""

    action: str
    separates: tuple[str, ...]
    expected_sigma: float
    minutes: float
    set_point: tuple[float, float, float] | None = None

    def as_plain(self) -> dict[str, object]:
        """For the JSON answer."""
        at = {} if self.set_point is None else dict(zip(("D1", "D2", "P_W"), self.set_point, strict=True))
        return {
            "action": self.action,
            "separates": list(self.separates),
            "expected_sigma": self.expected_sigma,
            "minutes": self.minutes,
            **at,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Rival:
    """An explanation that is still possible: its effects, probability and the model that it makes."""

    effects: tuple[str, ...]
    probability: float
    model: Model


@dataclass(frozen=True, slots=True, kw_only=True)
class _Options:
    """Things to do: names, minutes, set points (or None), and every rival's readings there (R, K, channels)."""

    actions: list[str]
    minutes: Array
    set_points: list[tuple[float, float, float] | None]
    readings: Array
    sigma: Array


def rivals_of(hypotheses: Sequence[Hypothesis], refinery: Refinery) -> list[Rival]:
    """The most probable explanations, one for each set of effects, at their own everyday spreads."""
    total: dict[tuple[str, ...], float] = {}
    fits = {}
    for h in hypotheses:
        fits.setdefault(h.fit.effects, h.fit)
        total[h.fit.effects] = total.get(h.fit.effects, 0.0) + h.probability
    chosen = sorted((p, e) for e, p in total.items() if p >= _LEAST)[::-1][:_MOST_RIVALS]
    return [
        Rival(effects=e, probability=p, model=refinery.model(fits[e], refinery.spreads(fits[e]))) for p, e in chosen
    ]


def next_measurements(
    observations: Observations, rivals: Sequence[Rival], most: int = MOST_STEPS
) -> list[NextMeasurement]:
    """The steps to take, in their order, until the rivals are apart; none where one explanation is left."""
    if len(rivals) < 2:
        return []
    present = [c for c in CHANNELS if c in observations.channels]
    options = _options(observations, rivals, present)
    steps, apart = _chosen(options, rivals, most)
    tied = [pair for pair, d2 in apart.items() if d2 < SEPARATED**2 and _differ(rivals, pair)]
    if tied:
        missing = _missing_channel(observations, rivals, tied[0])
        steps += [missing] if missing is not None else []
    return steps


def _differ(rivals: Sequence[Rival], pair: tuple[int, int]) -> tuple[str, ...]:
    """Effects that one of two explanations has and the other has not."""
    one, other = (set(rivals[k].effects) for k in pair)
    return tuple(sorted(one ^ other))


def _chosen(
    options: _Options, rivals: Sequence[Rival], most: int
) -> tuple[list[NextMeasurement], dict[tuple[int, int], float]]:
    """Steps in the order of their worth, and what they separate each pair by, squared."""
    pairs = list(combinations(range(len(rivals)), 2))
    probability = np.array([r.probability for r in rivals])
    weight = np.array([probability[i] * probability[j] for i, j in pairs])
    d2 = np.stack([_distance2(options.readings[i], options.readings[j], options.sigma) for i, j in pairs])
    reached = np.zeros(len(pairs))
    steps: list[NextMeasurement] = []
    while len(steps) < most and np.any(reached < SEPARATED**2):
        worth = (weight * np.exp(-0.5 * np.minimum(reached, 60.0))) @ d2 / options.minutes
        best = int(np.argmax(worth))
        open_pairs = np.where(reached < SEPARATED**2, weight * d2[:, best], 0.0)
        first = int(np.argmax(open_pairs))
        if d2[first, best] < _WORTH_DOING**2:
            break
        reached = reached + d2[:, best]
        steps.append(
            NextMeasurement(
                action=options.actions[best],
                separates=_differ(rivals, pairs[first]),
                expected_sigma=float(np.sqrt(d2[first, best])),
                minutes=float(options.minutes[best]),
                set_point=options.set_points[best],
            )
        )
    return steps, dict(zip(pairs, reached.tolist(), strict=True))


def _distance2(a: Array, b: Array, sigma: Array) -> Array:
    """Squared separation of two explanations by every option, summed over channels, (K,)."""
    return np.asarray(np.sum(np.nan_to_num((a - b) / sigma) ** 2, axis=-1))


def _missing_channel(
    observations: Observations, rivals: Sequence[Rival], pair: tuple[int, int]
) -> NextMeasurement | None:
    """The channel that is not measured and would separate two rivals best, with the point to use it at."""
    absent = [c for c in CHANNELS if c not in observations.channels]
    if not absent:
        return None
    two = [rivals[k] for k in pair]
    options = _options(observations, two, absent)
    d2 = (np.nan_to_num((options.readings[0] - options.readings[1]) / options.sigma)) ** 2
    option, channel = np.unravel_index(int(np.argmax(d2)), d2.shape)
    sigmas = float(np.sqrt(d2[option, channel]))
    if sigmas < _WORTH_DOING:
        return None
    return NextMeasurement(
        action=f"no point will do with these channels: measure {absent[channel].column} as well",
        separates=_differ(rivals, pair),
        expected_sigma=sigmas,
        minutes=float(options.minutes[option]),
        set_point=options.set_points[option],
    )


def _options(observations: Observations, rivals: Sequence[Rival], channels: Sequence[Channel]) -> _Options:
    """Everything that can be done, as every rival sees it."""
    points, names, minutes, where = _points(observations, rivals)
    again = int(np.argmax(np.asarray(points.power_W)))
    one = points.take(np.array([again]))
    warmer = replace(one, ambient_C=np.asarray(one.ambient_C) + _AMBIENT_K)
    whole = Points.join([points, warmer])
    columns = [c.column for c in channels]
    models = [r.model for r in rivals]
    seen = [np.stack([result[c] for c in columns], axis=-1) for result in simulate_many(models, whole)]
    altered: list[tuple[str, float, Callable[[Model], Model]]] = [
        (f"with {_DEAD_TIME_s * 1e9:.0f} ns more dead time, at", _REBUILD_MIN, _with_more_dead_time),
        ("with the analyzer's elements swapped, at", _REBUILD_MIN, _with_elements_swapped),
    ]
    for _, _, change in altered:
        results = simulate_many([change(m) for m in models], one)
        seen = [np.concatenate([s, np.stack([r[c] for c in columns], axis=-1)]) for s, r in zip(seen, results, strict=True)]
    spot = _said(where[again])
    names = [*names, f"warm the room by {_AMBIENT_K:.0f} K and measure {spot}", *(f"{n} {spot}" for n, _, _ in altered)]
    minutes = [*minutes, 4 * _REBUILD_MIN, *(m for _, m, _ in altered)]
    readings, sigma = np.stack(seen), _sigma(channels, np.concatenate([np.asarray(whole.power_W), *[np.asarray(one.power_W)] * 2]))
    ohms = np.array([_link_Ohm(m) for m in models])
    readings = np.concatenate([readings, np.full((len(models), 1, len(columns)), np.nan)], axis=1)
    readings[:, -1, 0], sigma = ohms, np.concatenate([sigma, np.full((1, len(columns)), _WINDING_Ohm)])
    return _Options(
        actions=[*names, "measure the ac link's resistance with four wires, warm"],
        minutes=np.array([*minutes, _REBUILD_MIN]),
        set_points=[*where, *[where[again]] * 3, None],
        readings=readings,
        sigma=sigma,
    )


def _said(at: tuple[float, float, float] | None) -> str:
    assert at is not None
    return f"D1 = {at[0]:.3f}, D2 = {at[1]:.3f}, {at[2]:.0f} W"


def _points(
    observations: Observations, rivals: Sequence[Rival]
) -> tuple[Points, list[str], list[float], list[tuple[float, float, float] | None]]:
    """Standby, no load, and set points over the measured ranges that every rival can run."""
    p, loaded = observations.points, observations.loaded
    axes = [
        np.linspace(np.min(x[loaded]), np.max(x[loaded]), count)
        for x, count in ((np.asarray(p.D1), 5), (np.asarray(p.D2), 5), (np.asarray(p.power_W), 6))
    ]
    D1, D2, power = (a.ravel() for a in np.meshgrid(*axes, indexing="ij"))
    D1, D2, power = (np.concatenate([np.asarray(a)[loaded], b]) for a, b in ((p.D1, D1), (p.D2, D2), (p.power_W, power)))
    V1, V2 = float(np.median(np.asarray(p.V1_V)[loaded])), float(np.median(np.asarray(p.V2_V)[loaded]))
    end_s = float(np.max(np.asarray(p.time_s)))

    def at(D1: Array, D2: Array, power: Array, pwm: Array) -> Points:
        return Points(D1=D1, D2=D2, power_W=power, V1_V=V1, V2_V=V2, time_s=end_s, pwm=pwm)

    spare = at(D1, D2, 1.05 * power, np.ones(D1.size, dtype=bool))
    runs = np.all([can_run(r.model, spare) for r in rivals], axis=0)
    D1, D2, power = D1[runs], D2[runs], power[runs]
    idle = float(np.median(D1)), float(np.median(D2))
    unloaded = ~np.isin(["standby", "no_load"], observations.frame["kind"].unique())
    pwm = np.array([False, True, *np.ones(D1.size, dtype=bool)])
    points = at(np.array([1.0, idle[0], *D1]), np.array([0.0, idle[1], *D2]), np.array([0.0, 0.0, *power]), pwm)
    where = [None, None, *zip(D1.tolist(), D2.tolist(), power.tolist(), strict=True)]
    names = ["standby", "no_load", *(f"measure {_said(w)}" for w in where[2:])]
    # a kind that was not measured yet needs no more than its own time
    minutes = [_STANDBY_MIN, _STANDBY_MIN if unloaded[1] else _POINT_MIN, *[_POINT_MIN] * D1.size]
    return points, names, minutes, where


def _with_more_dead_time(model: Model) -> Model:
    longer = replace(model.converter, dead_time_s=model.converter.dead_time_s + _DEAD_TIME_s)
    return replace(model, converter=longer)


def _with_elements_swapped(model: Model) -> Model:
    """What is wrong with port 1 then reads the output: the input power appears wrong by as much the other way."""
    for name in _PORT_1:
        if name in model.effects:
            values = dict(model.effects[name])
            head = next(iter(values))
            model = model.with_effect(name, **{**values, head: -values[head]})
    return model


def _link_Ohm(model: Model) -> float:
    """Resistance of the ac link at dc, primary side, as four wires would find it."""
    c = model.altered_converter()
    return c.link_resistance_Ohm + c.inductor.winding.resistance_Ohm + c.transformer.winding.resistance_Ohm


def _sigma(channels: Sequence[Channel], power_W: Array) -> Array:
    """Noise of one averaged reading at every option, (K, channels)."""
    columns = []
    for c in channels:
        scale = power_W if c.column != "I_L_rms_A" else power_W / 200.0  # Assumption: some 200 V of ac link
        relative = _SIGMA[c.column] * scale
        constant = np.full(power_W.size, _SIGMA[c.column])
        columns.append(np.maximum(relative, _LEAST_SIGMA[c.column]) if c.column in _OF_READING else constant)
    return np.stack(columns, axis=-1)
