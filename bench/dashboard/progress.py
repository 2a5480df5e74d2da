"""How far a campaign is, in plain values: rows, the present point and its question, time left."""

from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from statistics import median

from bench.dashboard.watcher import Feed
from bench.plan import most_rows
from bench.states import State
from bench.store import Row, SeenMoment
from bench.wording import duration

STALE_S = 15.0  # real seconds without news from a campaign that runs
RECENT = 30  # judged rows that tell how fast it goes


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgressView:
    """How far a campaign is; shares are fractions, ``left`` is words, empty while nobody knows.

    ``planned`` is the most there may be where ``at_most``: the plan grows. ``why`` is the present point's question.
    """

    name: str
    number: int
    state: str
    done: int
    planned: int
    at_most: bool
    rejected: int
    left: str
    point: str
    why: str
    phase: str
    settling: str
    settling_share: float
    asked: str
    stale: str

    @property
    def share(self) -> float:
        """Rows judged, of those planned."""
        return self.done / self.planned if self.planned else 0.0


def progress(feed: Feed, now: datetime) -> ProgressView:
    """Where the campaign stands."""
    row, moment = feed.campaign, feed.moment
    live = bool(row["is_live"])
    settling = moment.settling if moment and live else None
    return ProgressView(
        name=str(row["name"]),
        number=int(row["id"]),
        state=str(row["shown"]),
        done=len(feed.rows),
        planned=_planned(feed),
        at_most=_grows(feed) is not None,
        rejected=feed.rejected,
        left=_left(feed) if live and row["shown"] == "running" else "",
        point=_point(feed) if live else "",
        why=str((_present_point(feed) or {}).get("why") or "") if live else "",
        phase=moment.phase if moment and live else "",
        settling=_settling(settling.elapsed_s, settling.limit_s, settling.moving) if settling else "",
        settling_share=min(1.0, settling.elapsed_s / settling.window_s) if settling else 0.0,
        asked="" if row["shown"] == "paused" else str(row["request"] or ""),
        stale=_stale(moment, now) if live else "",
    )


def _left(feed: Feed) -> str:
    """Time left in words, from the pace of the last rows."""
    times = [datetime.fromisoformat(item["judged"]) for item in feed.recent[-RECENT:]]
    steps = [(b - a).total_seconds() for a, b in pairwise(times)]
    if not steps:
        return ""
    about = "at most" if _grows(feed) else "about"
    return f"{about} {duration(median(steps) * (_planned(feed) - len(feed.rows)))} left"


def _grows(feed: Feed) -> int | None:
    """The most rows of a plan that may still grow."""
    ended = feed.campaign["shown"] in (State.DONE, State.IMPORTED)
    return None if ended else most_rows(feed.campaign["config"] or {})


def _planned(feed: Feed) -> int:
    return _grows(feed) or int(feed.campaign["planned"])


def _present_point(feed: Feed) -> Row | None:
    point_id = feed.moment.point_id if feed.moment else None
    return feed.points.get(point_id) if point_id is not None else None


def _point(feed: Feed) -> str:
    row = _present_point(feed)
    if row is None:
        return ""
    if row["kind"] == "standby":
        return "standby: PWM off, load off"
    modulation = f"D1 {row['D1']:.3f}, D2 {row['D2']:.3f}"
    if row["kind"] == "no_load":
        return f"no load: {modulation}"
    return f"{modulation}, {row['P_set_W']:.0f} W" + (" (reference)" if row["kind"] == "reference" else "")


def _settling(elapsed_s: float, limit_s: float, moving: str) -> str:
    still = f"; still moving: {moving}" if moving else ""
    return f"{elapsed_s:.0f} s, given up after {limit_s:.0f} s{still}"


def _stale(moment: SeenMoment | None, now: datetime) -> str:
    if moment is None:
        return ""
    silent_s = (now - datetime.fromisoformat(moment.written)).total_seconds()
    return f"no news for {duration(silent_s)}" if silent_s > STALE_S else ""
