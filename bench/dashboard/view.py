"""What is seen, as plain values made of what is stored: pure functions, and no word about how it looks."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from bench.dashboard.rows import Rows
from bench.dashboard.watcher import Feed, Overview
from bench.store import BenchRow, BenchState, LinkReport, Row, SeenMoment
from bench.wording import channel_name, counted, duration, minus, per_cent, points_text, unit_of

NEAR = 0.95  # of a limit: worth a second look
PHASES = ("setting", "settling", "measuring")
LEVELS = ("unsafe", "unconfirmed", "running", "paused", "waiting", "off", "unknown")


@dataclass(frozen=True, slots=True, kw_only=True)
class Banner:
    """The bench in one line and one level (one of ``LEVELS``); ``todo`` is what a person has to do now."""

    level: str
    title: str
    said: str
    todo: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitView:
    """A guarded quantity: ``level`` is good, near, above or missing."""

    label: str
    value: str
    limit: str
    share: float
    level: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkView:
    """An instrument: who it is, where, how old its last reading is, how well it answers."""

    name: str
    identity: str
    resource: str
    reading: str
    age: str
    quality: str
    failures: str
    level: str
    last_error: str


@dataclass(frozen=True, slots=True, kw_only=True)
class GapView:
    """Measured less simulated efficiency so far, in words; ``level`` is agree, off or nothing."""

    mean: str
    uncertainty: str
    measured: str
    simulated: str
    points: int
    level: str


# --- the bench ----------------------------------------------------------------------------------------


def banner(overview: Overview) -> Banner:
    """The most alarming thing that is known of any bench."""
    if not overview.benches:
        if overview.problem:
            return Banner(level="unknown", title="Nothing is known", said=overview.problem)
        return Banner(
            level="unknown", title="No bench yet", said="Nothing has ever been switched on from here."
        )
    return min(
        (_banner_of(bench, overview) for bench in overview.benches), key=lambda b: LEVELS.index(b.level)
    )


def lab_of(overview: Overview) -> str:
    """Where the campaigns come from: ``virtual``, ``hardware``, or ``both``; hardware while there is none."""
    labs = {"virtual" if row["virtual"] else "hardware" for row in overview.campaigns}
    return "both" if len(labs) > 1 else next(iter(labs), "hardware")


def _banner_of(bench: BenchRow, overview: Overview) -> Banner:
    row = overview.campaign(bench.campaign_id) if bench.campaign_id is not None else None
    if bench.state is BenchState.UNSAFE:
        return Banner(
            level="unsafe",
            title=f"UNSAFE: {bench.name}",
            said=f"since {clock(bench.unsafe_since)}:\n{bench.unsafe}",
            todo="Switch it off by hand and see that it is off. Then, at the bench: d2ea clear",
        )
    if bench.state is BenchState.UNCONFIRMED:
        return Banner(
            level="unconfirmed",
            title=f"Not seen off: {bench.name}",
            said="the campaign that switched it on is gone; its controller trips by itself when beats stay away",
            todo="See that it is off. d2ea resume switches it off and goes on; d2ea clear when you have seen it off",
        )
    if bench.state is BenchState.ON or (row is not None and row["is_live"]):
        return _running(bench, row)
    if bench.state is BenchState.OFF:
        said = f"seen off {clock(bench.seen_off)}" + (f": {bench.said}" if bench.said else "")
        return Banner(level="off", title=f"Off: {bench.name}", said=said)
    return Banner(level="unknown", title=bench.name, said="never switched on from here")


def _running(bench: BenchRow, row: Row | None) -> Banner:
    state = str(row["shown"]) if row else "running"
    said = f"campaign {row['id']}, {row['name']}" if row else "a campaign has it"
    if state == "paused":
        return Banner(
            level="paused", title=f"Paused: {bench.name}", said=f"{said}; the bench is off and waits"
        )
    if state == "waiting":
        return Banner(level="waiting", title=f"Waiting: {bench.name}", said=f"{said} waits for its time")
    title = "Checking" if state == "checking" else "Running"
    return Banner(level="running", title=f"{title}: {bench.name}", said=said)


# --- the campaign -------------------------------------------------------------------------------------


def gap(rows: Rows) -> GapView:
    """How far the simulation is off on the accepted rows; agreement is judged at two standard errors."""
    known = rows.where(rows.counted & np.isfinite(rows.efficiency - rows.predicted_efficiency))
    if not len(known):
        return GapView(mean="–", uncertainty="", measured="–", simulated="–", points=0, level="nothing")
    residuals = known.efficiency - known.predicted_efficiency
    mean, count = float(residuals.mean()), len(residuals)
    error = float(residuals.std(ddof=1)) / math.sqrt(count) if count > 1 else math.nan
    off = abs(mean) > 2 * error if math.isfinite(error) else False
    return GapView(
        mean=signed(mean),
        uncertainty=f"± {points_text(2 * error)} (2 σ)" if math.isfinite(error) else "",
        measured=per_cent(float(known.efficiency[-1]), 3),
        simulated=per_cent(float(known.predicted_efficiency[-1]), 3),
        points=count,
        level="off" if off else "agree",
    )


# --- limits and instruments ---------------------------------------------------------------------------


def limits(campaign: Row, moment: SeenMoment | None) -> list[LimitView]:
    """Every guarded quantity with its limit; the present value where there is one."""
    upper, readings = _upper(campaign), _present(moment)
    return [_limit(name, limit, readings.get(name)) for name, limit in upper.items()]


def _present(moment: SeenMoment | None) -> Mapping[str, float | None]:
    """Readings that are of now: a bench that is off or paused still has its last ones."""
    return moment.readings if moment and moment.phase in PHASES else {}


def _upper(campaign: Row) -> dict[str, float]:
    """Upper limits by column, from the bench that the campaign was planned on; empty for an imported one."""
    told = ((campaign["config"] or {}).get("bench") or {}).get("limits") or {}
    columns = {
        "V1_V": "voltage_V",
        "I1_A": "current_A",
        "P1_W": "power_W",
        "V2_V": "output_voltage_V",
        "T_heatsink_C": "heatsink_C",
        "T_transformer_C": "winding_C",
        "T_inductor_C": "winding_C",
    }
    return {column: float(told[key]) for column, key in columns.items() if told.get(key) is not None}


def _limit(name: str, limit: float, value: float | None) -> LimitView:
    unit = unit_of(name)
    share = value / limit if value is not None and limit > 0 else 0.0
    level = "missing" if value is None else "above" if share > 1 else "near" if share > NEAR else "good"
    return LimitView(
        label=channel_name(name),
        value="–" if value is None else f"{value:.1f} {unit}",
        limit=f"{limit:g} {unit}",
        share=min(max(share, 0.0), 1.0),
        level=level,
    )


SHOWN_OF = {
    "analyzer": ("P1_W", "P2_W"),
    "supply": ("V1_V", "I1_A"),
    "load": ("V2_V", "I2_A"),
    "controller": ("D0", "T_heatsink_C"),
}


def links(campaign: Row, moment: SeenMoment | None, now: datetime) -> list[LinkView]:
    """The instruments of a campaign's bench."""
    identities = campaign["instruments"] or {}
    reports = moment.instruments if moment else {}
    since_s = (now - datetime.fromisoformat(moment.written)).total_seconds() if moment else 0.0
    names = dict.fromkeys((*SHOWN_OF, *identities, *reports))
    return [
        _link(name, str(identities.get(name, "")), reports.get(name), (moment, since_s))
        for name in names
        if name in identities or name in reports
    ]


def _link(
    name: str, identity: str, report: LinkReport | None, seen: tuple[SeenMoment | None, float]
) -> LinkView:
    moment, since_s = seen
    readings = _present(moment)
    values = [(column, readings.get(column)) for column in SHOWN_OF.get(name, ())]
    said = ", ".join(
        f"{channel_name(column)} {minus(f'{value:.4g}')} {unit_of(column)}".strip()
        for column, value in values
        if value is not None
    )
    quality = report.quality if report else None
    age_s = report.age_s + since_s if report and report.age_s is not None else None
    return LinkView(
        name=name,
        identity=identity or "not identified yet",
        resource=report.resource if report else "",
        reading=said or "–",
        age=duration(age_s) if age_s is not None else "–",
        quality="–" if quality is None else f"{100 * quality:.2f} %",
        failures=f"{report.failures} of {report.exchanges} failed" if report else "nothing runs on it now",
        level="unknown"
        if quality is None
        else "good"
        if quality > 0.999
        else "near"
        if quality > 0.95
        else "above",
        last_error=report.last_error if report else "",
    )


# --- words --------------------------------------------------------------------------------------------


def signed(fraction: float) -> str:
    """A difference of efficiency with its sign, in points.

    >>> signed(-0.0112)
    '−1.120'
    """
    return f"{100 * fraction:+.3f}".replace("-", "−")


def clock(stamp: str | None) -> str:
    """A stored time for people: local time, with the date when it is not today's."""
    if not stamp:
        return ""
    local = datetime.fromisoformat(stamp).astimezone()
    today = datetime.now(UTC).astimezone().date()
    return f"{local:%H:%M:%S}" if local.date() == today else f"{local:%Y-%m-%d %H:%M}"


STEPS = frozenset({"planned", "set", "settled", "measured", "chosen"})  # of a point: many, and seen elsewhere


def happened(feed: Feed, most: int = 12) -> list[tuple[str, str, str]]:
    """(when, what, detail) of the last things worth a line, the newest first."""
    rows = {row["id"]: row for row in feed.recent}
    lines = []
    for event in reversed(feed.events):
        row = rows.get(event["point_id"])
        if event["event"] in STEPS and event["point_id"] is not None:
            continue
        detail = str(event["detail"] or "") if row is None else _row_text(row, str(event["detail"] or ""))
        lines.append((clock(event["written"]), str(event["event"]), detail))
    return lines[:most]


def _row_text(row: Row, reason: str) -> str:
    place = f"D1 {row['D1']:.3f}, D2 {row['D2']:.3f}, {row['P_set_W']:.0f} W"
    measured = f": {per_cent(row['efficiency'], 3)}" if row["efficiency"] is not None else f": {row['kind']}"
    return place + measured + (f"; {reason}" if reason else "")


def campaign_rows(overview: Overview) -> list[dict[str, str]]:
    """All campaigns, the newest first, as words."""
    return [
        {
            "id": str(row["id"]),
            "name": str(row["name"]),
            "state": str(row["shown"]),
            "lab": "virtual" if row["virtual"] else "hardware",
            "rows": f"{row['accepted']} of {row['planned']}",
            "rejected": counted(row["rejected"], "row") if row["rejected"] else "none",
            "created": clock(row["created"]),
            "ended": clock(row["ended"]) if row["ended"] else "–",
            "off": str(row["power_off"] or ""),
            "error": str(row["error"] or ""),
        }
        for row in sorted(overview.campaigns, key=lambda row: -row["id"])
    ]
