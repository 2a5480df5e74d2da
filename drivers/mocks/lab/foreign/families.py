"""All foreign families by name."""

from drivers.mocks.lab.foreign.base import ForeignEffect
from drivers.mocks.lab.foreign.control import AdaptiveDeadTime, BlankedRectifier, DutyJitter
from drivers.mocks.lab.foreign.dc_side import (
    BoardLeakage,
    DcLinkEsr,
    LoadLeakage,
    OutputCapacitorEsr,
    SupplyRipple,
)
from drivers.mocks.lab.foreign.edges import EdgeRinging, GateLoopTurnOff, SnubberLoss
from drivers.mocks.lab.foreign.readings import AcPhaseError, GainWander
from drivers.mocks.lab.foreign.windings import (
    ContactResistance,
    CoreDcBias,
    MagnetizingSaturation,
    ProximityLoss,
)

_ALL: tuple[type[ForeignEffect], ...] = (
    SnubberLoss, EdgeRinging, GateLoopTurnOff, ProximityLoss, ContactResistance, CoreDcBias,
    MagnetizingSaturation, DcLinkEsr, OutputCapacitorEsr, LoadLeakage, BoardLeakage, SupplyRipple, DutyJitter,
    AdaptiveDeadTime, BlankedRectifier, AcPhaseError, GainWander,
)  # fmt: skip

FOREIGN: dict[str, type[ForeignEffect]] = {family.name: family for family in _ALL}
