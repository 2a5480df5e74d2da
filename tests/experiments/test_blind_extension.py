"""The true effect that an extension is compared with."""

import numpy as np

from drivers.mocks.lab.laboratory import DRIFT_S
from experiments.blind.extension import true_model
from sim.model import Model
from sim.operating_points import Points
from sim.simulate import reference, simulate


def test_the_true_effect_is_the_labs_in_all_its_parameters() -> None:
    """A drift that slows down over the campaign is no straight line: fitted to its first half it holds in the other."""
    points = Points(D1=0.8, D2=0.1, power_W=np.full(14, 900.0), time_s=1800.0 * np.arange(14.0))
    hidden = {"relative_loss_at_end": 0.1, "time_constant_s": DRIFT_S}
    shown = simulate(Model.baseline().with_effect("warm_up_drift", **hidden), points)
    fitted = true_model(
        "warm_up_drift", reference(Model.baseline(), points), shown["P1_W"], np.arange(14) < 7
    )
    found = simulate(fitted, points)
    # the fit's own tolerance, a thousandth of the prior scale of 0.1, is 2 mW of 16 W; a straight line misses by 0.5 W
    np.testing.assert_allclose(found["P1_W"], shown["P1_W"], rtol=0.0, atol=4e-3)
