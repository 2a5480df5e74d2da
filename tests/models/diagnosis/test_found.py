"""What is searched, and of which rows: once where one cause is far ahead before anything is searched."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from models.diagnosis import found as found_
from models.diagnosis.found import Begun, find, leading_by_far
from models.diagnosis.hypotheses import Fit
from models.diagnosis.observations import observe
from models.diagnosis.search import search
from models.diagnosis.usable import Usable, usable_readings
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.prototype import prototype
from tests.models.diagnosis.virtual_campaign import simulated_campaign

BASELINE = Model.baseline()
ALONE = ["kind", "D1", "D2", "P2_W", "P1_W", "efficiency"]


def usable_of(frame: pd.DataFrame, without: frozenset[str] = frozenset()) -> Usable:
    whole = observe(frame, prototype())
    return usable_readings(whole, BASELINE, without, range(len(frame)))


def with_effects(**values: dict[str, float]) -> pd.DataFrame:
    model = BASELINE
    for name, value in values.items():
        model = model.with_effect(name, **value)
    return simulated_campaign(model, seed=1, count=40)


def of_effect(name: str, begun: Begun) -> Fit:
    """One effect on its tangent at first sight."""
    (fit,) = (fit for fit in begun.sight.tangents if fit.effects == (name,))
    return fit


@pytest.fixture(scope="module")
def larger_inductance() -> Usable:
    """It takes power from rows."""
    return usable_of(with_effects(leakage_inductance={"relative_error": 0.12}))


@pytest.fixture
def searched(monkeypatch: pytest.MonkeyPatch) -> list[Fit]:
    """The leading fit of every search."""
    leading = []

    def counted(refinery):
        fits = search(refinery)
        leading.append(max(fits, key=refinery.log_probability))
        return fits

    monkeypatch.setattr(found_, "search", counted)
    return leading


def test_a_cause_that_is_far_ahead_leaves_rows_out_before_the_search(
    larger_inductance: Usable, searched: list[Fit]
) -> None:
    found = find(larger_inductance, BASELINE, lambda _: None)
    assert [fit.effects for fit in searched] == [("leakage_inductance",)]
    rows = found.begun.usable.observations.row
    assert set(rows) < set(larger_inductance.observations.row)
    # those that the search leaves, too: nothing that it has carries less of them
    assert found.begun.without_edge_of(found.leading, found.setting.refinery) is None


def test_replicates_tell_the_noise_where_they_have_no_power_to_spare(larger_inductance: Usable) -> None:
    before = Begun.of(larger_inductance, BASELINE)
    cause = of_effect("leakage_inductance", before)
    without_D0 = [n for n in before.noise if n.channel != "D0"]
    told = [replace(n, sigma=0.5 * n.sigma) for n in without_D0]
    kept = before.without_edge_of(cause, before.sight.setting.refinery)
    assert kept is not None
    lost = larger_inductance.observations.of("D0")
    lost &= np.isin(
        larger_inductance.observations.row, kept.usable.observations.row
    )  # D0 near the limit alone
    usable = replace(
        larger_inductance,
        observations=larger_inductance.observations.take(~lost),
        known=larger_inductance.known.take(~lost),
    )
    begun = replace(Begun.of(usable, BASELINE), noise=[*told, *set(before.noise) - set(without_D0)])
    found = begun.without_edge_of(of_effect("leakage_inductance", begun), begun.sight.setting.refinery)
    assert found is not None
    assert "D0" not in [c.name for c in found.usable.observations.channels]
    assert found.noise == told


def test_a_cause_that_is_not_far_ahead_does_so_after_it(
    larger_inductance: Usable, searched: list[Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Begun, "far_ahead", None)
    said = list[str]()
    found = find(larger_inductance, BASELINE, said.append)
    found.fits  # noqa: B018  what the caller asks for
    assert [fit.effects for fit in searched] == [("leakage_inductance",)] * 2
    assert set(found.begun.usable.observations.row) < set(larger_inductance.observations.row)
    assert len(said) == 2


def test_what_was_far_ahead_and_does_not_lead_leaves_no_row_out(
    searched: list[Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    usable = usable_of(with_effects(link_resistance={"resistance_Ohm": 0.1}))
    wrong = of_effect("leakage_inductance", Begun.of(usable, BASELINE))
    wrong = wrong.moved(np.array([0.12 - wrong.terms[0].value]))
    monkeypatch.setattr(Begun, "far_ahead", wrong)
    found = find(usable, BASELINE, lambda _: None)
    assert found.begun.usable.observations is usable.observations
    assert [fit.effects for fit in searched] == [("link_resistance",)] * 2


def test_with_efficiency_alone_what_bends_is_known_after_the_search(
    searched: list[Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    usable = usable_of(with_effects(duty_offset={"offset": -0.02})[ALONE])
    ahead = of_effect("duty_offset", Begun.of(usable, BASELINE))
    monkeypatch.setattr(Begun, "far_ahead", ahead)
    found = find(usable, BASELINE, lambda _: None)
    assert found.leading.effects == ("duty_offset",)
    assert len(searched[0].shift) == usable.observations.value.size
    assert found.begun.usable.known.bends.shape[0] == 2


def test_far_ahead_is_what_no_other_cause_comes_near(larger_inductance: Usable) -> None:
    begun = Begun.of(larger_inductance, BASELINE)
    first, tangents = begun.far_ahead, begun.sight.tangents
    assert first is not None
    assert first.effects == ("leakage_inductance",)
    near = first.log_evidence - 9.0
    close = [replace(f, log_evidence=near) if f.effects == ("fan_step",) else f for f in tangents]
    assert leading_by_far(close) is None
    assert (
        leading_by_far([replace(f, log_evidence=f.log_evidence + 1e6 * (not f.terms)) for f in tangents])
        is None
    )


def test_readings_far_off_mislead_no_first_sight() -> None:
    frame = with_effects(leakage_inductance={"relative_error": 0.12})
    frame.loc[[5, 21], "P1_W"] *= 1.02  # more than any cause makes of it, in two rows
    ahead = Begun.of(usable_of(frame), BASELINE).far_ahead
    assert ahead is not None
    assert ahead.effects == ("leakage_inductance",)


def test_one_effect_that_is_left_is_searched() -> None:
    frame = with_effects(leakage_inductance={"relative_error": 0.12})
    without = frozenset(CATALOGUE) - {"leakage_inductance"}
    found = find(usable_of(frame, without), BASELINE, lambda _: None)
    assert found.leading.effects == ("leakage_inductance",)
