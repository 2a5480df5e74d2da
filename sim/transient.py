r"""The closed loop in time: a step of the load, with PI on D0 and D1 and D2 from a table.

Once a switching period the controller samples the output voltage and the load power. The PI sets the phase between
the pulses' centres; D1 and D2 follow the filtered load power by the table, and D0 is the phase less their centre
offset, so that a change of D1 and D2 by itself does not move the phase (Assumption: the paper says that D0 is the
PI's output and that D1 and D2 are adjusted in real time, not how the two act on each other). What the controller
decides acts from the next period on. The converter is stepped through time (:mod:`sim.stepping`) at the temperatures of
the first load, which do not move within milliseconds.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim.model import Model
from sim.modulation import centre_offset, hybrid_edges
from sim.operating_points import Points
from sim.parameters import ParameterError
from sim.solved import Solved, solve_points
from sim.steady_state import periodic
from sim.stepping import Output, State, Stepper, Steps, Trace, settle
from sim.voltage_loop import LoopPlant, VoltageLoop

Array = NDArray[np.float64]

_WINDOWS = 4  # of a half period: short enough that no leg flips twice in one
_PHASE_STEP = 2e-3
_STEPS = Steps(in_dead_time=40, in_half_period=100)
_SECONDARY = np.array([0.0, 0.0, 1.0, 1.0])[:, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class DutyTable:
    """D1 and D2 over load power in W (rising), linear between the rows, arrays (K,)."""

    power_W: Array
    D1: Array
    D2: Array

    def __post_init__(self) -> None:
        if self.power_W.size == 0 or np.any(np.diff(self.power_W) <= 0):
            raise ParameterError(f"DutyTable.power_W is {self.power_W}; allowed: at least one, rising")
        for name in ("D1", "D2"):
            d = getattr(self, name)
            if d.shape != self.power_W.shape or not np.all((d >= 0) & (d <= 1)):
                raise ParameterError(f"DutyTable.{name} is {d}; allowed: one from 0 to 1 for each power")

    def at(self, power_W: float) -> tuple[Array, Array]:
        """D1 and D2, each (1,); the end rows hold beyond them."""
        return tuple(np.atleast_1d(np.interp(power_W, self.power_W, d)) for d in (self.D1, self.D2))  # type: ignore[return-value]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadStep:
    """From one load to another in W, at ``at_s``; the whole lasts ``duration_s``."""

    from_W: float
    to_W: float
    at_s: float = 0.25e-3
    duration_s: float = 2.5e-3

    def __post_init__(self) -> None:
        for name in ("from_W", "to_W"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ParameterError(f"LoadStep.{name} is {getattr(self, name)}; allowed: finite and > 0 W")
        if not 0 <= self.at_s < self.duration_s:
            raise ParameterError(
                f"LoadStep.at_s is {self.at_s}; allowed: 0 up to the duration, {self.duration_s} s"
            )

    def load_W(self, time_s: float) -> float:
        """The load at a time."""
        return self.from_W if time_s < self.at_s else self.to_W


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Waveforms (S, 1) of a load step, and what the controller had set in each period, arrays (M,)."""

    trace: Trace
    period_start_s: Array
    D0: Array
    D1: Array
    D2: Array
    step: LoadStep
    V2_V: float

    def settling_s(self, band: float = 0.01) -> float:
        """Time after the step from which on v2 stays within ``band`` of its set value; NaN if it never does."""
        outside = np.abs(self.trace.output_V[:, 0] / self.V2_V - 1.0) > band
        late = self.trace.time_s[:, 0][outside]
        if not late.size:
            return 0.0
        return float("nan") if outside[-1] else float(max(late[-1] - self.step.at_s, 0.0))

    @property
    def deviation(self) -> float:
        """Largest relative deviation of v2 after the step."""
        after = self.trace.time_s[:, 0] >= self.step.at_s
        return float(np.max(np.abs(self.trace.output_V[after] / self.V2_V - 1.0)))


@dataclass(slots=True, kw_only=True)
class _Controller:
    """PI with its integral held inside the range of the phase, and the filtered load."""

    loop: VoltageLoop
    table: DutyTable
    V2_V: float
    period_s: float
    integral: float
    load_W: float

    def decide(self, output_V: float, load_W: float) -> tuple[Array, Array, Array]:
        """D0, D1, D2 for the next period, each (1,)."""
        error_V = self.V2_V - output_V
        self.load_W += (load_W - self.load_W) * -np.expm1(-self.period_s / self.loop.load_filter_s)
        wanted = self.integral + self.loop.integral_per_V_s * self.period_s * error_V
        self.integral = float(np.clip(wanted, -0.5, 0.5))
        phase = float(np.clip(self.integral + self.loop.proportional_per_V * error_V, -0.5, 0.5))
        D1, D2 = self.table.at(self.load_W)
        return phase - centre_offset(D1, D2), D1, D2


@dataclass(slots=True)
class _Legs:
    """When the four legs flip next: flip number k of a leg comes at (k + edge) half periods."""

    edges: Array
    number: Array

    @classmethod
    def from_start(cls, edges: Array) -> "_Legs":
        return cls(edges=edges, number=np.ceil(-edges))

    def flips_s(self, start_s: float, end_s: float, half_period_s: float) -> Array:
        """Times (4, 1) of the flips in a window, inf for none; a flip that its edge overtook comes at once."""
        due_s = (self.number + self.edges) * half_period_s
        now = due_s < end_s
        self.number = self.number + now
        return np.where(now, np.maximum(due_s, start_s), np.inf)


@dataclass(slots=True, kw_only=True)
class _ClosedLoop:
    """The converter, its controller, and what is in force in the present period (D0, D1, D2, each (1,))."""

    solved: Solved
    loop: VoltageLoop
    step: LoadStep
    steps: Steps
    controller: _Controller
    legs: _Legs
    state: State
    command: tuple[Array, Array, Array]

    @classmethod
    def settled_at(
        cls, solved: Solved, loop: VoltageLoop, table: DutyTable, step: LoadStep, steps: Steps
    ) -> "_ClosedLoop":
        """The loop at rest, in the steady state of the first load."""
        circuit, half_period_s = solved.circuit, solved.converter.half_period_s
        D1, D2 = table.at(step.from_W)
        D0 = solved.edges[2] - _late(solved)
        controller = _Controller(
            loop=loop,
            table=table,
            V2_V=float(np.ravel(solved.points.V2_V)[0]),
            period_s=2 * half_period_s,
            integral=float((D0 + centre_offset(D1, D2))[0]),
            load_W=step.from_W,
        )
        state = settle(Stepper(circuit=circuit, steps=steps), solved.edges).state
        return cls(
            solved=solved, loop=loop, step=step, steps=steps, controller=controller,
            legs=_Legs.from_start(solved.edges), state=state, command=(D0, D1, D2),
        )  # fmt: skip

    def run_period(self, start_s: float) -> list[Trace]:
        """A switching period: sample and decide at its start, act on the decision at its end."""
        half_period_s = self.solved.converter.half_period_s
        following = self.controller.decide(float(self.state.output_V[0]), self.step.load_W(start_s))
        windows = pairwise(_window_edges_s(start_s, half_period_s, self.step.at_s))
        traces = [self._run_window(*window) for window in windows]
        self.command = following
        self.legs.edges = hybrid_edges(*following) + _SECONDARY * _late(self.solved)
        return traces

    def _run_window(self, start_s: float, end_s: float) -> Trace:
        output = Output(capacitance_F=self.loop.capacitance_F, load_W=self.step.load_W(start_s))
        stepper = Stepper(circuit=self.solved.circuit, output=output, steps=self.steps)
        flips_s = self.legs.flips_s(start_s, end_s, self.solved.converter.half_period_s)
        self.state, trace = stepper.run(self.state, np.array([end_s]), flips_s)
        return trace


def load_step(
    model: Model, loop: VoltageLoop, table: DutyTable, step: LoadStep, steps: Steps | None = None
) -> Response:
    """The response to a load step from the steady state of the first load.

    Raises
    ------
    ParameterError
        Where the table's D1 and D2 cannot carry one of the loads.
    """
    _solved_at(model, table, step.to_W)
    solved = _solved_at(model, table, step.from_W)
    closed = _ClosedLoop.settled_at(solved, loop, table, step, steps or _STEPS)
    period_s = 2 * solved.converter.half_period_s
    starts_s = np.arange(round(step.duration_s / period_s), dtype=float) * float(period_s)
    traces, commands = [], []
    for start_s in starts_s.tolist():
        commands.append(np.concatenate(closed.command))
        traces += closed.run_period(start_s)
    D0, D1, D2 = np.array(commands).T
    return Response(
        trace=_joined(traces), period_start_s=starts_s, D0=D0, D1=D1, D2=D2, step=step, V2_V=closed.controller.V2_V
    )  # fmt: skip


def loop_plant(model: Model, table: DutyTable, load_W: float) -> LoopPlant:
    """What the loop acts on at a load: the slope of the output current over phase, from two periodic orbits."""
    solved = _solved_at(model, table, load_W)

    def power_W(shift: float) -> float:
        edges = solved.edges + _SECONDARY * shift
        return float(periodic(solved.circuit, edges, np.zeros(1), np.zeros((4, 1))).output_power_W()[0])

    V2_V = float(np.ravel(solved.points.V2_V)[0])
    slope_A = (power_W(_PHASE_STEP) - power_W(-_PHASE_STEP)) / (2 * _PHASE_STEP) / V2_V
    return LoopPlant(slope_A=slope_A, load_W=load_W, V2_V=V2_V, period_s=2 * solved.converter.half_period_s)


def _solved_at(model: Model, table: DutyTable, power_W: float) -> Solved:
    D1, D2 = table.at(power_W)
    return solve_points(model, Points(D1=D1, D2=D2, power_W=power_W))


def _late(solved: Solved) -> Array:
    """The secondary's gate delay in half periods, (1,)."""
    return np.atleast_1d(solved.converter.secondary_delay_s / solved.converter.half_period_s)


def _window_edges_s(start_s: float, half_period_s: float, step_s: float) -> list[float]:
    """Ends of the windows of a switching period; the load steps at one of them."""
    even = [start_s + k * half_period_s / _WINDOWS for k in range(2 * _WINDOWS + 1)]
    return sorted({*even, step_s}) if even[0] < step_s < even[-1] else even


def _joined(traces: list[Trace]) -> Trace:
    names = ("time_s", "vp_V", "vs_V", "current_A", "magnetizing_A", "output_V")
    return Trace(**{name: np.concatenate([getattr(t, name) for t in traces]) for name in names})
