"""Set points that the converter cannot hold, or its controller does not take: the point is given up, not the night."""

import pytest

from bench.errors import OutputLost
from bench.progress import Progress
from bench.store import Store
from drivers.controller import Applied
from drivers.errors import SetPointRefused
from tests.bench.fake_bench import FakeInstruments, job, run


def test_a_point_out_of_reach_costs_that_point_only(store: Store) -> None:
    fake = FakeInstruments()

    def lose(progress: Progress) -> None:
        if progress.done == 5 and not progress.said:
            fake.faults = ("output_undervoltage",)
        elif progress.said.startswith("rejected"):
            fake.faults = ()  # arming clears it

    outcome = run(fake, store, progress=lose)
    assert (outcome.accepted, outcome.rejected) == (10, 1)
    assert "output_undervoltage" in store.predictions(1)["reason"].iloc[5]
    assert fake.done.count("supply on") == 2
    (lost,) = store.rejected_table(1).to_dict("records")  # nothing was read of it
    assert "output_undervoltage" in lost["reason"]
    assert lost["D1"] > 0


class Choosy(FakeInstruments):
    """A controller that has a longer dead time than the simulator thinks."""

    most_D1 = 0.85

    def set_modulation(self, D1: float, D2: float) -> Applied:
        if self.most_D1 < D1:
            raise SetPointRefused("the controller refuses: pulse too short")
        return super().set_modulation(D1, D2)


def test_a_point_that_the_controller_does_not_take_costs_that_point_only(store: Store) -> None:
    points = [{"D1": D1, "D2": 0.1, "power_W": 500.0} for D1 in (0.7, 0.9, 0.8)]
    plan = {"kind": "points", "order": "given", "standby": 0, "no_load": 0, "set_points": points}
    fake = Choosy()
    outcome = run(fake, store, job(plan=plan))
    assert (outcome.accepted, outcome.rejected) == (2, 1)
    (refused,) = store.rejected_table(1).to_dict("records")
    assert refused["D1"] == 0.9
    assert "pulse too short" in refused["reason"]
    assert fake.off


def test_points_out_of_reach_one_after_the_other_end_the_campaign(store: Store) -> None:
    fake = FakeInstruments()

    def lose(progress: Progress) -> None:
        if progress.done >= 5:
            fake.faults = ("output_undervoltage",)

    with pytest.raises(OutputLost):
        run(fake, store, progress=lose)
    assert fake.off
