"""A diagnosis against a model that was extended before: what is found is what that model still gets wrong."""

import numpy as np
import pytest

from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from models.diagnosis.observations import observe
from models.diagnosis.signatures import signatures
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.prototype import prototype
from tests.models.diagnosis.virtual_campaign import simulated_campaign

TRUE_Ohm, MODELLED_Ohm = 0.15, 0.05


def with_resistance(resistance_Ohm: float) -> Model:
    return Model.baseline().with_effect("link_resistance", resistance_Ohm=resistance_Ohm)


def test_what_the_model_has_too_little_of_is_found_and_off_is_what_it_has() -> None:
    frame = simulated_campaign(with_resistance(TRUE_Ohm), seed=2, count=40)
    diagnosis = diagnose(load_measurements(frame), with_resistance(MODELLED_Ohm))
    assert diagnosis.verdict.stated == ("link_resistance",)
    (parameter,) = diagnosis.as_plain(ahead=False)["causes"][0]["parameters"]
    assert parameter["off"] == MODELLED_Ohm
    assert parameter["ci95"][0] < TRUE_Ohm < parameter["ci95"][1]
    extended = diagnosis.extended.effects["link_resistance"]["resistance_Ohm"]
    assert extended == pytest.approx(TRUE_Ohm, abs=0.02)  # the interval's half width


def test_what_the_model_has_already_is_no_cause() -> None:
    frame = simulated_campaign(with_resistance(TRUE_Ohm), seed=2, count=40)
    verdict = diagnose(load_measurements(frame), with_resistance(TRUE_Ohm)).verdict
    assert (verdict.kind, verdict.stated) == ("consistent", ())


def test_a_value_at_its_bound_is_varied_to_the_inside() -> None:
    upper = CATALOGUE["link_resistance"].headline.upper
    frame = simulated_campaign(with_resistance(0.3), seed=2, count=20)
    known = signatures(observe(frame, prototype()), with_resistance(upper), among=["link_resistance"])
    slope = next(s.slope for s in known.effects if s.effect == "link_resistance")
    assert (
        np.nanmedian(slope[observe(frame, prototype()).of("efficiency")]) > 0.0
    )  # less resistance, less input power


def test_a_threshold_that_the_model_has_is_not_tried_elsewhere() -> None:
    has = CATALOGUE["fan_step"].about({"power_W": 4.0, "threshold_C": 45.0})
    assert has.variants() == [{"threshold_C": 45.0}]
    assert (has.headline.off, CATALOGUE["fan_step"].headline.off) == (4.0, 0.0)


def test_a_part_that_is_scaled_already_spreads_by_as_much_more_as_it_is_scaled_further() -> None:
    half_more = CATALOGUE["sic_on_resistance"].about({"relative_error": 0.5})
    assert half_more.spread_at(0.5, 0.1) == pytest.approx(0.1)
    assert half_more.spread_at(2.0, 0.1) == pytest.approx(0.2)
