"""Sweeps: the same numbers whoever computes them, in chunks, after a kill, with circuit parameters as inputs."""

import json
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.errors import InputError, NotWritten
from bench.set_points import parse_space, read_points
from bench.sweep import Sweep, TableRows, run_sweep, solve_chunk
from bench.workers import LOCAL, Workers
from sim.model import Model
from sim.operating_points import Points
from sim.prototype import prototype
from sim.simulate import grid, simulate
from tests.bench.conftest import no_room

GRID = "4x4x3"
ALONE = Workers(processes=1)


def sweep_to(
    path: Path, *, vary: tuple[str, ...] = (), chunk_rows: int = 20, model: Model | None = None
) -> Sweep:
    inputs = parse_space(GRID, vary, prototype())
    return Sweep(model=model or Model.baseline(), inputs=inputs, out=path, chunk_rows=chunk_rows)


def quiet(_done: int, _total: int) -> None:
    pass


def test_chunks_make_the_table_of_one_simulation(tmp_path: Path) -> None:
    swept = run_sweep(sweep_to(tmp_path / "a.parquet"), ALONE, quiet)
    whole = simulate(Model.baseline(), grid((4, 4, 3)))
    table = pd.read_parquet(tmp_path / "a.parquet")
    assert (swept.points, swept.feasible) == (48, int(whole.feasible.sum()))
    for name, values in whole.columns().items():
        if name == "reason" or name == "feasible":
            assert (table[name].to_numpy() == values).all()
        else:  # neighbours in a chunk change the order of sums
            np.testing.assert_allclose(table[name], values, rtol=1e-5, atol=1e-6)


def test_csv_and_parquet_hold_the_same(tmp_path: Path) -> None:
    for name in ("a.csv", "a.parquet"):
        run_sweep(sweep_to(tmp_path / name), ALONE, quiet)
    text, binary = pd.read_csv(tmp_path / "a.csv"), pd.read_parquet(tmp_path / "a.parquet")
    pd.testing.assert_frame_equal(text.fillna({"reason": ""}), binary, check_exact=False, rtol=1e-14)


@pytest.mark.parametrize(
    "workers", [Workers(processes=2), Workers(processes=2, dask=LOCAL)], ids=["processes", "dask"]
)
@pytest.mark.filterwarnings("ignore")  # of Dask's own start and end
def test_other_workers_find_the_same(tmp_path: Path, workers: Workers) -> None:
    run_sweep(sweep_to(tmp_path / "here.parquet"), ALONE, quiet)
    run_sweep(sweep_to(tmp_path / "there.parquet"), workers, quiet)
    here, there = (pd.read_parquet(tmp_path / f"{name}.parquet") for name in ("here", "there"))
    pd.testing.assert_frame_equal(here, there)


def test_nothing_is_left_beside_the_result(tmp_path: Path) -> None:
    run_sweep(sweep_to(tmp_path / "a.parquet"), ALONE, quiet)
    assert [path.name for path in tmp_path.iterdir()] == ["a.parquet"]


def test_a_stopped_sweep_goes_on_with_what_is_missing(tmp_path: Path) -> None:
    sweep = sweep_to(tmp_path / "a.parquet")

    def stop(done: int, _total: int) -> None:
        if done >= 40:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(sweep, ALONE, stop)
    seen: list[int] = []
    swept = run_sweep(sweep, ALONE, lambda done, _total: seen.append(done))
    assert swept.resumed == 2
    assert seen == [40, 48]
    run_sweep(sweep_to(tmp_path / "b.parquet"), ALONE, quiet)
    pd.testing.assert_frame_equal(*(pd.read_parquet(tmp_path / f"{name}.parquet") for name in "ab"))


def test_a_killed_process_loses_no_finished_chunk(tmp_path: Path) -> None:
    options = ("--grid", "5x5x2", "--chunk", "10", "--processes", "1", "--out", "a.parquet")
    command = [sys.executable, "-c", "from bench.cli import main; main()", "simulate", *options]
    running = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL)
    parts = tmp_path / "a.parquet.parts"
    while not (parts / "000001.parquet").exists():
        assert running.poll() is None, "it ended before it could be killed"
    running.send_signal(signal.SIGKILL)
    running.wait()
    there = len(list(parts.glob("*.parquet")))
    inputs = parse_space("5x5x2", (), prototype())
    sweep = Sweep(model=Model.baseline(), inputs=inputs, out=tmp_path / "a.parquet", chunk_rows=10)
    assert run_sweep(sweep, ALONE, quiet).resumed == there
    assert len(pd.read_parquet(tmp_path / "a.parquet")) == 50


def test_a_full_disk_leaves_the_chunks_and_the_sweep_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep = sweep_to(tmp_path / "a.csv")
    with monkeypatch.context() as full:
        full.setattr("pandas.DataFrame.to_csv", no_room)
        with pytest.raises(NotWritten, match=r"/a\.csv cannot be written: the disk is full; make room"):
            run_sweep(sweep, ALONE, quiet)
    assert list(tmp_path.iterdir()) == [sweep.folder]
    assert run_sweep(sweep, ALONE, quiet).resumed == len(sweep)
    assert list(tmp_path.iterdir()) == [sweep.out]


def test_chunks_of_another_sweep_are_not_taken_for_this_ones(tmp_path: Path) -> None:
    sweep = sweep_to(tmp_path / "a.parquet")
    sweep.folder.mkdir()
    (sweep.folder / "sweep.json").write_text(json.dumps({**sweep.identity(), "model": {}}))
    with pytest.raises(InputError, match=r"holds chunks of another sweep \(model differ\)"):
        run_sweep(sweep, ALONE, quiet)


def test_circuit_parameters_and_the_voltage_ratio_are_inputs(tmp_path: Path) -> None:
    vary = ("inductor.inductance_H=200e-6:260e-6:2", "voltage_ratio=0.9:1:2")
    run_sweep(sweep_to(tmp_path / "a.parquet", vary=vary, chunk_rows=400), ALONE, quiet)
    table = pd.read_parquet(tmp_path / "a.parquet")
    assert len(table) == 192
    row = table[
        table["feasible"] & (table["inductor.inductance_H"] > 250e-6) & (table["voltage_ratio"] < 0.95)
    ].iloc[0]
    converter = prototype()
    other = replace(converter, inductor=replace(converter.inductor, inductance_H=260e-6))
    point = Points(D1=row["D1"], D2=row["D2"], power_W=row["P_set_W"], V2_V=135.0)
    one = simulate(Model(converter=other), point)
    assert row["D0"] == pytest.approx(one["D0"][0], abs=1e-6)


def test_a_tables_own_columns_pass_and_its_inputs_count(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("mark,D1,D2,P_set_W,V2_V\na,0.8,0.1,500,130\nb,0.8,0.1,500,150\n")
    table, passed_on = read_points(path, prototype())
    assert passed_on == ("mark",)
    sweep = Sweep(
        model=Model.baseline(), inputs=TableRows(table=table), out=tmp_path / "a.csv", passed_on=passed_on
    )
    run_sweep(sweep, ALONE, quiet)
    found = pd.read_csv(tmp_path / "a.csv")
    assert list(found["mark"]) == ["a", "b"]
    assert found["D0"][0] > found["D0"][1]  # less voltage, more phase


def test_a_drift_of_the_model_counts_from_the_tables_time(tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text("D1;D2;P_set_W;time_s\n\n0,8;0,1;500;0\n0,8;0,1;500;7200\n")
    table, passed_on = read_points(tmp_path / "points.csv", prototype())
    drifting = Model.baseline().with_effect("warm_up_drift", relative_loss_at_end=0.2)
    run_sweep(Sweep(model=drifting, inputs=TableRows(table=table), out=tmp_path / "a.csv"), ALONE, quiet)
    loss = pd.read_csv(tmp_path / "a.csv").eval("P1_W - P2_W")
    assert not passed_on
    assert loss[1] > 1.1 * loss[0]  # most of a fifth after two hours


def test_a_bad_cell_is_named_by_its_line_in_any_kind_of_table(tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text("# bench 3\n\nD1;D2;P_set_W\n0,8;x;500\n")
    with pytest.raises(InputError, match=r"points.csv:4: D2 = 'x': a number from 0 to 1"):
        read_points(tmp_path / "points.csv", prototype())


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        ("inductor.inductance=1:2:3", "did you mean inductor.inductance_H"),
        ("inductor.inductance_H=-1:2:3", r"Inductor.inductance_H is .*allowed: finite and > 0"),
        ("V2_V=120:160", "NAME=LOW:HIGH:COUNT"),
        ("V2_V=-1:160:3", "a voltage above 0 V"),
        ("V2_V=nan:160:3", "a voltage above 0 V"),
        ("D1=0:1:3", "D1 belongs to --grid"),
        ("frequency_Hz=1e4:2e4:2", "is no input"),
    ],
)
def test_a_wrong_axis_is_named(vary: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        parse_space(GRID, [vary], prototype())


def test_an_input_given_twice_is_named() -> None:
    with pytest.raises(InputError, match="each input once"):
        parse_space(GRID, ["V2_V=120:160:3", "V2_V=1:2:3"], prototype())
    with pytest.raises(InputError, match="say the same"):
        parse_space(GRID, ["V2_V=120:160:3", "voltage_ratio=0.9:1:3"], prototype())


def test_a_scheduler_that_does_not_answer_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no scheduler answers there"):
        run_sweep(sweep_to(tmp_path / "a.parquet"), Workers(dask="nonsense://127.0.0.1:1"), quiet)


def test_a_chunk_is_a_whole_parquet_file(tmp_path: Path) -> None:
    content = solve_chunk(Model.baseline(), parse_space("2x2x2", (), prototype()).rows(0, 8))
    (tmp_path / "chunk.parquet").write_bytes(content)
    assert len(pd.read_parquet(tmp_path / "chunk.parquet")) == 8
