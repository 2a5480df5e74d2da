"""Following on a bench whose everyday spread does not move the readings along a line."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from models.diagnosis.common_mode import CommonModes
from models.diagnosis.hypotheses import Fit
from models.diagnosis.refinery import Refinery, _taught
from models.diagnosis.signatures import Signature
from sim.effects.catalogue import effect
from sim.model import Model
from sim.prototype import prototype
from sim.spread import Spread
from tests.models.diagnosis.fabricated import LinearBench, joint_fit, refinery

Array = NDArray[np.float64]

READINGS = 24
SIGMA = np.full(READINGS, 0.3)
GROWING = np.linspace(5.0, 60.0, READINGS)  # W per Ohm
LINK = Signature(entry=effect("link_resistance"), slope=GROWING)
WAVE = 2.0 * np.sin(np.arange(READINGS))  # W, one sigma of the cable on its line
KINK = WAVE + 3.0 * np.cos(2.5 * np.arange(READINGS))  # W, what every sigma beyond one adds
CABLE = Spread(path="input_cable_Ohm", sigma=0.002, relative=False)
BASELINE_Ohm = Model.baseline().converter.input_cable_Ohm


def kinked(sigmas: float, sharp: float = 1.0) -> Array:
    """What a cable that is off by so many sigmas does to the readings, in W, with a kink so many times as sharp."""
    return np.asarray(WAVE * sigmas + sharp * KINK * max(sigmas - 1.0, 0.0))


@dataclass(frozen=True)
class KinkedBench(LinearBench):
    """A bench whose cable has a kink, as edges have that pass each other."""

    sharp: float = 1.0

    def _predicted(self, model: Model) -> Array:
        sigmas = (model.converter.input_cable_Ohm - BASELINE_Ohm) / CABLE.sigma
        return super()._predicted(model) + kinked(sigmas, self.sharp)


def bench(value: Array, sharp: float = 1.0) -> Refinery:
    """Its refinery, which knows the cable on its line."""
    linear = refinery(value, [LINK], SIGMA, WAVE[None])
    return replace(
        linear,
        known=replace(linear.known, modes=CommonModes.of((CABLE,), prototype()), spread_names=(CABLE.path,)),
        observations=KinkedBench(value, [LINK], sharp),  # type: ignore[arg-type]  # as much as a refinery needs
    )


def test_nothing_is_followed_as_far_as_its_spreads_gain() -> None:
    found = bench(kinked(1.4))
    (once,) = found.simulated([Fit.nothing(READINGS)])
    (nothing,) = found.followed([once])
    assert once.log_evidence < -70.0  # the line leads to 1.76 sigma, where the kink has long begun
    assert nothing.log_evidence > once.log_evidence + 40.0  # of the 67 that there are


def test_a_step_that_loses_goes_half_the_way_of_the_spreads_as_well() -> None:
    """The line leads to 1.56 sigma, and from there to 0.56, in turn; the cable is off by 1.2."""
    found = bench(kinked(1.2, 2.0), 2.0)
    (once,) = found.simulated([Fit.nothing(READINGS)])
    (nothing,) = found.followed([once])
    assert np.ravel(nothing.spreads) == pytest.approx([1.06], abs=0.01)  # 0.56 and a half of one more
    assert nothing.log_evidence > -50.0  # 298 and 96 behind at the two others


def learned(spreads: Array) -> float:
    """How much a slope changes by a step of two sigma on which the readings jump, and the spreads move by so many."""
    before = joint_fit({"link_resistance": GROWING}, 0.0 * GROWING, value=0.0)
    aimed = joint_fit({"link_resistance": GROWING}, 2.0 * GROWING, value=2.0)
    fit = replace(aimed, shift=aimed.shift + KINK, spreads=spreads)
    taught = _taught(fit, replace(before, spreads=np.zeros(2)), aimed, np.ones(1))
    return float(np.linalg.norm(taught.terms[0].slope - GROWING) / np.linalg.norm(KINK))


def test_a_slope_learns_its_share_of_the_way_only() -> None:
    # a step of two, squared, and one for what is not smooth
    assert learned(np.zeros(2)) == pytest.approx(2.0 / 5.0)
    assert learned(np.array([3.0, 4.0])) == pytest.approx(2.0 / 30.0)  # 25 of the way was the spreads'
