"""Tables as instruments and simulation programs of several makers export them."""

import re
from pathlib import Path

import pytest

from models.dataset import DatasetError, load_measurements
from models.other_names import OtherName


def written(folder: Path, text: str, name: str = "theirs.csv") -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def test_what_an_analyzer_wrote_above_the_header_says_what_to_do(tmp_path: Path) -> None:
    lines = '"YOKOGAWA WT5000","Ver 2.01"\n"Sample Rate","2 MS/s"\n\nNo,D1,D2,P1_W,P2_W\n1,0.8,0.2,612,600\n'
    with pytest.raises(
        DatasetError, match="If line 4 is the header, delete the lines above it, or begin each"
    ):
        load_measurements(written(tmp_path, lines))


def test_a_line_of_numbers_that_is_too_long_is_no_header(tmp_path: Path) -> None:
    with pytest.raises(DatasetError) as caught:
        load_measurements(written(tmp_path, "D1,D2,P1_W,P2_W\n0,8,0,2,612,600\n"))
    assert "is the header" not in str(caught.value)


def test_units_in_a_line_of_their_own_are_not_what_all_rows_are_refused_for(tmp_path: Path) -> None:
    lines = "D1;D2;P2_W;efficiency\n1;1;W;%\n" + "0,8;0,2;600;98,1\n0,8;0,2;700;98,2\n"
    with pytest.raises(
        DatasetError, match=r"row 2 \(line 3\), efficiency = 98.1: this looks like per cent.*2 rows; 1 for"
    ):
        load_measurements(written(tmp_path, lines))


@pytest.mark.parametrize(
    ("header", "options"),
    [
        ("Input power:W,Output power:W,D1,D2", ['"P1_W=Input power:W"', '"P2_W=Output power:W"']),
        (
            "P1[kW],P2[kW],duty D1 [%],phase D2 [deg]",
            ['"D1=duty D1 [%]*0.01"', '"D2=phase D2 [deg]*0.00555556"'],
        ),
        ("P1/W,P2/W,D1,D2 (rad)", ['"D2=D2 (rad)*0.31831"', '"P2_W=P2/W"']),
    ],
)
def test_the_options_for_a_header_are_found(header: str, options: list[str], tmp_path: Path) -> None:
    with pytest.raises(DatasetError) as caught:
        load_measurements(written(tmp_path, f"{header}\n612,600,0.8,0.2\n"))
    assert all(option in str(caught.value) for option in options)


def test_units_in_a_line_of_their_own_are_in_the_options_that_are_found(tmp_path: Path) -> None:
    lines = "t;D1;Phase D2;P1;P2;ETA1\nmin;;deg;kW;kW;%\n0;0,8;36;0,612;0,6;98,04\n1;0,8;18;0,712;0,7;98,31\n"
    file = written(tmp_path, lines)
    with pytest.raises(DatasetError) as caught:
        load_measurements(file)
    options = re.findall(r'--column "([^"]*)"', str(caught.value))
    assert {"D2=Phase D2*0.00555556", "P1_W=P1*1000", "P2_W=P2*1000", "efficiency=ETA1*0.01"} <= set(options)
    measured = load_measurements(file, [OtherName.parse(option) for option in options])
    assert measured.frame["P2_W"].tolist() == [600.0, 700.0]
    assert [row.row for row in measured.rejected] == [1]  # the units


def test_options_that_were_given_stay_beside_those_that_are_needed_still(tmp_path: Path) -> None:
    file = written(tmp_path, "D1,D2,Load [W],eta [%],x\n0.8,0.2,600,98,1\n")
    given = [OtherName.parse("efficiency=eta [%]*0.01")]
    with pytest.raises(DatasetError) as caught:
        load_measurements(file, given)
    command = str(caught.value).splitlines()[-1]
    assert command.endswith('--column "efficiency=eta [%]*0.01" --column "P2_W=Load [W]"')
    nameless = written(tmp_path, "D1,D2,abc,eta [%]\n0.8,0.2,600,98\n")
    with pytest.raises(DatasetError) as caught:
        load_measurements(nameless, given)
    *_, command, missing = str(caught.value).splitlines()
    assert command.endswith('theirs.csv" --column "efficiency=eta [%]*0.01"')
    assert missing.startswith('still missing: P2_W. Add --column "P2_W=THEIRS*FACTOR"')


def test_powers_the_wrong_way_round_are_put_right_as_the_message_says(tmp_path: Path) -> None:
    file = written(tmp_path, "D1,D2,P1_W,P2_W\n0.8,0.2,600,612\n")
    with pytest.raises(DatasetError, match="--column P1_W=P2_W --column P2_W=P1_W puts them right"):
        load_measurements(file)
    exchanged = [OtherName(ours="P1_W", theirs="P2_W"), OtherName(ours="P2_W", theirs="P1_W")]
    assert load_measurements(file, exchanged).frame["P1_W"].tolist() == [612.0]


@pytest.mark.parametrize("name", ["steps.txt", "steps.tsv"])
def test_a_simulators_table_with_tabs_is_read_whatever_its_ending(name: str, tmp_path: Path) -> None:
    assert (
        len(load_measurements(written(tmp_path, "D1\tD2\tP1_W\tP2_W\n0.8\t0.2\t612\t600\n", name)).frame) == 1
    )


def test_a_separator_that_is_none_is_asked_for_and_no_option(tmp_path: Path) -> None:
    with pytest.raises(DatasetError) as caught:
        load_measurements(written(tmp_path, "D1|D2|P1_W|P2_W\n0.8|0.2|612|600\n"))
    assert "columns are separated by ','" in str(caught.value)
    assert "--column" not in str(caught.value)


@pytest.mark.parametrize(
    ("times", "seconds"),
    [
        (("09:14:05", "09:14:35", "09:14:20"), [0.0, 30.0, 15.0]),  # unsorted
        (("23:59:50", "00:00:20", "00:01:00"), [0.0, 30.0, 70.0]),  # over midnight
        (("09:14:05.250", "09:14:06.000", "09:14:07"), [0.0, 0.75, 1.75]),
    ],
)
def test_a_clock_without_a_date_counts_on_over_midnight(
    times: tuple[str, ...], seconds: list[float], tmp_path: Path
) -> None:
    rows = "".join(f"0.8,0.2,612,{600 + k},{time}\n" for k, time in enumerate(times))
    measured = load_measurements(written(tmp_path, f"D1,D2,P1_W,P2_W,time_s\n{rows}"))
    assert measured.frame["time_s"].tolist() == seconds


@pytest.mark.parametrize(("factor", "told"), [(1e3, "I1_A=I1_A*0.001"), (1e-3, "I1_A=I1_A*1000"), (7.0, "")])
def test_a_current_in_another_unit_is_told_by_voltage_and_power(
    factor: float, told: str, tmp_path: Path
) -> None:
    rows = "".join(f"0.8,0.2,{P},{P - 12},300,{P / 300 * factor}\n" for P in (600, 700, 800))
    measured = load_measurements(written(tmp_path, f"D1,D2,P1_W,P2_W,V1_V,I1_A\n{rows}"))
    assert measured.frame["I1_A"].isna().all()
    (note,) = measured.notes
    assert f"V1_V * I1_A is {factor:g} times P1_W" in note
    assert told in note


@pytest.mark.parametrize("port", ["1", "2"])
@pytest.mark.parametrize("share", [0.97, 1.03])
def test_a_power_that_is_not_voltage_times_current_is_said_and_nothing_left_out(
    share: float, port: str, tmp_path: Path
) -> None:
    power = {"1": 12, "2": 0}[port]
    rows = "".join(f"0.8,0.2,{P + 12},{P},300,{share * (P + power) / 300}\n" for P in (600, 700, 800))
    measured = load_measurements(written(tmp_path, f"D1,D2,P1_W,P2_W,V{port}_V,I{port}_A\n{rows}"))
    assert measured.frame[f"I{port}_A"].notna().all()
    (note,) = measured.notes
    assert f"V{port}_V * I{port}_A is {share:g} times P{port}_W (median)" in note


def test_readings_inside_an_analyzers_errors_are_not_said(tmp_path: Path) -> None:
    rows = "".join(f"0.8,0.2,{P},{P - 12},300,{1.004 * P / 300}\n" for P in (600, 700, 800))
    assert load_measurements(written(tmp_path, f"D1,D2,P1_W,P2_W,V1_V,I1_A\n{rows}")).notes == ()


def test_a_current_in_amperes_stays_and_standby_does_not_count(tmp_path: Path) -> None:
    rows = "standby,,,4,,300,0.5\nload,0.8,0.2,612,600,300,2.04\n"
    measured = load_measurements(written(tmp_path, f"kind,D1,D2,P1_W,P2_W,V1_V,I1_A\n{rows}"))
    assert measured.frame["I1_A"].tolist() == [0.5, 2.04]
    assert measured.notes == ()


def test_what_is_said_of_a_current_is_to_be_typed_for_that_table(tmp_path: Path) -> None:
    rows = "".join(f"0.8,0.2,{P},{P - 12},300,{P / 300 * 1e3}\n" for P in (600, 700, 800))
    file = written(tmp_path, f"D1,D2,P1_W,P2_W,V1_V,Iin\n{rows}")
    (note,) = load_measurements(file, [OtherName(ours="I1_A", theirs="Iin")]).notes
    assert '"I1_A=Iin*0.001"' in note
