"""Whether readings far off are outliers: what two elements of the analyzer see alike is none."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.agreement import Confirmed, confirmed
from models.diagnosis.evidence import Hypothesis
from models.diagnosis.hypotheses import Fit
from models.diagnosis.noise import Replicates, estimate_noise
from models.diagnosis.observations import Observations, observe
from models.diagnosis.setting import FirstSight, leftovers_of, set_up
from models.diagnosis.signatures import Signatures, signatures
from models.diagnosis.verdict import BY_CHANCE
from sim.model import Model
from sim.prototype import prototype
from tests.models.diagnosis.virtual_campaign import simulated_campaign

ROW, ERROR_W = 7, 6.0  # dozens of sigmas of each channel
AHEAD = ("efficiency", "P_link1_W")
NOISE = {"efficiency": 0.05, "P_link1_W": 0.2, "P_link2_W": 0.2}


@pytest.fixture(scope="module")
def bench() -> tuple[Observations, Signatures]:
    """Forty points and eight of them again as the simulator has them, with noise, and its signatures."""
    observed = observe(simulated_campaign(Model.baseline(), seed=1, count=40), prototype())
    noise, value = np.random.default_rng(2), observed.value.copy()
    for name, sigma in NOISE.items():
        readings = observed.of(name)
        value[readings] += sigma * noise.standard_normal(int(readings.sum()))
    known = signatures(observed, Model.baseline())
    kept = known.finite()
    return replace(observed, value=value).take(kept), known.take(kept)


def found(bench: tuple[Observations, Signatures], *channels: str) -> list[Confirmed]:
    """What is confirmed beside nothing, with so many watts more in some channels of one row."""
    observations, known = bench
    off = np.any([observations.of(name) for name in channels], axis=0) & (observations.row == ROW)
    observations = replace(observations, value=observations.value + ERROR_W * off)
    noise = estimate_noise(observations, Replicates.of(observations), observations.value - known.baseline)
    rivals = leftovers_of(observations, Model.baseline(), known)
    setting = set_up(FirstSight.of(observations, Model.baseline(), known, noise, rivals))
    assert np.all(setting.sigma[off] > 3 * setting.usual[off])  # taken for outliers, all of them
    nothing = Hypothesis(fit=Fit.nothing(observations.value.size), leftover=None, probability=1.0)
    return [c for c in confirmed(setting, nothing) if c.sigma > BY_CHANCE]


def test_watts_that_both_elements_ahead_of_the_link_miss_are_no_outlier(
    bench: tuple[Observations, Signatures],
) -> None:
    (row,) = found(bench, *AHEAD)
    assert row.row == ROW
    assert row.sigma > 2 * BY_CHANCE
    assert row.watts == pytest.approx(ERROR_W, abs=0.6)  # of which noise and the prediction are a few tenths


@pytest.mark.parametrize(
    "channels",
    [("efficiency",), ("P_link1_W",), ("P_link2_W",), (*AHEAD, "P_link2_W")],
    ids=["input", "ahead of the link", "behind the link", "the output's own reading"],
)
def test_what_one_element_misses_or_all_alike_is_an_outlier(
    bench: tuple[Observations, Signatures], channels: tuple[str, ...]
) -> None:
    assert not found(bench, *channels)


def test_a_row_that_carries_no_watt_more_confirms_nothing(bench: tuple[Observations, Signatures]) -> None:
    observations, known = bench
    still = replace(known, per_watt=np.where(observations.row == ROW, 0.0, known.per_watt))
    with np.errstate(invalid="raise"):
        assert not found((observations, still), *AHEAD)
