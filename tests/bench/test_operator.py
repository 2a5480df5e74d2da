"""What only an operator can say: that an alarm is known, and that a bench was seen to be off."""

from pathlib import Path

import pytest

from bench.process import Owner
from bench.store import Provenance, Store, database_url
from bench.toml_file import to_toml
from drivers.clock import StepClock
from drivers.mocks.plant import Plant
from drivers.mocks.rack import Rack
from tests.bench.command_line import bench_file, campaign_file, d2ea
from tests.bench.fake_bench import BENCH

pytestmark = pytest.mark.usefixtures("in_a_folder_of_its_own")


def test_an_alarm_keeps_a_bench_from_use_until_an_operator_acknowledges_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Rack(Plant.virtual(seed=3, hidden={}, clock=StepClock())) as rack:
        Path("rack.toml").write_text(to_toml(rack.bench_config()))
        rack.supply.trip("OVP")
        assert d2ea("check", "rack.toml") == 1
        assert "supply: alarm OVP stands" in capsys.readouterr().err
        assert d2ea("check", "rack.toml", "--acknowledge") == 0
    assert "acknowledged: supply OVP" in capsys.readouterr().out


def unsafe_bench() -> None:
    with Store(database_url()) as store:
        provenance = Provenance(config={}, config_hash="", virtual=True, bench="fake bench")
        campaign_id = store.create_campaign("c", provenance, [])
        store.benches.take("fake bench", virtual=True, campaign_id=campaign_id, owner=Owner.here())
        store.benches.energise("fake bench", {**BENCH, "limits": {**BENCH["limits"], "again_s": 0}})  # type: ignore[dict-item]
        store.benches.latch("fake bench", "load NOT confirmed off")


def test_unsafe_is_shown_and_refuses_with_its_own_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    unsafe_bench()
    assert d2ea("run", campaign_file(), "--bench", bench_file()) == 3
    assert "load NOT confirmed off" in capsys.readouterr().err
    assert d2ea("status") == 0
    assert "UNSAFE since" in capsys.readouterr().out


def test_clear_believes_only_what_is_read_back_or_an_operator(capsys: pytest.CaptureFixture[str]) -> None:
    unsafe_bench()
    assert d2ea("clear") == 3  # nothing of this bench can be reached
    assert "say --seen-off once you have seen that it is" in capsys.readouterr().err
    assert d2ea("clear", "--seen-off") == 0
    assert d2ea("clear") == 1
    assert "there is nothing to clear" in capsys.readouterr().err
