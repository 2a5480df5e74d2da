"""The page of answers has every key that a diagnosis and a demo write, with its type, and no other."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from bench import cli
from bench.campaign import run_campaign
from bench.demo import DemoResult, summary_of
from bench.diagnosing import answer_of
from bench.job import Job
from bench.lut_file import LutOrigin, as_plain
from bench.lut_on_bench import verified
from bench.measure import Target, rejected
from bench.plan import Kind
from bench.safety import Limits, Readings, decide
from bench.store import Store, database_url
from bench.wording import MODEL_NAMES
from models.dataset import load_measurements
from models.diagnosis.agreement import Confirmed
from models.diagnosis.change import Change
from models.diagnosis.conditions import Condition
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.diagnosis.observations import CHANNELS
from models.diagnosis.onset import Onset
from models.diagnosis.over_temperature import OverTemperature
from models.diagnosis.race import NextMeasurement
from models.diagnosis.sensors import SensorError
from models.diagnosis.stretches import Stretch
from models.diagnosis.unexplained import Unexplained
from models.lut import Line, Lut
from models.optimise import OptimumTable
from sim.model import Model
from tests.bench.fake_bench import FakeInstruments, bench_config, campaign_config, predict
from tests.docs.tables import tables
from tests.models.diagnosis.virtual_campaign import simulated_campaign
from tests.test_house import first_cells, section

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "answer.md"
KEYED = {"seconds": "step", "error": "model", "hidden_values": "effect"}  # by what data are told apart there
LIMITS = Limits(upper={}, output_voltage_V=140.0)
TYPES: dict[str, tuple[type, ...]] = {
    "text": (str,),
    "number": (int, float),
    "count": (int,),
    "flag": (bool,),
    "object": (dict,),
    "list": (list,),
    "null": (type(None),),
}

Plain = dict[str, Any]


# --- what is written ----------------------------------------------------------------------------------


def measured_table() -> pd.DataFrame:
    """Rows of the simulator with a resistance; one that cannot be, a sensor that stuck, a current that is off."""
    model = Model.baseline().with_effect("link_resistance", resistance_Ohm=0.1)
    frame = simulated_campaign(model, seed=2, count=20)
    frame.loc[3, "P2_W"] = 5000.0
    return frame.assign(V1_V=300.0, I1_A=1.03 * frame["P1_W"] / 300.0, T_inductor_C=25.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the table was imported, and the campaign diagnosed by the command."""
    where = tmp_path_factory.mktemp("diagnosed")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(where)
        patch.delenv("D2EA_DB", raising=False)
        measured_table().to_csv("measured.csv", index=False)
        for words in (("import", "measured.csv"), ("diagnose", "1", "--processes", "1")):
            with pytest.raises(SystemExit) as ended:
                cli.main(words)
            assert not ended.value.code
    return where / "diagnosis"


@pytest.fixture(scope="module")
def full() -> Diagnosis:
    """A diagnosis of the same rows, with an entry more wherever a list or a leftover may be."""
    found = diagnose(load_measurements(measured_table()))
    rows = np.arange(2)
    leftover = Unexplained(
        location="input", rms_W=1.0, formula="1 W", explained=1.0, rows=rows, readings=rows,
        watts=np.ones(2), size=9.0, probability=1.0, at_place=1.0,
        sensor=SensorError(column="D0", kind="offset", value=0.1, unit="Th"),
    )  # fmt: skip
    step = NextMeasurement(
        action="measure a point", separates=("dead_time",), expected_sigma=2.0, minutes=4.0, set_point=(1, 0, 500)
    )  # fmt: skip
    return replace(
        found,
        unexplained=leftover,
        alike=[Confirmed(row=1, watts=2.0, sigma=6.0)],
        parts={"inductor.inductance_H": 5.0},
        conditions=[
            Condition(column="V1_V", taken=300.0, value=304.0, ci95=(303.5, 304.5)),
            Condition(column="V2_V", taken=140.0),
        ],
        ahead=[step],
    )


@pytest.fixture(scope="module")
def summary(full: Diagnosis) -> Plain:
    """The summary of a demo that was not run: two loads, one of them not measured, and carried nowhere by a search."""
    loads_W = np.array([400.0, 800.0])
    optimum = OptimumTable(
        power_W=loads_W, D1=np.ones(2), D2=np.zeros(2), predicted=np.full(2, 0.98), regret=np.zeros(2),
        confirmed=np.ones(2, dtype=bool), optimiser="lattice", evaluations=9,
    )  # fmt: skip
    nothing = pd.DataFrame()
    result = DemoResult(
        bench=bench_config(),
        simulation=pd.DataFrame({"feasible": [True, False]}),
        measurements=nothing,
        losses=nothing,
        optimum=optimum,
        searches=(optimum, replace(optimum, D1=np.array([1.0, np.nan]), regret=np.full(2, np.nan))),
        optimum_measured={400.0: 0.979},
        diagnosis=full.as_plain(),
        error=dict.fromkeys(MODEL_NAMES, 1e-3) | {"calibrated": None},
        hidden={"link_resistance": 0.1},
        found=True,
        power_off="PWM off",
        campaigns=(SimpleNamespace(accepted=40),),  # type: ignore[arg-type]  # as much as a summary needs
        seconds=dict.fromkeys(steps_of_the_demo(), 1.0),
    )
    return summary_of(result)


def steps_of_the_demo() -> list[str]:
    source = (ROOT / "bench" / "demo.py").read_text(encoding="utf-8")
    return re.findall(r'watch\.(?:step\(|seconds\[)"(\w+)"', source)


# --- what is documented -------------------------------------------------------------------------------


def documented(part: str) -> dict[str, str]:
    """The type of every key under a heading of the page, by its path."""
    found = {}
    for table in tables(PAGE):
        if table.part == part:
            before = "" if " " in table.heading else f"{table.heading}."
            found |= {before + key: kind for key, kind, _ in table.rows}
    return found


def paths(value: object, path: str = "") -> Iterator[tuple[str, object]]:
    """Every key in plain data by its path; keys of data as the page calls them."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            at = f"{path}.{key}".lstrip(".")
            at = at.removeprefix("unknown.onset.stretches[].answer.")
            at = at.replace("unknown.onset.sensor.", "unknown.sensor.")
            at = re.sub(r"^noise\.\w+", "noise.<channel>", at)
            at = re.sub(r"^gain\.intervals\.\w+", "gain.intervals.<error>", at)
            at = re.sub(r"^(seconds|error|hidden_values)\.\w+", lambda m: f"{m[1]}.<{KEYED[m[1]]}>", at)
            yield at, inner
            yield from paths(inner, at)
    elif isinstance(value, list):
        for inner in value:  # other kinds of blocks have the keys of the first
            yield from paths(inner, "gain" if path == "gain.also" else f"{path}[]")


def written(*answers: Plain) -> dict[str, list[object]]:
    """All values under every path of some answers."""
    found: dict[str, list[object]] = {}
    for answer in answers:
        for path, value in paths(answer):
            found.setdefault(path, []).append(value)
    return found


def is_of(value: object, said: str) -> bool:
    """Whether a value is of one of the types that the page says."""
    of = [TYPES[each.split()[0]] for each in said.split(" or ")]
    return any(isinstance(value, t) and (not isinstance(value, bool) or bool in t) for t in of)


# --- one is the other ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def answers(folder: Path, full: Diagnosis) -> tuple[Plain, ...]:
    by_command = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    assert full.unexplained is not None
    onset = Onset(
        effect="link_resistance", parameter="resistance_Ohm", unit="Ohm", value=0.1, aside=0.0, after_s=60.0, before=0,
        row=1, sets_in=True, direction=np.ones(2),
    )  # fmt: skip
    changed = replace(full, unexplained=replace(full.unexplained, sensor=None, onset=onset))
    loose = replace(full.unexplained.sensor, value=0.2) if full.unexplained.sensor else None
    change = Change(place="offset of D0", columns=np.ones((1, 2)), sensor=loose)
    sensor = replace(
        changed, unexplained=replace(changed.unexplained, onset=replace(onset, change=change))
    ).as_plain("model.toml")
    measured = load_measurements(measured_table())
    apart = [
        Stretch(name="before", measurements=measured, found=full, refused=""),
        Stretch(name="after", measurements=measured, found=None, refused="7 usable rows"),
    ]
    whole = answer_of(changed, measured, None, "model.toml", apart)
    property_ = OverTemperature(
        effect="leakage_inductance", parameter="relative_error", unit="1", column="T_inductor_C", per_K=-1e-3,
        check="measure the series inductance",
    )  # fmt: skip
    warm = replace(
        full, unexplained=replace(full.unexplained, sensor=None, over_temperature=property_)
    ).as_plain("model.toml")
    return by_command, full.as_plain("model.toml"), whole, sensor, warm


def test_every_key_of_the_answer_is_on_the_page_and_no_other(answers: tuple[Plain, ...]) -> None:
    assert set(written(*answers)) == set(documented("diagnose --json"))


def test_every_value_of_the_answer_is_of_the_type_that_the_page_says(answers: tuple[Plain, ...]) -> None:
    said = documented("diagnose --json")
    wrong = {p: v for p, values in written(*answers).items() for v in values if not is_of(v, said[p])}
    assert not wrong


def test_what_of_the_answer_may_be_missing_is_what_the_page_says(answers: tuple[Plain, ...]) -> None:
    top = [row for t in tables(PAGE) if t.heading == "The answer" for row in t.rows]
    by_command = {key for key, _, meaning in top if "by d2ea diagnose" in meaning}
    assert set(answers[0]) - set(answers[1]) == by_command


def test_every_key_of_the_summary_is_on_the_page_and_no_other(summary: Plain) -> None:
    there = written(summary | {"diagnosis": {}})
    said = documented("summary.json")
    assert set(there) == set(said)
    assert not {p: v for p, values in there.items() for v in values if not is_of(v, said[p])}


def test_a_summary_is_json_where_a_search_carries_a_load_nowhere(summary: Plain) -> None:
    assert json.loads(json.dumps(summary["swarm"], allow_nan=False))[1]["D1"] == [1.0, None]


def test_the_steps_of_the_demo_are_those_on_the_page() -> None:
    told = PAGE.read_text(encoding="utf-8").split("### `seconds`")[1].split("###")[0]
    assert set(re.findall(r"`(\w+)`", told)) == set(steps_of_the_demo())


def lut_as_written(*, half_width: float, dip: float) -> Plain:
    line = Line(
        low_W=400.0, high_W=800.0, carries=False, zero_state_appears=True, lost_edges=("primary_rise",), dip=dip
    )  # fmt: skip
    rows = {name: np.ones(2) for name in ("power_W", "D1", "D2", "predicted", "price", "soft_edges")}
    lut = Lut(**rows, half_width=half_width, lines=(line,), left_out_W=(900.0,))
    origin = LutOrigin(model="0123", kind="d2ea", data_sha256="ab", data="x.csv", lab="hardware")
    return json.loads(json.dumps(as_plain(lut, origin), allow_nan=False))  # type: ignore[no-any-return]


def test_every_key_of_a_table_as_json_is_on_the_page_and_no_other() -> None:
    known, unknown = lut_as_written(half_width=0.01, dip=0.0), lut_as_written(half_width=np.nan, dip=np.inf)
    there, said = written(known, unknown), documented("A table as JSON")
    units = {path for path in there if path.startswith("units.")}
    assert set(there) - units == set(said) - {"units.<column>"}
    assert {path.removeprefix("units.") for path in units} == {"P_W", "D1", "D2", "predicted"}
    assert not {p: v for p in set(there) - units for v in there[p] if not is_of(v, said[p])}
    left_open = {path for path in there if None in there[path]}
    assert left_open == {path for path, kind in said.items() if "null" in kind}


# --- NOMENCLATURE.md: the tables that are written ------------------------------------------------------


def test_columns_of_the_residuals_are_those_listed(folder: Path, full: Diagnosis) -> None:
    there = {*pd.read_csv(folder / "residuals.csv"), *full.residual_table(), *_residuals_of_all_channels()}
    listed = set(first_cells("Residuals")) - {"residual_<column>"}
    assert there == listed | _residuals_of_all_channels()
    below = section("NOMENCLATURE.md", "Residuals").partition("Columns: ")[2]
    assert set(re.findall(r"`(\w+)`", below)) == {channel.column for channel in CHANNELS}


def _residuals_of_all_channels() -> set[str]:
    return {f"residual_{channel.column}" for channel in CHANNELS}


def test_columns_of_a_verified_table_are_those_listed() -> None:
    table = pd.DataFrame({"P_W": [400.0, 800.0], "D1": 0.9, "D2": 0.1, "predicted": 0.98})
    reading = {"kind": "load", "P_set_W": 600.0, "P2_W": 600.0, "D1": 0.9, "D2": 0.1}
    measured = pd.DataFrame([reading | {"efficiency": 0.98, "u_efficiency": 1e-4}])
    result = verified(table.assign(predicted_low=0.97, predicted_high=0.99), measured, 0.016)
    assert list(result) == first_cells("Verified table")


def test_rejected_rows_have_the_columns_listed_and_a_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("D2EA_DB", raising=False)
    fake = FakeInstruments()
    point = {"D1": 0.9, "D2": 0.1, "power_W": 500.0}
    plan = {"kind": "points", "set_points": [point], "standby": 0, "no_load": 0}
    config = campaign_config(measure={"samples": 4, "voltage_tolerance": 1e-9}, plan=plan)
    job = Job.prepare(config, bench_config(), predict=predict)
    with Store(database_url(None)) as store:
        outcome = run_campaign(job, store, fake.clock, around=fake.around())
        table = store.rejected_table(outcome.campaign_id)
    assert set(table) - set(first_cells("Measurement table")) == set(first_cells("Rejected rows"))
    assert is_listed(table["reason"][0])


def test_the_reasons_of_rejected_rows_are_those_listed() -> None:
    row: Any = SimpleNamespace(kind=Kind.LOAD, power_W=500.0)
    target = Target(output_voltage_V=140.0, settings=campaign_config().measure)
    held = {"V2_V": 140.0, "P2_W": 500.0}
    said = [
        rejected(row, held, "overrange", target),
        rejected(row, held | {"V2_V": 120.0}, "good", target),
        rejected(row, held | {"P2_W": 300.0}, "good", target),
        *decide(LIMITS, Readings(values={"V2_V": 10.0}, pwm_on=True, pwm_expected=True)).reasons,
    ]
    assert all(reason and is_listed(reason) for reason in said)


def is_listed(reason: str) -> bool:
    patterns = (re.escape(said).replace(r"\.\.\.", ".+") for said in first_cells("Rejected rows", 1))
    return any(re.fullmatch(pattern, reason) for pattern in patterns)
