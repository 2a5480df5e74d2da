"""Switching off: the ordered steps for whatever instruments can be reached, and a bench that a dead process left on."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

from bench.config import BenchConfig
from bench.connect import Inspection, open_all
from bench.lock import ports_of_bench
from bench.safety import DEADLINE_S, PowerOffReport, Step, power_off
from drivers.clock import Clock
from drivers.controller import Controller
from drivers.dc_device import DcDevice
from drivers.errors import LinkUnavailable, ReadbackError

DISCHARGE_POLL_S = 0.5


def off_steps(config: BenchConfig, instruments: Mapping[str, Any], clock: Clock) -> list[Step]:
    """PWM, load, supply, discharge; a step whose instrument is missing fails, and says why."""

    def of(name: str, act: Callable[[Any], None]) -> Callable[[], None]:
        def run() -> None:
            if name not in instruments:
                raise LinkUnavailable(f"the {name} cannot be reached")
            act(instruments[name])

        return run

    return [
        Step(name="PWM", act=of("controller", pwm_off)),
        Step(name="load", act=of("load", lambda load: load.off())),
        Step(name="supply", act=of("supply", lambda supply: supply.off())),
        Step(
            name="discharge",
            act=of("supply", lambda supply: discharged(config, supply, instruments.get("load"), clock)),
            deadline_s=DEADLINE_S + config.limits.discharge_s / config.speed,
            done=f"to {config.limits.safe_voltage_V:g} V or less",
        ),
    ]


def pwm_off(controller: Controller) -> None:
    """PWM seen off, and no more beats due."""
    controller.disable()
    controller.disarm()


def discharged(config: BenchConfig, supply: DcDevice, load: DcDevice | None, clock: Clock) -> None:
    """Wait until both ports of the converter have fallen below the safe voltage, by the instruments on them."""
    if load is None:
        raise LinkUnavailable("the load cannot be reached, which would tell the output voltage")
    safe_V = config.limits.safe_voltage_V
    end_s = clock.now() + config.limits.discharge_s
    while True:
        readings = {"input": supply.actual()["U"], "output": load.actual()["U"]}
        high = [
            f"{port} at {r.value:.1f} V" for port, r in readings.items() if not (r.good and r.value <= safe_V)
        ]
        if not high:
            return
        if clock.now() >= end_s:
            raise ReadbackError(
                f"{' and '.join(high)} after {config.limits.discharge_s:g} s; safe is {safe_V:g} V"
            )
        clock.sleep(DISCHARGE_POLL_S)


def switch_off_leftovers(config: BenchConfig, clock: Clock) -> PowerOffReport:
    """Switch off, step by step, whatever can be reached of a bench that nobody runs."""
    inspection = Inspection()
    with ports_of_bench(config), ExitStack() as stack:
        opened = open_all(config, clock, inspection, stack)
        answering = {name: it for name, it in opened.items() if inspection.attempt(name, it.identify)}
        return power_off(off_steps(config, answering, clock), again_s=config.limits.again_s)
