"""The diagnosis page: complete, self-contained, in an order that leads from the verdict to what to do."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from bench.diagnosis_page import DiagnosisPage, noise_rows, ties, tiles, unseen, write_diagnosis_page
from bench.errors import NotWritten
from bench.questions import first_questions
from bench.verdict_wording import unexplained_text

CAUSE = {
    "effect": "link_resistance", "probability": 0.997, "share_of_gap": 0.91, "tied_with": [],
    "added_W": {"mean": 8.9, "lowest": 0.4, "highest": 21.0},
    "parameters": [{"name": "resistance_Ohm", "value": 0.071, "ci95": [0.066, 0.077], "off": 0.0}],
    "says": "more series resistance than modelled", "check": "measure the ac link with four wires",
}  # fmt: skip
ANSWER = {
    "schema": 1, "verdict": "named", "points": 30, "channels": ["efficiency", "D0"],
    "gap": {"mean_abs_efficiency": 0.012, "mean_loss_W": 9.8,
            "worst": {"efficiency": -0.03, "loss_W": 20.0, "D1": 0.7, "D2": 0.1, "P2_W": 900.0}},
    "consistent": {"probability": 0.001}, "causes": [CAUSE], "named": ["link_resistance"],
    "groups": [],
    "unknown": {"probability": 0.8, "formula": "2 W * P/kW", "formula_explains": 0.9, "location": "input",
                "rms_W": 1.2},
    "next": [{"action": "standby", "separates": ["auxiliary_power"], "expected_sigma": 8.0, "minutes": 1.5}],
    "gain": {"blocks": "power band", "before": 0.012, "after": 0.0004, "ci95": [0.011, 0.012], "calibrated": 0.0002,
             "leftover_only": 0.003, "wrong_cause": 0.002, "calibrated_ci95": [0.011, 0.0125],
             "intervals": {"before": [0.01, 0.014], "after": [0.0003, 0.0005], "calibrated": [0.0001, 0.0003],
                           "leftover_only": [0.0025, 0.0035], "wrong_cause": [0.001, 0.003]}},
    "sight": [{"effect": "fan_step", "parameter": "power_W", "smallest": 12.0, "unit": "W", "visible": False,
               "searched": True, "tied_with": []},
              {"effect": "auxiliary_power", "parameter": "power_W", "smallest": 0.5, "unit": "W", "visible": True,
               "searched": True, "tied_with": ["analyzer_offset"]}],
    "noise": {"efficiency": {"sigma": 2e-4, "relative": True, "from_replicates": 0, "excess_kurtosis": 0.0,
                             "autocorrelation": 0.0}},
    "rejected_rows": [{"row": 3, "column": "P2_W", "value": "0.6", "reason": "looks like kilowatts"}],
    "rejected_columns": [{"column": "T_heatsink_C", "reason": "reads 25 in all 30 rows: a stuck sensor"}],
    "model": "model.toml",
}  # fmt: skip
WORSE = ANSWER["gain"] | {"after": 0.02, "ci95": [-0.009, -0.007]}  # held out, with what is named


@pytest.fixture
def page(residuals: pd.DataFrame) -> DiagnosisPage:
    return DiagnosisPage(
        source="somewhere.csv", virtual=False, created="2026-01-01", diagnosis=ANSWER, residuals=residuals
    )


def written(page: DiagnosisPage, folder: Path) -> str:
    write_diagnosis_page(folder / "page.html", page)
    return (folder / "page.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_leaves_the_page_of_before(page: DiagnosisPage, tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text("before")
    with pytest.raises(NotWritten, match=r"/page\.html cannot be written: the disk is full"):
        write_diagnosis_page(tmp_path / "page.html", page)
    assert (tmp_path / "page.html").read_text() == "before"


def test_it_reads_from_the_verdict_to_the_noise(page: DiagnosisPage, tmp_path: Path) -> None:
    text = written(page, tmp_path)
    order = [
        "Cause named beside something unknown (80.0 %): ac-link resistance",
        *("What to do", "measurement and simulation differ", "How probable", "What no cause explains"),
        *("What the diagnosis gains", "can and cannot see", ">Noise<"),
    ]
    places = [text.index(heading) for heading in order]
    assert places == sorted(places)


def test_every_chart_has_its_data_and_nothing_is_fetched(page: DiagnosisPage, tmp_path: Path) -> None:
    text = written(page, tmp_path)
    blocks = dict(re.findall(r'<script type="application/json" id="data-(\w+)">(.*?)</script>', text, re.S))
    assert set(blocks) == {"residuals", "time", "causes", "leftover", "gain"}
    assert all(json.loads(block)["data"] for block in blocks.values())
    assert not re.search(r'<(script|link|img)[^>]+(src|href)="http', text)


def test_what_was_left_out_and_what_is_unknown_is_said(page: DiagnosisPage, tmp_path: Path) -> None:
    text = written(page, tmp_path)
    assert "a stuck sensor" in text
    assert "2 W * P/kW" in text
    assert "looks like kilowatts" in text


def test_a_row_without_a_value_is_listed_without_one(page: DiagnosisPage, tmp_path: Path) -> None:
    row = {"row": 7, "column": "P2_W", "value": None, "reason": "too near the limit"}
    text = written(replace(page, diagnosis=ANSWER | {"rejected_rows": [row]}), tmp_path)
    assert "<td>P2_W</td><td>none</td><td>too near the limit</td>" in text


def test_what_the_import_left_out_is_listed_as_its_file_counts(page: DiagnosisPage, tmp_path: Path) -> None:
    row = {"row": 7, "line": 9, "column": "P1_W", "value": "inf", "reason": "overrange"}
    before = {"left_out_by_import": {"file": "theirs.csv", "rows": [row]}}
    text = written(replace(page, diagnosis=ANSWER | before), tmp_path)
    assert "What the import of theirs.csv left out: 1 row<" in text
    assert '<td class="number">9</td><td>P1_W</td><td>inf</td><td>overrange</td>' in text
    assert "1 row not used by the diagnosis; 1 row left out by the import" in text


def test_an_extension_that_predicts_worse_is_not_to_be_used(page: DiagnosisPage, tmp_path: Path) -> None:
    text = written(replace(page, diagnosis=ANSWER | {"gain": WORSE}), tmp_path)
    assert "held-out rows are 2.000 points off with what is named, 1.200 without" in text
    assert "(0.700 to 0.900 points worse, 95 %), so the extended model is not to be used" in text
    assert "Make sure first that the model describes the converter" in text
    assert "from now on" not in text
    assert "from now on" in written(page, tmp_path)


def test_a_name_that_spreads_cancel_in_efficiency_is_not_doubted(page: DiagnosisPage, tmp_path: Path) -> None:
    text = written(
        replace(page, diagnosis=ANSWER | {"gain": WORSE, "unknown": {"probability": 0.0}}), tmp_path
    )
    assert "Do not predict efficiency with the extended model: held-out rows are 2.000 points off" in text
    assert "but 0.020 with the everyday spreads of parts and instruments fitted beside it" in text
    assert "Make sure first that the model describes the converter" not in text
    assert "from now on" not in text


def test_spreads_that_may_not_help_do_not_save_a_name(page: DiagnosisPage, tmp_path: Path) -> None:
    gain = WORSE | {"calibrated_ci95": [-0.0001, 0.002]}
    text = written(
        replace(page, diagnosis=ANSWER | {"gain": gain, "unknown": {"probability": 0.0}}), tmp_path
    )
    assert "so the extended model is not to be used" in text


@pytest.mark.parametrize(
    "changed",
    [
        {"ci95": [-0.017, 0.001]},  # resampled rows do not agree that it is worse
        {"after": 0.0125, "ci95": [-0.0008, -0.0002]},  # sure, but too little to matter
    ],
)
def test_what_is_not_surely_and_much_worse_is_used(
    changed: dict[str, object], page: DiagnosisPage, tmp_path: Path
) -> None:
    text = written(replace(page, diagnosis=ANSWER | {"gain": WORSE | changed}), tmp_path)
    assert "the extended model is not to be used" not in text
    assert "from now on" in text
    assert "Efficiency of held-out rows is no nearer for it" in text


def test_a_cause_says_its_watts(page: DiagnosisPage, tmp_path: Path) -> None:
    assert '<td class="number">8.90<br>0.40 to 21.00</td>' in written(page, tmp_path)
    before = {key: value for key, value in CAUSE.items() if key != "added_W"}  # as kept by an earlier version
    older = written(replace(page, diagnosis=ANSWER | {"causes": [before]}), tmp_path)
    assert '<td class="number">–</td>' in older


def test_what_of_the_plan_is_not_there_is_said_with_the_verdict(page: DiagnosisPage, tmp_path: Path) -> None:
    of = {"campaign": {"id": 7, "planned": 50, "accepted": 26, "rejected": 0, "state": "interrupted"}}
    text = written(replace(page, diagnosis=ANSWER | of), tmp_path)
    assert "26 of 50 planned rows were measured, and the campaign is interrupted: d2ea resume 7" in text
    assert text.index("26 of 50 planned") < text.index("What to do")
    assert "Not all of the plan" not in written(page, tmp_path)


def test_a_suspect_is_said_at_once_and_is_no_agreement(page: DiagnosisPage, tmp_path: Path) -> None:
    open_ = {"verdict": "consistent", "unknown": {"probability": 0.0}, "consistent": {"probability": 0.3}}
    text = written(
        replace(page, diagnosis=ANSWER | open_ | {"causes": [CAUSE | {"probability": 0.7}]}), tmp_path
    )
    assert "Not sure: ac-link resistance (70.0 %) is suspected, or nothing is wrong (30.0 %)" in text
    assert '<section class="verdict suspected"' in text
    assert "Change nothing yet" in text
    sound = written(replace(page, diagnosis=ANSWER | open_ | {"causes": []}), tmp_path)
    assert '<section class="verdict consistent"' in sound
    assert "Nothing needs changing" in sound


def test_a_condition_that_readings_doubt_is_what_to_do_first(page: DiagnosisPage, tmp_path: Path) -> None:
    supply = {"column": "V1_V", "taken": 300.0, "value": 304.12, "ci95": [303.6, 304.6]}
    agrees = ANSWER | {"verdict": "consistent", "consistent": {"probability": 1.0}, "causes": []}
    text = written(replace(page, diagnosis=agrees | {"conditions": [supply]}), tmp_path)
    asked = text.index("Read V1_V, write what it was into the table and diagnose again.")
    assert asked < text.index("If it was that, nothing needs changing")
    assert "V1 304.1 V (95 %: 303.6 to 304.6; the model has 300 V)" in text.replace("\N{NO-BREAK SPACE}", " ")
    assert "Nothing needs changing:" not in text
    assert '<section class="verdict suspected"' in text


def test_efficiency_alone_asks_for_voltages_that_nobody_read(page: DiagnosisPage, tmp_path: Path) -> None:
    taken = [
        {"column": "V1_V", "taken": 300.0, "value": None, "ci95": None},
        {"column": "T_ambient_C", "taken": 25.0, "value": None, "ci95": None},
    ]
    asked = "Make sure first that V1_V was 300 V: the table does not say"
    alone = ANSWER | {"channels": ["efficiency"], "conditions": taken}
    assert asked in written(replace(page, diagnosis=alone), tmp_path).replace("\N{NO-BREAK SPACE}", " ")
    beside = ANSWER | {"channels": ["efficiency", "D0"], "conditions": taken}
    assert "Make sure first that V1_V" not in written(replace(page, diagnosis=beside), tmp_path)
    read = alone | {"conditions": taken[1:]}
    assert "Make sure first that V1_V" not in written(replace(page, diagnosis=read), tmp_path)


def test_a_sensor_that_is_off_is_said_and_is_to_be_checked_first(page: DiagnosisPage, tmp_path: Path) -> None:
    current = {"column": "I_L_rms_A", "kind": "gain", "value": 0.029, "unit": "1"}
    unknown = {"probability": 0.999, "location": "gain of I_L_rms_A", "rms_W": 0.0, "sensor": current}
    off = ANSWER | {"verdict": "unknown", "named": [], "causes": [], "unknown": unknown}
    residuals = page.residuals.assign(leftover_W=0.0)
    text = written(replace(page, diagnosis=off, residuals=residuals), tmp_path).replace(
        "\N{NO-BREAK SPACE}", " "
    )
    assert "A sensor is off: rms link current reads 2.9 % high" in text
    assert "<li>Check what reads the rms link current (I_L_rms_A)" in text
    assert "Make sure first that the model" not in text
    assert "What no cause explains" not in text  # no watt is missing
    beside = written(replace(page, diagnosis=ANSWER | {"unknown": unknown}), tmp_path)
    assert "Cause named beside a sensor that is off" in beside


def test_a_property_that_goes_by_temperature_is_said_and_is_to_be_measured_warm(
    page: DiagnosisPage, tmp_path: Path
) -> None:
    change = {
        "effect": "leakage_inductance", "parameter": "relative_error", "unit": "1", "column": "T_inductor_C",
        "per_K": -0.00102, "check": "measure the series inductance",
    }  # fmt: skip
    place = "leakage_inductance over T_inductor_C"
    unknown = {"probability": 0.999, "location": place, "rms_W": 0.1, "over_temperature": change}
    warm = ANSWER | {"verdict": "unknown", "named": [], "causes": [], "unknown": unknown}
    residuals = page.residuals.assign(leftover_W=0.1)
    whole = written(replace(page, diagnosis=warm, residuals=residuals), tmp_path)
    text = " ".join(whole.replace("\N{NO-BREAK SPACE}", " ").split())
    assert "Leakage inductance goes by the temperature of the inductor winding: −1.02 % in 10 K" in text
    assert "<li>Measure one set point soon after a cold start and again when all is warm" in text
    assert "If they do, measure the series inductance, cold and warm." in text
    assert "Make sure first that the model" not in text
    assert place not in text  # people do not read columns
    beside = written(replace(page, diagnosis=ANSWER | {"unknown": unknown}), tmp_path)
    assert "Cause named beside a property that goes by temperature" in beside


def test_a_cause_that_sets_in_is_said_with_its_moment(page: DiagnosisPage, tmp_path: Path) -> None:
    resistance = {"name": "resistance_Ohm", "unit": "Ohm", "value": 0.0606, "off": 0.0}
    onset = {
        "effect": "link_resistance", "parameter": resistance, "sets_in": True, "after_s": 10440.0,
        "between_rows": [58, 59], "check": "tighten the terminals",
    }  # fmt: skip
    unknown = {"probability": 0.999, "location": "part of the time", "rms_W": 1.0, "onset": onset}
    set_in = ANSWER | {"verdict": "unknown", "named": [], "causes": [], "unknown": unknown}
    residuals = page.residuals.assign(leftover_W=1.0)
    whole = written(replace(page, diagnosis=set_in, residuals=residuals), tmp_path)
    text = " ".join(whole.replace("\N{NO-BREAK SPACE}", " ").split())
    assert (
        "Ac-link resistance sets in between rows 58 and 59, after 2 h 54 min (60.6 mΩ then, 0 Ω before)"
        in text
    )
    assert "<li>Find out what changed after 2 h 54 min (tighten the terminals)" in text
    assert "What is there for a part of the time" in text
    assert "Make sure first that the model" not in text
    agree = {"name": "before", "rows": 58, "refused": None, "answer": {"verdict": "consistent"}}
    few = {"name": "after", "rows": 7, "refused": "7 usable rows", "answer": None}
    apart = set_in | {"unknown": unknown | {"onset": onset | {"stretches": [agree, few]}}}
    text = " ".join(written(replace(page, diagnosis=apart, residuals=residuals), tmp_path).split())
    assert (
        'Before the change, 58 rows: Simulation and measurement agree (<a href="before/diagnosis.html">its page</a>).'
        in text
    )
    assert "After the change, 7 rows: not diagnosed, 7 usable rows." in text
    gone = set_in | {"unknown": unknown | {"onset": onset | {"sets_in": False}}}
    text = written(replace(page, diagnosis=gone, residuals=residuals), tmp_path)
    assert "goes away between rows 58 and 59, after 2 h 54 min (0 Ω then, 60.6 mΩ before)" in text.replace(
        "\N{NO-BREAK SPACE}", " "
    )
    beside = written(replace(page, diagnosis=ANSWER | {"unknown": unknown}), tmp_path)
    assert "Cause named beside a change on the way" in beside


def test_what_is_less_likely_than_nothing_is_said_all_the_same(page: DiagnosisPage, tmp_path: Path) -> None:
    open_ = {"verdict": "consistent", "unknown": {"probability": 0.0}, "consistent": {"probability": 0.56}}
    text = written(
        replace(page, diagnosis=ANSWER | open_ | {"causes": [CAUSE | {"probability": 0.41}]}), tmp_path
    )
    assert "No fault proven: nothing is wrong (56.0 %), or ac-link resistance (41.0 %)" in text
    assert '<section class="verdict suspected"' in text
    hardly = written(
        replace(page, diagnosis=ANSWER | open_ | {"causes": [CAUSE | {"probability": 0.1}]}), tmp_path
    )
    assert "Simulation and measurement agree" in hardly


def test_the_value_that_the_model_file_holds_is_said(page: DiagnosisPage, tmp_path: Path) -> None:
    head = CAUSE["parameters"][0] | {"in_model": 0.0763}
    text = written(replace(page, diagnosis=ANSWER | {"causes": [CAUSE | {"parameters": [head]}]}), tmp_path)
    assert (
        "model.toml. It holds ac-link resistance 76.3 mΩ (71 mΩ is likeliest): of the values inside" in text
    )
    assert "It holds" not in written(page, tmp_path)  # as kept by an earlier version


def test_how_the_table_was_read_stands_before_the_residuals(page: DiagnosisPage, tmp_path: Path) -> None:
    said = "I1_A: V1_V * I1_A is 1.03 times P1_W (median)"
    text = written(replace(page, diagnosis=ANSWER | {"notes": [said]}), tmp_path)
    assert text.index("What to do") < text.index(said) < text.index("Where measurement and simulation differ")
    assert "How the table was read" not in written(page, tmp_path)


def test_two_that_are_tied_are_said_once_and_repeats_stand_with_their_step(
    page: DiagnosisPage, tmp_path: Path
) -> None:
    names = ("auxiliary_power", "analyzer_offset")
    seen = {"smallest": 1.0, "unit": "W", "visible": True}
    both = [seen | {"effect": a, "tied_with": [b]} for a, b in (names, names[::-1])]
    assert ties({"sight": both}) == [("auxiliary power", ["analyzer current offset"])]
    again = ANSWER["next"][0] | {"repeats": 3}
    text = written(replace(page, diagnosis=ANSWER | {"next": [again]}), tmp_path)
    assert ", 3 times</td>" in text


def test_a_virtual_lab_is_labelled(page: DiagnosisPage, tmp_path: Path) -> None:
    assert "VIRTUAL LAB" not in written(page, tmp_path)
    assert "VIRTUAL LAB" in written(replace(page, virtual=True), tmp_path)


def test_tables_say_what_stands_behind_them() -> None:
    assert noise_rows(ANSWER) == [("efficiency", "0.02 % of the output power", "assumed: no replicates", "–")]
    assert unseen(ANSWER).larger == (("fan power step", "12 W"),)
    few = {"efficiency": ANSWER["noise"]["efficiency"] | {"from_replicates": 3}}
    assert noise_rows({"noise": few})[0][2] == "assumed: 3 differences of replicates"
    sight = [
        ANSWER["sight"][0]
        | {"effect": effect, "parameter": parameter, "smallest": smallest, "searched": searched}
        for effect, parameter, smallest, searched in (
            ("link_resistance", "resistance_Ohm", 0.0899, True),
            ("core_loss_inductor", "relative_error", 1.2, True),
            ("gate_delay_skew", "skew_s", 0.36, False),
        )
    ]
    blind = unseen({"sight": sight})
    assert blind.larger == (("ac-link resistance", "89.9 mΩ"), ("inductor core loss", "120 %"))
    assert blind.never == ("gate-delay skew",)
    warm = {"T_heatsink_C": ANSWER["noise"]["efficiency"] | {"sigma": 0.4, "relative": False}}
    assert noise_rows({"noise": warm})[0][:2] == ("heatsink", "0.4 K")
    assert [what for what, _, _ in tiles(ANSWER)] == [
        "Measured rows",
        "Gap of efficiency",
        "Worst row",
        "Gap left, held out",
    ]


@pytest.mark.parametrize(
    ("differences", "kurtosis", "memory", "said"),
    [
        (100, 2.8, 0.29, "–"),
        (100, 3.2, 0.0, "heavy tails"),
        (100, 0.0, 0.41, "remembers: drift or slow settling"),
        (100, 3.2, 0.39, "heavy tails"),  # a hundred differences reach 0.4 by chance
        (16, 4.8, 1.1, "remembers: drift or slow settling"),  # sixteen reach a tail of 5 and a memory of 1
        (0, 9.0, 0.9, "–"),
    ],
)
def test_noise_is_unusual_only_beyond_what_chance_does(
    differences: int, kurtosis: float, memory: float, said: str
) -> None:
    of = {"from_replicates": differences, "excess_kurtosis": kurtosis, "autocorrelation": memory}
    noise = {"efficiency": ANSWER["noise"]["efficiency"] | of}
    assert noise_rows({"noise": noise})[0][3] == said


def test_where_only_laws_that_are_off_explain_efficiency_more_channels_are_asked_for() -> None:
    strained = ANSWER | {"verdict": "unknown", "unknown": {"probability": 1.0, "strained": True}}
    assert any("Measure more than efficiency: D0" in question for question in first_questions(strained))
    assert "loss laws of the simulation off" in unexplained_text(strained)
    assert not any("Measure more" in question for question in first_questions(ANSWER))


def test_a_part_that_a_name_needs_too_far_off_is_asked_for() -> None:
    needs = ANSWER | {"parts": [{"part": "secondary.switch.on.resistance_Ohm", "sigma": -6.97}]}
    assert any(
        "needs secondary switch on resistance 7.0 times its everyday spread off" in q
        for q in first_questions(needs)
    )
    assert not any("everyday spread off" in question for question in first_questions(ANSWER))
