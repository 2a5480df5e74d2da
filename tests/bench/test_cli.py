"""The command line: exit codes, words instead of tracebacks, and files that come out right."""

import errno
import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pytest

from bench.errors import Aborted, BenchUnsafe, InputError, Interrupted
from bench.progress import Progress
from bench.toml_file import read_toml, to_toml
from drivers.errors import LinkTimeout
from sim.converter_data import converter_to_plain
from sim.prototype import prototype
from tests.bench.command_line import bench_file, campaign_file, d2ea, measured_table
from tests.bench.conftest import no_room

pytestmark = pytest.mark.usefixtures("in_a_folder_of_its_own")


@pytest.mark.parametrize(
    "command",
    [
        ("diagnose", "theirs.csv", "--out"),
        ("train", "theirs.csv", "--models"),
        ("simulate", "--grid", "3x3x3", "--out"),
        ("optimise", "--out"),
        ("demo", "--out"),
        ("experiment", "table_4_search", "--out"),
    ],
)
def test_where_nothing_can_be_written_is_said_before_the_work(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    measured_table()
    Path("file").write_text("no folder")
    assert d2ea(*command, "file/results.csv") == 2
    said = capsys.readouterr().err
    assert "nothing can be written there (a file stands in the way)" in " ".join(said.split())
    assert f"{command[-1]} = 'file" in said


def test_an_unknown_verb_or_option_is_wrong_use() -> None:
    assert d2ea("measure") == 2
    assert d2ea("runs", "--fast") == 2


def test_a_wrong_key_is_named_with_its_line_and_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("run", campaign_file(sed=3), "--bench", bench_file()) == 2
    said = capsys.readouterr().err
    assert "campaign.toml:2: sed = 3: unknown key; did you mean seed?" in said
    assert "Traceback" not in said


def test_a_set_point_above_the_limits_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    plan = {"kind": "latin_hypercube", "points": 4}
    ranges = {"power_W": [200, 9000]}
    assert d2ea("run", campaign_file(plan=plan, ranges=ranges), "--bench", bench_file()) == 2
    assert "ranges.power_W = 9000.0: at most limits.power_W = 2200 W" in capsys.readouterr().err


def test_unreachable_ports_are_all_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("check", bench_file()) == 1
    said = capsys.readouterr().err
    for name in ("analyzer", "supply", "load", "controller"):
        assert f"fault: {name}: cannot open" in said


def test_a_run_on_unreachable_instruments_fails_and_is_recorded(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("run", campaign_file(), "--bench", bench_file()) == 1
    assert "cannot open" in capsys.readouterr().err
    assert d2ea("status") == 0
    assert "failed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (BenchUnsafe("load NOT confirmed off"), 3),
        (LinkTimeout("no reply"), 1),
        (InputError.of("f.toml", "a", 1, "allowed is 2"), 2),
        (ZeroDivisionError("division by zero"), 1),
        (FileNotFoundError(2, "No such file or directory", "bench/any.toml"), 1),
        (OSError(errno.ENOSPC, "No space left on device"), 1),
        (KeyboardInterrupt(), 130),
        (Interrupted("interrupted by the operator"), 130),
        (Aborted("the operator asked the campaign to stop"), 1),
    ],
)
def test_every_error_has_its_exit_code_and_no_traceback(
    error: BaseException, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_path: object) -> None:
        raise error

    monkeypatch.setattr("bench.commands.bench.read_bench", fail)
    assert d2ea("check", "any.toml") == code
    said = capsys.readouterr().err
    assert said
    assert "Traceback" not in said
    assert "Errno" not in said


def test_where_room_is_missing_what_to_do_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bench.commands.bench.read_bench", no_room)
    assert d2ea("check", "any.toml") == 1
    assert "the disk is full; make room, or name another folder" in capsys.readouterr().err


@contextmanager
def interrupting(number: signal.Signals) -> Iterator[Callable[[Progress], None]]:
    yield lambda _: signal.raise_signal(number)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_campaign_that_is_interrupted_is_said_to_be_aborted(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bench.commands.bench.live", lambda: interrupting(number))
    plan = {"kind": "latin_hypercube", "points": 1, "standby": 1, "no_load": 0}
    assert d2ea("run", campaign_file(plan=plan), "--bench", bench_file(), "--rehearse") == 130
    printed = capsys.readouterr()
    assert printed.err.strip() == "aborted: interrupted by the operator"
    assert "bench: PWM off; load off; supply off" in printed.out


def test_a_queue_that_waits_is_interrupted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bench.commands.queue.time.sleep", lambda _: signal.raise_signal(signal.SIGINT))
    assert d2ea("queue", "run") == 130
    assert "aborted: interrupted by the operator" in capsys.readouterr().err


def test_what_stands_between_colons_is_printed_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("import", measured_table(), "--name", "Pin:x:W") == 0
    assert d2ea("runs") == 0  # in a table
    assert d2ea("status") == 0  # in a line
    assert capsys.readouterr().out.count("Pin:x:W") == 2
    assert d2ea("diagnose", "theirs:x:.csv") == 2
    assert "theirs:x:.csv" in capsys.readouterr().err


def test_nothing_is_running_to_pause() -> None:
    assert d2ea("pause") == 1


def test_simulate_a_grid() -> None:
    assert d2ea("simulate", "--grid", "3x3x2", "--out", "grid.csv") == 0
    table = pd.read_csv("grid.csv")
    assert len(table) == 18
    assert table.loc[~table["feasible"], "efficiency"].isna().all()
    assert table.loc[table["feasible"], "efficiency"].between(0.5, 1.0).all()


def test_where_no_point_can_run_what_to_check_of_the_model_is_said(
    capsys: pytest.CaptureFixture[str],
) -> None:
    slow = converter_to_plain(prototype()) | {"name": "slow", "frequency_Hz": 100.0}
    Path("slow.toml").write_text(to_toml({"converter": slow}))
    assert d2ea("simulate", "--grid", "3x3x2", "--model", "slow.toml") == 0
    *reasons, last = capsys.readouterr().out.splitlines()
    assert "  8 × D1 and D2 carry no power into the secondary bridge" in reasons
    assert last.startswith(
        "no point can run; check first of the model: frequency_Hz = 100, inductor.inductance_H = "
    )
    assert (
        "V1_V = 300, V2_V = 140, transformer.turns_ratio = 2: without losses they carry 444915 W at most"
        in last
    )


def test_simulate_points_keeps_the_columns_given() -> None:
    Path("points.csv").write_text("D1,D2,P_set_W,mark\n0.8,0.1,500,a\n0.8,0.1,2500,b\n")
    assert d2ea("simulate", "points.csv", "--out", "out.csv") == 0
    table = pd.read_csv("out.csv")
    assert list(table["mark"]) == ["a", "b"]
    assert list(table["feasible"]) == [True, False]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("D1,P_set_W\n0.8,500\n", "points.csv: D2: column is missing; required are D1, D2, P_set_W"),
        ("D1,D2,P_set_W\n0.8,0.1,500\n1.8,0.1,500\n", "points.csv:3: D1 = 1.8: a number from 0 to 1"),
    ],
)
def test_simulate_names_what_is_wrong(content: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("points.csv").write_text(content)
    assert d2ea("simulate", "points.csv") == 2
    assert said in capsys.readouterr().err.replace("np.float64(1.8)", "1.8")


def test_simulate_with_a_wrong_model_names_effect_and_line(capsys: pytest.CaptureFixture[str]) -> None:
    Path("model.toml").write_text("[effects.sic_on_resistanse]\nvalue = 0.1\n")
    assert d2ea("simulate", "--grid", "2x2x2", "--model", "model.toml") == 2
    said = capsys.readouterr().err
    assert "model.toml:1: effects.sic_on_resistanse" in said
    assert "did you mean 'sic_on_resistance'" in said


def test_train_then_list_then_optimise(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bench.commands.learn.KINDS", ("d2ea",))  # the others take time and nothing new
    d2ea("import", measured_table())
    assert d2ea("train", "1") == 0
    assert d2ea("models", "list") == 0
    assert capsys.readouterr().out.count(" d2ea ") == 2  # in the training's table and in the list
    assert d2ea("optimise", "--powers", "400:800:200", "--out", "lut.json") == 0
    rows = json.loads(Path("lut.json").read_text())["table"]
    assert [row["P_W"] for row in rows] == [400.0, 600.0, 800.0]
    assert all(0 <= row["D1"] <= 1 and 0 <= row["D2"] <= 1 for row in rows)


def test_calibrated_physics_is_trained_kept_and_searched(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bench.commands.learn.KINDS", ("calibrated",))
    assert d2ea("train", measured_table()) == 0
    printed = capsys.readouterr()
    assert "calibrated: weighing the causes" in printed.err
    assert "calibrated" in printed.out
    assert d2ea("optimise", "--powers", "400:600:200", "--out", "lut.json") == 0
    assert "(calibrated), lattice, refined" in capsys.readouterr().out
    assert [row["P_W"] for row in json.loads(Path("lut.json").read_text())["table"]] == [400.0, 600.0]


def test_too_few_rows_to_calibrate_leave_the_other_kinds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bench.commands.learn.KINDS", ("calibrated", "d2ea"))
    assert d2ea("train", measured_table(rows=20)) == 0  # 8 of them to fit before judging
    printed = capsys.readouterr()
    assert "no calibrated model: 8 usable rows that carry power; a diagnosis needs at least 12" in printed.err
    assert " d2ea " in printed.out
    assert d2ea("optimise", "--powers", "400:600:200", "--out", "lut.json") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "95 % is not known: the model was judged on fewer than 19 rows" in said


def test_training_asks_where_the_simulation_is_far_off(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bench.commands.learn.KINDS", ("simulation_only",))
    table = pd.read_csv(measured_table())
    for off, asked in ((0.0, False), (-0.03, True)):
        shifted = table.assign(P1_W=table["P2_W"] / (table["P2_W"] / table["P1_W"] + off))
        shifted.to_csv("shifted.csv", index=False)
        assert d2ea("train", "shifted.csv") == 0
        assert ("d2ea diagnose shifted.csv says why" in capsys.readouterr().out) is asked


def test_too_few_rows_to_train_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("train", measured_table(rows=5)) == 2
    assert "at least 10 are needed" in capsys.readouterr().err


def test_mock_listens_until_it_is_ended_and_takes_its_file_away() -> None:
    command = [sys.executable, "-c", "from bench.cli import main; main()", "mock", "--out", "rack.toml"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as rack:
        assert rack.stdout is not None
        assert "VIRTUAL LAB" in rack.stdout.readline()
        assert "listening" in rack.stdout.readline()
        assert read_toml(Path("rack.toml"))["virtual"] is True
        assert d2ea("check", "rack.toml") == 0
        rack.send_signal(signal.SIGTERM)
        assert rack.wait(timeout=20) == 0
    assert not Path("rack.toml").exists()


@pytest.mark.parametrize(
    ("there", "said"),
    [
        ({"name": "bench one"}, "not of mock instruments"),
        ({"virtual": True, "analyzer": {"resource": "/dev/null"}}, "still run wrote that file"),
    ],
)
def test_mock_replaces_no_file_that_somebody_needs(
    there: dict[str, object], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("bench.toml").write_text(to_toml(there))
    assert d2ea("mock") == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert read_toml(Path("bench.toml")) == there


def test_a_rehearsal_needs_no_instruments_and_lists_its_faults(capsys: pytest.CaptureFixture[str]) -> None:
    Path("faults.toml").write_text('[[fault]]\ninstrument = "load"\nkind = "silence"\nafter = 40\n')
    plan = {"kind": "latin_hypercube", "points": 1, "standby": 1, "no_load": 0}
    arguments = (
        "run",
        campaign_file(plan=plan),
        "--bench",
        bench_file(),
        "--rehearse",
        "--fault",
        "faults.toml",
    )
    assert d2ea(*arguments) == 0
    said = capsys.readouterr().out
    assert "VIRTUAL LAB" in said
    assert "fault: silence at the load" in said
    assert not Path("d2ea-data").exists()


def test_faults_are_refused_on_a_real_run(capsys: pytest.CaptureFixture[str]) -> None:
    Path("faults.toml").write_text("")
    assert d2ea("run", campaign_file(), "--bench", bench_file(), "--fault", "faults.toml") == 2
    assert "faults are for --rehearse" in capsys.readouterr().err


def test_what_a_rehearsal_would_ignore_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    beside = ("--spy", "wires.txt", "--db", "postgresql://lab:secret@host/db")
    assert d2ea("run", campaign_file(), "--bench", bench_file(), "--rehearse", *beside) == 2
    said = capsys.readouterr().err
    for option in ("--spy", "--db"):
        assert f"command line: {option}: not with --rehearse" in said
    assert "secret" not in said
    assert not Path("wires.txt").exists()


@pytest.mark.parametrize("verb", ["status", "pause", "abort", "resume", "export"])
def test_a_campaign_0_is_no_campaign(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea(verb, "0", *(("--out", "x.csv") if verb == "export" else ())) == 2
    assert "greater than or equal to" in capsys.readouterr().err


def test_a_stopped_campaign_is_found_by_resume(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("resume") == 1
    assert "nothing to resume" in capsys.readouterr().err
    d2ea("run", campaign_file(), "--bench", bench_file())  # fails: there are no instruments
    capsys.readouterr()
    assert d2ea("resume") == 1
    said = capsys.readouterr()
    assert "campaign 1 was failed; 0 of" in said.out
    assert "cannot open" in said.err


def test_the_queue_is_filled_listed_and_emptied(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("queue", "add", campaign_file(schedule={"every": "6 h"}), "--bench", bench_file()) == 0
    assert d2ea("queue", "list") == 0
    assert "six points" in capsys.readouterr().out
    assert d2ea("queue", "remove", "1") == 0
    assert d2ea("queue", "run", "--until-empty") == 0
    assert d2ea("queue", "remove", "1") == 1
