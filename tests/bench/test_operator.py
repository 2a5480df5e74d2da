"""What only an operator can say: that an alarm is known, and that a bench was seen to be off."""

from pathlib import Path

import pytest

from bench.errors import Aborted, named
from bench.process import Owner
from bench.states import State
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
    first, *others = capsys.readouterr().err.splitlines()
    assert first == "BENCH NOT SAFE: switch it off by hand and see that it is off, then: d2ea clear"
    assert others[-1] == "load NOT confirmed off"


def test_status_says_first_what_needs_a_hand_and_nothing_twice(capsys: pytest.CaptureFixture[str]) -> None:
    unsafe_bench()
    with Store(database_url()) as store:
        why, cause = "load NOT confirmed off", "LinkLost: analyzer is gone"
        store.end(1, State.UNSAFE, power_off=why, error=cause)
    assert d2ea("status") == 0
    bench, part, *others, last = capsys.readouterr().out.splitlines()[1:]  # below whose lab it is
    assert "UNSAFE since" in bench
    assert bench.endswith("switch it off by hand and see that it is off, then: d2ea clear")
    assert part == "  load NOT confirmed off"
    assert others == ["campaign 1 'c': unsafe", "0 of 0 rows accepted, 0 rejected", f"stopped by: {cause}"]
    assert last.startswith("last: unsafe at ")


def test_status_says_once_that_a_campaign_was_aborted(capsys: pytest.CaptureFixture[str]) -> None:
    with Store(database_url()) as store:
        provenance = Provenance(config={}, config_hash="", virtual=False)
        store.create_campaign("c", provenance, [])
        said = named(Aborted("interrupted by the operator"))
        store.end(1, State.ABORTED, power_off="PWM off; load off", error=said)
    assert d2ea("status") == 0
    *_, bench, stopped, last = capsys.readouterr().out.splitlines()
    assert bench == "bench: PWM off; load off"
    assert stopped == "stopped by: interrupted by the operator"
    assert last.startswith("last: aborted at ")


def test_clear_believes_only_what_is_read_back_or_an_operator(capsys: pytest.CaptureFixture[str]) -> None:
    unsafe_bench()
    assert d2ea("clear") == 3  # nothing of this bench can be reached
    assert "say --seen-off once you have seen that it is" in capsys.readouterr().err
    assert d2ea("clear", "--seen-off") == 0
    assert d2ea("clear") == 1
    assert "there is nothing to clear" in capsys.readouterr().err
