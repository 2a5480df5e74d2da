"""Rounds of power and temperatures: what no loss could explain ends a point."""

from dataclasses import replace

import numpy as np

from sim.fixed_point import _possible
from sim.model import Model
from sim.operating_points import Points
from sim.prototype import prototype
from sim.simulate import simulate
from sim.station import station_of
from sim.steady_state import COARSE
from tests.sim.windings import never_flattening


def test_a_round_that_leaps_to_an_absurd_power_or_to_none_is_told() -> None:
    """Seen at the very most that can be carried: from 2196 W to half a megawatt, and then no number."""
    points = Points(D1=np.full(4, 0.8), D2=np.full(4, 0.2), power_W=np.array([0.0, 5.0, 600.0, 1500.0]))
    station = station_of(prototype(), points.with_voltages_of(prototype()), None)
    ahead = station.ahead(station.solve(COARSE))
    assert _possible(station, ahead).all()
    leap = np.array([0.0, 5e5, -5e5, np.nan])
    assert _possible(station, replace(ahead, target_W=ahead.target_W + leap)).tolist() == [
        True,
        False,
        False,
        False,
    ]


def test_losses_that_run_away_take_the_link_voltage_and_end_the_point() -> None:
    """Seen at the very most that can be carried, behind a long cable: 415 C and -4640 V. A point beside it runs."""
    points = Points(
        D1=0.702, D2=0.098, power_W=np.array([1955.62253497, 1900.0]), V1_V=300.03561435, V2_V=140.07725676
    )
    long = Model(converter=never_flattening(prototype())).with_effect(
        "cable_resistance_input", resistance_Ohm=0.15278640450004205
    )
    assert simulate(long, points).reason.tolist() == ["no steady state found", ""]
