"""A seeded sample of each row of the fault survey; all of it is run by ``d2ea experiment fault_survey``."""

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from experiments.fault_survey import Survey, _goals
from experiments.harness.postgresql import Cluster, programs
from experiments.harness.settings import Settings
from experiments.survey.databases import benches_at_once, failing_file, stopped_server, time_per_point
from experiments.survey.faulted import FaultReport, Script, expected, perform, scripts, wrong_numbers
from experiments.survey.kills import kill_at, kill_at_any_instant, places, undisturbed
from experiments.survey.late import LateReport, late_on_rtu, late_on_scpi
from experiments.survey.limits import commanded
from experiments.survey.steady_plant import Setting

SCRIPTS = (
    Script(instrument="analyzer", kind="late_reply"),
    Script(instrument="analyzer", kind="truncated_reply"),
    Script(instrument="analyzer", kind="stale"),
    Script(instrument="supply", kind="trip", value="OVP"),
    Script(instrument="supply", kind="wrong_transaction"),
    Script(instrument="load", kind="local"),
    Script(instrument="load", kind="exception", value=6),
    Script(instrument="load", kind="clip"),
    Script(instrument="controller", kind="hang_up"),
    Script(instrument="controller", kind="heartbeat_lost"),
    Script(instrument="controller", kind="replayed"),
)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    """A PostgreSQL server for this module."""
    if (bin := programs()) is None:
        pytest.skip("missing program: postgresql")
    with Cluster(bin) as running:
        yield running


def test_killed_at_seeded_places_it_ends_as_if_nobody_had() -> None:
    reference = undisturbed(2, 21)
    wanted = places(len(reference), share=0.12, seed=2)
    report = kill_at(wanted, reference, url="", points=2, seed=21)
    assert report.kills == len(wanted) >= 5
    assert report.good, report


def test_killed_at_any_instant_on_postgresql_it_ends_as_if_nobody_had(cluster: Cluster) -> None:
    reference = undisturbed(2, 22)
    report = kill_at_any_instant(3, reference, url=cluster.new_schema(), points=2, seed=22)
    assert report.good, report


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_a_scripted_fault_ends_well_and_stores_nothing_wrong(script: Script) -> None:
    report = perform(script, strikes=3, points=4)
    assert report.good, report


def test_every_instrument_has_its_scripts() -> None:
    every = list(scripts())
    assert len(every) >= 25
    assert {script.instrument for script in every} == {"analyzer", "supply", "load", "controller"}
    assert set(SCRIPTS) <= set(every)


@pytest.mark.parametrize("late", [late_on_rtu, late_on_scpi])
def test_no_late_reply_is_taken_for_another_answer(late: object) -> None:
    report = late(300, 4)  # type: ignore[operator]
    assert report.late > 0
    assert report.misattributed == 0


def test_nothing_outside_random_limits_is_on_a_wire() -> None:
    seen = commanded(80, 3)
    assert seen.seen > 20
    assert seen.beyond == []


@pytest.mark.parametrize("kind", ["disk_full", "read_only", "gone"])
def test_a_database_that_fails_stops_the_run_safe_and_it_goes_on_afterwards(
    kind: str, tmp_path: Path
) -> None:
    report = failing_file(kind, tmp_path / "x.sqlite", after=55, seed=3)
    assert report.good, report


def test_a_server_that_stops_does_too(cluster: Cluster) -> None:
    report = stopped_server(cluster, seed=4)
    assert report.good, report


def test_four_benches_write_one_server_at_once(cluster: Cluster) -> None:
    report = benches_at_once(cluster.new_schema(), benches=4, points=2)
    assert (report.done, report.rows) == (4, report.wanted)
    assert report.reads > 0


def test_points_are_timed_one_by_one(tmp_path: Path) -> None:
    times = time_per_point(f"sqlite:///{tmp_path}/x.sqlite", 3, 1)
    assert len(times.wall_ms) == len(times.processor_ms) == 6  # seven rows
    assert all(wall > 0 for wall in times.wall_ms)


def test_a_wrong_number_would_be_seen() -> None:
    setting = Setting(supply_on=True, supply_V=300.0, load_on=True, load_W=1000.0, pwm=True, D1=0.8, D2=0.1)
    right = {"kind": "load", "point": 0, "D1": 0.8, "D2": 0.1, "P_set_W": 1000.0, **expected(setting)}
    assert list(wrong_numbers(pd.DataFrame([right]))) == []
    assert len(list(wrong_numbers(pd.DataFrame([{**right, "P1_W": right["P1_W"] * 1.001}])))) == 1


def test_a_miss_is_a_miss() -> None:
    bad = FaultReport(
        name="x", struck=1, outcome="unsafe", cause="", rows=0, wrong=("P1",), truly_off=False, said_off=True,
        latched=False,
    )  # fmt: skip
    times = type("Times", (), {"wall_ms": [50.0], "processor_ms": [1.0]})()
    found = Survey(kills=[], faults=[bad], late=[], wild=[], times=times, databases=[], shared=None)
    missed = {goal.name for goal in _goals(found, Settings(out=Path("."))) if not goal.met}
    assert "wrong numbers stored" in missed
    assert "own time per point, 95th percentile, wall" in missed
    assert "trips that were not latched" in missed


def test_bars_that_count_work_are_those_of_the_share_that_was_done() -> None:
    times = type("Times", (), {"wall_ms": [1.0], "processor_ms": [1.0]})()
    late = [LateReport(wire="serial", exchanges=1000, misattributed=0)]
    found = Survey(kills=[], faults=[], late=late, wild=[], times=times, databases=[], shared=None)

    def bars(scale: float) -> dict[str, float]:
        return {goal.name: goal.bar for goal in _goals(found, Settings(out=Path("."), scale=scale))}

    assert bars(0.1)["exchanges with late replies, serial"] == 1000.0
    assert bars(1.0)["exchanges with late replies, serial"] == 10_000.0
    assert bars(0.1)["kill -9, in all"] == 20.0
    assert not any("PostgreSQL" in name for name in bars(1.0))  # it was not there
