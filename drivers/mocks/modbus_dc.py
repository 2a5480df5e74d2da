"""The mock dc supply and electronic load: EA devices in front, one side of the plant behind.

Set points are kept in counts, as the device keeps them. The protections look at the plant whenever state or
actual values are asked for, so a trip comes with the next poll; an alarm is latched and the output goes off.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Protocol

from drivers.mocks.modbus_device import DEVICE_FAILURE, ILLEGAL_VALUE, MockModbusDevice, Refusal
from drivers.modbus_map import ModbusMap, Raw, load_map

LOCAL_CONTROL = 0x17  # EA's exception code for a write while the panel has control
FULL = 0xCCCC
MODES = {"CV": 0, "CR": 1, "CC": 2, "CP": 3}
LOOK_FIRST = ("state", "actual_voltage", "actual_current", "actual_power", "output")


class DcTerminals(Protocol):
    """What of the plant's state is seen at the supply's and the load's terminals."""

    @property
    def supply_V(self) -> float: ...
    @property
    def supply_A(self) -> float: ...
    @property
    def supply_mode(self) -> str: ...
    @property
    def load_V(self) -> float: ...
    @property
    def load_A(self) -> float: ...


class DcPlant(Protocol):
    """What of the plant a supply and a load reach."""

    @property
    def output_V(self) -> float: ...
    def set_supply(self, *, on: bool, voltage_V: float, current_limit_A: float) -> None: ...
    def set_load(self, *, on: bool, power_W: float) -> None: ...
    def state(self) -> DcTerminals: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Rating:
    """What stands on the device's type plate."""

    device_class: int
    device_type: str
    voltage_V: float
    current_A: float
    power_W: float


# Assumption: the class numbers are made up; nothing depends on them.
PSI_9500_30 = Rating(device_class=33, device_type="PSI 9500-30 3U", voltage_V=500, current_A=30, power_W=5000)
ELR_9200_70 = Rating(device_class=40, device_type="ELR 9200-70", voltage_V=200, current_A=70, power_W=3500)


class MockDc(MockModbusDevice):
    """An EA dc device; ``press_local``, ``locked`` and ``trip`` are its front panel and its bad days."""

    def __init__(self, plant: DcPlant, map: ModbusMap, rating: Rating, *, unit: int) -> None:
        super().__init__(map, unit=unit, limited=unit == 0)
        self.plant = plant
        self.rating = rating
        self.on = False
        self.remote = False
        self.locked = False  # the panel is locked to local: remote mode is refused
        self.clips = False  # take a set point beyond the limits, and hold the limit instead
        self.alarms: set[str] = set()
        self._lasting: set[str] = set()
        top, set_top, protect_top = FULL, 0xD0E5, 0xE147
        self.counts = {"set_voltage": 0, "set_current": top, "set_power": top}
        self.counts |= dict.fromkeys(("protect_voltage", "protect_current", "protect_power"), protect_top)
        self.counts |= dict.fromkeys(("limit_voltage_max", "limit_current_max", "limit_power_max"), set_top)
        self.counts |= dict.fromkeys(("limit_voltage_min", "limit_current_min"), 0)

    @abstractmethod
    def terminals(self) -> tuple[float, float, str]:
        """Voltage in V, current in A, and regulation mode, now."""

    @abstractmethod
    def apply(self) -> None:
        """Hand the set points and the switch to the plant."""

    def press_local(self) -> None:
        """Somebody presses LOCAL at the front panel: remote mode ends, the output stays as it is."""
        with self.lock:
            self.remote = False

    def trip(self, alarm: str, *, lasting: bool = False) -> None:
        """Raise an alarm; one that is ``lasting`` cannot be acknowledged until ``heal``."""
        with self.lock:
            self.alarms.add(alarm)
            self._lasting |= {alarm} if lasting else set()
            self._switch(False)

    def heal(self) -> None:
        """The causes of all lasting alarms are gone; the alarms stay until acknowledged."""
        with self.lock:
            self._lasting.clear()

    def si(self, name: str) -> float:
        """A set point, protection threshold or limit in SI units."""
        return self.counts[name] * self.map.registers[name].scaling.per_count(self._nominal)

    def get(self, name: str) -> Raw:
        """What a register holds now."""
        if name in LOOK_FIRST:
            self._protect()
        if name in self.counts:
            return self.counts[name]
        match name.split("_"):
            case ["device", "class"]:
                return self.rating.device_class
            case ["device", "type"]:
                return self.rating.device_type
            case ["manufacturer"]:
                return "EA Elektro-Automatik"
            case ["nominal", _]:
                return self._nominal(name)
            case ["actual", _]:
                return self._actual(name)
            case ["state"]:
                return self._state_bits()
            case ["remote"]:
                return int(self.remote)
            case ["output"]:
                return int(self.on)
            case ["acknowledge"]:
                return 0
            case ["serial", "number"]:
                return "VIRTUAL LAB"
            case _:
                return "mock"  # firmware

    def put(self, name: str, raw: Raw) -> None:
        """Take a write as the device does, or refuse it."""
        value = int(raw)
        if name == "remote":
            if value and self.locked:
                raise Refusal(LOCAL_CONTROL)
            self.remote = bool(value)
            return
        if not self.remote:
            raise Refusal(LOCAL_CONTROL)
        if name == "output":
            if value and self.alarms:
                raise Refusal(DEVICE_FAILURE)
            self._switch(bool(value))
        elif name == "acknowledge":
            self.alarms &= self._lasting if value else self.alarms
        else:
            self.counts[name] = self._within_limits(name, value)
            self.apply()

    def _within_limits(self, name: str, counts: int) -> int:
        register = self.map.registers[name]
        lowest, highest = register.range or (0, 0xFFFF)
        lowest = max(lowest, self.counts.get(register.lowest, lowest))
        highest = min(highest, self.counts.get(register.highest, highest))
        if self.clips:
            return min(max(counts, lowest), highest)
        if not lowest <= counts <= highest:
            raise Refusal(ILLEGAL_VALUE)
        return counts

    def _switch(self, on: bool) -> None:
        self.on = on
        self.apply()

    def _protect(self) -> None:
        """Trip where the terminals exceed a protection threshold."""
        if not self.on:
            return
        voltage_V, current_A, _ = self.terminals()
        exceeded = {
            "OVP": voltage_V > self.si("protect_voltage"),
            "OCP": current_A > self.si("protect_current"),
            "OPP": voltage_V * current_A > self.si("protect_power"),
        }
        if trips := {alarm for alarm, beyond in exceeded.items() if beyond}:
            self.alarms |= trips
            self._switch(False)

    def _state_bits(self) -> int:
        flags, alarms, modes = self.map.flags, self.map.alarms, self.map.modes
        bits = MODES[self.terminals()[2]] << modes.shift
        bits |= flags["on"].mask if self.on else 0
        bits |= flags["remote"].mask if self.remote else 0
        for name, alarm in alarms.items():
            bits |= alarm.mask if name in self.alarms or (alarm.summary and self.alarms) else 0
        return bits

    def _actual(self, name: str) -> int:
        voltage_V, current_A, _ = self.terminals()
        value = {"U": voltage_V, "I": current_A, "P": voltage_V * current_A}
        key = {"actual_voltage": "U", "actual_current": "I", "actual_power": "P"}[name]
        counts = round(value[key] / self.map.registers[name].scaling.per_count(self._nominal))
        return min(max(counts, 0), 0xFFFF)

    def _nominal(self, name: str) -> float:
        rating = self.rating
        return {
            "nominal_voltage": rating.voltage_V,
            "nominal_current": rating.current_A,
            "nominal_power": rating.power_W,
        }[name]


class MockSupply(MockDc):
    """An EA PSI 9000 that feeds the plant."""

    def __init__(self, plant: DcPlant, *, unit: int = 0, rating: Rating = PSI_9500_30) -> None:
        super().__init__(plant, load_map("ea_psi9000"), rating, unit=unit)

    def terminals(self) -> tuple[float, float, str]:
        """The plant's supply side; a power limit shows as constant power."""
        state = self.plant.state()
        limited = state.supply_mode == "CC" and self._current_limit_A() < self.si("set_current")
        return state.supply_V, state.supply_A, "CP" if limited else state.supply_mode

    def apply(self) -> None:
        """Voltage, and the lower of the current limit and what the power limit leaves."""
        self.plant.set_supply(
            on=self.on, voltage_V=self.si("set_voltage"), current_limit_A=self._current_limit_A()
        )

    def _current_limit_A(self) -> float:
        voltage_V, current_A = self.si("set_voltage"), self.si("set_current")
        return min(current_A, self.si("set_power") / voltage_V) if voltage_V > 0 else current_A


class MockLoad(MockDc):
    """An EA ELR 9000 that loads the plant with constant power."""

    def __init__(self, plant: DcPlant, *, unit: int = 1, rating: Rating = ELR_9200_70) -> None:
        super().__init__(plant, load_map("ea_elr9000"), rating, unit=unit)
        self.counts["set_power"] = 0

    def terminals(self) -> tuple[float, float, str]:
        """The plant's load side; at the current limit the load is in constant current."""
        state = self.plant.state()
        limited = state.load_V > 0 and self.si("set_power") > self.si("set_current") * state.load_V
        return state.load_V, state.load_A, "CC" if limited else "CP"

    def apply(self) -> None:
        """The set power, or what the current limit leaves of it at the voltage of this moment.

        Below the voltage that is set a load draws nothing.
        """
        voltage_V, power_W = self.plant.output_V, self.si("set_power")
        if 0 < voltage_V < self.si("set_voltage"):
            power_W = 0.0
        elif voltage_V > 0:
            power_W = min(power_W, self.si("set_current") * voltage_V)
        self.plant.set_load(on=self.on, power_W=power_W)
