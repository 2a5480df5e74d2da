"""Losses of the semiconductors, part by part, from a periodic orbit.

Conduction is an integral over the waveform and closes its energy balance together with copper
(:mod:`sim.magnetics`); what happens at the edges (turn-off, hard turn-on, missing charge, recovery, diodes in the dead
time) is added at its node. Every function takes arrays over N operating points and returns the same, in W.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.bridges import Scheme, Transition, primary_scheme, secondary_scheme, switching_part
from sim.circuit import Temperatures
from sim.commutation import Commutation
from sim.parameters import Converter, Quantity, Switch
from sim.pieces import Pieces
from sim.soft_switching import residual_energy
from sim.steady_state import Orbit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class PathIntegrals:
    """Means over a period of |i| (A) and i^2 (A^2) while a path conducts, each (N,)."""

    mean_A: Array
    square_A2: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class _Through:
    """What a bridge carries in each piece, (K, N): integrals of its current and of its square, its sign."""

    charge: Array
    square: Array
    sign: Array


def _path_integrals(
    pieces: Pieces, through: _Through, voltage_V: Array, link_V: Array
) -> tuple[PathIntegrals, PathIntegrals, PathIntegrals]:
    """The active state of a bridge with the current along its voltage (K, N), against it, and the zero state."""
    half_period, charge, square = pieces.half_period_s, through.charge, through.square
    # a share where the sign is a mean
    live, positive = np.abs(voltage_V) > 0.5 * link_V, 0.5 + 0.5 * through.sign
    along = np.where(live, np.where(voltage_V > 0, positive, 1.0 - positive), 0.0)
    against = np.where(live, 1.0 - along, 0.0)
    signed = np.where(voltage_V > 0, charge, -charge)

    def mean(charge: Array, square: Array) -> PathIntegrals:
        return PathIntegrals(
            mean_A=np.sum(charge, axis=0) / half_period, square_A2=np.sum(square, axis=0) / half_period
        )

    return (
        mean(along * signed, along * square),
        mean(-against * signed, against * square),
        mean(np.where(live, 0.0, through.sign * charge), np.where(live, 0.0, square)),
    )


def conduction_losses(converter: Converter, t: Temperatures, pieces: Pieces, V1_V: Array) -> dict[str, Array]:
    """Conduction of both bridges by kind of device."""
    n = converter.transformer.turns_ratio
    nV2_V = np.max(np.abs(pieces.nvs_V), axis=0)
    before = _Through(charge=pieces.charge(), square=pieces.square(), sign=pieces.sign)
    behind = replace(before, square=pieces.secondary_square())
    if pieces.secondary_sign is not None:
        left = pieces.charge() - pieces.magnetizing_charge()
        behind = replace(behind, charge=left, sign=pieces.secondary_sign)
    primary = _path_integrals(pieces, before, pieces.vp_V, V1_V)
    # the secondary's voltage drives the current the other way round
    secondary = _path_integrals(pieces, behind, -pieces.nvs_V, nV2_V)
    return _conduction(primary_scheme(converter), t, primary, 1.0) | _conduction(
        secondary_scheme(converter), t, secondary, n
    )


def _conduction(
    scheme: Scheme, t: Temperatures, integrals: tuple[PathIntegrals, ...], turns: float
) -> dict[str, Array]:
    """Conduction by kind of device: V0 mean|i| + r mean i^2 of the current times ``turns``."""
    lost = {f"{kind}_conduction": np.zeros_like(integrals[0].mean_A) for kind in scheme.devices}
    for path, through in zip((scheme.forward, scheme.reverse, scheme.zero), integrals, strict=True):
        for carrier in path:
            V0, R = carrier.law.at(t.junction_C[carrier.kind])
            heat = V0 * turns * through.mean_A + R * turns**2 * through.square_A2
            lost[f"{carrier.kind}_conduction"] = lost[f"{carrier.kind}_conduction"] + carrier.count * heat
    return lost


@dataclass(frozen=True, slots=True, kw_only=True)
class _Step:
    """One transition of a leg at its edge: what it is, what it missed, and the voltage it switches."""

    scheme: Scheme
    transition: Transition
    t: Temperatures
    commutation: Commutation
    missing: Array
    turn_on_A: Array
    step_V: Array

    def energies_J(self) -> dict[str, Quantity]:
        """Energy lost in each kind of device."""
        lost: dict[str, Quantity] = dict.fromkeys(self.scheme.devices, 0.0)
        step, c = self.transition, self.commutation
        lost[step.opens] = lost[step.opens] + self._off_J(self.scheme.switch(step.opens))
        recovered = self._recovered_J()
        kept = 0.5 * recovered if step.shares else 0.0
        lost[step.recovers] = lost[step.recovers] + kept
        lost[step.closes] = lost[step.closes] + self._on_J() + self._missing_J() + recovered - kept
        for diode, charge_C, current_A in (
            (step.new_diode, c.opposite_C, c.turn_off_A),
            (step.old_diode, c.same_C, self.turn_on_A),
        ):
            if diode is not None:
                lost[diode] = lost[diode] + self._diode_J(diode, charge_C, current_A)
        return lost

    def _off_J(self, switch: Switch) -> Quantity:
        junction_C = self.t.junction_C[self.transition.opens]
        return switch.turn_off.at(
            current_A=self.commutation.turn_off_A, voltage_V=self.step_V, junction_C=junction_C
        )

    def _on_J(self) -> Quantity:
        """Turn-on, without what it has to discharge or to recover."""
        kind = self.transition.closes
        law = self.scheme.switch(kind).turn_on
        return law.at(current_A=self.turn_on_A, voltage_V=self.step_V, junction_C=self.t.junction_C[kind])

    def _recovered_J(self) -> Quantity:
        """Recovery of the diode that carried the current before."""
        kind = self.transition.recovers
        law = self.scheme.devices[kind].recovery
        return law.at(current_A=self.turn_on_A, junction_C=self.t.junction_C[kind]) * self.step_V

    def _missing_J(self) -> Quantity:
        return _missing_J(self.scheme, self.transition, self.step_V, self.missing)

    def _diode_J(self, kind: str, charge_C: Array, current_A: Array) -> Array:
        """What a diode loses in the dead time beyond the path that the waveform counts."""
        switch, junction_C = self.scheme.switch(kind), self.t.junction_C[kind]
        diode_V, diode_R = switch.reverse.at(junction_C)
        path_V, path_R = switch.backward.at(junction_C)
        return np.asarray(charge_C * (diode_V - path_V + (diode_R - path_R) * current_A))


def _missing_J(scheme: Scheme, transition: Transition, step_V: Quantity, missing: Quantity) -> Quantity:
    """Hard switching of the rest of the swing."""
    charging = [scheme.devices[k].capacitance for k in transition.charging]
    discharging = [scheme.devices[k].capacitance for k in transition.discharging]
    return residual_energy(charging, discharging, step_V, missing)


def _missing_at(missing: Array, place: int, count: int) -> Array:
    """Share of its own swing that one transition of an edge with so many misses: the last one misses first."""
    return np.clip(count * missing - (count - 1 - place), 0.0, 1.0)


def _bridge_losses(
    scheme: Scheme, t: Temperatures, commutation: Commutation, link_V: Array
) -> dict[str, Array]:
    """Energy a half period in each kind of device of a bridge, in J, from its two edges (2, N)."""
    lost: dict[str, Array] = {kind: np.zeros_like(link_V) for kind in scheme.devices}
    for k, transitions in enumerate((scheme.first, scheme.second)):
        edge, count = commutation.edge(k), len(transitions)
        for place, transition in enumerate(transitions):
            missing = _missing_at(edge.missing, place, count)
            share = np.where(edge.missing > 0, missing / np.where(edge.missing > 0, edge.missing, 1.0), 1.0)
            step = _Step(
                scheme=scheme, transition=transition, t=t, commutation=edge, missing=missing,
                turn_on_A=edge.turn_on_A * share, step_V=scheme.step * link_V,
            )  # fmt: skip
            for kind, energy_J in step.energies_J().items():
                lost[kind] = lost[kind] + scheme.legs * energy_J
    return lost


def switching_losses(
    converter: Converter, t: Temperatures, orbit: Orbit, V1_V: Array, V2_V: Array
) -> dict[str, Array]:
    """Losses at the edges by kind of device; each edge comes twice a period."""
    rate = 2.0 * converter.frequency_Hz
    lost: dict[str, Array] = {}
    for scheme, first, link_V in (
        (primary_scheme(converter), 0, V1_V),
        (secondary_scheme(converter), 2, V2_V),
    ):
        energies = _bridge_losses(scheme, t, orbit.commutation.edge(slice(first, first + 2)), link_V)
        lost |= {switching_part(k, scheme.devices[k]): rate * energy for k, energy in energies.items()}
    return lost


def missing_losses(converter: Converter, missing: Array, V1_V: Array, V2_V: Array) -> Array:
    """What the charge alone costs in W where switches close on the rest of a swing, by edge, (4, N).

    ``missing`` (4, N) is the share of its swing that each edge misses, in the order of
    :data:`~sim.modulation.EDGES`; recovery and the energy of the turn-on itself come on top.

    >>> from sim.prototype import prototype
    >>> soft, cut_short, hard = np.zeros((4, 1)), np.full((4, 1), 0.5), np.ones((4, 1))
    >>> [missing_losses(prototype(), m, 300.0, 140.0)[2, 0].round(2).item() for m in (soft, cut_short, hard)]
    [0.0, 0.09, 0.44]
    """
    rate, lost = 2.0 * converter.frequency_Hz, []
    for scheme, first, link_V in (
        (primary_scheme(converter), 0, V1_V),
        (secondary_scheme(converter), 2, V2_V),
    ):
        for own, transitions in zip(missing[first : first + 2], (scheme.first, scheme.second), strict=True):
            energies_J = [
                _missing_J(scheme, step, scheme.step * link_V, _missing_at(own, place, len(transitions)))
                for place, step in enumerate(transitions)
            ]
            lost.append(rate * scheme.legs * np.asarray(sum(energies_J)))
    return np.stack(lost)
