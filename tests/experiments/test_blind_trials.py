"""The plan of the blind trials, what the truth says of them, and one of each kind from lab to verdict."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from drivers.mocks.lab.foreign.families import FOREIGN
from drivers.mocks.lab.hidden import HIDDEN
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import schedule
from experiments import blind_trials
from experiments.blind import reach as reach_module
from experiments.blind import trial as blind_trial
from experiments.blind.answer import NO_ANSWER, Answer
from experiments.blind.draws import (
    coverage,
    efficiency_only,
    extension,
    foreign,
    foreign_alone,
    nothing,
    pairs,
    singles,
    sizes,
    tied,
)
from experiments.blind.part import Outcome, Part
from experiments.blind.reach import hideable
from experiments.blind.scoring import Scored
from experiments.blind.seeds import ROWS, SCORING, TUNING
from experiments.blind.surrogates import campaign
from experiments.blind.trial import HEAVY, NOISES, UNDERSTATED, BlindTrial, ask, measured
from experiments.blind_trials import NAMES
from experiments.harness.lab_data import measured_table, random_set_points
from experiments.harness.settings import Settings
from models.screening import LOADED_KINDS
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.prototype import prototype
from sim.simulate import Points, simulate
from sim.spread import everyday_spread

DRAWS = {"single": singles, "pairs": pairs, "nothing": nothing, "foreign": foreign, "coverage": coverage,
         "efficiency_only": efficiency_only, "tied": tied, "extension": extension, "sizes": sizes}  # fmt: skip
MANY = 60


# --- the plan -----------------------------------------------------------------------------------------


def test_every_row_of_the_table_has_seeds_and_a_part() -> None:
    assert set(NAMES) == {*ROWS, "foreign_alone"}  # of the labs of foreign effects


@pytest.mark.parametrize(
    ("only", "run"),
    [((), set(NAMES) - {"foreign_alone", "sizes"}), (("sizes", "single"), {"sizes", "single"})],
)
def test_the_table_is_what_has_a_bar_and_the_rest_is_run_by_name(
    only: tuple[str, ...], run: set[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    ran = set[str]()

    def noting(part: Part) -> Part:
        return replace(part, run=lambda _: ran.add(part.name) or Outcome())  # type: ignore[func-returns-value]

    monkeypatch.setattr(blind_trials, "PARTS", tuple(map(noting, blind_trials.PARTS)))
    monkeypatch.setattr(blind_trials, "_pictures", lambda *_: ())
    found = blind_trials.run_with(TUNING, Settings(only=only, out=tmp_path, now=iter((0.0, 7300.0)).__next__))
    assert ran == run
    # how long it takes is told of the whole table only: of 7200 s
    assert [(g.value > 2.0, g.verdict) for g in found.goals] == ([] if only else [(True, "missed")])
    assert found.notes[-1] == f"not run: {', '.join(name for name in NAMES if name not in run)}"


@pytest.mark.parametrize("row", DRAWS)
def test_no_seed_is_used_twice_and_none_for_both_tuning_and_scoring(row: str) -> None:
    scored, tuned = ([t.seed for t in islice(DRAWS[row](seeds), MANY)] for seeds in (SCORING, TUNING))
    assert len({*scored, *tuned}) == 2 * MANY
    assert min(scored) >= SCORING.first >= 5_100_000 > max(tuned) >= 100_000  # those below were scored before


@pytest.mark.parametrize("row", DRAWS)
def test_a_trial_is_the_same_each_time(row: str) -> None:
    first, again = ([t.key for t in islice(DRAWS[row](TUNING), 3)] for _ in range(2))
    assert first == again
    assert len(set(first)) == 3


def test_singles_walk_the_catalogue_with_values_of_the_labs_ranges() -> None:
    trials = list(islice(singles(TUNING), MANY))
    assert {t.names[0] for t in trials} == set(hideable())
    for t in trials:
        low, high = HIDDEN[t.names[0]].drawn
        assert low <= t.hidden[0][1] <= high


def test_foreign_labs_are_seen_in_efficiency_alone_as_well() -> None:
    both = zip(islice(foreign(TUNING), MANY), islice(foreign_alone(TUNING), MANY), strict=True)
    for all_channels, alone in both:
        assert alone == replace(all_channels, row="foreign_alone", efficiency_only=True)


def test_foreign_trials_walk_all_families() -> None:
    assert {t.names[0] for t in islice(foreign(TUNING), MANY)} == set(FOREIGN)


def test_pairs_are_two_different_effects() -> None:
    assert all(len(set(t.names)) == 2 for t in islice(pairs(TUNING), MANY))


def test_effects_of_the_prior_are_mostly_single_and_inside_their_bounds() -> None:
    trials = list(islice(coverage(TUNING), 400))
    counted = Counter(len(t.names) for t in trials)
    assert counted[1] == pytest.approx(300, abs=35)  # four sigmas of 400 draws
    for name, value in (hidden for t in trials for hidden in t.hidden):
        assert CATALOGUE[name].headline.lower <= value <= CATALOGUE[name].headline.upper


def test_nothing_is_tried_with_every_kind_of_noise() -> None:
    assert Counter(t.noise for t in islice(nothing(TUNING), 40)) == dict.fromkeys(NOISES, 10)


@pytest.mark.parametrize("size", [40, 400])
def test_a_campaign_of_the_surrogates_has_so_many_loaded_rows(size: int) -> None:
    assert np.isin(campaign(size).kind, ("load", "reference")).sum() == size


# --- what is measured ---------------------------------------------------------------------------------


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


def scatter(noise: str, kind: str) -> np.ndarray:
    """Readings of the input power less those of the same lab without noise, in parts of the reading."""
    trial = BlindTrial(row="nothing", seed=100_001, noise=noise, points=120)
    table, quiet = measured(trial), measured_quietly(trial)
    chosen = table["kind"] == kind
    return ((table["P1_W"] - quiet["P1_W"]) / quiet["P1_W"])[chosen].to_numpy(dtype=float)


def measured_quietly(trial: BlindTrial) -> pd.DataFrame:
    lab = Laboratory.draw(seed=trial.seed).without_noise()
    return blind_trial.survey(lab, trial.plan, seed=trial.seed)


def test_under_stated_noise_is_larger_where_it_is_not_judged() -> None:
    loads, references = scatter(UNDERSTATED, "load"), scatter(UNDERSTATED, "reference")
    assert np.std(loads) / np.std(references) > 1.2  # 1.5 by construction; 15 references


def test_heavy_tails_are_no_more_than_another_draw_of_the_same_lab() -> None:
    trial = BlindTrial(row="nothing", seed=100_001, noise=HEAVY)
    assert blind_trial.laboratory(trial).errors.tail == 3.0
    assert blind_trial.laboratory(trial).converter == Laboratory.draw(seed=100_001).converter


def test_a_drift_is_judged_by_what_it_came_to() -> None:
    trial = BlindTrial(row="coverage", seed=1, hidden=(("warm_up_drift", 0.2), ("dead_time", 1e-7)), points=8)
    lab = Laboratory.nominal()
    lab = replace(lab, quirks=replace(lab.quirks, drift_share=0.2)).without_noise()
    plain = blind_trial.survey(Laboratory.nominal().without_noise(), trial.plan, seed=1).iloc[-1]
    last = blind_trial.survey(lab, trial.plan, seed=1).iloc[-1]
    grown = (last["P1_W"] - plain["P1_W"]) / (plain["P1_W"] - plain["P2_W"])
    # an input voltage falls a little
    assert trial.headlines["warm_up_drift"] == pytest.approx(grown, rel=1e-3)
    assert trial.headlines["dead_time"] == 1e-7


# --- what can be told apart ---------------------------------------------------------------------------


RIVALS = ("auxiliary_power", "analyzer_offset", "gate_delay_skew", "core_loss_transformer")
PLACE = BlindTrial(row="single", seed=100_003, design=195_000, points=12)


@pytest.fixture(scope="module", autouse=True)
def small_reach() -> Iterator[None]:
    """The reach of one small design among four effects and the first ten parts: the whole one takes long."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reach_module, "everyday_spread", lambda converter: everyday_spread(converter)[:10])
        known = reach_module.reach(PLACE.plan, RIVALS)
        patch.setattr(blind_trial, "reach_of", lambda seed, points: known)
        yield


@pytest.fixture(scope="module")
def sighted(small_reach: None) -> dict[str, blind_trial.Sight]:
    """What one small design can see of three things, and of the same in efficiency alone."""
    found = {}
    for name, value in (("auxiliary_power", 5.0), ("gate_delay_skew", 1e-7), ("dc_link_esr", 0.4)):
        for alone in (False, True):
            one = replace(PLACE, hidden=((name, value),), efficiency_only=alone)
            found[name + " alone" * alone] = blind_trial.sight_of(one, measured(one))
    return found


def test_efficiency_alone_ties_auxiliary_power_to_the_analyzers_offset(
    sighted: dict[str, blind_trial.Sight],
) -> None:
    assert "analyzer_offset" in sighted["auxiliary_power alone"].tied("auxiliary_power")
    assert "analyzer_offset" not in sighted["auxiliary_power"].tied("auxiliary_power")


def test_the_nearest_is_the_first_that_is_not_tied(sighted: dict[str, blind_trial.Sight]) -> None:
    sight = sighted["auxiliary_power alone"]
    others = sight.rivals(["auxiliary_power"])
    nearest = sight.nearest("auxiliary_power")
    assert 5.0 <= nearest == min(others[n] for n in others if n not in sight.tied("auxiliary_power"))


def test_efficiency_alone_does_not_see_a_skew_and_d0_does(sighted: dict[str, blind_trial.Sight]) -> None:
    assert sighted["gate_delay_skew alone"].detectability < 1.0
    assert sighted["gate_delay_skew"].detectability > 5.0


def test_rivals_that_take_some_of_it_are_tried_in_the_very_lab(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    def recorded(lab: Laboratory, values: dict[str, float]) -> Laboratory:
        tried.append(*values)
        return reach_module.hiding(lab, values)

    monkeypatch.setattr(blind_trial, "hiding", recorded)
    trial = replace(PLACE, hidden=(("auxiliary_power", 5.0),), efficiency_only=True)
    blind_trial.sight_of(trial, measured(trial))
    assert tried.count("analyzer_offset") == 2  # both ends of its range
    assert "gate_delay_skew" not in tried


def test_a_row_at_the_limit_tells_no_two_apart_that_are_one_in_the_very_lab(
    monkeypatch: pytest.MonkeyPatch, sighted: dict[str, blind_trial.Sight]
) -> None:
    """In a lab of nominal parts a rival moves one row by half more, which the trial's own lab knows nothing of."""
    trial = replace(PLACE, hidden=(("auxiliary_power", 20.0),), efficiency_only=True)
    known = blind_trial.reach_of(PLACE.design, PLACE.points)
    plane = known.effects["analyzer_offset"].copy()
    plane[:, first_load(known.index)] *= 1.5
    there = replace(known, effects={**known.effects, "analyzer_offset": plane})
    loads = known.index.get_level_values(0).isin(PLACE.plan.time_s[np.isin(PLACE.plan.kind, LOADED_KINDS)])
    hidden = pd.Series(known.effects["auxiliary_power"][1], known.index)[loads]
    seen = there.sight(hidden, ("P1_W",), voltages_read=False)
    assert seen.share_beyond("analyzer_offset") < 0.1
    assert seen.beyond(["analyzer_offset"]) > 0.9 * seen.detectability
    monkeypatch.setattr(blind_trial, "reach_of", lambda seed, points: there)
    found = blind_trial.sight_of(trial, measured(trial))
    assert found.tied("auxiliary_power") == sighted["auxiliary_power alone"].tied("auxiliary_power")


def test_a_row_that_a_rival_cannot_run_in_the_very_lab_tells_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is hidden moves the first row by 50 W more, where every rival cannot run."""
    trial = replace(PLACE, hidden=(("auxiliary_power", 5.0),), efficiency_only=True)
    between, shifts = blind_trial.shift_between, list[pd.Series]()

    def first_row_at_the_limit(there: pd.DataFrame, plain: pd.DataFrame) -> pd.Series:
        shifts.append(shift := between(there, plain))
        first = first_load(shift.index)
        at_limit = shift.copy()
        at_limit.iloc[first] += 50.0
        return at_limit if len(shifts) == 1 else shift.drop(shift.index[first])

    monkeypatch.setattr(blind_trial, "shift_between", first_row_at_the_limit)
    assert "analyzer_offset" in blind_trial.sight_of(trial, measured(trial)).tied("auxiliary_power")


def first_load(index: "pd.Index[Any]") -> int:
    """Where the first reading of the input power of a row with load stands."""
    time_s, channel = index.get_level_values(0), index.get_level_values(1)
    loads = set(PLACE.plan.time_s[PLACE.plan.kind == "load"])
    return int(np.flatnonzero(time_s.isin(loads) & (channel == "P1_W"))[0])


def test_a_voltage_that_nobody_reads_may_be_off_as_far_as_a_bench_holds_it() -> None:
    known = blind_trial.reach_of(PLACE.design, PLACE.points)
    off = pd.Series(known.voltages[1], known.index)  # the supply, one sigma
    noise_free = replace(known, sigma=1e-6 * known.sigma, bent=0.0 * known.bent, nuisance=known.nuisance[:0])
    unread, read = (noise_free.sight(off, ("P1_W",), voltages_read=r).detectability for r in (False, True))
    assert unread == pytest.approx(1.0, rel=1e-3)  # by definition; noise is a millionth
    assert read == pytest.approx(0.1 / (300.0 * 2.635e-4), rel=1e-3)  # 5e-4 sqrt(5/18): an analyzer's voltage


def test_a_row_that_a_rival_cannot_run_tells_nothing_of_it_and_others_do() -> None:
    known = blind_trial.reach_of(PLACE.design, PLACE.points)
    first = first_load(known.index)
    moved = pd.Series(known.effects["auxiliary_power"][0], known.index)
    half = moved.drop(known.index[first])
    there = known.with_planes({"auxiliary_power": [half, 2 * half]})
    for row, least, most in ((first, 0.0, 1e-6), (first + len(reach_module.CHANNELS), 5.0, np.inf)):
        astray = moved + 5.0 * (np.arange(moved.size) == row)  # W
        assert least <= there.sight(astray).beyond(["auxiliary_power"]) <= most


def test_a_foreign_effect_stands_out_of_the_whole_catalogue(sighted: dict[str, blind_trial.Sight]) -> None:
    sight = sighted["dc_link_esr"]
    assert 5.0 < sight.beyond(list(sight.planes)) < sight.detectability


def test_a_reading_counts_for_what_does_not_bend_and_not_where_an_ordinary_lab_cannot_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    inductance = [s for s in everyday_spread(prototype()) if s.path == "inductor.inductance_H"]
    monkeypatch.setattr(reach_module, "everyday_spread", lambda converter: inductance)
    limit_W = 1767.0  # of the nominal lab with these pulses, and 1751 W with 1 % more inductance
    power_W = limit_W * np.array([0.6, 0.975, 0.998])
    plan = schedule(np.full(3, 0.67), np.full(3, 0.28), power_W, reference_every=10, standby=0, no_load=0)
    known = reach_module.reach(plan, [])
    seen = dict(zip(known.index, known.bent / known.sigma, strict=True))
    assert seen[plan.time_s[1], "P1_W"] < 0.1
    assert seen[plan.time_s[2], "P1_W"] > 1.0
    assert (plan.time_s[3], "P1_W") not in seen


def test_a_reach_worked_out_by_others_is_taken_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """A table of trials works a design out once, its labs shared among the processes, and hands it to each."""
    asked = list[int]()

    def others(work: Callable[[Laboratory], Any], labs: Iterable[Laboratory]) -> Iterable[Any]:
        asked.append(len(found := [work(lab) for lab in labs]))
        return found

    monkeypatch.setattr(reach_module, "_known", {})
    monkeypatch.setattr(reach_module, "everyday_spread", lambda converter: everyday_spread(converter)[:2])
    monkeypatch.setattr(reach_module, "hideable", lambda: list(RIVALS[:1]))
    known = reach_module.reach(PLACE.plan, each=others)
    reach_module.handed_over(PLACE.plan, known)
    assert reach_module.worked_out(replace(PLACE, seed=1).plan) is known
    assert asked == [12]  # two parts to both sides, four drifts, two voltages, both ends of an effect


# --- trials -------------------------------------------------------------------------------------------


def test_what_cannot_be_seen_is_excluded_and_not_diagnosed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blind_trial, "answered", lambda table: pytest.fail("diagnosed all the same"))
    small = (("auxiliary_power", 0.01),)
    record = ask(replace(PLACE, hidden=small))
    assert record["excluded"]
    assert record["isolability"] < 5.0


def test_a_hidden_link_resistance_is_found_and_the_same_seed_says_the_same() -> None:
    hidden = (("link_resistance", 0.12),)
    trial = BlindTrial(row="single", seed=100_005, hidden=hidden, points=16)
    first, second = ask(trial), ask(trial)
    scored = Scored.of(trial, first)
    assert scored.right_first
    assert scored.said.cause("link_resistance") is not None
    first["answer"]["cpu_s"] = second["answer"]["cpu_s"] = 0.0
    assert first == second


def test_a_diagnosis_that_gives_up_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    def gives_up(*_: object, **__: object) -> None:
        raise ValueError("too few rows")

    monkeypatch.setattr(blind_trial, "diagnose", gives_up)
    record = ask(BlindTrial(row="nothing", seed=100_005, points=4))
    answer = Answer.from_plain(record["answer"])
    assert (answer.verdict, answer.refused) == (NO_ANSWER, "ValueError: too few rows")
