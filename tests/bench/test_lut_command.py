"""The verbs of a table on the bench: one that was made for another converter goes into no controller."""

from pathlib import Path

import pytest

from bench.converter_stated import stated_converter
from bench.model_file import read_model
from bench.toml_file import to_toml
from sim.model import Model
from tests.bench.command_line import d2ea
from tests.bench.fake_bench import BENCH

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "two_level_dab.toml"

pytestmark = pytest.mark.usefixtures("in_a_folder_of_its_own")


def table_and_bench(converter: str | None = None, model: Path | None = None) -> tuple[str, str, str]:
    """The arguments of a verb, for a table that states a converter and a bench that has one."""
    last = "" if converter is None else f',"{converter}"'
    rows = "".join(f"{P},0.9,0.1{last}\n" for P in (400, 800))
    Path("lut.csv").write_text(f"P_W,D1,D2{',converter' if last else ''}\n{rows}")
    described = {**BENCH, **({} if model is None else {"converter": {"model": str(model)}})}
    Path("bench.toml").write_text(to_toml(described))
    return "lut.csv", "--bench", "bench.toml"


@pytest.mark.parametrize("verb", ["load", "verify"])
def test_a_table_of_another_converter_is_refused_with_both(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    other = stated_converter(read_model(EXAMPLE))
    assert d2ea("lut", verb, *table_and_bench(other)) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert f"lut.csv: converter = '{other}'" in said
    assert stated_converter(Model.baseline()) in said
    assert '[converter] model = "MODEL.toml"' in said


def test_what_the_bench_names_decides(capsys: pytest.CaptureFixture[str]) -> None:
    other = stated_converter(read_model(EXAMPLE))
    assert d2ea("lut", "load", *table_and_bench(other, EXAMPLE)) == 1  # taken: no controller is there
    assert "converter" not in capsys.readouterr().err


def test_a_line_on_which_the_converter_may_trip_is_said_before_the_table_is_loaded(
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = table_and_bench(stated_converter(Model.baseline()))
    assert d2ea("lut", "load", *arguments) == 1  # taken: no controller is there
    assert "between rows" not in capsys.readouterr().err
    # the zero state goes on the way from D1 = 0.9 to 1, and no D1 carries 1600 W where D2 = 0.9
    rows = "".join(f"{P},{D1},{D2}\n" for P, D1, D2 in ((400, 0.9, 0.1), (800, 1.0, 0.1), (1600, 1.0, 0.9)))
    Path("lut.csv").write_text(f"P_W,D1,D2\n{rows}")
    assert d2ea("lut", "load", *arguments) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "between rows: 400 to 800 W" in said
    assert "a zero state as short as the dead time" in said
    assert "between rows: 800 to 1600 W: power is not carried" in said
    assert (
        "d2ea optimise --powers LOW:HIGH:STEP, up to 400 W and from 800 W on, up to 800 W and from 1600 W"
        in said
    )


def test_a_table_that_names_no_converter_asks_to_make_sure(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("lut", "load", *table_and_bench()) == 1  # taken: no controller is there
    assert "does not say which converter it is for" in " ".join(capsys.readouterr().err.split())
