"""From a campaign's settings to the list of rows to measure: inspectable without any instrument.

Order: standby rows, no-load rows, a reference point, then the points in the order asked for with the
reference again after every N, and once more at the end. Only points that the simulator can reach, and that
it does not see beyond the bench's limits, are planned; the others are counted by reason. An adaptive plan begins
with some of its candidates, spread out, and grows (:mod:`bench.adaptive`).
"""

import csv
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.config import BenchConfig, CampaignConfig
from bench.errors import InputError, Problem
from bench.plan_config import AdaptiveConfig, PlanConfig, SetPointConfig
from bench.prediction import Asked, Predictor
from bench.within import Within
from bench.wording import alike

AMBIENT_C = 25.0  # the plan is made before anything is measured
# of the power, that a candidate must leave: closer to the most that is carried nothing can be told
SPARE = 0.12
TRIES_PER_POINT = 200  # a box with less than 1/200 feasible is a mistake in its ranges
CSV_COLUMNS = ("D1", "D2", "P_set_W")

Box = NDArray[np.float64]  # (N, 3): D1, D2, power_W


class Kind(StrEnum):
    """What a row of a campaign is for."""

    LOAD = "load"
    REFERENCE = "reference"
    STANDBY = "standby"  # supply on, PWM off
    NO_LOAD = "no_load"  # PWM on, load off


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedPoint:
    """One row to measure; ``point`` numbers the distinct set points, ``repeat`` counts its rows.

    ``why`` is the question that it answers, where the campaign chose it itself.
    """

    point: int
    repeat: int
    kind: Kind
    D1: float
    D2: float
    power_W: float
    why: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The rows in the order they are measured, and what was left out; ``most`` rows where the plan may grow."""

    points: tuple[PlannedPoint, ...]
    tried: int
    infeasible: Mapping[str, int]  # reason → count
    most: int | None = None

    def said(self) -> str:
        """The plan in one line for people."""
        kinds = Counter(row.kind.value for row in self.points)
        parts = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        if self.most is not None:
            parts += f"; more are chosen from what is measured, {self.most} in all at most"
        left_out = sum(self.infeasible.values())
        if not left_out:
            return f"{len(self.points)} rows ({parts}); all {self.tried} set points tried are feasible"
        return (
            f"{len(self.points)} rows ({parts}); "
            f"{left_out} of {self.tried} set points tried are infeasible: {_listed(self.infeasible)}"
        )


def _listed(reasons: Mapping[str, int]) -> str:
    """Why set points were left out, each reason with its count."""
    return "; ".join(f"{count} × {reason}" for reason, count in reasons.items())


def make_plan(
    campaign: CampaignConfig, bench: BenchConfig, predict: Predictor, *, file: str, bench_file: str = ""
) -> Plan:
    """The plan of ``campaign`` on ``bench``; InputError for points outside its limits.

    It names ``file`` of the campaign, or ``bench_file``; the bench itself where that is not known.
    """
    rng = np.random.default_rng(campaign.seed)
    plan = campaign.plan
    _refuse_outside_limits(campaign, bench, file)
    predict = Within(predict, bench, plan)
    if plan.kind == "latin_hypercube":
        feasible, tried, left_out = _latin_hypercube(campaign, plan.points or 0, predict, rng, file)
    elif plan.adaptive is not None:
        pool, tried, left_out = candidates_of(campaign, bench, predict, file)
        feasible = pool[spread_out(pool, plan.adaptive.start)]
    else:
        candidates = _grid(campaign) if plan.kind == "grid" else _explicit(plan, bench, file)
        feasible, left_out = _reachable(candidates, predict)
        tried = len(candidates)
    if not len(feasible):
        said = f"none of {tried} set points is feasible: {_listed(left_out)}; {_what_helps(plan)}"
        raise InputError.of(file, "plan", None, said)
    reference = _reference(plan, feasible, predict, file)
    largest_W = max(feasible[:, 2].max(), reference.power_W)
    start = _start(bench, largest_W, predict, bench_file or f"bench {bench.name!r}")
    rows = _rows(plan, feasible, (reference, start), rng)
    most = _budget(plan, len(rows), file)
    return Plan(points=tuple(_numbered(rows)), tried=tried, infeasible=dict(left_out), most=most)


def _budget(plan: PlanConfig, begun: int, file: str) -> int | None:
    """The most rows of a plan that grows; InputError when it ends before it has begun."""
    if plan.adaptive is None:
        return None
    most = plan.points or 0
    if most <= begun:
        raise InputError.of(
            file, "plan.points", most, f"more than the {begun} rows that the plan begins with"
        )
    return most


def most_rows(config: Mapping[str, Any]) -> int | None:
    """The most rows of a stored campaign whose plan grows, from its settings; None where the plan is whole."""
    plan = (config.get("campaign") or {}).get("plan") or {}
    return int(plan["points"]) if plan.get("adaptive") else None


# --- the set points ---------------------------------------------------------------------------------


def candidates_of(
    campaign: CampaignConfig, bench: BenchConfig, predict: Predictor, file: str
) -> tuple[Box, int, Counter[str]]:
    """What an adaptive plan may choose from: within the limits of the bench, with power to spare; by its seed.

    Returns them with how many were tried, and the reasons of those left out; InputError when too few are left.
    """
    settings = campaign.plan.adaptive or AdaptiveConfig()
    within = Within(predict, bench, campaign.plan, spare=SPARE)
    return _latin_hypercube(campaign, settings.candidates, within, np.random.default_rng(campaign.seed), file)


def spread_out(pool: Box, count: int) -> NDArray[np.intp]:
    """Indices (count,) of points far from each other: the most central one, then always the loneliest."""
    spread = np.ptp(pool, axis=0)
    scaled = (pool - np.median(pool, axis=0)) / np.where(spread > 0, spread, 1.0)
    chosen = [int(np.argmin((scaled**2).sum(axis=1)))]
    near = np.full(len(pool), np.inf)
    while len(chosen) < min(count, len(pool)):
        near = np.minimum(near, ((scaled - scaled[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(near)))
    return np.array(chosen)


def _latin_hypercube(
    campaign: CampaignConfig, wanted: int, predict: Predictor, rng: np.random.Generator, file: str
) -> tuple[Box, int, Counter[str]]:
    """One hypercube, large enough that its feasible part holds the points asked for; a choice of them."""
    from scipy.stats import qmc  # here: it takes half a second to load, and every verb would pay

    low, high = _corners(campaign)
    size = wanted
    while size <= TRIES_PER_POINT * wanted:
        unit = qmc.LatinHypercube(d=3, rng=rng).random(size)
        feasible, left_out = _reachable(low + unit * (high - low), predict)
        if len(feasible) >= wanted:
            keep = np.sort(rng.choice(len(feasible), wanted, replace=False))
            return feasible[keep], size, left_out
        size = max(size + 1, math.ceil(1.1 * size * wanted / max(len(feasible), 1)))
    said = f"hold fewer than {wanted} feasible points in {size} tries: {_listed(left_out)}"
    raise InputError.of(file, "ranges", None, f"{said}; {_what_helps(campaign.plan)}")


def _what_helps(plan: PlanConfig) -> str:
    """What to do where next to nothing of a plan is feasible."""
    first = (
        "change its set points" if plan.kind == "points" else "narrow ranges.power_W, move ranges.D1 and D2"
    )
    return f"{first}, or check the bench: its limits, its [converter] and the model of that"


def _grid(campaign: CampaignConfig) -> Box:
    low, high = _corners(campaign)
    shape = campaign.plan.shape or (1, 1, 1)
    axes = [np.linspace(low[axis], high[axis], count) for axis, count in enumerate(shape)]
    return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)


def _explicit(plan: PlanConfig, bench: BenchConfig, file: str) -> Box:
    if plan.file is not None:
        return _from_csv(plan.file, bench.limits.power_W)
    points = plan.set_points or []
    problems = [
        Problem(
            file=file,
            field=f"plan.set_points.{number}.power_W",
            value=point.power_W,
            allowed=f"at most limits.power_W = {bench.limits.power_W:g} W of the bench",
        )
        for number, point in enumerate(points)
        if point.power_W > bench.limits.power_W
    ]
    if problems:
        raise InputError(problems)
    return np.array([[point.D1, point.D2, point.power_W] for point in points], dtype=float).reshape(-1, 3)


def _from_csv(path: Path, limit_W: float) -> Box:
    """Set points of a CSV; every bad cell is reported with its line."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as handle:
            reader = csv.DictReader(handle)
            header = reader.fieldnames or []
            rows = [(reader.line_num, row) for row in reader]
    except OSError as error:
        raise InputError.of(path, "plan.file", None, f"cannot be read: {error.strerror}") from error
    missing = [name for name in CSV_COLUMNS if name not in header]
    if missing:
        allowed = f"column is missing; required are {', '.join(CSV_COLUMNS)}; found: {', '.join(header)}"
        raise InputError(
            [Problem(file=str(path), field=name, value=None, allowed=allowed) for name in missing]
        )
    allowed_range = {"D1": (0.0, 1.0), "D2": (0.0, 1.0), "P_set_W": (math.ulp(0.0), limit_W)}
    problems: list[Problem] = []
    points = [[_cell(path, line, row, name, allowed_range[name], problems) for name in CSV_COLUMNS]
              for line, row in rows]  # fmt: skip
    if problems:
        raise InputError(problems)
    return np.array(points, dtype=float).reshape(-1, 3)


def _cell(
    path: Path,
    line: int,
    row: Mapping[str, str],
    name: str,
    allowed: tuple[float, float],
    problems: list[Problem],
) -> float:
    low, high = allowed
    try:
        value = float(row[name])
    except (TypeError, ValueError):
        value = math.nan
    if not low <= value <= high:
        said = f"a number above 0, at most {high:g} W" if name == "P_set_W" else "a number from 0 to 1"
        problems.append(Problem(file=str(path), field=name, value=row[name], allowed=said, line=line))
    return value


def _corners(campaign: CampaignConfig) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    box = np.array([campaign.ranges.D1, campaign.ranges.D2, campaign.ranges.power_W], dtype=float)
    return box[:, 0], box[:, 1]


def _reachable(candidates: Box, predict: Predictor) -> tuple[Box, Counter[str]]:
    """The feasible ones, and how many of the others have which reason, whatever number it names."""
    feasible, reasons = _judged(candidates, predict)
    return candidates[feasible], alike(Counter(reasons))


def _judged(candidates: Box, predict: Predictor) -> tuple[NDArray[np.bool_], list[str]]:
    """Which are feasible, (N,), and why each of the others is not."""
    D1, D2, power_W = candidates.T
    forecast = predict(Asked(D1=D1, D2=D2, power_W=power_W, ambient_C=AMBIENT_C))
    return forecast.feasible, [str(reason) for reason in forecast.reason[~forecast.feasible]]


def _refuse_outside_limits(campaign: CampaignConfig, bench: BenchConfig, file: str) -> None:
    limit_W = bench.limits.power_W
    problems = []
    if campaign.plan.kind != "points" and campaign.ranges.power_W[1] > limit_W:
        problems.append(("ranges.power_W", campaign.ranges.power_W[1]))
    if campaign.plan.reference is not None and campaign.plan.reference.power_W > limit_W:
        problems.append(("plan.reference.power_W", campaign.plan.reference.power_W))
    if problems:
        allowed = f"at most limits.power_W = {limit_W:g} W of the bench"
        raise InputError(
            [Problem(file=file, field=field, value=value, allowed=allowed) for field, value in problems]
        )


# --- the rows ---------------------------------------------------------------------------------------


def _reference(plan: PlanConfig, feasible: Box, predict: Predictor, file: str) -> SetPointConfig:
    """The reference asked for, else the feasible point nearest to the middle of all of them."""
    if plan.reference is None:
        spread = np.ptp(feasible, axis=0)
        scaled = (feasible - np.median(feasible, axis=0)) / np.where(spread > 0, spread, 1.0)
        D1, D2, power_W = feasible[np.argmin((scaled**2).sum(axis=1))]
        return SetPointConfig(D1=float(D1), D2=float(D2), power_W=float(power_W))
    wanted = plan.reference
    _, reasons = _judged(np.array([[wanted.D1, wanted.D2, wanted.power_W]]), predict)
    if reasons:
        raise InputError.of(file, "plan.reference", None, f"is infeasible: {reasons[0]}; choose another")
    return wanted


def _start(bench: BenchConfig, largest_W: float, predict: Predictor, file: str) -> tuple[float, float]:
    """The modulation to start with; InputError when it does not carry no load and the largest power."""
    D1, D2 = bench.converter.start_D1, bench.converter.start_D2
    _, reasons = _judged(np.array([[D1, D2, 0.0], [D1, D2, largest_W]]), predict)
    if reasons:
        why = "; ".join(dict.fromkeys(reasons))
        said = f"must carry every power from none to {largest_W:.0f} W; the simulator says: {why}"
        raise InputError.of(file, "converter.start_D1, start_D2", (D1, D2), said)
    return D1, D2


def _rows(
    plan: PlanConfig,
    feasible: Box,
    special: tuple[SetPointConfig, tuple[float, float]],
    rng: np.random.Generator,
) -> list[PlannedPoint]:
    number = len(feasible)
    reference, (start_D1, start_D2) = special
    at_reference = PlannedPoint(
        point=number,
        repeat=0,
        kind=Kind.REFERENCE,
        D1=reference.D1,
        D2=reference.D2,
        power_W=reference.power_W,
    )
    idle = replace(at_reference, D1=start_D1, D2=start_D2, power_W=0.0)
    standby = replace(idle, point=number + 1, kind=Kind.STANDBY)
    no_load = replace(idle, point=number + 2, kind=Kind.NO_LOAD)
    every = plan.reference_every
    rows = [standby] * plan.standby + [no_load] * plan.no_load + [at_reference] * bool(every)
    for done, row in enumerate(_ordered(plan, feasible, rng), start=1):
        rows.append(row)
        if every and done % every == 0:
            rows.append(at_reference)
    return rows if not every or rows[-1] is at_reference else [*rows, at_reference]


def _ordered(plan: PlanConfig, feasible: Box, rng: np.random.Generator) -> list[PlannedPoint]:
    rows = [
        PlannedPoint(
            point=number, repeat=0, kind=Kind.LOAD, D1=float(D1), D2=float(D2), power_W=float(power_W)
        )
        for _ in range(plan.repeats)
        for number, (D1, D2, power_W) in enumerate(feasible)
    ]
    if plan.order == "random":
        return [rows[index] for index in rng.permutation(len(rows))]
    return sorted(rows, key=lambda row: row.power_W) if plan.order == "power" else rows


def _numbered(rows: list[PlannedPoint]) -> Iterator[PlannedPoint]:
    """Count the repeats of each point in the order they will be measured."""
    seen: Counter[int] = Counter()
    for row in rows:
        yield replace(row, repeat=seen[row.point])
        seen[row.point] += 1
