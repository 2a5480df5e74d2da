"""The form of a table's file: separators, decimal signs, thousands, quotation marks, encodings."""

import pytest

from models.dataset import DatasetError, load_measurements
from models.other_names import OtherName


@pytest.mark.parametrize(
    "text",
    [
        "D1;D2;P2_W;P1_W;note\n0,8;0,2;600;612,5;\n0,7;,2;6,0e2;613,25;ok, warm\n",
        "D1\tD2\tP2_W\tP1_W\tnote\n0.8\t0.2\t600\t612.5\t\n0.7\t.2\t600\t613.25\tok, warm\n",
        'D1,D2,P2_W,P1_W,note\n0.8,0.2,600,612.5,\n0.7,.2,600,613.25,"ok, warm"\n',
        'D1,D2,P2_W,P1_W,note\n"0,8","0,2",600,"612,5",\n"0,7","0,2",600,"613,25","ok, warm"\n',
        "# bench 3\n\nD1;D2;P2_W;P1_W;note;\n\n0,8;0,2;600;612,5;;\n0,7;0,2;600;613,25;ok, warm;;;\n",
        "D1\tD2\tP2_W\tP1_W\tnote\r0.8\t0.2\t600\t612.5\r0.7\t0.2\t600\t613.25\tok, warm\r",
    ],
)
def test_any_separator_and_decimal_sign_gives_the_same_table(tmp_path, text):
    (tmp_path / "m.csv").write_text(text)
    frame = load_measurements(tmp_path / "m.csv").frame
    assert frame[["D1", "D2", "P2_W", "P1_W"]].to_numpy().tolist() == [
        [0.8, 0.2, 600.0, 612.5],
        [0.7, 0.2, 600.0, 613.25],
    ]
    assert frame["note"].tolist() == [None, "ok, warm"]


def test_a_table_in_sixteen_bits_and_a_typographic_minus_are_read(tmp_path):
    (tmp_path / "m.csv").write_text("D1\tD2\tP2_W\tP1_W\tD0\n0.8\t0.2\t600\t612\t−0.1\n", encoding="utf-16")
    assert load_measurements(tmp_path / "m.csv").frame["D0"].tolist() == [-0.1]


def test_a_line_with_values_missing_is_told(tmp_path):
    (tmp_path / "m.csv").write_text("D1,D2,P2_W,P1_W,D0\n0.8,0.2,600,612,0.1\n0.7,0.2,600,612\n")
    (note,) = load_measurements(tmp_path / "m.csv").notes
    assert "(line 3: 4 of 5)" in note


@pytest.mark.parametrize(
    "rows",
    [
        "0,8;0,2;1 200,5;1 224\n0,7;0,2;600;612\n",
        "0,8;0,2;1\N{NARROW NO-BREAK SPACE}200,5;1\N{NO-BREAK SPACE}224\n0,7;0,2;600;612\n",
        "0.8;0.2;1'200.5;1\N{RIGHT SINGLE QUOTATION MARK}224\n0.7;0.2;600;612\n",
        "0,8;0,2;1.200,5;1.224,0\n0,7;0,2;600;612\n",
        "0.8;0.2;1,200.5;1,224\n0.7;0.2;600;612\n",
    ],
)
def test_thousands_that_stand_apart_are_one_number(tmp_path, rows):
    """Else every row of more than a kilowatt would be left out."""
    (tmp_path / "m.csv").write_text(f"D1;D2;P2_W;P1_W\n{rows}", encoding="utf-8")
    frame = load_measurements(tmp_path / "m.csv").frame
    assert frame[["D1", "P2_W", "P1_W"]].to_numpy().tolist() == [[0.8, 1200.5, 1224.0], [0.7, 600.0, 612.0]]


def test_a_quotation_mark_that_is_not_closed_is_told_with_its_line(tmp_path):
    rows = "".join(f"0.8,0.2,{power},{1.02 * power}\n" for power in range(600, 1400, 100))
    (tmp_path / "m.csv").write_text(f'D1,D2,P2_W,P1_W\n0.8,0.2,500,510\n"{rows}')
    with pytest.raises(DatasetError, match="line 3: a quotation mark opens a value that runs on to line 10"):
        load_measurements(tmp_path / "m.csv")


def test_a_table_in_a_western_code_page_is_read(tmp_path):
    (tmp_path / "m.csv").write_bytes("D1,D2,P2_W,P1_W,Kühler °C\n0.8,0.2,600,612,40\n".encode("cp1252"))
    assert "unknown columns, kept and ignored: Kühler °C" in load_measurements(tmp_path / "m.csv").notes


def test_a_table_with_zero_bytes_is_no_text(tmp_path):
    (tmp_path / "m.csv").write_bytes("D1,D2,P2_W,P1_W\n0.9,0.1,500,515\n".encode("utf-16-le"))
    with pytest.raises(DatasetError, match=r"a zero byte stands at 1\. Is it UTF-16"):
        load_measurements(tmp_path / "m.csv")


def test_what_a_spreadsheet_says_of_its_separator_is_no_header(tmp_path):
    (tmp_path / "m.csv").write_text("sep=;\nD1;D2;P2_W;efficiency\n0,9;0,1;500;0,97\n", encoding="utf-8")
    assert load_measurements(tmp_path / "m.csv").frame["D1"].tolist() == [0.9]


def test_decimal_commas_before_a_sign_of_per_cent_are_read(tmp_path):
    (tmp_path / "m.csv").write_text("D1;D2;P2_W;eta\n0,9;0,1;500;97,5 %\n", encoding="utf-8")
    read = load_measurements(tmp_path / "m.csv", [OtherName.parse("efficiency=eta*0.01")])
    assert read.frame["efficiency"].tolist() == pytest.approx([0.975])
