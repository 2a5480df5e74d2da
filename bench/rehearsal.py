"""A campaign on the mock bench before it meets the real one, with whatever goes wrong in a file of faults.

The limits, the converter's settings and the campaign are those of the real run; instruments, clock and database are
not: nothing of a rehearsal is kept beside what was measured.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from bench.campaign import run_campaign
from bench.config import BenchConfig, CampaignConfig, check
from bench.errors import BenchError
from bench.job import CampaignOutcome, Job
from bench.prediction import model_of
from bench.progress import Progress, silent
from bench.store import Store
from bench.store.failures import Failures
from bench.toml_file import read_toml
from drivers.clock import StepClock
from drivers.errors import InstrumentError
from drivers.mocks.faults import DATABASE, FaultFile, Struck
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.plant import Plant
from drivers.mocks.rack import Rack
from sim.parameters import Converter

AGAIN_S = 8.0  # real time that a mock instrument may be gone
# With what faults may silence: a sound mock on a busy machine takes longer than half a second. Late ones say how late.
PATIENCE = {"timeout_s": 2.0, "lateness_s": 0.5}


@dataclass(frozen=True, slots=True, kw_only=True)
class Rehearsal:
    """How a rehearsal went: its outcome, or why it stopped; rows by state; and the faults that struck."""

    outcome: CampaignOutcome | None
    error: BenchError | InstrumentError | None
    accepted: int
    rejected: int
    planned: int
    power_off: str
    struck: tuple[Struck, ...]


def read_faults(path: Path) -> FaultFile:
    """A file of faults; InputError names line, field, and what is allowed."""
    return check(read_toml(path), FaultFile, file=str(path), text=path.read_text(encoding="utf-8"))


def rehearse(
    campaign: CampaignConfig,
    bench: BenchConfig,
    faults: FaultFile,
    *,
    seed: int = 1,
    progress: Callable[[Progress], None] = silent,
    bench_file: str = "",
) -> Rehearsal:
    """Run ``campaign`` on mock instruments under the limits of ``bench``, at its voltages, with parts of its model.

    ``bench_file`` is where an error says that the bench stands.
    """
    clock = StepClock()
    plant = Plant(Laboratory.draw(seed=seed, converter=_converter(bench)), clock=clock, seed=seed)
    with tempfile.TemporaryDirectory(prefix="d2ea-rehearsal-") as folder, Rack(plant, faults=faults) as rack:
        virtual = rehearsed(bench, rack, faults)
        with Store(f"sqlite:///{folder}/rehearsal.sqlite") as store:
            failures = Failures(store.database)
            for fault in faults.at(DATABASE):
                failures.after(fault.after, fault.kind, fault.seconds)
            outcome, error = None, None
            try:
                job = Job.prepare(campaign, virtual, file=campaign.name, bench_file=bench_file)
                outcome = run_campaign(job, store, clock, progress=progress)
            except (BenchError, InstrumentError) as stopped:
                error = stopped
            failures.heal()
            row = store.campaigns()[-1] if store.campaigns() else {}
            return Rehearsal(
                outcome=outcome,
                error=error,
                accepted=row.get("accepted", 0),
                rejected=row.get("rejected", 0),
                planned=row.get("planned", 0),
                power_off=str(row.get("power_off") or "not recorded"),
                struck=tuple(s for injector in rack.injectors.values() for s in injector.struck),
            )


def _converter(bench: BenchConfig) -> Converter:
    """What the mock bench's parts scatter around."""
    own = bench.converter
    return replace(model_of(own).converter, V1_V=own.input_voltage_V, V2_V=own.output_voltage_V)


def rehearsed(bench: BenchConfig, rack: Rack, faults: FaultFile) -> BenchConfig:
    """The mock bench with the real one's limits, converter and heartbeat."""
    settings = rack.bench_config()
    ports: dict[str, dict[str, object]] = {
        name: dict(settings[name], **(PATIENCE if faults.at(name) else {}))  # type: ignore[call-overload]
        for name in ("analyzer", "supply", "load", "controller")
    }
    ports["controller"]["heartbeat_s"] = bench.controller.heartbeat_s
    ports["analyzer"]["update_s"] = bench.analyzer.update_s
    limits = bench.limits.model_dump() | {"again_s": AGAIN_S, "recover_s": AGAIN_S}
    own = {"limits": limits, "converter": bench.converter.model_dump(exclude_none=True)}
    name = {"name": f"rehearsal of {bench.name}", "virtual": True}
    return check({**name, **ports, **own}, BenchConfig, file="rehearsal")
