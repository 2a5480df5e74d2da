"""Variants solved from their neighbour's response: the same steady states in fewer looks."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.effects.catalogue import CATALOGUE
from sim.fixed_point import operate
from sim.model import Model
from sim.neighbours import Response, approach, settled_alone
from sim.operating_points import Points
from sim.parameters import Converter
from sim.prototype import prototype
from sim.simulate import Result, answering, reference, simulate, simulate_each, simulate_many
from sim.station import Station, station_of

COUNT = 40
ORIGIN = np.arange(COUNT)
HEAD = CATALOGUE["link_resistance"].headline.name


def points() -> Points:
    rng = np.random.default_rng(12)
    return Points(
        D1=rng.uniform(0.6, 0.97, COUNT),
        D2=rng.uniform(0.03, 0.3, COUNT),
        power_W=rng.uniform(200, 1000, COUNT),
        V1_V=300.0,
        V2_V=140.0,
    )


@pytest.fixture(scope="module")
def solved() -> Station:
    return found()[1]


@pytest.fixture(scope="module")
def response() -> Response:
    return found()[0]


def found() -> tuple[Response, Station]:
    outcome = operate(prototype(), points())
    station = outcome.station.ready(outcome.state)
    response, look = Response.of(station)
    return response, response.nearer(station, look)


def looks(solved: Station, response: Response, converter: Converter) -> list[int]:
    """How many points settled at each look that settled any."""
    variant = station_of(converter, points(), solved.start())
    return [found.rows.size for found in approach(variant, response, ORIGIN)]


def test_the_solved_points_miss_nothing(solved: Station) -> None:
    state, missed = solved.missed()
    assert np.all(solved.settled(state, missed))


def test_a_step_of_newtons_rule_is_right_to_first_order(solved: Station, response: Response) -> None:
    warmer = replace(solved, slow=replace(solved.slow, target_W=solved.slow.target_W + 1e-3))
    step = response.step(ORIGIN, warmer.missed()[1])
    # the target is what the losses ask for: all that was wrong is the milliwatt itself
    np.testing.assert_allclose(step[-2], -1e-3, rtol=0.02)


def test_an_unchanged_converter_is_settled_at_the_first_look(solved: Station, response: Response) -> None:
    assert looks(solved, response, prototype()) == [COUNT]


def test_points_settle_alone_from_a_state_not_far_off(solved: Station) -> None:
    known = solved.known
    astray = replace(solved, warm=replace(known, phase=known.phase + 1e-4))
    settled, there = settled_alone(astray)
    assert settled.mean() > 0.9  # the others lie at a bend of their dead times
    state, missed = there.take(np.flatnonzero(settled)).missed()
    assert np.all(there.take(np.flatnonzero(settled)).settled(state, missed))


def test_what_does_not_settle_alone_stays_as_it_was(solved: Station) -> None:
    known = solved.known
    astray = replace(solved, warm=replace(known, phase=np.full(COUNT, 0.49)))
    settled, there = settled_alone(astray)
    assert not settled.all()
    np.testing.assert_array_equal(there.known.phase[~settled], 0.49)


def test_a_variant_settles_in_few_looks(solved: Station, response: Response) -> None:
    settled = looks(solved, response, replace(prototype(), link_resistance_Ohm=0.05))
    assert sum(settled[:4]) > 0.9 * COUNT


@pytest.mark.parametrize("times", [-1e8, 1e8])
def test_a_step_that_takes_the_link_its_voltage_is_put_aside(
    solved: Station, response: Response, times: float
) -> None:
    wild = replace(response, inverse=response.inverse.copy())
    wild.inverse[3, -1] *= times  # the input current: ten thousand amperes through a tenth of an ohm
    variant = station_of(replace(prototype(), input_cable_Ohm=0.1), points(), solved.start())
    sound, astray = (
        {
            int(row): P1_W
            for each in approach(variant, r, ORIGIN)
            for row, P1_W in zip(each.rows, each.columns[1], strict=True)
        }
        for r in (response, wild)
    )
    assert 3 in astray  # by a response of its own
    assert astray.keys() == sound.keys()
    np.testing.assert_allclose(
        astray[3], sound[3], rtol=1e-6
    )  # two ways to a state that each is good to 2e-7


@pytest.mark.parametrize(
    ("effect", "value"),
    [
        ("link_resistance", 0.05), ("dead_time", 8e-8), ("output_capacitance", 0.5), ("inductor_saturation", 0.15),
        ("cable_resistance_input", 0.1), ("leakage_inductance", -0.08), ("thermal_resistance", 0.5),
    ],
)  # fmt: skip
def test_a_variant_is_what_it_is_alone(effect: str, value: float) -> None:
    model = Model.baseline().with_effect(effect, **{CATALOGUE[effect].headline.name: value})
    near = reference(Model.baseline(), points())
    (quick,) = simulate_many([model], points(), near)
    alone = simulate(model, points())
    for name, column in alone.values.items():
        # both stop inside the same tolerances (2e-7 of the power, 0.1 mK); a swing that is cut short hangs on the
        # little current at its edge, of which the orbit's tolerance is a larger share
        atol = 1e-3 if name.startswith("missing_") else 2e-4
        np.testing.assert_allclose(quick[name], column, rtol=1e-6, atol=atol, err_msg=name)


def test_points_beyond_reach_are_told_by_a_variant_too() -> None:
    near = reference(Model.baseline(), points())
    weaker = Model.baseline().with_effect("leakage_inductance", relative_error=0.3)
    at = replace(points(), power_W=1500.0)
    quick, alone = simulate_many([weaker], at, near)[0], simulate(weaker, at)
    np.testing.assert_array_equal(quick.feasible, alone.feasible)


def test_some_of_the_points_keep_their_starts() -> None:
    near, chosen = reference(Model.baseline(), points()), np.array([3, 8, 20])
    part: Result = near.take(chosen)
    (quick,) = simulate_many([Model.baseline()], points().take(chosen), part)
    # from a start that is one step nearer: inside the tolerance of 2e-7 of the power
    np.testing.assert_allclose(quick["P1_W"], near["P1_W"][chosen], rtol=2e-7)


def test_starts_far_and_near_lead_to_the_same_state() -> None:
    near = reference(Model.baseline(), points())
    model = Model.baseline().with_effect("leakage_inductance", relative_error=-0.05)
    first = simulate_each([(model, points())], near)[0]
    again = simulate_each([(model, points())], near, [first.state + 0.1])[0]
    # tenths of a kelvin, of an ampere and of a thousandth of the half period aside: inside the tolerances
    np.testing.assert_allclose(again["P1_W"], first["P1_W"], rtol=1e-6)


def test_a_start_that_leaves_the_link_no_voltage_is_that_of_the_neighbour() -> None:
    near = reference(Model.baseline(), points())
    model = Model.baseline().with_effect("cable_resistance_input", resistance_Ohm=0.1)
    (plain,) = simulate_each([(model, points())], near)
    wild, unknown = plain.state.copy(), plain.state.copy()
    wild[-1, 3], unknown[:, 3] = 1e5, np.nan  # ten thousand amperes, as the unit is a tenth of one
    astray, alone = (simulate_each([(model, points())], near, [start])[0] for start in (wild, unknown))
    np.testing.assert_array_equal(astray["P1_W"], alone["P1_W"])


def test_an_unknown_start_is_that_of_the_neighbour() -> None:
    near = reference(Model.baseline(), points())
    model = Model.baseline().with_effect("link_resistance", **{HEAD: 0.05})
    (plain,) = simulate_each([(model, points())], near)
    (unknown,) = simulate_each([(model, points())], near, [np.full_like(plain.state, np.nan)])
    np.testing.assert_array_equal(unknown["P1_W"], plain["P1_W"])


def test_processes_find_what_one_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.shares._SENT", -10_000)  # so few rows are not worth it
    near = reference(Model.baseline(), points())
    models = [Model.baseline().with_effect("link_resistance", **{HEAD: x}) for x in (0.01, 0.02, 0.03)]
    cases = [(model, points()) for model in models]
    for one, two in zip(simulate_each(cases, near), simulate_each(cases, near, processes=2), strict=True):
        # rows solved beside others take the same steps, but for the last bits
        np.testing.assert_allclose(two["P1_W"], one["P1_W"], rtol=1e-9)
        assert two.state.shape == one.state.shape


def inverses_of(result: Result) -> NDArray[np.float64]:
    assert result.seed is not None
    assert result.seed.response is not None
    return result.seed.response.inverse


def test_a_response_of_another_model_leads_to_the_same_solutions() -> None:
    near = reference(Model.baseline(), points())
    warmer = Model.baseline().with_effect("link_resistance", **{HEAD: 0.2})
    (there,) = simulate_each([(warmer, points())], near)
    about = answering(near, warmer, there.state)
    assert not np.array_equal(inverses_of(about), inverses_of(near))
    further = [(Model.baseline().with_effect("link_resistance", **{HEAD: x}), points()) for x in (0.15, 0.25)]
    for one, other in zip(simulate_each(further, near), simulate_each(further, about), strict=True):
        # both end where a last step is short: what it is right to, relative
        np.testing.assert_allclose(other["P1_W"], one["P1_W"], rtol=1e-6)


def test_where_another_model_was_not_solved_the_response_is_that_of_the_neighbour() -> None:
    near = reference(Model.baseline(), points())
    unknown = np.full_like(simulate_each([(Model.baseline(), points())], near)[0].state, np.nan)
    about = answering(near, Model.baseline(), unknown)
    # differences over a thousandth of a unit, about states that agree to a last step
    np.testing.assert_allclose(inverses_of(about), inverses_of(near), rtol=1e-3, atol=1e-3)
