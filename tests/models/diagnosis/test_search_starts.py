"""Where an effect is far from a line, the search starts at several of its values."""

import pytest

from experiments.blind.trial import BlindTrial, efficiency_table, measured
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose


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


@pytest.mark.parametrize(
    ("seed", "design", "points", "inductance_H"),
    [
        (190003, None, 400, 2.0e-3),
        # where its line is 145 behind nothing, and the simulator 130 ahead
        (3000490, 3095004, 100, 3.08e-3),
    ],
)
def test_what_is_far_from_a_line_is_tried_though_that_falls_behind(
    seed: int, design: int | None, points: int, inductance_H: float
) -> None:
    """What a line misses grows with the rows; where the search starts is tried all the same."""
    hidden = (("magnetizing_inductance", inductance_H),)
    trial = BlindTrial(row="single", seed=seed, hidden=hidden, design=design, points=points)
    assert diagnose(load_measurements(measured(trial))).verdict.stated == ("magnetizing_inductance",)
