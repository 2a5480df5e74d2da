"""The plan of the first trials, and their score."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from drivers.mocks.lab.hidden import HIDDEN
from experiments.blind.answer import Answer, Cause
from experiments.blind.reach import hideable
from experiments.blind.scoring import Scored
from experiments.blind.seeds import SCORING, TUNING
from experiments.first_trials import SIZES, drawn, plan, scored_result
from experiments.harness.settings import Settings
from sim.effects.catalogue import CATALOGUE


def settings(scale: float = 1.0) -> Settings:
    return Settings(out=Path("unused"), scale=scale)


def test_the_plan_is_every_effect_in_three_sizes_and_two_labs_and_six_with_nothing() -> None:
    counted = Counter((t.names, t.row) for t in plan(settings()))
    expected = {((name,), size): 2 for name in hideable() for size in SIZES}
    assert counted == expected | {((), "nothing"): 6}


def test_no_seed_is_used_twice_or_elsewhere() -> None:
    seeds = [t.seed for t in plan(settings())]
    assert len(set(seeds)) == len(seeds)
    for blind in (TUNING, SCORING):
        assert not set(seeds) & set(range(blind.first, blind.first + 100_000))


def test_a_thinned_plan_is_part_of_the_whole_with_every_effect_and_size() -> None:
    thinned = plan(settings(0.1))
    assert set(thinned) <= set(plan(settings()))
    assert {t.names for t in thinned} == {(), *((name,) for name in hideable())}
    assert {t.row for t in thinned} == {*SIZES, "nothing"}


@pytest.mark.parametrize("effect", ["auxiliary_power", "magnetizing_inductance"])
def test_sizes_are_thirds_of_the_range_by_their_distance_from_off(effect: str) -> None:
    off = CATALOGUE[effect].headline.off
    edges = sorted(np.geomspace(*HIDDEN[effect].drawn, 4), key=lambda value: abs(value - off))
    for k, size in enumerate(SIZES):
        values = [drawn(effect, size, seed) for seed in range(50)]
        low, high = sorted(edges[k : k + 2])
        assert low <= min(values) < max(values) <= high


def answer(effect: str) -> Answer:
    cause = Cause(effect=effect, probability=0.99, value=0.1, low=0.0, high=0.2)
    return Answer(verdict="named", causes=(cause,), named=(effect,))


def test_a_miss_and_a_false_name_stay_visible() -> None:
    first, second, *_, nothing = plan(settings(0.4))
    found = Scored(trial=first, isolability=None, answer=answer(first.names[0]))
    wrong = Scored(trial=second, isolability=None, answer=answer("fan_step"))
    quiet = Scored(trial=nothing, isolability=None, answer=Answer(verdict="consistent"))
    result = scored_result([found, wrong, quiet])
    assert [goal.value for goal in result.goals] == [50.0, pytest.approx(100 / 3)]
    assert "1 of 1 consistent" in result.notes[1]
