"""Files of an operator, whatever is in them: what they say, or an error that names what is wrong."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.config import BenchConfig, CampaignConfig, check, read_bench, read_campaign
from bench.errors import InputError
from bench.plan import make_plan
from bench.rehearsal import read_faults
from bench.table_file import write_table
from experiments.survey.limits import commanded
from models.dataset import DatasetError, load_measurements
from tests.bench.fake_bench import BENCH, CAMPAIGN, bench_config, campaign_config, predict

RUNS = settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
ODD = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.lists(st.integers(), max_size=3),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
)  # fmt: skip
TOML = st.text("abcdeilmnoprstu_[]=\"'# \n0123456789.,-{}", max_size=120)


def refused(kind: type[Exception], act: Callable[[], object]) -> str | None:
    """The words of a refusal of this kind; None where there was none. Anything else is raised."""
    try:
        act()
    except kind as error:
        return str(error)
    return None


@RUNS
@given(
    content=st.one_of(TOML.map(str.encode), st.binary(max_size=40)),
    read=st.sampled_from([read_bench, read_campaign, read_faults]),
)
def test_any_bytes_are_a_file_or_an_input_error(tmp_path: Path, content: bytes, read: object) -> None:
    file = tmp_path / "any.toml"
    file.write_bytes(content)
    said = refused(InputError, lambda: read(file))  # type: ignore[operator]
    assert said is None or "any.toml" in said


@RUNS
@given(section=st.sampled_from(sorted(BENCH)), value=ODD)
def test_any_value_in_a_bench_file(section: str, value: object) -> None:
    said = refused(InputError, lambda: check({**BENCH, section: value}, BenchConfig, file="bench.toml"))
    assert said is None or f"bench.toml: {section}" in said or "bench.toml: file" in said


@RUNS
@given(section=st.sampled_from(["plan", "ranges", "settling", "measure", "schedule", "seed"]), value=ODD)
def test_any_value_in_a_campaign_file(section: str, value: object) -> None:
    said = refused(InputError, lambda: check({**CAMPAIGN, section: value}, CampaignConfig, file="c.toml"))
    assert said is None or section in said


@RUNS
@given(text=st.text('D12P_setW,\n0123456789.eE-+nai" ', max_size=120))
def test_any_csv_is_a_plan_or_an_input_error(tmp_path: Path, text: str) -> None:
    file = tmp_path / "points.csv"
    file.write_text("D1,D2,P_set_W\n" + text)
    campaign = campaign_config(plan={"kind": "points", "file": str(file)})
    assert refused(InputError, lambda: make_plan(campaign, bench_config(), predict, file="c")) != ""


@RUNS
@given(text=st.text('D12P_Wefficny,\n0123456789.eE-+nai" ', max_size=160))
def test_any_measurement_table_is_one_or_a_dataset_error(tmp_path: Path, text: str) -> None:
    file = tmp_path / "theirs.csv"
    file.write_text("D1,D2,P2_W,P1_W\n" + text)
    assert refused(DatasetError, lambda: load_measurements(file)) != ""


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_no_sequence_of_commands_gets_outside_any_limits(seed: int) -> None:
    assert commanded(60, seed).beyond == []


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_an_exported_table_says_which_lab_it_is_from(tmp_path: Path, ending: str) -> None:
    table = pd.DataFrame({"D1": [0.8], "D2": [0.1], "P2_W": [500.0], "P1_W": [510.0], "lab": ["virtual"]})
    write_table(table, tmp_path / f"out{ending}")
    loaded = load_measurements(tmp_path / f"out{ending}")
    assert list(loaded.frame["lab"]) == ["virtual"]
    assert not any("lab" in note for note in loaded.notes)
    assert np.isfinite(loaded.frame["P1_W"]).all()
