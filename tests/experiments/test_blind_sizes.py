"""Trials of short and long tables: what is drawn, and how it is told."""

from dataclasses import replace
from itertools import islice

from experiments.blind.draws import SIZES, sizes
from experiments.blind.reach import hideable
from experiments.blind.scoring import Scored
from experiments.blind.seeds import TUNING
from experiments.blind.verdicts import OF_SIZES
from experiments.blind_trials import PARTS
from tests.experiments.fabricated import answer, scored


def test_every_effect_is_tried_in_a_table_of_each_size() -> None:
    trials = list(islice(sizes(TUNING), OF_SIZES))
    assert len({(t.names[0], t.points) for t in trials}) == OF_SIZES == len(SIZES) * len(hideable())


def test_trials_of_each_size_are_told_by_themselves() -> None:
    """One that was found, one found with something else, one not found, and nothing left out as too faint."""
    found, wrong, missed = (
        scored("fan_step", answer("named", "fan_step")),
        scored("fan_step", answer("named", "fan_step", "dead_time")),
        scored("fan_step", answer("consistent")),
    )
    of_size = {30: [found, wrong, missed], 200: [found, found], 400: [missed]}

    class Finished:
        def scored(self, *_: object) -> list[Scored]:
            return [
                replace(s, trial=replace(s.trial, points=points))
                for points, all_ in of_size.items()
                for s in all_
            ]

    (part,) = (part for part in PARTS if part.name == "sizes")
    table, missing = part.run(Finished()).tables  # type: ignore[arg-type]
    assert table.rows == ((30, 3, 1, 1, 0, 1, 1.0), (200, 2, 2, 0, 0, 0, 1.0), (400, 1, 0, 0, 0, 1, 1.0))
    assert len(missing.rows) == 3
