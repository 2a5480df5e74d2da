"""The report and the overview picture: complete, self-contained, honest about what they show."""

import json
import re
import shutil
import subprocess
from dataclasses import replace

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from playwright.sync_api import sync_playwright

from bench.bands import power_bands
from bench.charts import channel_residuals, efficiency_maps, loss_breakdown
from bench.errors import NotWritten
from bench.figures import overview_png
from bench.paper_figures import gain_bars, model_errors, optimum_over_load, write_figures
from bench.report import ReportData, actions, write_report

CAUSE = {
    "effect": "link_resistance",
    "probability": 0.997,
    "share_of_gap": 0.91,
    "parameters": [{"name": "resistance_Ohm", "value": 0.071, "ci95": [0.066, 0.077], "off": 0.0}],
    "tied_with": [],
    "says": "the ac link has more series resistance than modelled",
    "check": "measure the ac link with four wires",
}
DIAGNOSIS = {
    "schema": 1,
    "verdict": "named",
    "points": 60,
    "gap": {"mean_abs_efficiency": 0.0121, "mean_loss_W": 9.8},
    "causes": [CAUSE, CAUSE | {"effect": "core_loss_inductor", "probability": 0.001}],
    "named": ["link_resistance"],
    "groups": [["auxiliary_power", "analyzer_offset"]],
    "unknown": {"probability": 0.01, "formula": None},
    "next": [{"action": "standby", "separates": ["auxiliary_power"], "expected_sigma": 8.2, "minutes": 1.5}],
    "gain": {"blocks": "power band", "before": 0.0121, "after": 0.0004, "ci95": [0.011, 0.012]},
    "model": "out/model.toml",
    "rejected_rows": [{"row": 3, "column": "P2_W", "value": "0.6", "reason": "looks like kilowatts"}],
}
SUMMARY = {
    "points": 60,
    "sim_points": 500,
    "sim_feasible": 400,
    "seconds": {"simulate": 2.0, "campaign": 14.0, "total": 16.0},
    "error": {"simulation_only": 0.012, "d2ea": 0.003, "calibrated": None},
    "optimum": [
        {"P_W": 500.0, "D1": 0.7, "D2": 0.2, "predicted": 0.981, "measured": 0.9805},
        {"P_W": 1500.0, "D1": 0.9, "D2": 0.1, "predicted": 0.973, "measured": None},
    ],
    "hidden": ["link_resistance"],
    "hidden_values": {"link_resistance": 0.08},
    "found": True,
}
MINIMAL = {"schema": 1, "verdict": "consistent", "causes": [], "gain": None}


@pytest.fixture
def data():
    axes = np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 1, 6), np.linspace(200, 2000, 10), indexing="ij")
    D1, D2, power_W = (axis.ravel() for axis in axes)
    feasible = power_W < 2300 * D1 * (1 - D2)
    efficiency = np.where(feasible, 0.98 - 0.05 * (D1 - 0.8) ** 2, np.nan)
    simulation = pd.DataFrame(
        {"D1": D1, "D2": D2, "P_set_W": power_W, "feasible": feasible, "efficiency": efficiency}
    )
    rng = np.random.default_rng(0)
    rows = pd.DataFrame(
        {"D1": rng.random(60), "D2": rng.random(60), "P2_W": rng.uniform(150, 2100, 60), "kind": "load"}
    )
    rows = rows.assign(sim_efficiency=0.97, efficiency=0.97 - 0.01 * rows["D2"], D0=0.2, sim_D0=0.19)
    standby = pd.DataFrame({"kind": ["standby"], "P1_W": [6.0]})
    losses = pd.DataFrame(
        {"P_set_W": [500.0, 1500.0], "loss_inductor_core_W": [1.0, 2.0], "loss_added_W": [0.0, 0.0]}
    )
    return ReportData(
        title="A <run>",
        bench="bench 7",
        virtual=True,
        created="2024-11-05",
        simulation=simulation,
        measurements=pd.concat([standby, rows], ignore_index=True),
        losses=losses,
        summary=SUMMARY,
        diagnosis=DIAGNOSIS,
        power_off={"confirmed": True, "devices": {"supply": "off, read back 0.0 V"}},
        optimiser={"name": "PSO-SAVL", "evaluations": 500, "regret": 0.0012},
    )


@pytest.mark.parametrize(("write", "name"), [(write_report, "report.html"), (overview_png, "overview.png")])
def test_a_full_disk_leaves_what_was_there_before(data, tmp_path, full_disk, write, name):
    (tmp_path / name).write_text("before")
    with pytest.raises(NotWritten, match=f"{name} cannot be written: the disk is full"):
        write(tmp_path / name, data)
    assert (tmp_path / name).read_text() == "before"


def page(data, tmp_path):
    write_report(tmp_path / "report.html", data)
    return (tmp_path / "report.html").read_text()


def body(data, tmp_path):
    """The page without Plotly's own source."""
    return re.sub(r"<script>/\*\*.*?</script>", "", page(data, tmp_path), flags=re.S)


def test_one_file_that_loads_nothing(data, tmp_path):
    text = page(data, tmp_path)
    assert text.count("plotly.js v") == 1
    assert not re.search(r"<(script|img|iframe)[^>]*\ssrc=|<link\b|@import", body(data, tmp_path))


def test_a_virtual_lab_says_so_and_a_real_bench_does_not(data, tmp_path):
    virtual, real = body(data, tmp_path), body(replace(data, virtual=False), tmp_path)
    assert virtual.count("VIRTUAL LAB") == 2  # window title and banner
    assert "VIRTUAL" not in real
    assert "irtual lab:" not in real


def test_an_unconfirmed_power_off_comes_first(data, tmp_path):
    unsafe = replace(data, power_off={"confirmed": False, "devices": {"supply": "no reply"}})
    text = body(unsafe, tmp_path)
    assert text.index("POWER-OFF NOT CONFIRMED") < text.index("<h1>")
    assert "by hand" in actions(unsafe)[0]
    assert "POWER-OFF NOT CONFIRMED" not in body(data, tmp_path)


def test_the_verdict_stands_above_its_evidence(data, tmp_path):
    text = body(data, tmp_path)
    order = [
        "Cause named: ac-link resistance; and auxiliary power or analyzer current offset: "
        "these data cannot tell which<",
        "What to do",
        "resistance 71\xa0mΩ (95\xa0%: 66 to 77)",
        "What the diagnosis gains",
    ]
    order += ["Errors of the models", "Best modulation over load", "What the run cost", "Power-off confirmed"]
    places = [text.index(part) for part in order]
    assert places == sorted(places)


def test_numbers_are_those_of_the_data(data, tmp_path):
    text = body(data, tmp_path)
    for said in (
        "1.210",
        "0.040 points",
        "99.7 %",
        "400 can carry their power (80 %)",
        "98.05 %",
        "0.1200 points better",
    ):
        assert said in text
    assert "not computed" in text  # the calibrated model is absent, and that is said
    assert "4 times smaller" in text  # 0.012 against 0.003


def test_actions_follow_the_verdict(data):
    assert actions(data) == [
        "Check ac-link resistance: measure the ac link with four wires; expected, against the simulation: "
        "resistance 71 mΩ (95 %: 66 to 77).",
        "Measure next: standby (about 1.5 min), to tell whether auxiliary power is a cause.",
        "Simulate with the extended model from now on: out/model.toml.",
    ]
    gain = DIAGNOSIS["gain"]
    timing = DIAGNOSIS | {"gain": gain | {"after": 1.05 * gain["before"], "ci95": [-1e-4, 1e-4]}}
    assert "held-out rows is no nearer" in actions(replace(data, diagnosis=timing))[-1]
    tied = actions(replace(data, diagnosis=DIAGNOSIS | {"verdict": "group", "next": []}))
    assert tied == actions(data)[:1]  # the check
    assert "Nothing needs changing" in actions(replace(data, diagnosis=MINIMAL))[0]
    (strange,) = actions(
        replace(data, diagnosis=MINIMAL | {"parts": [{"part": "P_link1_W gain", "sigma": 4.73}]})
    )
    assert (
        strange
        == "More may be wrong than is said: what is found needs P link1 gain 4.7 times its everyday spread off."
    )
    step = {"action": "measure D1 = 0.7, D2 = 0.2, 500 W", "separates": ["dead_time"], "minutes": 4.0}
    asked = actions(replace(data, diagnosis=DIAGNOSIS | {"verdict": "group", "next": [step]}))
    assert (
        asked[-1]
        == "Measure next: D1 = 0.7, D2 = 0.2, 500 W (about 4 min), to tell whether dead time is a cause."
    )
    suspect = actions(replace(data, diagnosis=DIAGNOSIS | {"verdict": "consistent"}))
    assert suspect[0].startswith("Change nothing yet")
    assert suspect[0].endswith("What follows would make sure.")
    assert len(suspect) == 3


def test_a_cause_as_large_as_is_searched_asks_for_the_model_first(data):
    leakage = CAUSE | {"effect": "leakage_inductance"}
    inside, at_the_end = (
        leakage
        | {"parameters": [{"name": "relative_error", "value": value, "off": 0.0, "at_bound": at_bound}]}
        for value, at_bound in ((0.29, False), (0.3, True))
    )
    asked = [actions(replace(data, diagnosis=DIAGNOSIS | {"causes": [c]}))[0] for c in (inside, at_the_end)]
    assert asked[0].startswith("Check leakage inductance")
    assert asked[1].startswith("Make sure first that the model describes the converter that was measured")
    assert asked[1].endswith("leakage inductance is as far off as is searched (relative error +30 %).")
    faint = at_the_end | {"probability": 0.3}
    assert "Make sure" not in actions(replace(data, diagnosis=DIAGNOSIS | {"causes": [faint]}))[0]
    unknown = actions(replace(data, diagnosis=DIAGNOSIS | {"verdict": "unknown"}))
    assert unknown[0].endswith("in its unit: no known cause explains all of the gap.")
    all_explained = DIAGNOSIS | {"verdict": "unknown", "unknown": {"probability": 0.0}}
    assert not any("Make sure" in action for action in actions(replace(data, diagnosis=all_explained)))


def test_rows_that_stand_out_and_are_no_outliers_are_to_be_measured_again(data):
    rows = [{"row": k, "watts": 3.2, "sigma": 8.0} for k in (7, 12, 19, 23)]
    unknown = DIAGNOSIS | {"verdict": "unknown", "causes": [], "unknown": {"probability": 1.0, "rows": rows}}
    first = actions(replace(data, diagnosis=unknown))[0]
    assert first.startswith(
        "Measure again what stands out: row 7 (+3.20 W), row 12 (+3.20 W) and row 19 (+3.20 W)"
    )
    assert "and 1 more row." in first
    assert not any("Make sure first" in action for action in actions(replace(data, diagnosis=unknown)))


def test_what_no_cause_explains_is_looked_for_where_the_channels_show_it(data):
    unknown = {"probability": 0.9, "location": "ac link, by temperature", "rms_W": 1.2, "formula": None}
    seen = DIAGNOSIS | {"verdict": "unknown", "unknown": unknown, "channels": ["efficiency", "P_link1_W"]}
    asked = actions(replace(data, diagnosis=seen))
    assert "Look for what no cause explains in what carries the ac link's current" in asked[1]
    blind = actions(replace(data, diagnosis=seen | {"channels": ["efficiency"]}))
    assert not any("Look for" in action for action in blind)


def test_words_from_outside_are_escaped(data, tmp_path):
    nasty = "</script><script>alert(1)</script>"
    text = body(replace(data, notes=(nasty,), bench=nasty), tmp_path)
    assert "<title>VIRTUAL LAB – A &lt;run&gt;</title>" in text
    assert nasty not in text
    odd = data.losses.rename(columns={"loss_inductor_core_W": f"loss_{nasty}_W"})
    assert nasty not in body(replace(data, losses=odd), tmp_path)


def test_a_run_without_diagnosis_optimum_or_losses_still_gives_a_report(data, tmp_path):
    bare = replace(
        data, diagnosis=MINIMAL, summary={"points": 60}, losses=data.losses[["P_set_W"]], optimiser={}
    )
    text = body(bare, tmp_path)
    assert "Simulation and measurement agree" in text
    assert 'id="chart-maps"' in text
    assert not re.search(r'id="chart-(gain|optimum|losses|errors)"', text)
    overview_png(tmp_path / "bare.png", bare)


def test_an_optimum_that_was_not_measured_is_shown_as_such(data, tmp_path):
    rows = [row | {"measured": None} for row in SUMMARY["optimum"]]
    unmeasured = replace(data, summary=SUMMARY | {"optimum": rows})
    assert "Best measured" not in body(unmeasured, tmp_path)
    overview_png(tmp_path / "unmeasured.png", unmeasured)


def test_what_was_hidden_is_revealed_with_the_outcome(data, tmp_path):
    assert "ac-link resistance 80 mΩ – found." in body(data, tmp_path)
    missed = replace(data, summary=SUMMARY | {"found": False})
    assert "ac-link resistance 80 mΩ – not found." in body(missed, tmp_path)


def test_every_axis_is_labelled_with_its_unit(data, tmp_path):
    figures = re.findall(r'id="data-(\w+)">(.*?)</script>', body(data, tmp_path), flags=re.S)
    assert {name for name, _ in figures} == {"gain", "errors", "optimum", "maps", "channels", "losses"}
    for name, text in figures:
        layout = json.loads(text)["layout"]
        titles = [axis["title"]["text"] for key, axis in layout.items() if "axis" in key and "title" in axis]
        assert titles, name
        assert all("(" in title for title in titles), titles


def test_every_measured_point_is_in_one_band(data):
    bands = power_bands(data.simulation, data.measurements)
    assert [band.power_W for band in bands] == [600.0, 1000.0, 1600.0]
    assert sum(len(band.measured) for band in bands) == 60
    for band in bands:
        assert band.measured["P2_W"].between(band.low_W, band.high_W).all()


def test_the_difference_drawn_is_measured_less_simulated(data):
    figure = efficiency_maps(data.simulation, data.measurements)
    for trace in figure.data[2::3]:
        # points: 100 · (-0.01 · D2)
        np.testing.assert_allclose(trace.marker.color, -1.0 * np.asarray(trace.y), atol=1e-9)


def test_infeasible_cells_are_blank(data):
    heat = efficiency_maps(data.simulation, data.measurements).data[0]
    assert np.isnan(heat.z[list(heat.y).index(1.0)]).all()  # D2 = 1 carries nothing


def test_a_channel_needs_both_columns(data):
    rows = data.measurements.iloc[1:].assign(T_heatsink_C=40.0)
    titles = [a.text for a in channel_residuals(rows).layout.annotations]
    assert titles == ["efficiency", "D0"]
    assert channel_residuals(rows.drop(columns=["sim_efficiency", "sim_D0"])) is None


def test_loss_parts_stack_to_the_total(data):
    figure = loss_breakdown(data.losses)
    # a part that loses nothing is not drawn
    assert [trace.name for trace in figure.data] == ["inductor core"]
    assert list(figure.data[0].y) == [1.0, 2.0]


def test_the_overview_is_a_picture_of_its_size_and_labelled_virtual(data, tmp_path):
    yellow = np.array([0xFF, 0xD8, 0x3D]) / 255
    counts = []
    for virtual in (True, False):
        overview_png(tmp_path / "overview.png", replace(data, virtual=virtual))
        image = matplotlib.image.imread(tmp_path / "overview.png")[..., :3]
        assert image.shape == (900, 1600, 3)
        counts.append(int((np.abs(image - yellow).max(axis=2) < 0.01).sum()))
    assert counts[0] > 5000  # the label is about 580 x 28 pixels
    assert counts[1] == 0


def test_a_browser_draws_every_chart(data, tmp_path):
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("missing program: chromium")
    write_report(tmp_path / "report.html", data)
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    options += [f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=20000", "--dump-dom"]
    done = subprocess.run(
        [browser, *options, (tmp_path / "report.html").as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    drawn = re.findall(
        r'id="chart-(\w+)"[^>]*class="[^"]*js-plotly-plot|class="chart js-plotly-plot" id="chart-(\w+)"',
        done.stdout,
    )
    assert {a or b for a, b in drawn} == {"gain", "errors", "optimum", "maps", "channels", "losses"}


def test_figures_for_a_paper_are_pictures_of_column_width(data, tmp_path):
    files = write_figures(tmp_path, data)
    assert [file.stem for file in files] == ["maps", "model_errors", "optimum", "residuals", "losses", "gain"]
    widths = {file.stem: matplotlib.image.imread(file).shape[1] for file in files}
    for name, width_mm in (("optimum", 88), ("maps", 181)):
        assert abs(widths[name] - width_mm / 25.4 * 300) <= 1  # rounded to whole pixels


@pytest.mark.parametrize("draw", [gain_bars, model_errors, optimum_over_load])
def test_no_label_of_a_figure_for_a_paper_is_cut_off(draw, data):
    figure = draw(data)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    for axes in figure.axes:
        label = axes.xaxis.label.get_window_extent(canvas.get_renderer())
        assert label.x0 >= 0
        assert label.x1 <= figure.bbox.x1


def test_figures_that_the_data_do_not_allow_are_left_out(data, tmp_path):
    bare = replace(data, losses=data.losses.iloc[:0], summary={}, diagnosis=MINIMAL)
    assert [file.stem for file in write_figures(tmp_path, bare)] == ["maps", "residuals"]


def test_it_prints_on_paper_with_every_table_open(data, tmp_path):
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("missing program: chromium")
    write_report(tmp_path / "report.html", data)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1400, "height": 900}, color_scheme="dark")
        page.goto(f"file://{tmp_path}/report.html")
        page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        page.emulate_media(media="print")
        wide = "els => els.filter(el => el.getBoundingClientRect().width > 700).length"
        assert page.locator(".chart .main-svg").evaluate_all(wide) == 0
        assert page.locator("details:not([open])").count() == 0
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
        page.evaluate("window.dispatchEvent(new Event('afterprint'))")
        assert page.locator("details[open]").count() == 0
        browser.close()
