"""Tied pairs: what a proposed step becomes, what a bench does with it, and what counts as separated."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from experiments.blind import reach as reach_module
from experiments.blind import tied as tied_module
from experiments.blind import trial as blind_trial
from experiments.blind.answer import Answer, Cause
from experiments.blind.tied import Bench, ask_tied, right_about_channels, separated, settled, understood
from experiments.blind.trial import BlindTrial
from sim.spread import everyday_spread

TRIAL = BlindTrial(
    row="tied", seed=150_000, hidden=(("auxiliary_power", 4.0),), rival="dead_time", efficiency_only=True,
    design=195_000, points=4,
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def small_reach() -> Iterator[None]:
    """The reach of one small design among two effects and the first ten parts: the whole one takes long."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reach_module, "everyday_spread", lambda converter: everyday_spread(converter)[:10])
        known = reach_module.reach(TRIAL.plan, ("auxiliary_power", "gate_delay_skew"))
        patch.setattr(blind_trial, "reach_of", lambda seed, points: known)
        yield


@pytest.mark.parametrize(
    ("action", "kind", "warmer_K"),
    [
        ("standby", "standby", 0.0),
        ("no_load", "no_load", 0.0),
        ("measure D1 = 0.8, D2 = 0.1, 900 W", "load", 0.0),
        ("warm the room by 15 K and measure D1 = 0.8, D2 = 0.1, 900 W", "load", 15.0),
    ],
)
def test_a_proposed_step_becomes_a_row(action: str, kind: str, warmer_K: float) -> None:
    step = understood({"action": action, "repeats": 2})
    assert step.plan is not None
    assert (step.plan.kind.tolist(), step.repeats, step.warmer_K) == ([kind], 2, warmer_K)


def test_a_missing_channel_is_understood_and_what_this_bench_cannot_do_is_left() -> None:
    said = "measure P_link1_W too, beginning with D1 = 0.8, D2 = 0.1, 90 W"
    assert understood({"action": said}).channel == "P_link1_W"
    assert understood({"action": "swap the two elements at D1 = 0.8, D2 = 0.1, 900 W"}).plan is None


def test_a_proposed_session_is_warm_when_it_counts() -> None:
    """The second row starts from where the first one ends: were that one cold, it would be lower by 0.3 W."""
    bench = Bench.of(TRIAL)
    before = len(bench.table)
    bench.carry_out([understood({"action": "measure D1 = 0.8, D2 = 0.1, 2000 W", "repeats": 2})])
    later = bench.table.iloc[before:]
    assert bench.added == len(later) == 2
    assert float(np.ptp(later["P1_W"] - later["P2_W"])) < 0.25  # noise of a difference is 0.1 W of 2080


def test_a_channel_is_right_where_it_separates_and_none_where_none_does() -> None:
    assert right_about_channels({"channels": ["D0", "P_link1_W"], "needed": ["P_link1_W"]})
    assert not right_about_channels({"channels": ["D0"], "needed": []})
    assert not right_about_channels({"channels": [], "needed": ["D0"]})
    assert right_about_channels({"channels": [], "needed": []})


def test_the_channel_that_is_asked_for_is_what_the_last_answer_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two answers, the first with a row to measure and a channel: who has measured it asks for none any more."""
    first = [{"action": "standby"}, {"action": "measure D0 too"}]
    said = iter([{"verdict": "group", "causes": [], "named": [], "groups": [], "unknown": {"probability": 0.0},
                  "next": steps} for steps in (first, [])])  # fmt: skip
    monkeypatch.setattr(Bench, "diagnosed", lambda self: next(said))
    monkeypatch.setattr(tied_module, "_possible", lambda trial: (6.0, ["D0"]))
    record = ask_tied(TRIAL)
    assert (record["rows"], record["channels"]) == (1, [])


def test_a_bench_stops_measuring_at_a_wrong_name_as_at_a_right_one(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = {"verdict": "named", "causes": [], "named": ["dead_time"], "groups": [], "unknown": {"probability": 0.0},
             "next": [{"action": "standby"}]}  # fmt: skip
    monkeypatch.setattr(Bench, "diagnosed", lambda self: wrong)
    monkeypatch.setattr(tied_module, "_possible", lambda trial: (6.0, ["D0"]))
    record = ask_tied(TRIAL)
    assert (record["rows"], record["separated"]) == (0, False)


def test_what_the_first_table_does_not_show_ties_nothing_and_is_not_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def asked(_: Bench) -> dict[str, Any]:
        raise AssertionError("a skew is not seen in efficiency alone")

    monkeypatch.setattr(Bench, "diagnosed", asked)
    unseen = replace(TRIAL, hidden=(("gate_delay_skew", 1e-7),))
    assert ask_tied(unseen) == {"excluded": True}
    with pytest.raises(AssertionError, match="a skew"):
        ask_tied(TRIAL)


def grouped(**probabilities: float) -> Answer:
    """All these causes in one group, as tied as can be."""
    causes = tuple(
        Cause(effect=name, probability=p, value=1.0, low=0.5, high=1.5) for name, p in probabilities.items()
    )
    return Answer(verdict="group", causes=causes, groups=(tuple(probabilities),))


def test_a_pair_is_separated_without_the_rival_whatever_else_is_tied() -> None:
    trial = BlindTrial(row="tied", seed=1, hidden=(("sic_on_resistance", 0.3),), rival="thermal_resistance")
    third = grouped(sic_on_resistance=0.6, link_resistance=0.4)
    assert separated(trial, third)
    assert not settled(trial, third)
    assert not separated(trial, grouped(sic_on_resistance=0.6, thermal_resistance=0.4))
    assert not separated(trial, grouped(link_resistance=0.6, cable_resistance_input=0.4))
