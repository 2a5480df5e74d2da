"""Dc supply: holds the converter's input voltage, up to a current limit."""

from drivers.dc_device import DcDevice, DcLimits, DcState

__all__ = ["DcLimits", "DcState", "DcSupply"]


class DcSupply(DcDevice):
    """A dc supply behind its register map; set points are checked before and read back after."""

    kind = "supply"

    def set_voltage(self, voltage_V: float) -> None:
        """Set the output voltage; raises ``LimitError``, ``ModbusRefused``, ``ReadbackError``."""
        self.device.write("set_voltage", voltage_V)

    def set_power_limit(self, power_W: float) -> None:
        """Set the highest output power; an instrument without such a register has only its highest current."""
        if "set_power" in self.device.map.registers:
            self.device.write("set_power", power_W)
