"""A campaign that chooses its points: what it begins with, what it chooses and why, and what stops it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from bench.adaptive import Adaptive, Choice, is_settled
from bench.campaign import Surroundings, resume_campaign, run_campaign
from bench.errors import CampaignStopped, InputError
from bench.job import Job
from bench.plan import SPARE, Kind, PlannedPoint
from bench.prediction import Asked, Forecast, SimulatedConverter
from bench.progress import Progress
from bench.states import State
from bench.store import Store
from sim.model import Model
from sim.simulate import Points, simulate
from tests.bench.fake_bench import FakeInstruments, bench_config, campaign_config, memory, predict
from tests.models.diagnosis.virtual_campaign import simulated_campaign

PLAN = {"kind": "adaptive", "points": 40, "standby": 1, "no_load": 1}
BEGUN = 17  # 1 standby, 1 no load, 12 points, a reference first and after every 6


def prepared(**changes: object) -> Job:
    return Job.prepare(campaign_config(plan={**PLAN, **changes}), bench_config(), predict=predict)


# --- the plan ---------------------------------------------------------------------------------------


def test_it_begins_with_standby_no_load_and_points_spread_out() -> None:
    rows = prepared().plan.points
    assert [row.kind for row in rows[:3]] == [Kind.STANDBY, Kind.NO_LOAD, Kind.REFERENCE]
    loads = np.array([(row.D1, row.D2, row.power_W) for row in rows if row.kind is Kind.LOAD])
    assert (len(rows), len(loads)) == (BEGUN, 12)
    # points far from each other reach both ends of every range; twelve at random would leave a tenth out
    low, high = np.array([0.3, 0.0, 200.0]), np.array([1.0, 0.6, 2000.0])
    assert np.all(np.ptp(loads, axis=0) > 0.85 * (high - low))


def test_candidates_have_power_to_spare() -> None:
    simulated = SimulatedConverter.of(bench_config().converter)
    job = Job.prepare(campaign_config(plan=PLAN), bench_config(), predict=simulated)
    assert isinstance(job.choose, Adaptive)
    D1, D2, power_W = job.choose.candidates.T
    assert simulated(Asked(D1=D1, D2=D2, power_W=(1 + SPARE) * power_W, ambient_C=25.0)).feasible.all()


def test_limits_that_leave_no_candidate_are_refused() -> None:
    too_cold = bench_config(limits={**bench_config().limits.model_dump(), "heatsink_C": 25.5})
    with pytest.raises(
        InputError, match=r"fewer than 200 feasible points.*heatsink predicted too near its limit"
    ):
        Job.prepare(campaign_config(plan=PLAN), too_cold)


def test_a_budget_that_ends_before_the_beginning_does_is_refused() -> None:
    with pytest.raises(InputError, match=f"plan.points = {BEGUN}: more than the {BEGUN} rows"):
        prepared(points=BEGUN)


def test_settings_of_another_plan_are_refused() -> None:
    with pytest.raises(InputError, match="does not use adaptive"):
        campaign_config(plan={"kind": "latin_hypercube", "points": 5, "adaptive": {}})


# --- the engine -------------------------------------------------------------------------------------


@dataclass
class Script:
    """Chooses two points, and two more, and then has enough; notes how many rows it was shown."""

    shown: list[int] = field(default_factory=list)

    def __call__(self, table: pd.DataFrame, planned: Sequence[PlannedPoint]) -> Choice:
        self.shown.append(len(table))
        if len(planned) >= BEGUN + 4:
            return Choice(said=("enough",))
        new = PlannedPoint(
            point=len(planned), repeat=0, kind=Kind.LOAD, D1=0.9, D2=0.1, power_W=500.0, why="to see"
        )
        return Choice(rows=(new, replace(new, point=len(planned) + 1, D1=0.8)), said=("a question",))


def here(work: Callable[[], Choice], meanwhile: Callable[[], None], every_s: float) -> Choice:
    meanwhile()
    return work()


def around(fake: FakeInstruments) -> Surroundings:
    return replace(fake.around(), think=here)


def stopped_before_the_first_chosen(fake: FakeInstruments, store: Store) -> Script:
    """As if the process had died between choosing and setting."""
    script = Script()

    def watch(progress: Progress) -> None:
        if progress.row is not None and progress.row.why:
            raise CampaignStopped("died")

    with pytest.raises(CampaignStopped):
        run_campaign(
            replace(prepared(), choose=script), store, fake.clock, around=around(fake), progress=watch
        )
    return script


def test_chosen_points_are_in_the_ledger_with_why_before_they_are_set() -> None:
    fake = FakeInstruments()
    with memory() as store:
        stopped_before_the_first_chosen(fake, store)
        waiting = store.unfinished(1)
        assert [(row["state"], row["why"], row["D1"]) for row in waiting] == [
            ("planned", "to see", 0.9),
            ("planned", "to see", 0.8),
        ]
        assert store.campaign(1)["planned"] == BEGUN + 2
        assert next(e["detail"] for e in store.events(1) if e["event"] == "choice") == "a question"


def test_what_was_chosen_is_measured_after_a_crash_and_not_chosen_again(store: Store) -> None:
    fake, script = FakeInstruments(), Script()
    stopped_before_the_first_chosen(fake, store)
    job = replace(Job.stored(store, store.campaign(1), predict=predict), choose=script)
    resume_campaign(1, store, fake.clock, job=job, around=around(fake))
    assert script.shown == [BEGUN + 2, BEGUN + 4]
    assert store.measurement_table(1)["point"].tolist()[BEGUN:] == [BEGUN, BEGUN + 1, BEGUN + 2, BEGUN + 3]
    assert store.campaign(1)["state"] == State.DONE


def test_the_bench_hears_its_heartbeat_while_points_are_chosen() -> None:
    fake = FakeInstruments()
    beats = []

    def think(work: Callable[[], Choice], meanwhile: Callable[[], None], every_s: float) -> Choice:
        before = fake.done.count("beat")
        meanwhile()
        beats.append((fake.done.count("beat") - before, every_s))
        return work()

    with memory() as store:
        job = replace(prepared(), choose=Script())
        run_campaign(job, store, fake.clock, around=replace(fake.around(), think=think))
    assert beats == [(1, 1.0)] * 3  # every half of the heartbeat's 2 s


# --- the choice -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "left_open", "probability", "enough"),
    [
        ("named", False, 0.96, True),
        ("named", False, 0.90, False),
        ("group", False, 0.60, True),  # the design ties its causes: more rows would not part them
        ("group", True, 0.60, False),  # these data did, and more would
        ("unknown", False, 0.96, False),
    ],
)
def test_a_verdict_is_enough_where_more_rows_would_not_change_it(
    kind: str, left_open: bool, probability: float, enough: bool
) -> None:
    cause = SimpleNamespace(effect="link_resistance", probability=probability)
    verdict = SimpleNamespace(
        kind=kind, left_open=left_open, causes=(cause,), stated=() if kind == "unknown" else (cause.effect,),
    )  # fmt: skip
    assert is_settled(SimpleNamespace(verdict=verdict), 0.95) is enough  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def adaptive() -> Adaptive:
    job = Job.prepare(campaign_config(plan=PLAN), bench_config())
    assert isinstance(job.choose, Adaptive)
    return job.choose


def as_planned(table: pd.DataFrame) -> list[PlannedPoint]:
    return [
        PlannedPoint(
            point=int(row.point), repeat=0, kind=Kind(row.kind), D1=row.D1, D2=row.D2, power_W=row.P2_W
        )
        for row in table.itertuples()
    ]


@pytest.fixture(scope="module")
def powers() -> pd.DataFrame:
    """Dc powers with load of a converter that draws 4 W beside itself: it might as well be the analyzer's offset."""
    truth = Model.baseline().with_effect("auxiliary_power", power_W=4.0)
    table = simulated_campaign(truth, seed=3, count=24)
    loaded = table[table["kind"].isin(["load", "reference"])].reset_index(drop=True)
    return loaded[["kind", "D1", "D2", "P2_W", "P1_W", "efficiency", "time_s"]].assign(
        point=range(len(loaded))
    )


@pytest.fixture(scope="module")
def choice(adaptive: Adaptive, powers: pd.DataFrame) -> Choice:
    return adaptive(powers, as_planned(powers))


def test_rows_are_chosen_that_answer_the_open_question(choice: Choice) -> None:
    assert choice.rows[0].kind is Kind.STANDBY
    assert "analyzer current offset" in choice.rows[0].why
    assert (choice.rows[0].D1, choice.rows[0].D2, choice.rows[0].power_W) == (0.8, 0.0, 0.0)


def test_the_same_rows_lead_to_the_same_choice(
    adaptive: Adaptive, choice: Choice, powers: pd.DataFrame
) -> None:
    again = Job.prepare(campaign_config(plan=PLAN), bench_config()).choose
    assert isinstance(again, Adaptive)
    assert again(powers.copy(), as_planned(powers)) == choice
    np.testing.assert_array_equal(again.candidates, adaptive.candidates)
    other = Job.prepare(campaign_config(plan=PLAN, seed=2), bench_config()).choose
    assert isinstance(other, Adaptive)
    assert not np.isin(other.candidates, adaptive.candidates).any()


def test_too_few_rows_for_a_diagnosis_are_added_to_where_nothing_was_measured(adaptive: Adaptive) -> None:
    few = pd.DataFrame(
        {"point": [0, 1], "kind": "load", "D1": [0.9, 0.8], "D2": 0.1, "P2_W": [500.0, 600.0],
         "P1_W": [515.0, 617.0], "efficiency": [0.971, 0.972], "time_s": [0.0, 200.0]}
    )  # fmt: skip
    choice = adaptive(few, as_planned(few))
    assert choice.said[0].startswith("no diagnosis yet: ")
    places = {(row.D1, row.D2, row.power_W) for row in choice.rows}
    assert len(places) == 4
    assert places <= set(map(tuple, adaptive.candidates.tolist()))


def test_a_diagnosis_that_breaks_is_not_taken_for_too_few_rows(
    adaptive: Adaptive, powers: pd.DataFrame, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ValueError("operands could not be broadcast together")

    monkeypatch.setattr("models.diagnosis.diagnose.diagnose", broken)
    with pytest.raises(ValueError, match="broadcast"):
        adaptive(powers, as_planned(powers))


def test_a_set_point_that_was_rejected_is_not_chosen_again(adaptive: Adaptive, powers: pd.DataFrame) -> None:
    only = replace(adaptive, candidates=adaptive.candidates[:1])
    D1, D2, power_W = only.candidates[0].tolist()
    lost = PlannedPoint(point=99, repeat=0, kind=Kind.LOAD, D1=D1, D2=D2, power_W=power_W)
    assert only(powers, [*as_planned(powers), lost]) == Choice(
        said=("enough: every candidate was tried and rejected",)
    )


def test_the_budget_ends_it(adaptive: Adaptive, powers: pd.DataFrame) -> None:
    planned = as_planned(powers)
    full = [*planned, *[planned[-1]] * (40 - len(planned))]
    assert adaptive(powers, full) == Choice(said=("enough: the budget of 40 rows is used up",))


def test_rows_keep_the_number_of_their_set_point(
    adaptive: Adaptive, choice: Choice, powers: pd.DataFrame
) -> None:
    first = choice.rows
    after = adaptive(powers, [*as_planned(powers), *first]).rows  # as if none of them had been accepted
    assert [row.point for row in after if row.kind is Kind.STANDBY][:1] == [first[0].point]
    assert after[0].repeat == sum(row.kind is Kind.STANDBY for row in first)


def from_250_W(asked: Asked) -> Forecast:
    """The simulator on a bench that may not be set to less."""
    forecast = SimulatedConverter.of(bench_config().converter)(asked)
    return replace(forecast, feasible=forecast.feasible & (asked.power_W >= 250.0))


def quiet_table() -> pd.DataFrame:
    """A campaign of the baseline with 0.02 % noise of efficiency."""
    table = simulated_campaign(Model.baseline(), seed=3, count=24)
    noise = 1 + 2e-4 * np.random.default_rng(5).standard_normal(len(table))
    return table.assign(
        P1_W=table["P1_W"] * noise, efficiency=table["efficiency"] / noise, point=range(len(table))
    )


NO_CAUSE_IN_QUESTION = {**PLAN, "adaptive": {"probability": 0.51}}


def test_rows_are_chosen_where_the_optimum_is_not_decided_and_may_be_set(adaptive: Adaptive) -> None:
    table, settings = quiet_table(), campaign_config(plan=NO_CAUSE_IN_QUESTION)
    choice = replace(adaptive, campaign=settings, within=from_250_W)(table, as_planned(table))
    assert len(choice.rows) == 4
    assert all("another hill may be the highest" in row.why for row in choice.rows)
    assert min(row.power_W for row in choice.rows) > 250.0  # most of what is lost is lost at 200 W here


def test_a_load_of_which_nobody_knows_whether_it_is_carried_is_tried_once(adaptive: Adaptive) -> None:
    power = np.arange(2000.0, 2300.0)
    carried = simulate(Model.baseline(), Points(D1=1.0, D2=0.0, power_W=power)).feasible
    most_W = float(power[carried][-2])
    ranges = {"D1": [0.3, 1.0], "D2": [0.0, 0.6], "power_W": [200.0, most_W]}
    table, settings = quiet_table(), campaign_config(plan=NO_CAUSE_IN_QUESTION, ranges=ranges)
    at_the_most = replace(adaptive, campaign=settings, within=from_250_W)
    (row,) = at_the_most(table, as_planned(table)).rows
    assert (row.D1, row.D2, row.power_W) == (1.0, 0.0, most_W)
    assert "only who measures there knows" in row.why
    again = at_the_most(table, [*as_planned(table), row])  # it was not carried
    assert all("another hill may be the highest" in row.why for row in again.rows)
