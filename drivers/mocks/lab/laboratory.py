"""One virtual lab: a drawn converter with what is hidden in it, its heat, and its instruments.

Everything here is vectorised over operating points; :class:`drivers.mocks.plant.Plant` runs it one point at a
time along the clock, trial generators run a whole campaign at once.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.mocks.lab.choke import Choke
from drivers.mocks.lab.foreign.base import AcReading, Added, ForeignEffect, Moment
from drivers.mocks.lab.foreign.families import FOREIGN
from drivers.mocks.lab.hidden import Quirks, drawn_values, everyday_quirks, hide
from drivers.mocks.lab.instruments import InstrumentErrors, draw_instruments, perfect_instruments
from drivers.mocks.lab.laws import Laws
from drivers.mocks.lab.legs import KINDS, primary_legs
from drivers.mocks.lab.losses import LabLosses, lab_losses
from drivers.mocks.lab.parts import draw_converter
from drivers.mocks.lab.waveforms import Demand, Heat, Link, lab_circuit
from sim.modulation import centre_offset, infeasible_pulse
from sim.parameters import Converter
from sim.prototype import prototype
from sim.regulation import Regulated
from sim.steady_state import Circuit

Array = NDArray[np.float64]

AMBIENT_C = 25.0
DRIFT_S = 6 * 3600.0  # a slow part of the lab warms with this time constant
_SETTLING_ROUNDS = 8
_STILL_K = 2e-3  # a sensor shows tenths


@dataclass(frozen=True, slots=True, kw_only=True)
class Electrical:
    """Truth inside the converter at N points; ``running`` is false where it cannot run.

    ``drawn_W`` is taken from the dc link at ``link_V``, before fan and slow drift.
    """

    running: NDArray[np.bool_]
    D0: Array
    link_V: Array
    drawn_W: Array
    V2_V: Array
    P2_W: Array
    P_link1_W: Array
    P_link2_W: Array
    rms_A: Array
    losses: LabLosses
    regulated: Regulated


@dataclass(frozen=True, slots=True, kw_only=True)
class Inertia:
    """Thermal time constants: of a bench whose rows settle, unless told otherwise."""

    heatsink_s: float = 40.0
    inductor_s: float = 60.0
    transformer_s: float = 80.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Laboratory:
    """What one seed drew; ``foreign`` are the effects in it that no catalogue has."""

    converter: Converter
    quirks: Quirks
    errors: InstrumentErrors
    hidden: dict[str, float]
    foreign: tuple[ForeignEffect, ...] = ()
    inertia: Inertia = Inertia()
    laws: Laws = field(default_factory=Laws)

    @classmethod
    def draw(
        cls,
        *,
        seed: int,
        hidden: Mapping[str, float | None] | None = None,
        converter: Converter | None = None,
    ) -> Self:
        """A lab from a seed; ``hidden`` maps effect names to values, ``None`` for one that the seed draws.

        ``converter`` is what its parts scatter around, the prototype by default. Some effects are of three-level
        primaries and cannot be hidden in another one.
        """
        parts, instruments, values, everyday, laws = (np.random.default_rng([seed, k]) for k in range(5))
        chosen = drawn_values(hidden or {}, values)
        known = {name: value for name, value in chosen.items() if name not in FOREIGN}
        converter, quirks = hide(draw_converter(parts, converter), known, everyday_quirks(everyday))
        return cls(
            converter=converter,
            quirks=quirks,
            errors=draw_instruments(instruments),
            hidden=chosen,
            foreign=tuple(FOREIGN[name](size=size) for name, size in chosen.items() if name in FOREIGN),
            laws=Laws.draw(laws),
        )

    def driven_by(self, modulation: str) -> Self:
        """This lab under another modulation; ParameterError where its primary does not have it."""
        return replace(self, converter=replace(self.converter, modulation=modulation))

    @classmethod
    def nominal(cls) -> Self:
        """Every part as its datasheet says, nothing hidden, nothing misread."""
        return cls(converter=prototype(), quirks=Quirks(), errors=perfect_instruments(), hidden={})

    def without_noise(self) -> Self:
        """This lab with instruments that keep their fixed errors and lose their noise."""
        return replace(self, errors=replace(self.errors, noise=0.0))

    def port_1(
        self, volts: Array, amps: Array, watts: Array, time_s: Array | float = 0.0
    ) -> tuple[Array, Array, Array]:
        """What element 1 shows with all that is wrong with it beyond its specification."""
        quirks = self.quirks
        step = np.where(amps < quirks.low_range_A, 1 + quirks.low_range_step, 1.0)
        gain, offset_A = step * (1 + quirks.input_gain), quirks.input_offset_A
        for effect in self.foreign:
            gain = gain * (1 + np.asarray(effect.input_gain(time_s)))
        return volts, amps * gain + offset_A, watts * gain + offset_A * volts

    def ac_watts(self, reading: AcReading) -> Array:
        """What an ac element shows of a power, beyond its specified errors."""
        for effect in self.foreign:
            reading = replace(reading, watts=effect.ac_watts(reading))
        return reading.watts

    def ambient_C(self, time_s: Array | float) -> Array:
        """The room's temperature."""
        start_C = AMBIENT_C + self.quirks.warmer_K
        return np.asarray(start_C + self.quirks.ambient_K_per_h * np.asarray(time_s) / 3600)

    def cold(self, ambient_C: Array) -> Heat:
        """Everything at ambient."""
        return Heat(**{f.name: np.array(ambient_C, dtype=float) for f in fields(Heat)})

    def demand(self, D1: Array, D2: Array, power_W: Array, supply_V: Array) -> Demand:
        """What the converter gets for a set point: its own duty offset and sensing error included.

        A D1 of 1 has no edge that could be offset.
        """
        offset = np.where(D1 < 1.0, self.quirks.duty_offset, 0.0)
        V2 = self.converter.V2_V * (1 + self.errors.output_sense)
        return Demand(
            D1=np.clip(D1 + offset, 0.0, 1.0),
            D2=np.asarray(D2, dtype=float),
            power_W=power_W + self.converter.output_cable_Ohm * (power_W / V2) ** 2,
            V1_V=supply_V + self.errors.supply_V - self.converter.input_cable_Ohm * power_W / supply_V,
            V2_V=V2 + 0.0 * power_W,
        )

    def run(self, demand: Demand, power_W: Array, heat: Heat, warm: Electrical | None = None) -> Electrical:
        """Solve the circuit at given temperatures; the mean of what it visits where it does not stand still."""
        visited = [demand]
        for effect in self.foreign:
            visited = [place for point in visited for place in effect.excursions(point)]
        found = [self._run_at(place, power_W, heat, warm) for place in visited]
        return found[0] if len(found) == 1 else _mean_of(found)

    def _run_at(self, demand: Demand, power_W: Array, heat: Heat, warm: Electrical | None) -> Electrical:
        dead = np.full(demand.D1.shape, self.converter.dead_share)
        runs = infeasible_pulse(demand.D1, demand.D2, dead) == ""
        expected = demand.power_W * 1e-3 if warm is None else warm.losses.secondary_switching
        laws = replace(self.laws, choke=Choke(drop=max(self.quirks.choke_drop, 0.0)))
        link = Link(converter=self.converter, choke=laws.choke, adapt=self._adapted)
        circuit, regulated = link.solved(heat, demand, expected, None if warm is None else warm.regulated)
        own = lab_circuit(self.converter, heat, demand)  # the drops of the converter's own parts
        losses = lab_losses(self.converter, heat, own, regulated.orbit, laws)
        moment = Moment(
            converter=self.converter, heat=heat, demand=demand, circuit=circuit, orbit=regulated.orbit
        )
        input_W = np.zeros(1)
        for effect in self.foreign:
            added = effect.added(moment)
            losses, input_W = _with(losses, added), input_W + added.input
        link2 = demand.power_W + losses.secondary_conduction + losses.secondary_switching
        link1 = link2 + losses.link
        return Electrical(
            running=runs & regulated.reached,
            D0=regulated.phase - centre_offset(demand.D1, demand.D2),
            link_V=demand.V1_V,
            drawn_W=link1 + losses.primary + self.converter.auxiliary_power_W + input_W,
            V2_V=demand.V2_V - self.converter.output_cable_Ohm * power_W / demand.V2_V,
            P2_W=power_W,
            P_link1_W=link1,
            P_link2_W=link2,
            rms_A=losses.rms_A,
            losses=losses,
            regulated=regulated,
        )

    def _adapted(self, circuit: Circuit, demand: Demand, heat: Heat) -> Circuit:
        for effect in self.foreign:
            circuit = effect.circuit(circuit, demand, heat)
        return circuit

    def input_terminals(
        self, now: Electrical, heatsink_C: Array, time_s: Array | float
    ) -> tuple[Array, Array]:
        """V1 in V and P1 in W at the analyzer's terminals: fan, slow drift and input cable included."""
        fan = np.where(heatsink_C > self.quirks.fan_on_C, self.quirks.fan_W, 0.0)
        drift = self.quirks.drift_share * -np.expm1(-np.asarray(time_s) / DRIFT_S)
        drawn = now.drawn_W + fan + drift * (now.drawn_W + fan - now.P2_W)
        drawn = drawn + self.leaked_W(now.link_V, heatsink_C, time_s)
        V1 = now.link_V + self.converter.input_cable_Ohm * drawn / now.link_V
        return V1, drawn * V1 / now.link_V

    def leaked_W(self, V1_V: Array, heatsink_C: Array, time_s: Array | float) -> Array:
        """Power drawn beside the converter, also while its gates are off."""
        total = np.zeros_like(V1_V)
        for effect in self.foreign:
            total = total + effect.drawn_W(V1_V, heatsink_C, time_s)
        return np.asarray(total)

    def final_heat(self, losses: LabLosses, ambient_C: Array) -> Heat:
        """Temperatures that these losses would settle at."""
        c, kinds = self.converter, losses.by_kind
        heatsink = ambient_C + c.heatsink_K_per_W * sum(kinds.values(), np.zeros(1))
        return self._with_junctions(
            losses,
            heatsink,
            ambient_C + c.inductor.thermal_K_per_W * losses.inductor,
            ambient_C + c.transformer.thermal_K_per_W * losses.transformer,
        )

    def _with_junctions(
        self, losses: LabLosses, heatsink_C: Array, inductor_C: Array, transformer_C: Array
    ) -> Heat:
        rise = dict.fromkeys(KINDS, 0.0) | primary_legs(self.converter).thermal_K_per_W()
        rise["secondary"] = float(self.converter.secondary.switch.thermal_K_per_W)
        junctions = {f"{k}_C": np.minimum(heatsink_C + rise[k] * losses.by_kind[k] / 4, 200.0) for k in rise}
        return Heat(
            heatsink_C=np.minimum(heatsink_C, 180.0),
            inductor_C=np.minimum(inductor_C, 180.0),
            transformer_C=np.minimum(transformer_C, 180.0),
            **junctions,
        )

    def warmed(self, heat: Heat, losses: LabLosses, ambient_C: Array, elapsed_s: float) -> Heat:
        """Temperatures after a time at constant losses: first-order lags, junctions at once."""
        end = self.final_heat(losses, ambient_C)

        def lag(now: Array, final: Array, time_constant_s: float) -> Array:
            return np.asarray(final + (now - final) * np.exp(-elapsed_s / time_constant_s))

        return self._with_junctions(
            losses,
            lag(heat.heatsink_C, end.heatsink_C, self.inertia.heatsink_s),
            lag(heat.inductor_C, end.inductor_C, self.inertia.inductor_s),
            lag(heat.transformer_C, end.transformer_C, self.inertia.transformer_s),
        )

    def cooled(self, heat: Heat, ambient_C: Array, elapsed_s: float) -> Heat:
        """Temperatures after a time without losses."""

        def lag(now: Array, time_constant_s: float) -> Array:
            return np.asarray(ambient_C + (now - ambient_C) * np.exp(-elapsed_s / time_constant_s))

        heatsink = lag(heat.heatsink_C, self.inertia.heatsink_s)
        return Heat(
            heatsink_C=heatsink,
            inductor_C=lag(heat.inductor_C, self.inertia.inductor_s),
            transformer_C=lag(heat.transformer_C, self.inertia.transformer_s),
            **{f"{kind}_C": heatsink for kind in ("outer", "inner", "clamp", "secondary")},
        )

    def settled(
        self,
        D1: Array,
        D2: Array,
        power_W: Array,
        supply_V: Array,
        time_s: Array,
        near: tuple[Electrical, Heat] | None = None,
    ) -> tuple[Electrical, Heat]:
        """The steady state of N set points; ``near`` is that of a lab which is nearly this one."""
        demand, ambient = self.demand(D1, D2, power_W, supply_V), self.ambient_C(time_s) + 0.0 * power_W
        heat, now, before = self.cold(ambient), None, None
        if near is not None:
            now, heat = near
        for _ in range(_SETTLING_ROUNDS):
            now = self.run(demand, power_W, heat, now)
            asked = self.final_heat(now.losses, ambient)
            if np.all((heat.furthest_K(asked) < _STILL_K) | ~now.running):
                break
            heat, before = heat.onward(asked, before), (heat, asked)
        assert now is not None
        return now, asked

    def lagging(self, end: Heat, losses: LabLosses, ambient_C: Array, interval_s: float) -> Heat:
        """Temperatures of rows in their order, each ``interval_s`` after the one before, which it started from.

        ``end`` is where each row would settle; the first one starts from ambient.
        """
        from scipy.signal import lfilter  # here: it loads slowly, and only trials ask for it

        def lag(final_C: Array, time_constant_s: float) -> Array:
            keep = np.exp(-interval_s / time_constant_s)
            start = [keep * ambient_C[0]]
            return np.asarray(lfilter([1 - keep], [1.0, -keep], final_C, zi=start)[0])

        return self._with_junctions(
            losses,
            lag(end.heatsink_C, self.inertia.heatsink_s),
            lag(end.inductor_C, self.inertia.inductor_s),
            lag(end.transformer_C, self.inertia.transformer_s),
        )


def _with(losses: LabLosses, added: Added) -> LabLosses:
    """The losses with what an effect adds; what the heatsink has to carry is put to the devices nearest."""
    kinds = losses.by_kind | {
        "outer": losses.by_kind["outer"] + added.primary,
        "secondary": losses.by_kind["secondary"] + added.secondary,
    }
    return replace(
        losses,
        primary=losses.primary + added.primary,
        link=losses.link + added.link + added.transformer,
        transformer=losses.transformer + added.transformer,
        secondary_switching=losses.secondary_switching + added.secondary + added.output,
        by_kind=kinds,
    )


def _mean_of(found: Sequence[Electrical]) -> Electrical:
    """The mean of states that are visited equally often; the first one is where the next search starts."""
    first, losses = found[0], [each.losses for each in found]

    def mean(values: Iterable[Array]) -> Array:
        return np.asarray(np.mean(list(values), axis=0))

    rms = np.sqrt(mean(each.rms_A**2 for each in found))
    return replace(
        first,
        running=np.all([each.running for each in found], axis=0),
        D0=mean(each.D0 for each in found),
        link_V=mean(each.link_V for each in found),
        drawn_W=mean(each.drawn_W for each in found),
        P_link1_W=mean(each.P_link1_W for each in found),
        P_link2_W=mean(each.P_link2_W for each in found),
        rms_A=rms,
        losses=LabLosses(
            primary=mean(each.primary for each in losses),
            link=mean(each.link for each in losses),
            secondary_conduction=mean(each.secondary_conduction for each in losses),
            secondary_switching=mean(each.secondary_switching for each in losses),
            by_kind={kind: mean(each.by_kind[kind] for each in losses) for kind in first.losses.by_kind},
            inductor=mean(each.inductor for each in losses),
            transformer=mean(each.transformer for each in losses),
            rms_A=rms,
        ),
    )
