"""A part of the blind trials: one row of the table, run alone or with the others."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from typing import Any

from bench.processes import lasting_pool
from drivers.mocks.lab.survey import Schedule
from experiments.blind.draws import Draw
from experiments.blind.reach import Reach, handed_over, worked_out
from experiments.blind.scoring import Scored
from experiments.blind.seeds import Seeds
from experiments.blind.trial import BlindTrial, ask
from experiments.harness.journal import Journal
from experiments.harness.result import Goal, Table
from experiments.harness.settings import Settings
from experiments.harness.trials import perform

Record = dict[str, Any]
_LABS_AT_ONCE = 8  # that a process is asked for: what they start from is sent as often
_MOST_TRIES = 4  # times what is wanted: an effect that cannot be seen does not stop the rest


def own_design(trial: BlindTrial) -> tuple[Schedule, ...]:
    """The design of a trial whose isolability is asked of the truth."""
    return () if trial.design is None else (trial.plan,)


Work = Callable[[BlindTrial], Record]
SeenFrom = Callable[[BlindTrial], tuple[Schedule, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Task:
    """A trial with its work, the schedules that its truth is asked at, and their reach where that is worked out."""

    trial: BlindTrial
    work: Work
    plans: tuple[Schedule, ...]
    known: tuple[Reach | None, ...] = ()

    @property
    def key(self) -> str:
        """The trial's."""
        return self.trial.key


def _carried_out(task: _Task) -> Record:
    for plan, known in zip(task.plans, task.known, strict=False):
        if known is not None:
            handed_over(plan, known)
    return task.work(task.trial)


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """How the parts are run: settings, whose seeds, and the journal of finished trials."""

    settings: Settings
    seeds: Seeds
    journal: Journal

    def records(
        self, draw: Draw, wanted: int, work: Work = ask, seen_from: SeenFrom = own_design
    ) -> list[tuple[BlindTrial, Record]]:
        """Trials with their records until so many (thinned) are not excluded.

        The truth of a trial is asked at the schedules that it is ``seen_from``, whose reach all processes share.
        """
        wanted = self.settings.thinned(wanted)
        source, done = draw(self.seeds), list[tuple[BlindTrial, Record]]()
        while (missing := wanted - sum(not r.get("excluded") for _, r in done)) > 0:
            batch = list(islice(source, missing))
            if not batch or len(done) >= _MOST_TRIES * wanted:
                break
            tasks = [_Task(trial=trial, work=work, plans=seen_from(trial)) for trial in batch]
            found = perform(_carried_out, self._prepared(tasks), self.journal, self.settings)
            done += zip(batch, found, strict=True)
        return done

    def _prepared(self, tasks: list["_Task"]) -> list["_Task"]:
        """Tasks that are left to do with the reach of their schedules, each worked out by all processes together."""
        if self.settings.processes == 1:
            return tasks
        finished, found = self.journal.read(), dict[int, Reach]()
        waiting = [task for task in tasks if task.key not in finished]
        with lasting_pool(self.settings.processes) as pool:
            for plan in {id(plan): plan for task in waiting for plan in task.plans}.values():
                found[id(plan)] = worked_out(plan, partial(pool.map, chunksize=_LABS_AT_ONCE))
        return [replace(task, known=tuple(found.get(id(plan)) for plan in task.plans)) for task in tasks]

    def scored(self, draw: Draw, wanted: int) -> list[Scored]:
        """The same for trials that only ask, scored against the truth."""
        return [Scored.of(trial, record) for trial, record in self.records(draw, wanted)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What a part adds to the result."""

    goals: tuple[Goal, ...] = ()
    tables: tuple[Table, ...] = ()
    notes: tuple[str, ...] = field(default=())


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A row of the table by its name, which ``--only`` takes.

    One ``beside`` the table has no bar, and is run by its name only.
    """

    name: str
    says: str
    run: Callable[[Run], Outcome]
    beside: bool = False
