"""The process that is killed: it runs or resumes a campaign, and ends itself with SIGKILL where it is told to.

A place is a step of a row, and ``before`` its transaction, ``inside`` it (statements sent, commit not), or ``after``
the commit has returned.
"""

import os
import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import event

from bench.campaign import resume_campaign, run_campaign
from bench.config import BenchConfig, CampaignConfig
from bench.errors import BenchError
from bench.job import Job
from bench.states import State
from bench.store import Store
from drivers.clock import SharedStepClock
from drivers.errors import InstrumentError
from experiments.survey.campaign import predict

STEPS = ("set", "settled", "measured", "accepted")
WHERE = ("before", "inside", "after")
STOPPED = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where to die: at a step of the row at this position of the plan."""

    position: int
    step: str
    where: str

    def __str__(self) -> str:
        return f"row {self.position} {self.where} {self.step}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Orders:
    """What the child is to do."""

    url: str
    clock: Path
    campaign: dict[str, Any]
    bench: dict[str, Any]
    place: Place | None = None


def live(orders: Orders) -> None:
    """Run the campaign to its end, or die on the way."""
    clock = SharedStepClock(orders.clock)
    bench = BenchConfig.model_validate(orders.bench)
    with Store(orders.url) as store:
        if orders.place is not None:
            _arrange(store, orders.place)
        try:
            rows = store.campaigns()
            if rows and rows[0]["shown"] is State.DONE:
                return
            if rows:
                stored = Job.stored(store, rows[0], bench=bench, predict=predict)
                resume_campaign(rows[0]["id"], store, clock, job=stored)
            else:
                job = Job.prepare(CampaignConfig.model_validate(orders.campaign), bench, predict=predict)
                run_campaign(job, store, clock)
        except (BenchError, InstrumentError) as error:
            sys.stderr.write(f"the campaign stopped: {error}\n")
            os._exit(STOPPED)


def die() -> None:
    """At once: nothing is switched off, nothing is written."""
    os.kill(os.getpid(), signal.SIGKILL)


def _arrange(store: Store, place: Place) -> None:
    """Let the store's step at the place be the last thing that this process does."""
    real_advance, real_reading = store.advance, store.add_reading
    here = [False]

    def at(point_id: int, step: str) -> bool:
        row = store.point(point_id)
        return row is not None and row["position"] == place.position and step == place.step

    def around(act: Any, point_id: int, step: str, *arguments: Any, **named: Any) -> None:
        here[0] = at(point_id, step)
        if here[0] and place.where == "before":
            die()
        act(*arguments, **named)
        if here[0] and place.where == "after":
            die()

    def advance(campaign_id: int, point_id: int, state: Any, **named: Any) -> None:
        around(real_advance, point_id, str(state), campaign_id, point_id, state, **named)

    def add_reading(campaign_id: int, point_id: int, reading: Any) -> None:
        around(real_reading, point_id, "measured", campaign_id, point_id, reading)

    def on_commit(_connection: object) -> None:
        if here[0] and place.where == "inside":
            die()

    event.listen(store.database.engine, "commit", on_commit)
    store.advance, store.add_reading = advance, add_reading  # type: ignore[method-assign]
