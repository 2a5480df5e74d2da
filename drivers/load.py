"""Electronic load: draws a constant power from the converter's output, up to a current limit."""

from drivers.dc_device import DcDevice, DcLimits, DcState

__all__ = ["DcLimits", "DcState", "ElectronicLoad"]


class ElectronicLoad(DcDevice):
    """An electronic load behind its register map; set points are checked before and read back after."""

    kind = "load"

    def set_power(self, power_W: float) -> None:
        """Set the power to draw; raises ``LimitError``, ``ModbusRefused``, ``ReadbackError``."""
        self.device.write("set_power", power_W)
