"""Electronic load: draws a constant power from the converter's output, up to a current limit."""

from drivers.dc_device import DcDevice, DcLimits, DcState

__all__ = ["DcLimits", "DcState", "ElectronicLoad"]


class ElectronicLoad(DcDevice):
    """An electronic load behind its register map; set points are checked before and read back after."""

    kind = "load"

    def allow_current(self, current_A: float) -> None:
        """Set the current limit to so much, or to the highest that the instrument allows where that is less."""
        _, highest_A = self.device.limits("set_current")
        self.set_current_limit(min(current_A, highest_A))

    def accept_any_voltage(self) -> None:
        """Set the voltage below which nothing is drawn to the lowest there is: somebody may have left another."""
        if "set_voltage" in self.device.map.registers:
            lowest_V, _ = self.device.limits("set_voltage")
            self.device.write("set_voltage", lowest_V)

    def set_power(self, power_W: float) -> None:
        """Set the power to draw; raises ``LimitError``, ``ModbusRefused``, ``ReadbackError``."""
        self.device.write("set_power", power_W)
