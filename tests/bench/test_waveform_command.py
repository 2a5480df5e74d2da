"""The verb waveform: what it draws, samples and says is what the simulator and the netlist's circuit agree on."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sim.model import Model
from sim.operating_points import Points
from sim.simulate import simulate
from tests.bench.command_line import d2ea

POINT = ("--D1", "0.8", "--D2", "0.1", "--P", "800")

pytestmark = pytest.mark.usefixtures("in_a_folder_of_its_own")


def test_samples_have_the_currents_that_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("waveform", *POINT, "--out", "new/point.csv", "--out", "new/point.png") == 0
    said = capsys.readouterr().out
    samples = pd.read_csv("new/point.csv")
    solved = simulate(Model.baseline(), Points(D1=0.8, D2=0.1, power_W=800.0))
    told = [float(number) for number in re.findall(r"([\d.]+) A rms, ([\d.]+) A peak", said)[0]]
    # three decimals are told
    assert told == pytest.approx([solved["I_L_rms_A"][0], solved["I_L_pp_A"][0]], abs=6e-4)
    time_s, current_A = samples["time_s"].to_numpy(), samples["iL_A"].to_numpy()
    rms_A = np.sqrt(np.trapezoid(current_A**2, time_s) / (time_s[-1] - time_s[0]))
    assert [rms_A, np.ptp(current_A)] == pytest.approx(told, rel=5e-3)  # two solvers, of slopes of their own
    assert time_s[-1] == pytest.approx(1 / 20e3, rel=1e-9)  # a period, to rounding
    assert Path("new/point.png").read_bytes().startswith(b"\x89PNG")


def test_the_picture_holds_its_title(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    point = ("--D1", "0.8765", "--D2", "0.1234", "--P", "1234.5", "--V", "312.5", "147.5")
    assert d2ea("waveform", *point, "--out", "point.pdf") == 0
    (figure,) = drawn
    FigureCanvasAgg(figure).draw()
    (title,) = [text for text in figure.texts if "simulated" in text.get_text()]
    box, page = title.get_window_extent(), figure.bbox
    assert page.x0 <= box.x0 < box.x1 <= page.x1
    assert box.y1 <= page.y1


def test_voltages_and_backward_power_can_be_given(capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--D1", "0.8", "--D2", "0.1", "--P", "-600", "--V", "310", "150")
    assert d2ea("waveform", *options, "--out", "back.csv") == 0
    assert "input -5" in capsys.readouterr().out
    samples = pd.read_csv("back.csv")
    assert samples["vs_V"].max() == pytest.approx(150, rel=0.02)  # the bridge's own drop beside it


def test_everything_wrong_is_named_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    wrong = ("--D1", "1.2", "--D2", "nan", "--P", "inf", "--V", "0", "140", "--out", "point.txt")
    assert d2ea("waveform", *wrong) == 2
    said = capsys.readouterr().err
    for field in ("--D1 = 1.2: a number from 0 to 1", "--D2 = nan", "--P = inf", "--V = 0.0: two voltages"):
        assert field in said
    assert "point.txt" in said
    assert ".svg" in said


def test_a_power_out_of_reach_leaves_no_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("waveform", "--D1", "0.5", "--D2", "0.5", "--P", "1900", "--out", "point.png") == 1
    assert "1900 W cannot run: D1 and D2 carry" in capsys.readouterr().err
    assert not Path("point.png").exists()
