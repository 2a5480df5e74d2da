"""Converters drawn at random: whether what is stated stands still, and what two other solvers make of it."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.harness.result import Cell, Table
from experiments.harness.settings import Settings
from experiments.peers.ngspice import NgspiceFailed, installed, run_ngspice
from experiments.peers.random_converters import random_converter, random_points
from experiments.simulator.points import Findings, at_most
from sim.fixed_point import operate
from sim.model import Model
from sim.netlist import netlist
from sim.operating_points import Points
from sim.parameters import Converter, NpcBridge
from sim.simulate import simulate
from sim.solved import solve_points
from sim.stepping import Stepper, settle

Array = NDArray[np.float64]

CONVERTERS, POINTS, CIRCUITS = 40, 20, 12
_SEED = 7
_BANDS = (0.003, 0.01, 0.02, 0.05)  # dead time over half a period
# what the last solution of a settled point may still ask for; power is relative
_STILL_K, _STILL = 0.05, 1e-4
_EFFICIENT = 0.93  # of what is given to ngspice: points that somebody would run


@dataclass(frozen=True, slots=True, kw_only=True)
class _Drawn:
    """A converter with those of its random points that run."""

    converter: Converter
    running: Points
    seen: int

    @classmethod
    def of(cls, number: int) -> "_Drawn":
        """The one of this number."""
        rng = np.random.default_rng((_SEED, number))
        converter = random_converter(rng)
        points = random_points(converter, POINTS, rng)
        feasible = simulate(Model(converter=converter), points).feasible
        return cls(converter=converter, running=points.take(np.flatnonzero(feasible)), seen=len(points))

    @property
    def model(self) -> Model:
        """The converter as a model without effects."""
        return Model(converter=self.converter)

    @property
    def dead_time(self) -> float:
        """Over half a period."""
        return float(self.converter.dead_time_s) / self.converter.half_period_s

    def moving(self) -> int:
        """Points whose losses ask for other temperatures or another power than they were solved with."""
        outcome = operate(self.converter, self.running)
        asked, now = outcome.station.ahead(outcome.state).by_name(), outcome.station.slow.by_name()
        off = {name: np.abs(asked[name] - now[name]) for name in now}
        off_W, _ = off.pop("target_W"), off.pop("I1_A")
        far = off_W > _STILL * np.abs(np.asarray(self.running.power_W))
        return int(np.count_nonzero(far | (np.max(list(off.values()), axis=0) > _STILL_K)))

    def stepped(self) -> tuple[Array, Array]:
        """By how much time stepping differs, in per cent of rms current and of rated power."""
        solved = solve_points(self.model, self.running)
        settled = settle(Stepper(circuit=solved.circuit), solved.edges)
        rms = np.abs(settled.rms_A / solved.result["I_L_rms_A"] - 1)
        off_W = settled.output_W(solved.circuit.turns_ratio) - solved.orbit.output_power_W()
        return 100 * rms, 100 * np.abs(off_W) / self.converter.rated_power_W

    def circuit_row(self) -> tuple[Cell, ...] | None:
        """Its first efficient point in ngspice; None where there is no such point or no netlist."""
        if isinstance(self.converter.primary, NpcBridge) and self.converter.modulation != "hybrid":
            return None
        result = simulate(self.model, self.running)
        efficient = np.flatnonzero(result["efficiency"] > _EFFICIENT)[:1]
        if not efficient.size:
            return None
        point, k = self.running.take(efficient), int(efficient[0])
        c = self.converter
        known: tuple[Cell, ...] = (
            c.modulation, 1e-3 * c.frequency_Hz, 100 * self.dead_time,
            float(c.transformer.magnetizing_H) / float(c.inductor.inductance_H),
            100 * float(np.ravel(point.power_W)[0]) / c.rated_power_W, 100 * float(result["efficiency"][k]),
        )  # fmt: skip
        try:
            measured = run_ngspice(netlist(self.model, point))
        except NgspiceFailed as error:
            return (*known, None, None, str(error))
        off_W = measured["p2_w"] - float(np.ravel(point.power_W)[0])
        return (*known, 100 * (measured["i_l_rms_a"] / result["I_L_rms_A"][k] - 1), 100 * off_W / c.rated_power_W,
                None)  # fmt: skip


def other_converters(settings: Settings) -> Findings:
    """Random points of random converters."""
    drawn = [_Drawn.of(number) for number in range(settings.thinned(CONVERTERS))]
    drawn = [d for d in drawn if len(d.running)]
    runs, seen = sum(len(d.running) for d in drawn), sum(d.seen for d in drawn)
    moving = sum(d.moving() for d in drawn)
    tables, notes = [_stepping_table(drawn)], [
        f"random converters: {runs} of {seen} points of {len(drawn)} converters run; the others cannot carry their "
        "power, get too hot or have no room for a pulse. Power is compared relative to rated power",
    ]  # fmt: skip
    if installed():
        tables.append(_circuit_table(drawn, settings.thinned(CIRCUITS)))
        notes.append(
            "random converters against ngspice: it has the diodes of the dead times, whose drop beyond that of the "
            "channels beside them is a loss here, not a voltage"
        )
    else:
        notes.append("random converters against ngspice: not run, there is no ngspice on the PATH")
    return Findings(
        goals=(
            at_most(f"random converters: those of {runs} stated points that do not stand still", moving, 0),
        ),
        tables=tuple(tables),
        notes=tuple(notes),
    )


def _stepping_table(drawn: list[_Drawn]) -> Table:
    found = [(d.dead_time, *d.stepped()) for d in drawn]
    rows: list[tuple[Cell, ...]] = []
    for low, high in itertools.pairwise(_BANDS):
        inside = [both for dead, *both in found if low <= dead < high]
        if inside:
            rms, power = (np.concatenate(part) for part in zip(*inside, strict=True))
            quantiles = (float(np.quantile(x, q)) for x in (rms, power) for q in (0.5, 0.9, 1.0))
            rows.append((f"{100 * low:g} to {100 * high:g}", len(inside), rms.size, *quantiles))
    columns = (
        "dead time, % of half a period", "converters", "points", "rms median, %", "90th", "worst",
        "power median, % of rated", "90th", "worst",
    )  # fmt: skip
    return Table(title="Random converters against time stepping", columns=columns, rows=tuple(rows))


def _circuit_table(drawn: list[_Drawn], count: int) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for d in drawn:
        if len(rows) < count and (row := d.circuit_row()) is not None:
            rows.append(row)
    columns = (
        "modulation", "kHz", "dead time, % of half a period", "magnetizing over link inductance", "power, % of rated",
        "efficiency, %", "rms, %", "power off, % of rated", "failure",
    )  # fmt: skip
    return Table(title="Random converters against ngspice", columns=columns, rows=tuple(rows))
