"""The measurement table: what is accepted, what is refused and how that is said."""

import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from models.dataset import DatasetError, load_measurements
from models.other_names import OtherName, OtherNameError

GOOD = {"D1": 0.8, "D2": 0.2, "P2_W": 600.0, "P1_W": 612.0}


def table(*rows):
    return pd.DataFrame([GOOD | row for row in rows])


def test_efficiency_and_input_power_are_worked_out_from_each_other():
    from_power = load_measurements(table({})).frame
    assert from_power["efficiency"][0] == pytest.approx(600 / 612)
    from_efficiency = load_measurements(
        pd.DataFrame([{"D1": 0.8, "D2": 0.2, "P2_W": 600.0, "efficiency": 0.96}])
    )
    assert from_efficiency.frame["P1_W"][0] == pytest.approx(625.0)


def test_light_loads_of_a_small_converter_are_in_watts():
    small = table({"P2_W": 90.0, "P1_W": 95.0}, {"P2_W": 2.0, "P1_W": 3.0}, {"P2_W": 9.0, "P1_W": 10.0})
    assert len(load_measurements(small).rejected) == 0


def test_a_table_in_kilowatts_throughout_is_said_to_be():
    with pytest.raises(DatasetError, match=r"none of 2 rows .* kilowatts"):
        load_measurements(table({"P2_W": 0.6, "P1_W": 0.61}, {"P2_W": 1.2, "P1_W": 1.23}))


@pytest.mark.parametrize(
    ("row", "column", "reason"),
    [
        ({"D1": np.nan}, "D1", "not a finite number"),
        ({"P2_W": np.inf}, "P2_W", "not a finite number"),
        ({"P2_W": 9.91e37}, "P2_W", "not a finite number"),
        ({"P1_W": 9.9e37}, "P1_W", "overrange or no data"),
        ({"P1_W": np.nan}, "P1_W", "neither P1_W nor efficiency"),
        ({"P1_W": np.nan, "efficiency": 98.45}, "efficiency", "per cent"),
        ({"P1_W": np.nan, "efficiency": 1.02}, "efficiency", r"not in \(0, 1\]"),
        ({"efficiency": -0.1}, "efficiency", r"not in \(0, 1\]"),
        ({"P2_W": 0.6, "P1_W": 0.612}, "P2_W", "kilowatts"),
        ({"P1_W": 0.612}, "P1_W", "kilowatts"),
        ({"P1_W": 590.0}, "P2_W", "more power out than in"),
        ({"P2_W": -600.0}, "P2_W", "not above 0 W"),
        ({"D1": 1.2}, "D1", r"outside \[0, 1\]"),
        ({"D2": -0.01}, "D2", r"outside \[0, 1\]"),
        ({"efficiency": 0.90}, "efficiency", "differs from P2_W / P1_W"),
        ({"kind": "loaded"}, "kind", "load, reference, standby, no_load"),
        ({"kind": "standby", "P1_W": np.nan}, "P1_W", "not a finite number"),
        ({"D1": "O.8"}, "D1", "text"),
    ],
)
def test_an_impossible_row_is_named_with_column_value_and_reason(row, column, reason):
    result = load_measurements(table({"P1_W": 615.0}, row, {"P1_W": 614.0}))
    (rejected,) = result.rejected
    assert (rejected.row, rejected.column) == (2, column)
    assert re.search(reason, rejected.reason)
    assert len(result.frame) == 2


def test_the_rejected_value_is_shown_as_it_stood():
    (rejected,) = load_measurements(table({}, {"efficiency": 98.04})).rejected
    assert rejected.value == "98.04"


def test_a_row_that_repeats_another_is_rejected_and_a_replicate_is_not():
    result = load_measurements(table({}, {"P1_W": 612.1}, {}))
    assert [(r.row, r.reason) for r in result.rejected] == [(3, "repeats an earlier row in every column")]
    assert str(result.rejected[0]).startswith("row 3, D1 = 0.8: repeats")


def test_a_row_that_repeats_another_but_for_its_number_is_told_by_its_time():
    copied = table({"time_s": 1.0, "Nr.": 1}, {"time_s": 1.0, "Nr.": 2}, {"time_s": 2.0, "Nr.": 3})
    (rejected,) = load_measurements(copied).rejected
    assert (rejected.row, rejected.column) == (2, "time_s")
    assert len(load_measurements(copied.drop(columns="time_s")).rejected) == 0


def test_standby_rows_need_input_power_only():
    standby = {"D1": np.nan, "D2": np.nan, "P2_W": np.nan, "P1_W": 6.0, "kind": "standby"}
    result = load_measurements(table({"kind": "load"}, standby))
    assert result.frame["kind"].tolist() == ["load", "standby"]
    assert np.isnan(result.frame["efficiency"][1])
    assert len(result.loaded()) == 1


def test_an_unusable_optional_value_costs_no_row():
    result = load_measurements(
        table({"T_heatsink_C": 40.0, "u_P1_W": 0.1}, {"T_heatsink_C": -300.0, "u_P1_W": 0.0})
    )
    assert not result.rejected
    assert np.isnan(result.frame["T_heatsink_C"][1])
    assert any(note.startswith("u_P1_W: 1 of 2 values") for note in result.notes)


def test_unknown_columns_are_kept_with_one_note():
    result = load_measurements(table({"operator": "Ada", "shift": 2}))
    assert result.frame["operator"][0] == "Ada"
    assert result.notes == ("unknown columns, kept and ignored: operator, shift",)


def test_other_names_lead_to_import_and_our_own_are_no_guess():
    with pytest.raises(DatasetError, match="d2ea import --column") as refused:
        load_measurements(pd.DataFrame({"Tastgrad": [0.9], "P2_W": [500.0]}))
    assert "is 'P2_W' meant" not in str(refused.value)
    with pytest.raises(DatasetError, match="has a header and no rows"):
        load_measurements(table({}).iloc[:0])


def test_a_missing_column_names_file_column_and_nearest(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("d1,D2,P2\n0.5,0.5,600\n")
    with pytest.raises(DatasetError) as error:
        load_measurements(path)
    said = str(error.value)
    for part in (str(path), "column D1 is missing", "is 'P2' meant", "P1_W or efficiency is missing"):
        assert part in said


def test_csv_and_parquet_give_the_same_table(tmp_path):
    frame = table(
        {"time_s": 1.0, "settled": True, "point": 3},
        {"P1_W": 613.0, "time_s": 2.0, "settled": False, "point": 4},
    )
    frame.to_csv(tmp_path / "m.csv", index=False)
    frame.to_parquet(tmp_path / "m.parquet")
    one, two = (load_measurements(tmp_path / f"m.{kind}").frame for kind in ("csv", "parquet"))
    pd.testing.assert_frame_equal(one, two)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("D1,D2,P2_W,P1_W\n0,8,0,2,600,612\n", "line 2 has 6 values for 4 columns"),
        ("D1,D2,P2_W,P1_W,D1\n", "'D1' is there 2 times"),
        ("D1,D2,P2_W,P1_W\n", "has a header and no rows"),
        ("", "m.csv: is empty"),
        ("PK\x03\x04", "save the sheet as CSV"),
        ("D1|D2|P2_W|P1_W\n0.8|0.2|600|612\n", "line 1, has a single name; columns are separated by"),
        ("Bench 3;;;\nD1;D2;P2_W;P1_W\n", "line 1, has a single name"),
        (
            "D1,D2,P2_W,efficiency\n0.8,0.2,600,98.0\n",
            "row 1 (line 2), efficiency = 98.0: this looks like per cent; efficiency is a fraction (0.9845), and "
            "d2ea import --column efficiency=efficiency*0.01 converts it",
        ),
        (
            "D1,D2,P2_W,P1_W,quality\n0.8,0.2,600,612,overrange\n",
            "quality = overrange: the analyzer's data are",
        ),
    ],
)
def test_an_unusable_file_says_why(tmp_path, text, said):
    (tmp_path / "m.csv").write_text(text)
    with pytest.raises(DatasetError) as error:
        load_measurements(tmp_path / "m.csv")
    assert said in str(error.value)


def test_a_rejected_row_is_named_by_its_line_and_the_others_keep_their_numbers(tmp_path):
    (tmp_path / "m.csv").write_text("\nD1,D2,P2_W,P1_W\n\n0.8,0.2,600,x\n0.8,0.2,600,612\n")
    result = load_measurements(tmp_path / "m.csv")
    assert str(result.rejected[0]).startswith("row 1 (line 4), P1_W = x:")
    assert result.rows == (2,)


@pytest.mark.parametrize(
    ("times", "seconds"),
    [
        (["2024-05-01T10:00:20+02:00", "2024-05-01T08:00:00Z"], [20.0, 0.0]),
        (["01.05.2024 08:00:00", "02.05.2024 08:00:20"], [0.0, 86420.0]),
        (["01.05.2024 23:59", "02.05.2024 00:01"], [0.0, 120.0]),
        ([1_700_000_000.0, 1_700_000_020.5], [0.0, 20.5]),
        ([-20.0, 0.0], [0.0, 20.0]),
        ([3600.0, 3620.0], [3600.0, 3620.0]),
    ],
)
def test_times_of_day_become_seconds_since_the_first(times, seconds):
    result = load_measurements(table(*({"time_s": time} for time in times)))
    assert result.frame["time_s"].tolist() == seconds
    assert any("taken as seconds" in note for note in result.notes) == (seconds != times)


def test_times_that_are_not_read_are_told_with_what_is_allowed():
    result = load_measurements(table({"time_s": "8 PM"}))
    assert result.notes == (
        "time_s: 1 of 1 values are no times (row 1: 8 PM), more than a fifth, so it is left empty; allowed are "
        "seconds, or times of day like 2026-11-20T22:14:05, 20.11.2026 22:14:05, 11/20/2026 10:14:05 PM, 22:14:05",
    )


def test_a_voltage_that_cannot_be_is_left_empty():
    result = load_measurements(table({"V1_V": 300.0}, {"V1_V": -300.0}))
    assert np.isnan(result.frame["V1_V"][1])


def test_a_header_with_units_is_answered_by_the_options_that_read_it(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("D1 [-],d2,P2 (kW),P1 [kW],T_heatsink [°C]\n0.8,0.2,0.6,0.612,40\n")
    with pytest.raises(DatasetError) as refused:
        load_measurements(path)
    options = re.findall(r'--column "([^"]*)"', str(refused.value))
    assert options == [
        "D1=D1 [-]",
        "D2=d2",
        "P2_W=P2 (kW)*1000",
        "P1_W=P1 [kW]*1000",
        "T_heatsink_C=T_heatsink [°C]",
    ]
    (row,) = load_measurements(path, [OtherName.parse(o) for o in options]).frame.to_dict("records")
    assert (row["P2_W"], row["T_heatsink_C"]) == (600.0, 40.0)


def test_headers_of_other_languages_are_answered_by_the_options_that_read_them(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text(
        "Zeitstempel;Tastgrad D1;Phase D2;Pout/mW;eta (%)\n01.05.2024 08:00:00;0,8;0,2;600000;98,1\n"
    )
    with pytest.raises(DatasetError, match=f'd2ea import "{path}"') as refused:
        load_measurements(path)
    options = re.findall(r'--column "([^"]*)"', str(refused.value))
    (row,) = load_measurements(path, [OtherName.parse(o) for o in options]).frame.to_dict("records")
    assert [row[c] for c in ("time_s", "D1", "D2", "P2_W")] == [0.0, 0.8, 0.2, 600.0]
    assert row["efficiency"] == pytest.approx(0.981, rel=1e-15)  # 98.1 * 0.01 rounds


def test_a_table_says_itself_that_its_lab_is_virtual():
    assert load_measurements(table({"lab": "virtual"})).virtual
    assert load_measurements(table({})).virtual is None


def test_kinds_are_read_however_they_are_written():
    frame = load_measurements(
        table({"kind": "Load"}, {"kind": "No load "}, {"kind": "no-load", "D1": 0.7})
    ).frame
    assert frame["kind"].tolist() == ["load", "no_load", "no_load"]


def test_columns_under_other_names_and_in_other_units(tmp_path):
    (tmp_path / "m.csv").write_text("duty 1;D2;Pout (kW);eta %\n0,8;0,2;0,6;98\n0,7;0,2;-;98\n")
    names = [OtherName.parse(n) for n in ("D1=duty 1", "P2_W=Pout (kW)*1000", "efficiency = eta % * 0.01")]
    result = load_measurements(tmp_path / "m.csv", names)
    row = result.frame.iloc[0]
    assert (row["D1"], row["P2_W"], row["efficiency"]) == (0.8, 600.0, 0.98)
    assert [(r.row, r.column, r.value) for r in result.rejected] == [(2, "P2_W", "-")]


def test_the_option_that_converts_is_told_with_the_name_that_the_table_has(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("D1,D2,P2_W,eta\n0.8,0.2,600,98.1\n")
    with pytest.raises(
        DatasetError, match=re.escape('d2ea import --column "efficiency=eta*0.01" converts it')
    ):
        load_measurements(path, [OtherName.parse("efficiency=eta")])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("P1_W", "OURS=THEIRS"),
        ("=Pin", "OURS=THEIRS"),
        ("power=Pin", "'power' is no column"),
        ("P1_W=Pin*kilo", "'kilo'"),
        ("P1_W=Pin*0", "other than 0"),
        ("kind=what*2", "no number"),
    ],
)
def test_a_name_that_cannot_be_taken_says_why(text, said):
    with pytest.raises(OtherNameError, match=re.escape(said)):
        OtherName.parse(text)


@pytest.mark.parametrize(
    ("text", "said"), [("P1_W=Pin", "no column 'Pin'"), ("P1_W=P2_W", "'P1_W' is there already")]
)
def test_a_column_that_is_not_there_or_there_already_is_told(text, said):
    with pytest.raises(DatasetError, match=said):
        load_measurements(table({}), [OtherName.parse(text)])


def test_a_last_line_cut_short_costs_that_row_only(tmp_path):
    (tmp_path / "m.csv").write_text("D1,D2,P2_W,P1_W\n0.8,0.2,600,612\n0.7,0.2,60")
    result = load_measurements(tmp_path / "m.csv")
    assert len(result.frame) == 1
    assert result.rejected[0].row == 2


@pytest.mark.parametrize("name", ["no.csv", "m.xlsx", "m.parquet"])
def test_a_file_that_is_absent_or_another_kind_is_named(tmp_path, name):
    (tmp_path / "m.parquet").write_text("no parquet")
    with pytest.raises(DatasetError, match=name):
        load_measurements(tmp_path / name)


cells = st.one_of(
    st.none(), st.floats(), st.integers(-5, 2500), st.sampled_from(["", "NAN", "INF", "0.5", "x", "1e999"])
)
columns = st.sampled_from(
    ["D1", "D2", "P2_W", "P1_W", "efficiency", "kind", "time_s", "u_P1_W", "T_ambient_C", "note"]
)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    st.lists(columns, min_size=1, unique=True).flatmap(
        lambda c: st.lists(st.fixed_dictionaries(dict.fromkeys(c, cells)), min_size=1, max_size=5)
    )
)
def test_any_table_is_accepted_with_possible_rows_or_refused_in_words(rows):
    _accepted_or_refused(pd.DataFrame(rows), len(rows))


@settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    st.one_of(
        st.binary(max_size=200),
        st.text("D12P_W,;.0123459eEnaif-\n\"' ", max_size=200).map(
            lambda t: ("D1,D2,P2_W,P1_W\n" + t).encode()
        ),
    )
)
def test_any_csv_file_is_accepted_with_possible_rows_or_refused_in_words(tmp_path, content):
    path = tmp_path / "fuzz.csv"
    path.write_bytes(content)
    _accepted_or_refused(path, None)


def _accepted_or_refused(source, count):
    try:
        result = load_measurements(source)
    except DatasetError:
        return
    loaded = result.loaded()
    assert loaded["efficiency"].between(0, 1, inclusive="right").all()
    assert loaded[["D1", "D2"]].stack().between(0, 1).all()
    assert (loaded["P1_W"] * (1 + 1e-12) >= loaded["P2_W"]).all()  # P1 = P2 / efficiency rounds
    assert np.isfinite(result.frame["P1_W"]).all()
    if count is not None:
        assert len(result.frame) + len(result.rejected) == count


def test_cells_that_are_missing_are_told_as_missing(tmp_path):
    (tmp_path / "m.csv").write_text("D1,D2,P2_W,P1_W\n0\n,0")
    with pytest.raises(DatasetError, match=r"none of 2 rows can be used; row 1 \(line 2\), D2 = nan"):
        load_measurements(tmp_path / "m.csv")
