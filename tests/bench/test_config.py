"""The operator's files: every problem at once, with line, value and what is allowed."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from bench.config import BenchConfig, DcDeviceConfig, check, config_hash, read_bench, read_campaign
from bench.connect import _modbus
from bench.errors import InputError
from bench.toml_file import line_of, read_toml, to_toml
from bench.whole_file import write_whole
from drivers.modbus_map import load_map
from tests.bench.fake_bench import BENCH, CAMPAIGN, bench_config, campaign_config


def said(path: Path, text: str) -> list[str]:
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_campaign(path)
    return str(caught.value).splitlines()


def test_an_unknown_key_names_line_and_nearest_key(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    (problem,) = said(path, 'name = "x"\n[plan]\nkind = "grid"\nshape = [2, 2, 2]\nrepeat = 3\n')
    assert problem.startswith(f"{path}:5: plan.repeat = 3: unknown key; did you mean repeats?")


def test_all_problems_come_at_once(tmp_path: Path) -> None:
    text = (
        '[plan]\nkind = "grid"\nshape = [2, 2, 2]\n[ranges]\nD1 = [0.5, 1.4]\n[settling]\nslope = "steep"\n'
    )
    problems = said(tmp_path / "c.toml", text)
    assert len(problems) == 3
    assert any(
        ":5: ranges.D1.1 = 1.4" in problem and "less than or equal to 1" in problem for problem in problems
    )
    assert any(":7: settling.slope = 'steep'" in problem for problem in problems)
    assert any("name: is missing; name of the campaign" in problem for problem in problems)


def test_a_syntax_error_names_its_line(tmp_path: Path) -> None:
    (problem,) = said(tmp_path / "c.toml", 'name = "x"\n[plan\n')
    assert "c.toml:2: TOML syntax" in problem


def test_a_missing_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        read_bench(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"virtual": False, "speed": 5.0}, "only a virtual bench"),
        ({"analyzer": {**BENCH["analyzer"], "update_s": 5.0}}, "would starve the heartbeat"),
        ({"limits": {**BENCH["limits"], "voltage_V": 200}}, "above limits.voltage_V = 200"),
        (
            {"limits": {**BENCH["limits"], "voltage_V": 200, "output_voltage_V": 100}},
            "above limits.voltage_V = 200; converter.output_voltage_V = .* limits.output_voltage_V = 100",
        ),
        ({"supply": {"map": "ea_psi900", "resource": "x"}}, "no register map 'ea_psi900'"),
        ({"analyzer": {"model": "wt300", "resource": "x"}}, "no analyzer model 'wt300'"),
        ({"analyzer": {"resource": "x", "wiring": {"input": 1, "output": 1}}}, "element of its own"),
        ({"analyzer": {"resource": "x", "ranges": {"P1": 300.0}}}, "a range is U or I and an element"),
    ],
)
def test_a_bench_that_contradicts_itself_is_refused(change: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        check({**BENCH, **change}, BenchConfig, file="bench.toml")


def test_a_device_has_the_unit_as_delivered_unless_the_file_says_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("bench.connect.open_link", lambda *_args, **_options: SimpleNamespace(disturbances=0))
    for more, unit in ({}, load_map("riden_rd60xx").unit), ({"unit": 7}, 7):
        config = DcDeviceConfig(map="riden_rd60xx", resource="/dev/ttyUSB0", **more)
        assert _modbus(config, {}, None).unit == unit


def test_a_plan_refuses_fields_of_another_kind() -> None:
    with pytest.raises(InputError, match="does not use shape"):
        campaign_config(plan={"kind": "latin_hypercube", "points": 5, "shape": [2, 2, 2]})


def test_files_named_in_a_file_are_beside_it(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_text(to_toml({**BENCH, "converter": {"model": "model.toml"}}))
    assert read_bench(tmp_path / "b.toml").converter.model == tmp_path / "model.toml"


def test_toml_written_reads_back_the_same(tmp_path: Path) -> None:
    data = {**CAMPAIGN, "odd key": 'quote " and \\', "flag": True, "tiny": 1e-12, "list": [1, 2.5, "ä"]}
    write_whole(tmp_path / "x.toml", to_toml(data))
    assert read_toml(tmp_path / "x.toml") == data
    assert [path.name for path in tmp_path.iterdir()] == ["x.toml"]


def test_the_line_of_a_missing_key_is_that_of_its_table() -> None:
    text = "a = 1\n\n[plan]\nkind = 2\n[ranges]\n"
    assert line_of(text, ["plan", "kind"]) == 4
    assert line_of(text, ["plan", "points"]) == 3
    assert line_of(text, ["nothing"]) is None


def test_the_hash_is_of_the_settings_not_of_their_spelling() -> None:
    assert config_hash(campaign_config()) == config_hash(campaign_config(seed=1))
    assert config_hash(campaign_config()) != config_hash(campaign_config(seed=2))
    assert config_hash(bench_config(), campaign_config()) != config_hash(campaign_config(), bench_config())
