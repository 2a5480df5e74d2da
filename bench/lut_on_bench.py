"""A table of D1 and D2 on the bench: into the controller, read back, and measured over load.

To verify a table is to let the controller follow it. A campaign draws every load of the table and one between
each two, and the controller chooses D1 and D2 by itself; what it chose is compared with the table, and what the
analyzer shows with what was predicted.
"""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from bench.campaign import Surroundings
from bench.config import BenchConfig, CampaignConfig, check
from bench.connect import Inspection, Instruments, open_controller, open_instruments
from bench.instruments import Bench
from bench.job import Job
from bench.lock import ports_of_bench
from bench.plan import PlannedPoint
from bench.prediction import SimulatedConverter, modulation_of
from bench.spy import log_of
from drivers.clock import Clock
from drivers.controller import Applied, TableRow
from drivers.identity import Identity
from models.feasibility import edge_gap_of
from models.lut import makeable

OWN_METER = 0.02  # how far the controller's own power may be from the analyzer's, relative
ONE_COUNT = 1e-3  # half periods: a step of a coarse PWM timer


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """Who holds a table, and the rows as the controller keeps them, in whole PWM counts."""

    identity: Identity
    rows: tuple[TableRow, ...]


def table_rows(table: pd.DataFrame) -> tuple[TableRow, ...]:
    """A table (columns P_W, D1, D2) as the controller's driver takes it."""
    rows = table[["P_W", "D1", "D2"]].astype(float).itertuples(index=False)
    return tuple(TableRow(power_W=P_W, D1=D1, D2=D2) for P_W, D1, D2 in rows)


def load_into_controller(config: BenchConfig, table: pd.DataFrame) -> Held:
    """Load a table and read it back; it is not yet in use. No other instrument is touched.

    Raises InstrumentError: refused, not reached, or not the same when it is read back; BenchTaken while somebody has
    the bench.
    """
    with ports_of_bench(config), closing(open_controller(config, log_of("controller"))) as controller:
        return Held(identity=controller.identify(), rows=controller.load_table(table_rows(table)))


class TableBench(Bench):
    """A bench whose controller chooses D1 and D2 itself, from a table."""

    def __init__(
        self,
        config: BenchConfig,
        instruments: Instruments,
        clock: Clock,
        inspection: Inspection,
        rows: tuple[TableRow, ...],
    ) -> None:
        super().__init__(config, instruments, clock, inspection)
        self._rows = rows
        self._modulation = modulation_of(config.converter)

    def configure(self) -> None:
        """As any bench, and the table loaded and read back."""
        super().configure()
        self._of.controller.load_table(self._rows)

    def _modulate(self, row: PlannedPoint) -> Applied:
        """Let the controller follow its table at the power that is drawn; what it then applies."""
        self._of.controller.use_table()
        told = self.beat()
        return Applied(D1=told.D1, D2=told.D2, mode=self._modulation)


def following(rows: tuple[TableRow, ...]) -> Surroundings:
    """The same bench as always, with a controller that follows ``rows``."""

    @contextmanager
    def open_(config: BenchConfig, clock: Clock) -> Iterator[Bench]:
        with open_instruments(config, clock) as (instruments, inspection):
            yield TableBench(config, instruments, clock, inspection, rows)

    return Surroundings(connect=open_)


def verification(table: pd.DataFrame, config: BenchConfig, *, name: str, bench_file: str = "") -> Job:
    """The campaign that measures a table on the bench of ``bench_file``: every load and one between each two."""
    simulated = SimulatedConverter.of(config.converter)
    loads_W = [float(power_W) for power_W in table["P_W"]]
    loads_W = sorted([*loads_W, *((low + high) / 2 for low, high in pairwise(loads_W))])
    D1, D2 = at_loads(table, np.asarray(loads_W), edge_gap_of(simulated.model))
    points = [
        {"D1": a, "D2": b, "power_W": P} for a, b, P in zip(D1.tolist(), D2.tolist(), loads_W, strict=True)
    ]
    plan = {
        "kind": "points",
        "set_points": points,
        "order": "given",
        "standby": 0,
        "no_load": 0,
        "heat_margin": 0.0,
        "power_margin": 0.0,
    }
    campaign = check({"name": name, "plan": plan}, CampaignConfig, file=name)
    return Job.prepare(campaign, config, predict=simulated, file=name, bench_file=bench_file)


Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def at_loads(table: pd.DataFrame, power_W: Array, edge_gap: float) -> tuple[Array, Array]:
    """D1 and D2 (N,) that a table stands for at output powers (N,)."""
    known = table["P_W"].to_numpy(dtype=np.float64)
    D1, D2 = (np.interp(power_W, known, table[name].to_numpy(dtype=np.float64)) for name in ("D1", "D2"))
    return makeable(D1, D2, edge_gap)


def verified(table: pd.DataFrame, measured: pd.DataFrame, edge_gap: float) -> pd.DataFrame:
    """The table beside what was measured, one row per accepted reading.

    ``followed`` tells whether the controller applied the table's D1 and D2, ``inside`` whether the measured
    efficiency lies in the predicted interval, widened by the reading's own 95 % (NaN where nothing is predicted).
    """
    rows = measured[measured["kind"] == "load"].reset_index(drop=True)
    P2_W = rows["P2_W"].to_numpy(dtype=np.float64)
    out = pd.DataFrame({"P_W": rows["P_set_W"], "P2_W": P2_W, "D1": rows["D1"], "D2": rows["D2"]})
    off = np.zeros(len(rows))
    near = [at_loads(table, P2_W * share, edge_gap) for share in (1 - OWN_METER, 1.0, 1 + OWN_METER)]
    for k, name in enumerate(("D1", "D2")):
        spread = np.stack([point[k] for point in near])
        applied = rows[name].to_numpy(dtype=np.float64)
        off = np.maximum(off, np.maximum(spread.min(axis=0) - applied, applied - spread.max(axis=0)))
    out["followed"] = off <= ONE_COUNT
    out["measured"], out["u_efficiency"] = rows["efficiency"], rows["u_efficiency"]
    if "predicted" in table:
        P_W = table["P_W"].to_numpy(dtype=np.float64)
        for name in ("predicted", "predicted_low", "predicted_high"):
            known = table[name].to_numpy(dtype=np.float64) if name in table else np.full(len(P_W), np.nan)
            out[name] = np.interp(P2_W, P_W, known)
        reach = 1.96 * out["u_efficiency"]
        inside = out["measured"].between(out["predicted_low"] - reach, out["predicted_high"] + reach)
        out["inside"] = inside.astype(float).where(out["predicted_low"].notna())
    return out
