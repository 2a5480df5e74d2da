"""Where an effect is far from a line, the search starts at several of its values."""

import numpy as np
import pytest

from experiments.blind.trial import BlindTrial, efficiency_table, measured
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from models.diagnosis.search import _not_far_behind
from models.diagnosis.signatures import Signature
from sim.effects.catalogue import effect
from tests.models.diagnosis.fabricated import fit_of, refinery


def test_a_choke_that_saturates_is_found_where_its_line_leads_nowhere() -> None:
    trial = BlindTrial(
        row="efficiency_only",
        seed=1770300,
        hidden=(("inductor_saturation", 0.268),),
        efficiency_only=True,
        design=1795000,
    )
    found = diagnose(load_measurements(efficiency_table(measured(trial))))
    assert found.verdict.stated == ("inductor_saturation",)
    low, high = found.as_plain(ahead=False)["causes"][0]["parameters"][0]["ci95"]
    assert low < 0.268 < high
    assert high - low < 0.268  # one sigma of the law is a tenth: known to half of itself at the worst


def test_what_is_far_from_a_line_is_tried_though_that_falls_behind() -> None:
    """Its line is 145 behind nothing here, and the simulator 130 ahead."""
    hidden = (("magnetizing_inductance", 3.08e-3),)
    trial = BlindTrial(row="single", seed=3000490, hidden=hidden, design=3095004)
    assert diagnose(load_measurements(measured(trial))).verdict.stated == ("magnetizing_inductance",)


@pytest.mark.parametrize(
    ("value", "seed", "design"),
    [
        # its line promises 46 more than nothing at 0.101, is 40 behind it there, and the simulator 80 ahead at 0.072
        (0.07932836526948904, 3470002, 3495002),
        # the simulator is 107 ahead of nothing at 0.078, and led there from 0.025, where it is 248 behind
        (0.06420413570161683, 3770191, 3795005),
    ],
)
def test_where_a_line_overshoots_to_a_place_that_no_step_leads_back_from_it_starts_again_on_the_way(
    value: float, seed: int, design: int
) -> None:
    hidden = (("leakage_inductance", value),)
    trial = BlindTrial(row="efficiency_only", seed=seed, hidden=hidden, efficiency_only=True, design=design)
    found = diagnose(load_measurements(efficiency_table(measured(trial))))
    assert found.verdict.stated == ("leakage_inductance",)


@pytest.mark.parametrize(("readings", "tried"), [(800, False), (1300, True)])
def test_the_more_readings_the_further_a_line_may_fall_behind(readings: int, tried: bool) -> None:
    flat = np.ones(readings)
    signature = Signature(entry=effect("magnetizing_inductance"), slope=flat)
    bench = refinery(np.zeros(readings), [signature], flat)
    behind = fit_of(
        "magnetizing_inductance", np.sqrt(600.0 / readings) * flat
    )  # 300 in log evidence without a step
    (weighed,) = bench.weighed_all([behind])
    found = _not_far_behind(bench, [behind], nothing=weighed.log_evidence + 300.0)
    assert bool(found) is tried  # 200, or a quarter of each reading
