"""What a dc supply and an electronic load share: remote mode, on and off, state, readings, limits."""

from dataclasses import dataclass
from typing import ClassVar, Self

from drivers.clock import Clock, WallClock
from drivers.errors import InstrumentError, InstrumentTripped, ReadbackError
from drivers.health import Health
from drivers.identity import Identity
from drivers.modbus import ModbusDevice
from drivers.modbus_errors import ModbusRefused
from drivers.modbus_map import MapError
from drivers.reading import Quality, Reading

ACTUAL = {"U": "actual_voltage", "I": "actual_current", "P": "actual_power"}
OFF_ATTEMPTS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class DcState:
    """What the instrument says of itself: output on, regulation mode (CV, CC, CP, CR), remote, alarms."""

    on: bool
    mode: str
    remote: bool
    alarms: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DcLimits:
    """Lowest and highest set point that the instrument lets through, as adjusted on it now."""

    voltage_V: tuple[float, float]
    current_A: tuple[float, float]
    power_W: tuple[float, float]


class DcDevice:
    """A dc supply or load; ``clock`` is the bench's clock, which stamps the readings."""

    kind: ClassVar[str]

    def __init__(self, device: ModbusDevice, *, clock: Clock | None = None) -> None:
        if device.map.kind != self.kind:
            raise MapError(
                f"the {self.kind} has the map of {device.map.series}, which is a {device.map.kind}"
            )
        self.device = device
        self._clock = clock or WallClock()

    def identify(self) -> Identity:
        """Ask who answers; raises ``IdentityError`` when it is not what the map is for."""
        return self.device.identify()

    def limits(self) -> DcLimits:
        """The adjustment limits of the instrument, asked anew."""
        self.device.forget()
        voltage_V, current_A = self.device.limits("set_voltage"), self.device.limits("set_current")
        if "set_power" in self.device.map.registers:
            power_W = self.device.limits("set_power")
        else:
            power_W = (0.0, voltage_V[1] * current_A[1])
        return DcLimits(voltage_V=voltage_V, current_A=current_A, power_W=power_W)

    def allows(self, quantity: str, value: float) -> bool:
        """Whether a set point of ``voltage_V``, ``current_A`` or ``power_W`` is within :meth:`limits`, to a count."""
        name = f"set_{quantity.partition('_')[0]}"
        if name in self.device.map.registers:
            return self.device.allows(name, value)
        lowest, highest = getattr(self.limits(), quantity)
        return bool(lowest <= value <= highest)

    def take_remote(self) -> None:
        """Take control from the front panel, and start the instrument's own watchdog where it has one.

        Raises ``ModbusRefused`` (a panel that is locked to local) or ``ReadbackError``.
        """
        device = self.device
        if "remote" in device.map.registers:
            device.write("remote", True)
        device.forget()  # somebody may have turned the limits at the panel until now
        if device.map.watchdog:
            device.write(device.map.watchdog.sets, device.map.watchdog.timeout_s)

    def release(self) -> None:
        """Switch off, and give control back to the front panel."""
        self.off()
        if "remote" in self.device.map.registers and self.state().remote:
            self.device.write("remote", False)

    def on(self) -> None:
        """Switch on; returns once the state reads on.

        Raises ``InstrumentTripped`` when an alarm stands or comes, ``ModbusRefused``, ``ReadbackError``.
        """
        self._raise_alarms("it was not switched on")
        try:
            self.device.write("output", True)
        except (ModbusRefused, ReadbackError):
            self._raise_alarms("it did not stay on")
            raise

    def off(self) -> None:
        """Switch off; returns only once the state reads off.

        Off is safe to say twice, so it is: after a failure the state is read, remote mode is taken back if
        it was lost, and off is said again. Raises ``ReadbackError`` when the output was not seen off.
        """
        for attempt in range(1, OFF_ATTEMPTS + 1):
            try:
                self._try_off()
                return
            except InstrumentError as error:
                if attempt == OFF_ATTEMPTS:
                    problem = f"the {self.kind} was not seen off after {attempt} attempts: {error.message}"
                    raise ReadbackError(problem, **error.context) from error

    def acknowledge(self) -> None:
        """Clear latched alarms whose cause is gone; raises ``InstrumentTripped`` when one still stands."""
        if "acknowledge" in self.device.map.registers:
            self.device.write("acknowledge", True)
        self._raise_alarms("acknowledging did not clear it: its cause is still there")

    def state(self) -> DcState:
        """The state, from one read."""
        map = self.device.map
        raws = self.device.read_raw(map.state_registers)
        alarms = {name: alarm for name, alarm in map.alarms.items() if alarm.stands(raws)}
        named = tuple(name for name, alarm in alarms.items() if not alarm.summary)
        modes = map.modes
        return DcState(
            on=map.flags["on"].stands(raws),
            mode=modes.names[(int(raws[modes.of]) >> modes.shift) & modes.mask],
            remote="remote" not in map.flags or map.flags["remote"].stands(raws),
            alarms=named or tuple(alarms),
        )

    def actual(self) -> dict[str, Reading]:
        """Voltage "U", current "I" and power "P" at the terminals, from one instant where the map allows."""
        raws = self.device.read_raw(list(ACTUAL.values()))
        time_s = self._clock.now()
        readings = {}
        for key, name in ACTUAL.items():
            raw = raws[name]
            quality = Quality.OVERRANGE if self.device.overrange(name, raw) else Quality.GOOD
            unit, value = self.device.map.registers[name].unit, float(self.device.value(name, raw))
            readings[key] = Reading(value=value, unit=unit, time_s=time_s, quality=quality)
        return readings

    def set_current_limit(self, current_A: float) -> None:
        """Set the highest current; checked before, read back after (see ``ModbusDevice.write``)."""
        self.device.write("set_current", current_A)

    @property
    def health(self) -> Health:
        """How well its link does."""
        return self.device.link.health

    @property
    def resource(self) -> str:
        """Where it is reached."""
        return self.device.link.resource

    def close(self) -> None:
        """Close the link; switches nothing."""
        self.device.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _try_off(self) -> None:
        try:
            self.device.write("output", False)
        except InstrumentError:
            state = self.state()
            if not state.on:
                return
            if not state.remote:
                self.device.write("remote", True)
            raise

    def _raise_alarms(self, consequence: str) -> None:
        if alarms := self.state().alarms:
            raise InstrumentTripped(
                f"the {self.kind} has {', '.join(alarms)} standing; {consequence}",
                instrument=f"{self.device.map.maker} {self.device.map.series}",
            )
