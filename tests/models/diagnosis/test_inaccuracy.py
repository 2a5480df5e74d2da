"""The simulation's own inaccuracy: each loss part is seen by the channels behind it, and scales with the converter."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.model_file import read_model
from models.diagnosis.inaccuracy import inaccuracy, of_laws
from models.diagnosis.observations import Observations, observe
from sim.losses import missing_losses
from sim.modulation import EDGES
from sim.prototype import prototype
from sim.simulate import Points, Result
from tests.models.diagnosis.fabricated import CHANNEL

OTHER = Path(__file__).parents[3] / "docs" / "examples" / "two_level_dab.toml"
CHANNELS = ("efficiency", "P_link1_W", "P_link2_W")


def readings() -> Observations:
    """Three powers of one loaded row."""
    row = {
        "D1": 0.9,
        "D2": 0.1,
        "P2_W": 500.0,
        "kind": "load",
        "P1_W": 520.0,
        "P_link1_W": 515.0,
        "P_link2_W": 505.0,
    }
    return observe(pd.DataFrame([row]), prototype())


def lost_in(part: str, **missing: float) -> Result:
    """A simulation that loses 10 W in one part, with edges that miss these shares of their swings."""
    points = Points(D1=np.array([0.9]), D2=np.array([0.1]), power_W=np.array([500.0]))
    values = {f"missing_{edge}": np.array([missing.get(edge, 0.0)]) for edge in EDGES}
    values[f"loss_{part}_W"] = np.array([10.0])
    return Result(points=points, feasible=np.array([True]), reason=np.array([""]), values=values)


@pytest.mark.parametrize(
    ("part", "law", "shown_by"),
    [("primary_inner_conduction", 0.01, 1), ("transformer_core", 0.03, 2), ("secondary_conduction", 0.01, 3)],
)
def test_a_part_is_seen_by_the_channels_behind_it(part: str, law: float, shown_by: int) -> None:
    smooth, at_edges, cut_short = inaccuracy(readings(), lost_in(part), prototype())
    own = np.array([CHANNEL[name].accuracy for name in CHANNELS])
    extra = np.where(np.arange(3) < shown_by, 10.0 * law, 0.0)
    np.testing.assert_allclose(smooth, np.hypot(own, extra), rtol=1e-12)
    assert not np.any(at_edges)
    assert not np.any(cut_short)


@pytest.mark.parametrize(
    ("part", "sensor", "law_K"),
    [
        ("primary_inner_conduction", "T_heatsink_C", 0.1),  # 1 % of 10 W into 1 K/W
        ("secondary_conduction", "T_heatsink_C", 0.1),
        ("transformer_core", "T_transformer_C", 1.5),  # 3 % into 5 K/W
        ("inductor_copper", "T_inductor_C", 0.7),  # 1 % into 7 K/W
    ],
)
def test_a_part_is_as_unsure_in_the_heat_that_it_makes(part: str, sensor: str, law_K: float) -> None:
    sensors = ["T_heatsink_C", "T_transformer_C", "T_inductor_C"]
    row = {"D1": 0.9, "D2": 0.1, "P2_W": 500.0, "kind": "load", **dict.fromkeys(sensors, 40.0)}
    smooth, *_ = inaccuracy(observe(pd.DataFrame([row]), prototype()), lost_in(part), prototype())
    own = np.array([CHANNEL[name].accuracy for name in sensors])
    extra = np.where(np.array(sensors) == sensor, law_K, 0.0)
    np.testing.assert_allclose(smooth, np.hypot(own, extra), rtol=1e-12)


def test_an_edge_is_as_unsure_in_the_heat_that_it_makes() -> None:
    row = {"D1": 0.9, "D2": 0.1, "P2_W": 500.0, "kind": "load", "P1_W": 520.0, "T_heatsink_C": 40.0}
    hot = replace(prototype(), heatsink_K_per_W=2.5)
    near = lost_in("primary_outer_switching", primary_fall=0.5)
    of_power, of_heat = inaccuracy(observe(pd.DataFrame([row]), hot), near, hot)[2]
    assert of_power > 1.0  # W: a tenth of what is switched, beside half of what the rest costs
    assert of_heat == pytest.approx(2.5 * of_power, rel=1e-12)


def test_what_happens_at_edges_may_also_change_over_a_short_way() -> None:
    _, at_edges, _ = inaccuracy(readings(), lost_in("primary_outer_switching"), prototype())
    np.testing.assert_allclose(at_edges, [0.5, 0.0, 0.0], rtol=1e-12)  # 5 % of 10 W


@pytest.mark.parametrize(("edge", "shown_by"), [("primary_fall", 1), ("secondary_lead", 3)])
def test_half_of_what_the_rest_of_a_swing_costs_is_doubted(edge: str, shown_by: int) -> None:
    near = lost_in("primary_conduction", **{edge: 0.5})
    missing = np.where(np.array(EDGES) == edge, 0.5, 0.0)[:, None]
    lost_W = missing_losses(prototype(), missing, np.array([300.0]), np.array([140.0])).sum()
    *_, cut_short = inaccuracy(readings(), near, prototype())
    assert lost_W > 0.05
    np.testing.assert_allclose(cut_short, np.where(np.arange(3) < shown_by, 0.5 * lost_W, 0.0), rtol=1e-12)


def test_a_tenth_of_what_the_bridge_switches_is_doubted_beside_it() -> None:
    quiet, loud = (
        inaccuracy(readings(), lost_in(f"primary_{part}", primary_fall=0.5), prototype())[2, 0]
        for part in ("conduction", "outer_switching")
    )
    assert loud == pytest.approx(np.hypot(quiet, 1.0), rel=1e-12)  # 10 W are switched
    other = inaccuracy(readings(), lost_in("primary_outer_switching", secondary_lead=0.5), prototype())
    assert other[2, 0] < 0.1


@pytest.mark.parametrize("missing", [0.0, 0.005, 0.995, 1.0])
def test_an_edge_that_is_soft_or_hard_all_the_way_is_known_better(missing: float) -> None:
    near = lost_in("primary_outer_switching", primary_fall=missing)
    assert not np.any(inaccuracy(readings(), near, prototype())[2])


def test_a_law_over_the_whole_map_is_one_of_the_input_power() -> None:
    (law_W,) = of_laws(readings(), lost_in("transformer_core"))
    np.testing.assert_allclose(law_W, [0.3, 0.0, 0.0], rtol=1e-12)  # 3 % of 10 W


def test_channels_scale_with_the_converter() -> None:
    small, channel = read_model(OTHER).converter, CHANNEL["P_link1_W"]
    assert channel.of(small).floor == pytest.approx(channel.floor * small.rated_power_W / 2000.0)
    current = CHANNEL["I_L_rms_A"]
    rated_A = small.rated_power_W / small.V1_V
    assert current.of(small).accuracy == pytest.approx(current.accuracy * rated_A / (2000.0 / 300.0))
    assert replace(channel, floor=1.0) == channel  # one channel is one, however large its converter
