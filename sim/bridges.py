"""Bridges by what conducts in each state and what each leg does at an edge: data that circuit and losses read.

A leg's swing from one rail to the other is one transition in a two-level leg and two in a three-level one, through
the link's middle. Hybrid modulation makes one of the two at each edge, in both legs at once; legs that are shifted
against each other make both at once, one leg at a time.

Assumption: a three-level leg that goes from rail to rail passes the middle, outer switch first, so that it moves the
charges of both transitions one after the other and every device still blocks half the link.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from sim.modulation import CLAMPED
from sim.parameters import Conduction, Converter, Diode, FullBridge, NpcBridge, Switch


@dataclass(frozen=True, slots=True, kw_only=True)
class Carrier:
    """A device of a conducting path: its kind, the law by which it conducts, how many are in series."""

    kind: str
    law: Conduction
    count: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Transition:
    """A step of one leg, by kinds of device.

    ``charging`` and ``discharging`` junctions move its charge; ``recovers`` is the diode that carried the current
    before a hard step, ``shares`` whether it keeps half of its recovery loss. ``old_diode`` and ``new_diode`` carry
    the current in the dead time where a channel does not do so yet.
    """

    opens: str
    closes: str
    charging: tuple[str, ...]
    discharging: tuple[str, ...]
    recovers: str
    shares: bool = False
    old_diode: str | None = None
    new_diode: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Scheme:
    """A bridge under its modulation.

    ``forward`` conducts in the active state with the current along the bridge's voltage, ``reverse`` against it,
    ``zero`` in the zero state. At an edge of the first square wave ``legs`` legs make the transitions ``first``, at
    one of the second ``second``; each transition swings by ``step`` of the dc link.
    """

    devices: Mapping[str, Switch | Diode]
    forward: tuple[Carrier, ...]
    reverse: tuple[Carrier, ...]
    zero: tuple[Carrier, ...]
    first: tuple[Transition, ...]
    second: tuple[Transition, ...]
    legs: int
    step: float

    def switch(self, kind: str) -> Switch:
        """A device that opens and closes."""
        device = self.devices[kind]
        assert isinstance(device, Switch)
        return device


def _two_level(bridge: FullBridge, kind: str) -> Scheme:
    switch = bridge.switch
    swing = Transition(
        opens=kind, closes=kind, charging=(kind,), discharging=(kind,),
        recovers=kind, old_diode=kind, new_diode=kind,
    )  # fmt: skip
    return Scheme(
        devices={kind: switch},
        forward=(Carrier(kind=kind, law=switch.on),),
        reverse=(Carrier(kind=kind, law=switch.backward),),
        zero=(Carrier(kind=kind, law=switch.on, count=1), Carrier(kind=kind, law=switch.backward, count=1)),
        first=(swing,),
        second=(swing,),
        legs=1,
        step=1.0,
    )


_OUTER, _INNER, _CLAMP = "primary_outer", "primary_inner", "primary_clamp"
# Seen rising: from the middle to a rail, and from a rail to the middle.
_TO_RAIL = Transition(
    opens=_INNER, closes=_OUTER, charging=(_INNER, _CLAMP), discharging=(_OUTER,),
    recovers=_CLAMP, shares=True, new_diode=_OUTER,
)  # fmt: skip
_TO_MIDDLE = Transition(
    opens=_OUTER, closes=_INNER, charging=(_OUTER,), discharging=(_INNER, _CLAMP),
    recovers=_OUTER, old_diode=_OUTER,
)  # fmt: skip
# The second half of a swing from rail to rail: no clamp has carried current, the inner diode has.
_ON_TO_RAIL = Transition(
    opens=_INNER, closes=_OUTER, charging=(_INNER, _CLAMP), discharging=(_OUTER,),
    recovers=_INNER, old_diode=_INNER, new_diode=_OUTER,
)  # fmt: skip


def _three_level(bridge: NpcBridge, *, clamped: bool) -> Scheme:
    outer, inner, clamp = bridge.outer, bridge.inner, bridge.clamp
    along = (Carrier(kind=_OUTER, law=outer.on), Carrier(kind=_INNER, law=inner.on))
    against = (Carrier(kind=_OUTER, law=outer.backward), Carrier(kind=_INNER, law=inner.backward))
    at_middle = (Carrier(kind=_INNER, law=inner.on), Carrier(kind=_CLAMP, law=clamp.on))
    at_rail = tuple(Carrier(kind=c.kind, law=c.law, count=1) for c in (*along, *against))
    return Scheme(
        devices={_OUTER: outer, _INNER: inner, _CLAMP: clamp},
        forward=along,
        reverse=against,
        zero=at_middle if clamped else at_rail,
        first=(_TO_RAIL,) if clamped else (_TO_MIDDLE, _ON_TO_RAIL),
        second=(_TO_MIDDLE,) if clamped else (_TO_MIDDLE, _ON_TO_RAIL),
        legs=2 if clamped else 1,
        step=0.5,
    )


def primary_scheme(converter: Converter) -> Scheme:
    """The primary bridge under the converter's modulation."""
    if isinstance(converter.primary, NpcBridge):
        return _three_level(converter.primary, clamped=converter.modulation in CLAMPED)
    return _two_level(converter.primary, "primary")


def secondary_scheme(converter: Converter) -> Scheme:
    """The secondary bridge: two legs shifted against each other."""
    return _two_level(converter.secondary, "secondary")


def part_names(converter: Converter) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Loss parts of the primary and of the secondary bridge."""
    return _parts(primary_scheme(converter)), _parts(secondary_scheme(converter))


def switching_part(kind: str, device: Switch | Diode) -> str:
    """The loss part of what a kind of device loses at edges."""
    return f"{kind}_recovery" if isinstance(device, Diode) else f"{kind}_switching"


def _parts(scheme: Scheme) -> tuple[str, ...]:
    conduction = (f"{kind}_conduction" for kind in scheme.devices)
    return (*conduction, *(switching_part(kind, device) for kind, device in scheme.devices.items()))
