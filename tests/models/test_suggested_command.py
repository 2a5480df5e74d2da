"""The command that a table under other names is answered with reads it as it stands."""

import re
import shlex
from pathlib import Path

import pandas as pd
import pytest

from models.dataset import DatasetError, load_measurements
from models.other_names import OtherName
from tests.models.small_tables import efficiencies


def answered(folder: Path, text: str) -> tuple[Path, list[str]]:
    """A table that is refused, and what stands below the sentence that refuses it."""
    (folder / "theirs.csv").write_text(text, encoding="utf-8")
    with pytest.raises(DatasetError) as refused:
        load_measurements(folder / "theirs.csv")
    return folder / "theirs.csv", str(refused.value).splitlines()[1:]


@pytest.mark.parametrize(
    "table",
    [
        "Datum;Uhrzeit;Tastgrad D1 [%];Phasenversatz [%];Uein [V];Uaus [V];Pein [kW];Paus [kW]\n"
        "20.11.2026;22:21:13;80,5;20,5;300;140;0,6125;0,6\n20.11.2026;22:21:43;70,5;20,5;300;140;0,7125;0,7\n",
        "Horodatage\tRapport cyclique D1\tDéphasage\tPuissance d’entrée (W)\tPuissance de sortie (W)\tRadiateur (°C)\n"
        "20/11/2026 22:21:13\t0,805\t0,205\t612,5\t600\t35\n20/11/2026 22:21:43\t0,705\t0,205\t712,5\t700\t36\n",
        "t/s\tD1\tD2\tP_in/kW\tP_out/kW\tT_hs/°F\tT_amb/°F\n0\t0.805\t0.205\t0.6125\t0.6\t95\t77\n"
        "30\t0.705\t0.205\t0.7125\t0.7\t97\t77\n",
        "Elapsed Time,D1,D2,P1,P2,U1,Theat\nh:m:s,%,%,kW,kW,V,degF\n0:07:08,80.5,20.5,0.6125,0.6,300,95\n"
        "0:07:38,70.5,20.5,0.7125,0.7,300,97\n",
        "t [ms];D1;D2;Pin;Pout\nms;1;1;W;W\n0;0.805;0.205;612.5;600\n30000;0.705;0.205;712.5;700\n",
    ],
)
def test_the_command_reads_the_table_as_it_is_printed(table: str, tmp_path: Path) -> None:
    file, (command,) = answered(tmp_path, table)
    verb, name, *options = shlex.split(command)[1:]
    assert (verb, name) == ("import", str(file))
    read = load_measurements(file, [OtherName.parse(each) for each in options if each != "--column"]).frame
    assert read["D1"].tolist() == pytest.approx([0.805, 0.705])
    assert read["D2"].tolist() == pytest.approx([0.205, 0.205])
    assert read["P2_W"].tolist() == pytest.approx([600.0, 700.0])
    assert read["P1_W"].tolist() == pytest.approx([612.5, 712.5])
    assert (read["time_s"] - read["time_s"][0]).tolist() == pytest.approx([0.0, 30.0])


def test_what_cannot_be_guessed_is_no_part_of_the_command(tmp_path: Path) -> None:
    _, (command, missing) = answered(tmp_path, "D1 [%],Phase D2,abc,eta\n80,0.2,600,0.98\n")
    assert "THEIRS" not in command
    assert missing.startswith('still missing: P2_W. Add --column "P2_W=THEIRS*FACTOR"')


def test_without_any_guess_there_is_no_command(tmp_path: Path) -> None:
    _, lines = answered(tmp_path, "D1,D2,abc,xyz\n0.8,0.2,600,612\n")
    assert [line.split(".")[0] for line in lines] == [
        "still missing: P2_W",
        "still missing: P1_W or efficiency",
    ]


def test_a_table_of_our_own_names_is_not_asked_for_others(tmp_path: Path) -> None:
    assert answered(tmp_path, "D1,D2,P1_W\n0.8,0.2,612\n")[1] == []


@pytest.mark.parametrize(
    ("header", "product"),
    [
        ("D1,D2,Pout,Vin [V],Iin [mA]", "P1_W to the table: 'Vin [V]' times 'Iin [mA]' times 0.001, a dc"),
        ("D1,D2,Pout,V1_V,I1_A", "P1_W to the table: 'V1_V' times 'I1_A', a dc"),
        ("D1,D2,P2_W,V1_V,I1_A", "P1_W to the table: 'V1_V' times 'I1_A', a dc"),
    ],
)
def test_a_power_that_is_missing_is_to_be_had_from_voltage_and_current(
    header: str, product: str, tmp_path: Path
) -> None:
    *_, missing = answered(tmp_path, f"{header}\n0.8,0.2,600,300,2.04\n")[1]
    assert missing.startswith("still missing: P1_W or efficiency. Add a column ")
    assert product in missing


def test_what_was_named_already_is_called_as_the_table_does(tmp_path: Path) -> None:
    file, _ = answered(tmp_path, "D1,D2,P2_W,Vin [V],Iin [mA]\n0.8,0.2,600,300,2040\n")
    given = [OtherName.parse(each) for each in ("V1_V=Vin [V]", "I1_A=Iin [mA]*0.001")]
    with pytest.raises(DatasetError, match=r"'Vin \[V\]' times 'Iin \[mA\]' times 0.001, a dc"):
        load_measurements(file, given)


def test_units_below_our_own_names_are_told_where_no_column_is_missing() -> None:
    table = pd.concat(
        [pd.DataFrame([{"D1": "%", "D2": "1", "P2_W": "kW", "efficiency": "%"}]), efficiencies()],
        ignore_index=True,
    )
    note = next(note for note in load_measurements(table).notes if note.startswith("a row of units"))
    options = re.findall(r'--column "([^"]*)"', note)
    assert options == ["D1=D1*0.01", "P2_W=P2_W*1000", "efficiency=efficiency*0.01"]
