"""The whole way: campaign, drivers, real ports, mock instruments, virtual lab."""

from contextlib import closing

import numpy as np
import pandas as pd
import pytest

from bench.campaign import CampaignOutcome, Job, run_campaign
from bench.config import BenchConfig, CampaignConfig, check
from bench.connect import acknowledge_alarms, inspect_bench, open_controller
from bench.errors import BenchTaken, CampaignStopped
from bench.lock import ports_of_bench
from bench.lut_on_bench import following, load_into_controller, table_rows, verification
from bench.progress import Progress
from bench.store import Store
from drivers.analyzer import NOT_SCALED
from drivers.clock import StepClock
from drivers.errors import InstrumentError
from drivers.mocks.plant import Plant
from drivers.mocks.rack import Rack
from tests.bench.fake_bench import memory

PLAN = {"kind": "latin_hypercube", "points": 6, "reference_every": 3, "standby": 1, "no_load": 1}
CAMPAIGN = check({"name": "six points", "plan": PLAN}, CampaignConfig, file="campaign.toml")
TABLE = pd.DataFrame({"P_W": [400.0, 800.0], "D1": [0.8, 0.9], "D2": [0.1, 0.1]})


def virtual_plant() -> Plant:
    return Plant.virtual(seed=3, hidden={}, clock=StepClock())


def config(rack: Rack, **converter: object) -> BenchConfig:
    settings = rack.bench_config()
    settings["limits"] |= {"again_s": 0.0, "recover_s": 0.0}  # type: ignore[operator]
    settings["converter"] |= converter  # type: ignore[operator]
    return check(settings, BenchConfig, file="bench.toml")


def is_off(plant: Plant) -> bool:
    state = plant.state()
    return not state.pwm and state.supply_V == 0.0 and state.load_A == 0.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[CampaignOutcome, Store, Plant]:
    store = Store(f"sqlite:///{tmp_path_factory.mktemp('campaign')}/x.sqlite")
    plant = virtual_plant()
    with Rack(plant) as rack:
        outcome = run_campaign(Job.prepare(CAMPAIGN, config(rack)), store, plant.clock)
    store.close()
    return outcome, store, plant


def test_every_row_is_accepted_and_settled(run: tuple[CampaignOutcome, Store, Plant]) -> None:
    outcome, _, _ = run
    assert (outcome.accepted, outcome.rejected, outcome.settled) == (11, 0, 11)


def test_the_bench_is_seen_off(run: tuple[CampaignOutcome, Store, Plant]) -> None:
    outcome, store, plant = run
    assert is_off(plant)
    assert outcome.power_off.safe
    assert store.campaign(1)["power_off"] == "PWM off; load off; supply off; discharge to 60 V or less"


def test_predicted_and_measured_are_stored_and_agree(run: tuple[CampaignOutcome, Store, Plant]) -> None:
    _, store, _ = run
    measured = store.measurement_table(1)
    predicted = store.predictions(1)["predicted_efficiency"].to_numpy(dtype=float)
    loaded = measured["kind"].isin(["load", "reference"]).to_numpy()
    gap = measured["efficiency"].to_numpy(dtype=float)[loaded] - predicted[loaded]
    assert len(gap) == 9
    # parts off by their tolerance and an analyzer inside its specification: within a point, never equal
    assert np.all(np.abs(gap) < 0.01)
    assert np.all(gap != 0)


def test_the_set_point_is_what_was_measured(run: tuple[CampaignOutcome, Store, Plant]) -> None:
    _, store, _ = run
    table = store.measurement_table(1)
    loaded = table[table["kind"] == "load"]
    # the load's register has 52 429 counts for its nominal power, the analyzer 0.05 % + 0.1 % of range
    np.testing.assert_allclose(loaded["P2_W"], loaded["P_set_W"], rtol=0.01)
    assert (loaded["u_P2_W"] > 0).all()


def test_the_instruments_are_named(run: tuple[CampaignOutcome, Store, Plant]) -> None:
    _, store, _ = run
    assert set(store.campaign(1)["instruments"]) == {"analyzer", "supply", "load", "controller"}
    assert "760304" in store.campaign(1)["instruments"]["analyzer"]


def test_the_same_seed_measures_the_same(run: tuple[CampaignOutcome, Store, Plant]) -> None:
    _, first, _ = run
    plant = virtual_plant()
    with Rack(plant) as rack, memory() as second:
        run_campaign(Job.prepare(CAMPAIGN, config(rack)), second, plant.clock)
        again = second.measurement_table(1)
    assert again.equals(first.measurement_table(1))


def test_a_check_of_a_good_bench_finds_everyone_and_no_fault() -> None:
    plant = virtual_plant()
    with Rack(plant) as rack:
        found = inspect_bench(config(rack), plant.clock)
    assert found.faults == []
    assert list(found.identities) == ["analyzer", "supply", "load", "controller"]


def test_a_check_lists_every_fault_at_once() -> None:
    plant = virtual_plant()
    with Rack(plant) as rack:
        bench = rack.bench_config()
        bench["analyzer"] |= {"resource": "/dev/no-such-port"}  # type: ignore[operator]
        bench["supply"] |= {"resource": "tcp://127.0.0.1:1"}  # type: ignore[operator]
        bench["limits"] |= {"power_W": 1e6}  # type: ignore[operator]
        found = inspect_bench(check(bench, BenchConfig, file="bench.toml"), plant.clock)
    assert [fault.split(":")[0] for fault in found.faults] == ["analyzer", "supply", "load", "load"]
    assert "no such port" in found.faults[0]
    assert "current_A = 7142.86 is needed" in found.faults[2]
    assert "power_W = 1e+06 is needed" in found.faults[3]


def test_a_check_finds_settings_that_the_analyzer_has_not() -> None:
    plant = virtual_plant()
    with Rack(plant) as rack:
        bench = rack.bench_config()
        bench["analyzer"] |= {"update_s": 0.3, "ranges": {"U1": 250.0}, "scaled": True}  # type: ignore[operator]
        faults = inspect_bench(check(bench, BenchConfig, file="bench.toml"), plant.clock).faults
    interval, voltage, scaling = faults
    assert scaling == f"analyzer: {NOT_SCALED}"
    assert interval.startswith("analyzer: update interval 0.3 s")
    assert voltage.startswith("analyzer: range U1")


@pytest.mark.parametrize("current_A", [0.5, 7.3, 8.0, 9.99])
def test_a_limit_that_was_set_at_the_panel_to_that_of_the_bench_is_no_fault(current_A: float) -> None:
    plant = virtual_plant()
    with Rack(plant) as rack:
        rack.supply.counts["limit_current_max"] = round(current_A / 30 * 0xCCCC)
        bench = rack.bench_config()
        bench["limits"] |= {"current_A": current_A}  # type: ignore[operator]
        assert inspect_bench(check(bench, BenchConfig, file="bench.toml"), plant.clock).faults == []


def test_a_supply_that_may_not_give_the_power_is_a_fault() -> None:
    plant = virtual_plant()
    with Rack(plant) as rack:
        rack.supply.counts["limit_power_max"] = rack.supply.counts["limit_power_max"] // 10
        (fault,) = inspect_bench(config(rack), plant.clock).faults
    assert fault.startswith(
        "supply: power_W = 2200 is needed by bench.toml; the instrument allows 0 to 509.9"
    )


def test_a_power_limit_that_somebody_left_at_the_supply_is_set_anew() -> None:
    plan = {
        "kind": "points",
        "standby": 1,
        "no_load": 1,
        "set_points": [{"D1": 0.9, "D2": 0.1, "power_W": 900}],
    }
    campaign = check({"name": "one point", "plan": plan}, CampaignConfig, file="campaign.toml")
    plant = virtual_plant()
    store = memory()
    with Rack(plant) as rack:
        rack.supply.counts["set_power"] //= 10  # 500 W, from the panel or an earlier program
        outcome = run_campaign(Job.prepare(campaign, config(rack)), store, plant.clock)
        assert rack.supply.si("set_power") == pytest.approx(2200.0, abs=5000 / 0xCCCC)  # one count
    store.close()
    assert outcome.rejected == 0


def test_alarms_whose_cause_is_gone_are_acknowledged_and_the_others_stand() -> None:
    plant = virtual_plant()
    with Rack(plant) as rack:
        rack.supply.trip("OVP")
        rack.load.trip("OT", lasting=True)
        assert inspect_bench(config(rack), plant.clock).faults == [
            "supply: alarm OVP stands",
            "load: alarm OT stands",
        ]
        assert acknowledge_alarms(config(rack), plant.clock) == ["supply OVP"]
        assert inspect_bench(config(rack), plant.clock).faults == ["load: alarm OT stands"]
        assert not rack.supply.remote
        with ports_of_bench(config(rack)), pytest.raises(BenchTaken):
            acknowledge_alarms(config(rack), plant.clock)
        with ports_of_bench(config(rack)), pytest.raises(BenchTaken):
            inspect_bench(config(rack), plant.clock)
    assert is_off(plant)


def test_a_bench_in_use_is_said_and_left_alone() -> None:
    plant = virtual_plant()
    with Rack(plant) as rack, memory() as store, memory() as another:
        bench = config(rack)

        def start_another(progress: Progress) -> None:
            if progress.done == 2:
                with pytest.raises(BenchTaken, match=r"campaign 1 .* has the bench"):
                    run_campaign(Job.prepare(CAMPAIGN, bench), store, plant.clock)
                with pytest.raises(
                    BenchTaken, match="is in use by process"
                ):  # another database knows nothing
                    run_campaign(Job.prepare(CAMPAIGN, bench), another, plant.clock)
                raise CampaignStopped("seen enough")

        with pytest.raises(CampaignStopped, match="seen enough"):
            run_campaign(Job.prepare(CAMPAIGN, bench), store, plant.clock, progress=start_another)
        assert another.campaign(1)["power_off"] == "nothing was switched on"
    assert is_off(plant)


def test_a_plug_pulled_in_the_middle_leaves_what_can_be_reached_off() -> None:
    plant = virtual_plant()
    with Rack(plant) as rack, memory() as store:

        def pull(progress: Progress) -> None:
            if progress.done == 3:
                rack.analyzer_server.stop()

        with pytest.raises(InstrumentError):
            run_campaign(Job.prepare(CAMPAIGN, config(rack)), store, plant.clock, progress=pull)
        assert is_off(plant)
        assert store.campaigns()[0]["state"] == "failed"


def test_an_adaptive_campaign_chooses_measures_and_ends() -> None:
    settings = {"kind": "adaptive", "points": 20, "adaptive": {"start": 10}}
    plant = Plant.virtual(seed=100_003, hidden={}, clock=StepClock())
    with Rack(plant) as rack, memory() as store:
        campaign = check({"name": "adaptive", "plan": settings}, CampaignConfig, file="campaign.toml")
        outcome = run_campaign(Job.prepare(campaign, config(rack)), store, plant.clock)
        chosen = [event for event in store.events(1) if event["event"] == "chosen"]
        said = [event["detail"] for event in store.events(1) if event["event"] == "choice"]
    assert (outcome.accepted, outcome.rejected) == (20, 0)
    assert len(chosen) == 20 - 17  # 2 standby, 2 no load, 10 points, 3 references before
    assert all(event["detail"] for event in chosen)
    assert said[0].startswith("verdict so far: ")
    assert is_off(plant)


# --- a table in the controller ----------------------------------------------------------------------


def test_a_table_is_loaded_in_the_modulation_of_the_bench() -> None:
    with Rack(virtual_plant()) as rack:
        bench = config(rack, modulation="tps")
        rows = load_into_controller(bench, TABLE).rows
        with closing(open_controller(bench)) as controller:
            assert controller.read_table() == ("tps", rows)


def test_no_table_is_loaded_while_somebody_has_the_bench() -> None:
    with Rack(virtual_plant()) as rack:
        bench = config(rack)
        with ports_of_bench(bench), pytest.raises(BenchTaken, match="is in use by"):
            load_into_controller(bench, TABLE)


def test_what_a_controller_follows_is_applied_in_the_modulation_of_the_bench() -> None:
    plant = virtual_plant()
    with Rack(plant) as rack:
        bench = config(rack, modulation="tps")
        row = verification(TABLE, bench, name="verify").plan.points[0]
        with following(table_rows(TABLE)).connect(bench, plant.clock) as connected:
            connected.configure()
            connected.power_up()
            applied = connected.set_point(row)
            assert connected.power_off().safe
    assert applied is not None
    assert applied.mode == "tps"
