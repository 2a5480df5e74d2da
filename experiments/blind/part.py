"""A part of the blind trials: one row of the table, run alone or with the others."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from experiments.blind.draws import Draw
from experiments.blind.scoring import Scored
from experiments.blind.seeds import Seeds
from experiments.blind.trial import BlindTrial, ask
from experiments.harness.journal import Journal
from experiments.harness.result import Goal, Table
from experiments.harness.settings import Settings
from experiments.harness.trials import perform

Record = dict[str, Any]
_MOST_TRIES = 4  # times what is wanted: an effect that cannot be seen does not stop the rest


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """How the parts are run: settings, whose seeds, and the journal of finished trials."""

    settings: Settings
    seeds: Seeds
    journal: Journal

    def records(
        self, draw: Draw, wanted: int, work: Callable[[BlindTrial], Record] = ask
    ) -> list[tuple[BlindTrial, Record]]:
        """Trials with their records until so many (thinned) are not excluded."""
        wanted = self.settings.thinned(wanted)
        source, done = draw(self.seeds), list[tuple[BlindTrial, Record]]()
        while (missing := wanted - sum(not r.get("excluded") for _, r in done)) > 0:
            batch = list(islice(source, missing))
            if not batch or len(done) >= _MOST_TRIES * wanted:
                break
            found = perform(work, batch, self.journal, self.settings)
            done += zip(batch, found, strict=True)
        return done

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
    """A row of the table by its name, which ``--only`` takes."""

    name: str
    says: str
    run: Callable[[Run], Outcome]
