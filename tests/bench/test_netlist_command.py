"""The verbs netlist and simulate --vary at the command line: files, words, exit codes."""

from pathlib import Path

import pandas as pd
import pytest

from tests.bench.command_line import d2ea

POINT = ("--D1", "0.8", "--D2", "0.1", "--P", "800")

pytestmark = pytest.mark.usefixtures("in_a_folder_of_its_own")


def test_the_file_names_its_point(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("netlist", *POINT, "--out", "new/point.cir") == 0
    first = Path("new/point.cir").read_text().splitlines()[0]
    assert "D1 = 0.8, D2 = 0.1, 800 W, D0 = " in first
    assert "written to new/point.cir" in capsys.readouterr().out


def test_everything_wrong_is_named_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("netlist", "--D1", "1.2", "--D2", "nan", "--P", "inf", "--out", "point.txt") == 2
    said = capsys.readouterr().err
    for field in ("--D1 = 1.2: a number from 0 to 1", "--D2 = nan", "--P = inf", "the name must end in .cir"):
        assert field in said


def test_a_power_out_of_reach_fails_with_the_reason(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("netlist", "--D1", "0.5", "--D2", "0.5", "--P", "1900", "--out", "point.cir") == 1
    said = capsys.readouterr().err
    assert "1900 W cannot run: D1 and D2 carry" in said
    assert not Path("point.cir").exists()


def test_shifted_legs_of_a_three_level_bridge_have_no_netlist(capsys: pytest.CaptureFixture[str]) -> None:
    Path("model.toml").write_text('modulation = "tps"\n')
    assert d2ea("netlist", *POINT, "--out", "point.cir", "--model", "model.toml") == 1
    assert "written for hybrid modulation; this model is driven by tps" in capsys.readouterr().err


def test_a_parameter_space_has_its_axes_as_columns(capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--grid", "3x3x2", "--vary", "V2_V=130:150:2", "--chunk", "20", "--processes", "1")
    assert d2ea("simulate", *options, "--out", "space.parquet") == 0
    said = capsys.readouterr()
    assert "36 points" in said.out
    assert "36 of 36 points after" in said.err  # progress
    assert sorted(pd.read_parquet("space.parquet")["V2_V"].unique()) == [130.0, 150.0]


def test_a_table_brings_its_own_axes(capsys: pytest.CaptureFixture[str]) -> None:
    Path("points.csv").write_text("D1,D2,P_set_W\n0.8,0.1,500\n")
    assert d2ea("simulate", "points.csv", "--vary", "V2_V=130:150:2") == 2
    assert "--vary: belongs to --grid" in capsys.readouterr().err
