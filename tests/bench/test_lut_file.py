"""The table as a file: the same rows in three forms, read back, and a header that a C compiler likes."""

import json
import math
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.converter_stated import check_same_converter, stated_converter
from bench.errors import InputError
from bench.lut_file import LutOrigin, converter_of, model_of, read_lut, write_lut
from models.lut import Lut
from sim.model import Model

ORIGIN = LutOrigin(
    model="0123456789ab",
    kind="d2ea",
    data_sha256="ab" * 32,
    data="x.sqlite */ campaign 1",
    lab="virtual lab",
    converter=stated_converter(Model.baseline()),
)
LUT = Lut(
    power_W=np.array([200.0, 600.0, 1000.5]),
    D1=np.array([0.5, 0.123456789, 1.0]),
    D2=np.array([0.25, 0.0, 1e-7]),
    predicted=np.array([0.97, 0.98, 0.999]),
    price=np.zeros(3),
    soft_edges=np.array([4.0, 3.0, 4.0]),
    half_width=0.002,
)


@pytest.fixture(params=["lut.csv", "lut.json", "lut.h"])
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / str(request.param)
    write_lut(LUT, path, ORIGIN)
    return path


def test_rows_read_back_are_the_rows_written(file: Path) -> None:
    rows = read_lut(file)
    # a C float holds seven digits
    np.testing.assert_allclose(
        rows[["P_W", "D1", "D2"]], LUT.frame()[["P_W", "D1", "D2"]], rtol=1e-7, atol=1e-12
    )


def test_every_file_names_its_model_and_its_lab(file: Path) -> None:
    assert model_of(file) == ORIGIN.model
    assert "virtual lab" in file.read_text().lower()


def test_every_file_names_its_converter(file: Path) -> None:
    assert converter_of(file) == ORIGIN.converter


def test_a_table_that_does_not_say_is_of_no_known_converter(tmp_path: Path) -> None:
    LUT.frame()[["P_W", "D1", "D2"]].to_csv(tmp_path / "own.csv", index=False)
    assert converter_of(tmp_path / "own.csv") is None
    write_lut(LUT, tmp_path / "lut.json", replace(ORIGIN, converter="not stated"))
    assert converter_of(tmp_path / "lut.json") is None


@pytest.mark.parametrize("name", ["lut.csv", "lut.json", "lut.h"])
def test_a_table_is_of_its_own_converter_whatever_that_is_called(name: str, tmp_path: Path) -> None:
    called = Model(converter=replace(Model.baseline().converter, name='Prüfling "A" \\ 2 // */'))
    write_lut(LUT, tmp_path / name, replace(ORIGIN, converter=stated_converter(called)))
    check_same_converter(name, converter_of(tmp_path / name) or "", "bench", called)
    with pytest.raises(InputError, match="other D1 and D2 are right for it"):
        check_same_converter(name, converter_of(tmp_path / name) or "", "bench", Model.baseline())


def test_an_interval_ends_at_one() -> None:
    assert LUT.frame()["predicted_high"].max() == 1.0


def test_an_unknown_interval_is_null_and_no_number_is_nan(tmp_path: Path) -> None:
    unknown = Lut(
        **{name: getattr(LUT, name) for name in ("power_W", "D1", "D2", "predicted", "price", "soft_edges")}
    )
    write_lut(unknown, tmp_path / "lut.json", ORIGIN)
    content = json.loads((tmp_path / "lut.json").read_text(), parse_constant=pytest.fail)
    assert content["table"][0]["predicted_low"] is None
    assert math.isnan(read_lut(tmp_path / "lut.json")["predicted_low"][0])


MAIN = """
#include <stdio.h>
#include "lut.h"
int main(void) {
    float power_W;
    while (scanf("%f", &power_W) == 1) {
        struct d2ea_lut_row at = d2ea_lut_at(power_W);
        printf("%.9g %.9g\\n", (double)at.D1, (double)at.D2);
    }
    return 0;
}
"""


@pytest.mark.skipif(shutil.which("gcc") is None, reason="missing program: gcc")
@pytest.mark.parametrize("standard", ["c99", "c17"])
def test_firmware_interpolates_as_the_table_says(tmp_path: Path, standard: str) -> None:
    write_lut(LUT, tmp_path / "lut.h", ORIGIN)
    (tmp_path / "main.c").write_text(MAIN)
    flags = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow", f"-std={standard}"]
    subprocess.run(["gcc", *flags, "main.c", "-o", "main"], cwd=tmp_path, check=True)
    power_W = [0.0, 200.0, 399.0, 600.0, 777.7, 1000.5, 5000.0]
    ran = subprocess.run(
        [tmp_path / "main"], input=" ".join(map(str, power_W)), text=True, capture_output=True, check=True
    )
    got = np.array([line.split() for line in ran.stdout.splitlines()], dtype=float)
    wanted = np.stack([np.interp(power_W, LUT.power_W, x) for x in (LUT.D1, LUT.D2)], axis=1)
    np.testing.assert_allclose(got, wanted, atol=1e-6)  # single precision


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("D1,D2\n0.5,0.1\n", "columns: P_W missing; there are: D1, D2"),
        ("P_W,D1,D2\n200,0.5,0.1\n", "rows = 1: a controller takes 2 to 64"),
        ("P_W,D1,D2\n200,0.5,0.1\n300,1.5,x\n", "row 2, D1 = 1.5: a number from 0 to 1"),
        ("P_W,D1,D2\n0,0.5,0.1\n200,0.5,0.1\n", "row 1, P_W = 0: a number above 0"),
        ("P_W,D1,D2\n200,0.5,0.1\ninf,0.5,0.1\n", "row 2, P_W = inf: a number above 0"),
        ("P_W,D1,D2\n300,0.5,0.1\n200,0.5,0.1\n", "powers must rise"),
        ("P_W,D1,D2\n300,0.5,0.1\n300,0.5,0.1\n", "powers must rise"),
    ],
)
def test_a_table_that_no_controller_can_use_is_refused(tmp_path: Path, content: str, said: str) -> None:
    (tmp_path / "lut.csv").write_text(content)
    with pytest.raises(InputError) as caught:
        read_lut(tmp_path / "lut.csv")
    assert said in str(caught.value)


def test_a_file_that_is_no_table_is_refused(tmp_path: Path) -> None:
    (tmp_path / "lut.json").write_text('{"rows": []}')
    with pytest.raises(InputError, match="is not a table of D1 and D2 over load"):
        read_lut(tmp_path / "lut.json")
    with pytest.raises(InputError, match="there is no such file"):
        read_lut(tmp_path / "absent.csv")


def test_a_table_without_a_model_cannot_be_traced(tmp_path: Path) -> None:
    pd.DataFrame({"P_W": [1.0, 2.0], "D1": 0.5, "D2": 0.1}).to_csv(tmp_path / "lut.csv")
    with pytest.raises(InputError, match="does not name its model"):
        model_of(tmp_path / "lut.csv")
