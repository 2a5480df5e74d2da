"""The plan: what is measured, in which order, and what is left out."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.errors import InputError
from bench.plan import Kind, Plan, make_plan, spread_out
from bench.prediction import Asked, Forecast
from tests.bench.fake_bench import bench_config, campaign_config, predict


def plan(seed: int = 1, ranges: dict[str, object] | None = None, **changes: object) -> Plan:
    settings = {"kind": "latin_hypercube", "points": 40, "reference_every": 10, **changes}
    campaign = campaign_config(plan=settings, seed=seed, ranges=ranges or {})
    return make_plan(campaign, bench_config(), predict, file="campaign.toml")


def test_standby_no_load_and_reference_come_first_and_the_reference_every_ten() -> None:
    kinds = [row.kind for row in plan().points]
    assert kinds[:5] == [Kind.STANDBY, Kind.STANDBY, Kind.NO_LOAD, Kind.NO_LOAD, Kind.REFERENCE]
    assert [index for index, kind in enumerate(kinds) if kind is Kind.REFERENCE] == [4, 15, 26, 37, 48]


def test_every_planned_point_is_feasible_and_the_rest_is_counted() -> None:
    made = plan(ranges={"D1": [0.0, 1.0], "D2": [0.0, 1.0]})
    assert all(row.D1 > row.D2 for row in made.points)
    assert Counter(row.kind for row in made.points)[Kind.LOAD] == 40
    # half of the square is feasible: of a hypercube of n points, n/2 within three of its deviations
    left_out = sum(made.infeasible.values())
    assert abs(left_out - made.tried / 2) < 3 * np.sqrt(made.tried) / 2
    assert f"{left_out} of {made.tried} set points tried are infeasible" in made.said()
    assert list(made.infeasible) == ["D1 and D2 carry at most … W"]


def test_the_seed_decides_points_and_order() -> None:
    assert plan(seed=3) == plan(seed=3)
    assert plan(seed=3) != plan(seed=4)


def test_random_order_keeps_power_and_time_apart() -> None:
    box = {"D1": [0.6, 0.9], "D2": [0.0, 0.3], "power_W": [200, 1500]}
    grid = {"kind": "grid", "points": None, "shape": [3, 3, 20], "reference_every": 0}

    def powers(order: str) -> list[float]:
        return [row.power_W for row in plan(ranges=box, order=order, **grid).points if row.kind is Kind.LOAD]

    given, random = powers("given"), powers("random")
    assert sorted(random) == sorted(given) == powers("power")
    steps = np.sign(np.diff(random))
    # a grid in order rises 19 times for each fall; of 179 random steps about half rise: 90 within 4 times 3.9
    assert abs((steps > 0).sum() - 90) < 4 * 3.9
    assert (np.diff(given) > 0).sum() == 9 * 19


def test_repeats_are_counted_in_the_order_measured() -> None:
    rows = [row for row in plan(points=5, repeats=3, reference_every=0).points if row.kind is Kind.LOAD]
    assert Counter(row.point for row in rows) == dict.fromkeys(range(5), 3)
    for point in range(5):
        assert [row.repeat for row in rows if row.point == point] == [0, 1, 2]


def test_a_grid_has_its_corners_and_its_feasible_part_only() -> None:
    made = plan(kind="grid", points=None, shape=[3, 3, 2], ranges={"D1": [0, 1], "D2": [0, 1]})
    assert (made.tried, sum(made.infeasible.values())) == (18, 12)  # D1 > D2 in 3 of 9
    assert {(row.D1, row.D2) for row in made.points if row.kind is Kind.LOAD} == {(0.5, 0), (1, 0), (1, 0.5)}


def test_a_point_above_the_limit_is_refused_by_name() -> None:
    points = [{"D1": 0.9, "D2": 0.1, "power_W": 500}, {"D1": 0.9, "D2": 0.1, "power_W": 5000}]
    with pytest.raises(
        InputError, match=r"campaign.toml: plan.set_points.1.power_W = 5000.0: at most .* 2200"
    ):
        plan(kind="points", points=None, set_points=points)


def test_ranges_above_the_limit_are_refused() -> None:
    with pytest.raises(InputError, match=r"ranges.power_W = 3000.0: at most limits.power_W = 2200"):
        plan(ranges={"power_W": [200, 3000]})


def test_a_csv_names_each_bad_cell_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("D1,D2,P_set_W\n0.9,0.1,500\n1.9,0.1,500\n0.9,0.1,much\n")
    with pytest.raises(InputError) as caught:
        plan(kind="points", points=None, file=path)
    assert [(p.line, p.field, p.value) for p in caught.value.problems] == [
        (3, "D1", "1.9"),
        (4, "P_set_W", "much"),
    ]


def test_a_csv_without_a_column_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("D1,P_set_W\n0.9,500\n")
    with pytest.raises(
        InputError, match="D2: column is missing; required are D1, D2, P_set_W; found: D1, P_set_W"
    ):
        plan(kind="points", points=None, file=path)


def test_far_from_each_other_goes_by_each_columns_own_range() -> None:
    middle, ends = (
        (0.65, 0.3, 1100.0),
        [(1.0, 0.3, 1100.0), (0.3, 0.3, 1100.0), (0.65, 0.3, 2000.0), (0.65, 0.3, 200.0)],
    )
    between = [(0.65, 0.3, 1400.0), (0.65, 0.3, 800.0)]  # 300 W away, a sixth of the range of power
    pool = np.array([*between, middle, *ends])
    chosen = spread_out(pool, 5)
    assert tuple(pool[chosen[0]]) == middle
    assert {tuple(pool[k]) for k in chosen[1:]} == set(ends)


def test_ranges_that_hold_next_to_nothing_feasible_are_refused() -> None:
    with pytest.raises(InputError) as caught:
        plan(ranges={"D1": [0.0, 0.3], "D2": [0.4, 0.9]})
    said = str(caught.value)
    assert "hold fewer than 40 feasible points in" in said
    assert "× D1 and D2 carry at most … W; narrow ranges.power_W, move ranges.D1 and D2" in said


def test_points_of_which_none_is_feasible_are_refused_with_each_reason_and_what_helps() -> None:
    points = [{"D1": 0.1, "D2": 0.5, "power_W": 500}, {"D1": 0.2, "D2": 0.5, "power_W": 500}]
    said = r"none of 2 set points is feasible: 2 × D1 and D2 carry at most … W; change its set points"
    with pytest.raises(InputError, match=said):
        plan(kind="points", points=None, set_points=points)


def test_an_infeasible_reference_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"plan.reference: is infeasible: D1 and D2 carry at most 0 W; choose"
    ):
        plan(reference={"D1": 0.1, "D2": 0.5, "power_W": 500})


@pytest.mark.parametrize(
    ("bench_file", "named"), [("lab/left.toml", "lab/left.toml"), ("", "bench 'fake bench'")]
)
def test_a_start_that_does_not_carry_the_power_is_named_with_its_file_and_how_much_it_carries(
    bench_file: str, named: str
) -> None:
    bench = bench_config(converter={"start_D1": 0.1, "start_D2": 0.5})
    with pytest.raises(InputError) as caught:
        make_plan(campaign_config(), bench, predict, file="campaign.toml", bench_file=bench_file)
    said = str(caught.value)
    assert said.startswith(f"{named}: converter.start_D1, start_D2 = (0.1, 0.5): must carry")
    assert said.endswith("the simulator says: D1 and D2 carry at most 0 W")


def test_points_predicted_beyond_the_limits_are_left_out_and_counted() -> None:
    def hot(asked: Asked) -> Forecast:
        known = predict(asked)
        return replace(known, columns=known.columns | {"T_heatsink_C": 25.0 + 0.04 * asked.power_W})

    settings = {"kind": "latin_hypercube", "points": 40, "heat_margin": 0.25}
    made = make_plan(campaign_config(plan=settings), bench_config(), hot, file="campaign.toml")
    # a rise of 65 K with a quarter more than predicted: 0.04 K/W · 1.25 · power at most 65 K
    assert 1200.0 < max(row.power_W for row in made.points) <= 1300.0
    assert made.infeasible["heatsink predicted too near its limit or above it"] > 0


@pytest.mark.parametrize(("margin", "most_W"), [(0.02, 980.39), (0.1, 909.09), (0.0, 1000.0)])
def test_points_keep_a_margin_of_power_and_current_to_the_limits(margin: float, most_W: float) -> None:
    """What is measured takes a little more than what is predicted, and one sample beyond a limit ends a campaign."""

    def lossless(asked: Asked) -> Forecast:
        known = predict(asked)
        return replace(known, columns=known.columns | {"P1_W": asked.power_W})

    powers = [900.0, 909.0, 910.0, 980.0, 981.0, 1000.0, 1001.0]
    points = [{"D1": 0.9, "D2": 0.0, "power_W": power_W} for power_W in powers]
    limits = {"voltage_V": 320, "current_A": 10, "power_W": 1100, "output_voltage_V": 160}
    plan = {"kind": "points", "set_points": points, "power_margin": margin}
    ranges = {"I2": 1000.0 / 140.0}
    bench = bench_config(limits=limits, analyzer={"resource": "fake", "ranges": ranges})
    made = make_plan(campaign_config(plan=plan), bench, lossless, file="campaign.toml")
    assert max(row.power_W for row in made.points) == max(p for p in powers if p <= most_W)


def test_points_beyond_a_fixed_range_or_the_links_peak_are_left_out_with_the_reason() -> None:
    analyzer = {"resource": "fake", "ranges": {"U1": 300.0, "I2": 5.0}}
    limits = {"voltage_V": 320, "current_A": 10, "power_W": 2200, "output_voltage_V": 160, "link_peak_A": 9.0}

    def with_link(asked: Asked) -> Forecast:
        forecast = predict(asked)
        return replace(forecast, columns=forecast.columns | {"I_L_pp_A": 20.0 * asked.D1})

    campaign = campaign_config(plan={"kind": "latin_hypercube", "points": 20})
    made = make_plan(
        campaign, bench_config(analyzer=analyzer, limits=limits), with_link, file="campaign.toml"
    )
    loaded = [row for row in made.points if row.kind is Kind.LOAD]
    assert max(row.power_W for row in loaded) <= 5.0 * 140.0
    assert max(row.D1 for row in loaded) <= 0.9  # half of 20 A times D1 at 9 A
    assert {"output current predicted too near the analyzer's range or above it",
            "peak link current predicted too near its limit or above it"} <= set(made.infeasible)  # fmt: skip
