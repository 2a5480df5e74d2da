"""A whole campaign of a virtual lab at once: settled points through the instruments' model, without the wire.

For trials by the hundred. What comes out is a measurement table as a campaign stores it, truth left out.
"""

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from drivers.mocks.lab.foreign.base import AcReading
from drivers.mocks.lab.instruments import read_element
from drivers.mocks.lab.laboratory import Electrical, Laboratory
from drivers.mocks.lab.waveforms import Heat

Array = NDArray[np.float64]

_PWM_COUNTS = 2500  # of a half period: what the controller can set and report
_TEMPERATURE_NOISE_K = 0.1
SUPPLY_V = 300.0
POINT_S = 180.0  # from one point to the next
_IDLE = (0.8, 0.0)  # D1, D2 of a converter that runs without load


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """Set points in the order of a campaign, arrays (N,); ``kind`` as in the measurement table.

    ``supply_V`` is what the dc supply is set to, for all rows or for each.
    """

    D1: Array
    D2: Array
    power_W: Array
    kind: NDArray[np.str_]
    time_s: Array
    supply_V: float | Array = SUPPLY_V

    def followed_by(self, later: Self, pause_s: float = 3600.0) -> Self:
        """This schedule and, after a pause, another one."""
        start_s = self.time_s[-1] + pause_s
        return replace(
            self,
            D1=np.concatenate([self.D1, later.D1]),
            D2=np.concatenate([self.D2, later.D2]),
            power_W=np.concatenate([self.power_W, later.power_W]),
            kind=np.concatenate([self.kind, later.kind]),
            time_s=np.concatenate([self.time_s, start_s + later.time_s]),
        )


def schedule(
    D1: Array, D2: Array, power_W: Array, *, reference_every: int = 8, standby: int = 2, no_load: int = 2
) -> Schedule:
    """Standby and no load first, then the points with a reference (the first of them) every so many."""
    rows: list[tuple[float, float, float, str]] = [(1.0, 0.0, 0.0, "standby")] * standby
    rows += [(*_IDLE, 0.0, "no_load")] * no_load
    for k, point in enumerate(zip(D1, D2, power_W, strict=True)):
        if k % reference_every == 0:
            rows.append((float(D1[0]), float(D2[0]), float(power_W[0]), "reference"))
        rows.append((float(point[0]), float(point[1]), float(point[2]), "load"))
    a, b, p, kind = zip(*rows, strict=True)
    time_s = POINT_S * np.arange(len(rows), dtype=np.float64)
    return Schedule(D1=np.array(a), D2=np.array(b), power_W=np.array(p), kind=np.array(kind), time_s=time_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settled:
    """The steady states of a schedule's rows in one lab."""

    truth: Electrical
    heat: Heat


def settle(lab: Laboratory, plan: Schedule, near: Settled | None = None) -> Settled:
    """Where every row would end if it lasted; ``near`` is what a lab nearly like this one settled at."""
    D1, D2 = _applied(plan)
    start = None if near is None else (near.truth, near.heat)
    supply_V = np.full(D1.size, plan.supply_V)
    truth, heat = lab.settled(D1, D2, plan.power_W, supply_V, plan.time_s, start)
    return Settled(truth=truth, heat=heat)


def survey(
    lab: Laboratory, plan: Schedule, *, seed: int, samples: int = 8, settled: Settled | None = None
) -> pd.DataFrame:
    """The measurement table of a schedule: rows in their order, readings the mean of ``samples`` updates."""
    rng = np.random.default_rng(seed)
    on = plan.kind != "standby"
    D1, D2 = _applied(plan)
    settled = settled or settle(lab, plan)
    truth, heat = _in_order(lab, plan, settled)
    V1, P1 = lab.input_terminals(truth, heat.heatsink_C, plan.time_s)
    idle_V = np.full(D1.size, plan.supply_V + lab.errors.supply_V)
    V1 = np.where(on, V1, idle_V)
    P1 = np.where(on, P1, lab.leaked_W(idle_V, heat.heatsink_C, plan.time_s))
    shown = {e: _averaged(lab, e, _element(e, V1, P1, truth, on), rng, samples) for e in (1, 2)}
    shown |= {e: _averaged(lab, e, _ac_element(lab, e, truth, D1, D2), rng, samples) for e in (3, 4)}
    U1, I1, P1_shown = lab.port_1(*shown[1], plan.time_s)
    U2, I2, P2 = shown[2]

    def sensor(name: str, values: Array) -> Array:
        return values + lab.errors.temperature_K[name] + rng.normal(0.0, _TEMPERATURE_NOISE_K, values.size)

    def running(values: Array) -> Array:
        return np.where(on, values, np.nan)

    loaded = np.isin(plan.kind, ("load", "reference"))
    frame = pd.DataFrame(
        {
            "kind": plan.kind, "time_s": plan.time_s, "P_set_W": plan.power_W, "D1": D1, "D2": D2,
            "D0": running(np.round(truth.D0 * _PWM_COUNTS) / _PWM_COUNTS),
            "V1_V": U1, "I1_A": I1, "P1_W": P1_shown,
            "V2_V": U2, "I2_A": I2, "P2_W": P2,
            "efficiency": np.where(loaded, P2 / np.where(P1_shown > 0, P1_shown, np.nan), np.nan),
            "I_L_rms_A": running(shown[3][1]),
            "P_link1_W": running(shown[3][2]), "P_link2_W": running(shown[4][2]),
            "T_ambient_C": float(lab.ambient_C(0.0)),
            "T_heatsink_C": sensor("heatsink", heat.heatsink_C),
            "T_transformer_C": sensor("transformer", heat.transformer_C),
            "T_inductor_C": sensor("inductor", heat.inductor_C),
        }
    )  # fmt: skip
    # what runs while it is cold and not when it has settled has stopped before its row is read
    shown_rows = np.flatnonzero((truth.running & settled.truth.running) | ~on)
    return frame.iloc[shown_rows].reset_index(drop=True)


def _element(
    element: int, V1: Array, P1: Array, truth: Electrical, on: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Truth at one dc element: voltage, current, power."""
    if element == 1:
        return V1, P1 / V1, P1
    V2 = np.where(on, truth.V2_V, 0.0)
    power = np.where(on, truth.P2_W, 0.0)
    return V2, power / np.where(on, truth.V2_V, 1.0), power


def _ac_element(
    lab: Laboratory, element: int, truth: Electrical, D1: Array, D2: Array
) -> tuple[Array, Array, Array]:
    """Truth at an element of the ac link, with what is wrong with its probes: rms voltage, current, power."""
    n = lab.converter.transformer.turns_ratio
    watts = truth.P_link1_W if element == 3 else truth.P_link2_W
    volts = truth.link_V * np.sqrt(D1) if element == 3 else truth.V2_V * np.sqrt(1 - D2)
    amps = truth.rms_A if element == 3 else n * truth.rms_A
    return volts, amps, lab.ac_watts(AcReading(element=element, watts=watts, volts=volts, amps=amps))


def _applied(plan: Schedule) -> tuple[Array, Array]:
    """D1 and D2 in whole counts; what a converter in standby would do does not matter."""
    on = plan.kind != "standby"
    D1, D2 = np.where(on, plan.D1, _IDLE[0]), np.where(on, plan.D2, _IDLE[1])
    return np.round(D1 * _PWM_COUNTS) / _PWM_COUNTS, np.round(D2 * _PWM_COUNTS) / _PWM_COUNTS


def _in_order(lab: Laboratory, plan: Schedule, settled: Settled) -> tuple[Electrical, Heat]:
    """The rows as they follow each other: what is warm is still warm from the row before.

    A row is measured when its time is over, settled or nearly so, as on a bench.
    """
    D1, D2 = _applied(plan)
    truth, end = settled.truth, settled.heat
    ambient = lab.ambient_C(plan.time_s) + 0.0 * plan.power_W
    off = (plan.kind == "standby") | ~truth.running  # what cannot run is switched off at once
    end = Heat(**{f.name: np.where(off, ambient, getattr(end, f.name)) for f in fields(Heat)})
    heat = lab.lagging(end, truth.losses, ambient, POINT_S)
    demand = lab.demand(D1, D2, plan.power_W, np.full(D1.size, plan.supply_V))
    return lab.run(demand, plan.power_W, heat, truth), heat


def _averaged(
    lab: Laboratory, element: int, triple: tuple[Array, Array, Array], rng: np.random.Generator, samples: int
) -> tuple[Array, Array, Array]:
    readings = [read_element(lab.errors, element, triple, rng) for _ in range(samples)]
    volts, amps, watts = (np.mean([reading[k] for reading in readings], axis=0) for k in range(3))
    return volts, amps, watts


def noise_free_efficiency(
    lab: Laboratory, D1: Array, D2: Array, power_W: Array, *, supply_V: float = SUPPLY_V, time_s: float = 0.0
) -> Array:
    """What the lab's analyzer would show without noise at settled points, (N,); NaN where it cannot run.

    All points are seen at one time of the campaign, ``time_s``.
    """
    now_s = np.full_like(power_W, time_s)
    truth, heat = lab.settled(D1, D2, power_W, np.full(D1.size, supply_V), now_s)
    V1, P1 = lab.input_terminals(truth, heat.heatsink_C, now_s)
    quiet = np.random.default_rng(0)
    silent = lab.without_noise()
    shown_1 = silent.port_1(*read_element(silent.errors, 1, (V1, P1 / V1, P1), quiet))
    shown_2 = read_element(silent.errors, 2, (truth.V2_V, power_W / truth.V2_V, power_W), quiet)
    return np.where(truth.running, shown_2[2] / shown_1[2], np.nan)
