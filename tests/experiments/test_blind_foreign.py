"""The part of foreign effects with efficiency alone, on answers that are made up."""

from experiments.blind.scoring import Scored
from experiments.blind_trials import PARTS
from tests.experiments.fabricated import answer, scored


def test_what_is_said_of_foreign_effects_by_efficiency_alone_is_counted() -> None:
    class Finished:
        def scored(self, *_: object) -> list[Scored]:
            return [
                scored("dc_link_esr", answer("named", "sic_on_resistance")),
                scored("dc_link_esr", answer("unknown")),
                scored("load_leakage", answer("consistent")),
                scored("load_leakage", answer("unknown")),
            ]

    (part,) = (part for part in PARTS if part.name == "foreign_alone")
    outcome = part.run(Finished())  # type: ignore[arg-type]
    assert outcome.goals == ()
    assert (
        outcome.notes[-1]
        == "foreign alone: wrong 1 of 4 (25 %), unknown 2 of 4 (50 %), consistent 1 of 4 (25 %)"
    )
    assert [row[0] for row in outcome.tables[0].rows] == ["dc_link_esr", "load_leakage"]
    assert len(outcome.tables[1].rows) == 1
