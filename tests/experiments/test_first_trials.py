"""The plan of the blind trials, and one of them from the lab to the verdict."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from drivers.mocks.lab.hidden import HIDDEN
from drivers.mocks.lab.laboratory import Laboratory
from experiments.blind import trial as blind_trial
from experiments.blind.scoring import Scored
from experiments.blind.trial import Answer, BlindTrial, ask
from experiments.first_trials import FIRST_SEED, SIZES, drawn, hideable, plan
from experiments.harness.lab_data import measured_table, random_set_points
from experiments.harness.settings import Settings
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.simulate import Points, simulate


def settings(scale: float = 1.0) -> Settings:
    return Settings(out=Path("unused"), scale=scale)


def test_the_plan_is_every_effect_in_three_sizes_and_two_labs_and_six_with_nothing() -> None:
    counted = Counter((t.effect, t.size) for t in plan(settings()))
    expected = {(name, size): 2 for name in set(CATALOGUE) & set(HIDDEN) for size in SIZES}
    assert counted == expected | {(None, "–"): 6}


def test_no_seed_is_used_twice_or_for_tuning() -> None:
    seeds = [t.seed for t in plan(settings())]
    assert len(set(seeds)) == len(seeds)
    assert min(seeds) >= FIRST_SEED > 10_000


def test_a_thinned_plan_is_part_of_the_whole_with_every_effect_and_size() -> None:
    thinned = plan(settings(0.1))
    assert set(thinned) <= set(plan(settings()))
    assert {t.effect for t in thinned} == {*hideable(), None}
    assert {t.size for t in thinned} == {*SIZES, "–"}
    assert len(thinned) == len(hideable()) + 1


@pytest.mark.parametrize("effect", ["auxiliary_power", "magnetizing_inductance"])
def test_sizes_are_thirds_of_the_range_by_their_distance_from_off(effect: str) -> None:
    off = CATALOGUE[effect].headline.off
    edges = sorted(np.geomspace(*HIDDEN[effect].drawn, 4), key=lambda value: abs(value - off))
    for k, size in enumerate(SIZES):
        values = [drawn(effect, size, seed) for seed in range(50)]
        low, high = sorted(edges[k : k + 2])
        assert low <= min(values) < max(values) <= high


def test_set_points_are_feasible_and_the_reference_has_power_to_spare() -> None:
    points = random_set_points(4, np.random.default_rng(8))  # whose first feasible point has none to spare
    points[0, 2] *= 1.12
    D1, D2, power_W = points.T
    assert simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W)).feasible.all()


def test_a_campaign_has_idle_rows_first_and_a_reference_every_eight() -> None:
    table = measured_table(Laboratory.draw(seed=7), 24, seed=7)
    kinds = table["kind"].tolist()
    assert kinds[:5] == ["standby", "standby", "no_load", "no_load", "reference"]
    assert kinds.count("reference") == 3


def test_a_hidden_link_resistance_is_found_and_the_same_seed_says_the_same() -> None:
    trial = BlindTrial(effect="link_resistance", value=0.1, size="medium", seed=5, points=24)
    first, second = ask(trial), ask(trial)
    answer = Answer.from_plain(first)
    assert Scored(trial=trial, answer=answer).found
    assert answer.value is not None
    assert answer.half_width is not None
    # the lab's own winding and board resistances, inside their tolerances, add to what is hidden
    assert answer.value == pytest.approx(0.1, abs=2 * answer.half_width)
    assert {**first, "cpu_s": 0} == {**second, "cpu_s": 0}


def test_a_diagnosis_that_gives_up_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    def gives_up(_: object) -> None:
        raise ValueError("too few rows")

    monkeypatch.setattr(blind_trial, "diagnose", gives_up)
    trial = BlindTrial(effect=None, value=None, size="–", seed=5, points=4)
    answer = Answer.from_plain(ask(trial))
    assert (answer.verdict, answer.refused) == ("no answer", "ValueError: too few rows")
