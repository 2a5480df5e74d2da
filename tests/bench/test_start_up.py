"""What has to be up before the next part is switched on."""

import pytest

from bench.errors import LimitReached
from bench.instruments import REACHED, START_UP_S
from tests.bench.fake_bench import FakeInstruments, job, memory, run

STARTED = {
    "plan": {
        "kind": "points",
        "set_points": [{"D1": 0.9, "D2": 0.0, "power_W": 400.0}],
        "standby": 0,
        "no_load": 0,
    }
}


class Watched(FakeInstruments):
    """Notes the input voltage at which the PWM went on."""

    at_V: float | None = None

    def set(self, name: str, **state: object) -> None:
        if name == "PWM on" and self.at_V is None:
            self.at_V = self.supply_V
        super().set(name, **state)


def test_the_pwm_waits_for_a_supply_that_rises_slowly() -> None:
    fake = Watched(supply_rises_s=4.0)
    assert run(fake, memory(), job(**STARTED)).accepted == 1
    assert fake.at_V is not None
    assert fake.at_V >= REACHED * 300.0


def test_a_supply_that_does_not_come_up_ends_it_with_the_pwm_never_on() -> None:
    fake = Watched(supply_rises_s=1e6)
    with pytest.raises(
        LimitReached, match=f"input voltage .* {START_UP_S:g} s after the supply .* target 300 V"
    ):
        run(fake, memory(), job(**STARTED))
    assert fake.at_V is None
    assert fake.off
