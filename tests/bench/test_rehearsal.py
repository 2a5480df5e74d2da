"""A campaign on the mock bench before it meets the real one, with faults from a file."""

from pathlib import Path

import pytest

from bench.errors import InputError, LimitReached, StoreError
from bench.rehearsal import read_faults, rehearse
from drivers.mocks.faults import NO_FAULTS, FaultFile
from tests.bench.fake_bench import bench_config, campaign_config

PLAN = {"kind": "latin_hypercube", "points": 1, "standby": 1, "no_load": 0}
CAMPAIGN = campaign_config(plan=PLAN, measure={"samples": 2})


def faults(*entries: dict[str, object]) -> FaultFile:
    return FaultFile.model_validate({"fault": list(entries)})


def test_a_rehearsal_runs_to_its_end_and_keeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    went = rehearse(CAMPAIGN, bench_config(), NO_FAULTS)
    assert went.error is None
    assert went.accepted == went.planned == 2
    assert list(tmp_path.iterdir()) == []


def test_the_mock_bench_has_the_voltages_of_the_real_one() -> None:
    low = bench_config(
        converter={"input_voltage_V": 60.0, "output_voltage_V": 28.0},
        limits={"voltage_V": 80.0, "current_A": 3.0, "power_W": 100.0, "output_voltage_V": 40.0},
    )
    campaign = campaign_config(plan=PLAN, ranges={"power_W": [20.0, 60.0]}, measure={"samples": 2})
    went = rehearse(campaign, low, NO_FAULTS)
    assert went.error is None
    assert went.accepted == went.planned


def test_a_disturbance_from_the_file_is_survived_and_listed() -> None:
    went = rehearse(CAMPAIGN, bench_config(), faults({"instrument": "load", "kind": "silence", "after": 40}))
    assert went.error is None
    assert [struck.fault.kind for struck in went.struck] == ["silence"]


def test_a_trip_stops_it_with_the_bench_off_and_the_cause_named() -> None:
    trip = {"instrument": "supply", "kind": "trip", "value": "OVP", "after": 40}  # the bench is up
    went = rehearse(CAMPAIGN, bench_config(), faults(trip))
    assert isinstance(went.error, LimitReached)
    assert "supply OVP" in str(went.error)
    assert went.power_off.startswith("PWM off; load off; supply off")


def test_a_full_disk_stops_it_too() -> None:
    went = rehearse(
        CAMPAIGN, bench_config(), faults({"instrument": "database", "kind": "read_only", "after": 25})
    )
    assert isinstance(went.error, StoreError)
    assert "read-only" in str(went.error)


def test_a_wrong_entry_is_named_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "faults.toml"
    file.write_text('seed = 1\n\n[[fault]]\ninstrument = "load"\nkind = "explode"\n')
    with pytest.raises(InputError, match=r"'explode' cannot happen to the load"):
        read_faults(file)
