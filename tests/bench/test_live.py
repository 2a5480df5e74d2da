"""Progress of a campaign: a table on a terminal, plain lines elsewhere."""

import io
from dataclasses import replace

import pytest
from rich.console import Console

from bench.commands import live as module
from bench.plan import Kind, Plan, PlannedPoint
from bench.progress import Progress, Tracker
from drivers.clock import StepClock

ROW = PlannedPoint(point=1, repeat=0, kind=Kind.LOAD, D1=0.8, D2=0.1, power_W=500.0)
POINT = Progress(
    done=1, total=9, row=ROW, said="accepted", measured=0.97, predicted=0.98, mean_residual=-0.01, left_s=95.0
)


def shown(monkeypatch: pytest.MonkeyPatch, *, terminal: bool, row: PlannedPoint = ROW) -> str:
    text = io.StringIO()
    console = Console(file=text, force_terminal=terminal, width=160, color_system=None, legacy_windows=False)
    monkeypatch.setattr(module, "err", console)
    with module.live() as progress:
        progress(Progress(done=0, total=9, row=row))
        progress(replace(POINT, row=row))
    return text.getvalue()


def test_plain_lines_where_nobody_can_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, terminal=False)
    assert "\x1b" not in text
    assert text.splitlines() == [
        "1/9 load D1 = 0.800 D2 = 0.100 500 W, accepted, measured 97.000 %, "
        "measured − simulated −1.000 points, mean so far −1.000, 1 min 35 s left"
    ]


def test_a_table_and_a_bar_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, terminal=True)
    for part in ("difference / points", "97.000 %", "98.000 %", "-1.000", "1/9", "1 min 35 s left"):
        assert part in text


def test_beside_the_bar_colons_and_brackets_stay_what_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, terminal=True, row=replace(ROW, why="chosen by Pin:x:W [W]"))
    assert "chosen by Pin:x:W [W]" in text


def test_the_time_left_is_that_of_who_waits() -> None:
    real, told = StepClock(), list[Progress]()
    plan = Plan(points=(ROW,) * 4, tried=4, infeasible={})
    tracker = Tracker(plan, told.append, real.now)
    for _ in range(2):
        tracker.begin(ROW)
        real.sleep(3.0)  # whatever the bench's clock says
        tracker.finish(ROW, None, measured=0.97, predicted=0.98)
    assert [progress.left_s for progress in told] == [None, 9.0, 9.0, 6.0]


def test_the_pace_of_a_resumed_campaign_is_its_own() -> None:
    real, told = StepClock(), list[Progress]()
    tracker = Tracker(Plan(points=(ROW,) * 4, tried=4, infeasible={}), told.append, real.now)
    tracker.accepted = 2  # before it was resumed
    tracker.begin(ROW)
    real.sleep(3.0)
    tracker.finish(ROW, None, measured=0.97, predicted=0.98)
    assert [progress.left_s for progress in told] == [None, 3.0]
