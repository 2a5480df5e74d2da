"""What a search tries again on a linear bench."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis import search as searched
from models.diagnosis.hypotheses import Fit
from models.diagnosis.refinery import Refinery
from models.diagnosis.search import _crossed, _other_variants, _sharpened, _shorter, _to_sharpen, search
from models.diagnosis.signatures import Signature
from sim.effects.catalogue import effect
from tests.models.diagnosis.fabricated import fit_of, joint_fit, refinery

READINGS = 24
GROWING = np.linspace(5.0, 60.0, READINGS)  # W per Ohm
FLAT = np.ones(READINGS)
SIGMA = np.linspace(0.2, 0.4, READINGS)


def _weighed(bench: Refinery, fits: list[Fit]) -> list[Fit]:
    return [f.at(f.terms, w.log_evidence) for f, w in zip(fits, bench.weighed_all(fits), strict=True)]


@pytest.mark.parametrize("power_W", [0.0, 2.0])
def test_a_value_that_was_found_beside_a_faint_cause_is_tried_without_it(power_W: float) -> None:
    readings = 0.05 * GROWING + power_W + SIGMA * np.random.default_rng(11).standard_normal(READINGS)
    slopes = {"link_resistance": GROWING, "auxiliary_power": FLAT}
    bench = refinery(readings, [Signature(entry=effect(n), slope=s) for n, s in slopes.items()], SIGMA)
    at_off = joint_fit(slopes, 0.0 * FLAT, value=0.0)
    both, stuck = _weighed(
        bench,
        [at_off.moved(np.array([0.05, power_W])), at_off.without("auxiliary_power").moved(np.array([0.02]))],
    )
    found = _shorter(bench, [both], [stuck])
    assert [f.effects for f in found] == ([("link_resistance",)] if power_W == 0.0 else [])
    for fit in found:
        assert fit.terms[0].value == pytest.approx(0.05, abs=4 * bench.weighed(fit).sigma[0])
        assert fit.log_evidence > stuck.log_evidence + 10
        assert _shorter(bench, [both], found) == []  # known already


def test_what_gains_without_a_faint_cause_is_tried_without_the_next() -> None:
    readings = 0.05 * GROWING + SIGMA * np.random.default_rng(11).standard_normal(READINGS)
    slopes = {"link_resistance": GROWING, "auxiliary_power": FLAT, "analyzer_gain": (GROWING - 30.0) ** 2}
    bench = refinery(readings, [Signature(entry=effect(n), slope=s) for n, s in slopes.items()], SIGMA)
    at_off = joint_fit(slopes, 0.0 * FLAT, value=0.0)
    pairs = [at_off.without(name) for name in ("auxiliary_power", "analyzer_gain")]
    alone = pairs[0].without("analyzer_gain")
    stuck = [*(p.moved(np.array([0.02, 0.0])) for p in pairs), alone.moved(np.array([0.02]))]
    (whole,) = _weighed(bench, [at_off.moved(np.array([0.05, 0.0, 0.0]))])
    found = _shorter(bench, [whole], _weighed(bench, stuck))
    assert {f.effects for f in found} == {f.effects for f in stuck}
    (single,) = (f for f in found if len(f.terms) == 1)
    assert single.terms[0].value == pytest.approx(0.05, abs=4 * bench.weighed(single).sigma[0])


def test_the_search_goes_on_from_what_a_faint_cause_led_to(monkeypatch: pytest.MonkeyPatch) -> None:
    readings = 0.05 * GROWING + SIGMA * np.random.default_rng(11).standard_normal(READINGS)
    slopes = {"link_resistance": GROWING, "auxiliary_power": FLAT}
    bench = refinery(readings, [Signature(entry=effect(n), slope=s) for n, s in slopes.items()], SIGMA)
    at_off = joint_fit(slopes, 0.0 * FLAT, value=0.0)
    nothing, stuck, both = _weighed(
        bench,
        [
            Fit.nothing(READINGS),
            at_off.without("auxiliary_power").moved(np.array([0.02])),
            at_off.moved(np.array([0.05, 0.0])),
        ],
    )
    monkeypatch.setattr(searched, "_alone", lambda *_: ([nothing, stuck], []))
    monkeypatch.setattr(searched, "_larger", lambda *args: [both] if args[3] == 2 else [])
    monkeypatch.setattr(searched, "_sharpened", lambda _, fits: fits)  # each as it came
    alone = next(f for f in search(bench) if f.effects == ("link_resistance",))
    assert alone.terms[0].value == pytest.approx(0.05, abs=4 * bench.weighed(alone).sigma[0])


@pytest.mark.parametrize(("sigmas", "named"), [(10.0, True), (2.0, False)])
def test_a_part_beyond_the_line_is_tried_as_a_cause_whatever_tangents_promise(
    sigmas: float, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    auxiliary = effect("auxiliary_power")
    usual = auxiliary.headline.tolerance
    readings = (
        0.05 * GROWING + sigmas * usual + 0.1 * SIGMA * np.random.default_rng(11).standard_normal(READINGS)
    )
    slopes = {"link_resistance": GROWING, "auxiliary_power": FLAT}
    effects = [Signature(entry=effect(n), slope=s) for n, s in slopes.items()]
    plain = refinery(readings, effects, 0.1 * SIGMA, usual * FLAT[None])
    bench = replace(plain, known=replace(plain.known, spread_names=("auxiliary_power",)))
    monkeypatch.setattr(searched, "_on_tangents", lambda *_: [])
    pairs = [fit for fit in search(bench) if len(fit.terms) == 2]
    assert [fit.effects for fit in pairs] == [("auxiliary_power", "link_resistance")] * named
    for fit in pairs:
        # a tenth of a sigma of the part at the worst
        assert fit.term("auxiliary_power").value == pytest.approx(sigmas * usual, abs=0.5 * usual)


@pytest.mark.parametrize("name", ["fan_step", "warm_up_drift"])
def test_every_variant_of_what_is_chosen_is_followed_and_no_second_line(name: str) -> None:
    along = np.array([1.0, 0.0])
    chosen, other = fit_of(name, along, value=0.3), fit_of(name, along, value=0.6)
    lines = [fit_of("link_resistance", along, value=v) for v in (0.02, 0.04)]
    (found,) = _other_variants([chosen, lines[0]], [chosen, other, *lines])
    assert found is other


def test_a_threshold_whose_rows_were_moved_by_heat_is_tried_elsewhere() -> None:
    fans = [
        Signature(entry=effect("fan_step"), other={"threshold_C": at}, slope=FLAT * (at < GROWING))
        for at in (30, 35, 40)
    ]
    fit = joint_fit({"thermal_resistance": GROWING, "fan_step": FLAT}, GROWING)
    line = replace(fit, terms=(fit.terms[0], replace(fit.terms[1], signature=fans[1])), log_evidence=0.0)
    near, far = replace(line, log_evidence=-20.0), replace(line, log_evidence=-500.0)
    assert _crossed([line], [near], fans) == []
    assert [f.terms[1].signature for f in _crossed([line], [far], fans)] == [fans[0], fans[2]]


def test_what_comes_in_reach_of_a_best_that_was_too_likely_is_simulated_anew_too() -> None:
    """Slopes too shallow by twenty leave values open, which counts as likely: 3 in log evidence of each."""
    readings = 0.05 * GROWING + SIGMA * np.random.default_rng(10).standard_normal(READINGS)
    slopes = {"link_resistance": GROWING, "auxiliary_power": FLAT}
    bench = refinery(readings, [Signature(entry=effect(n), slope=s) for n, s in slopes.items()], SIGMA)
    right = joint_fit(slopes, 0.05 * (GROWING + FLAT), value=0.05)
    both = replace(right, terms=(replace(right.terms[0], slope=0.05 * GROWING), right.terms[1]))
    link = replace(both, terms=both.terms[:1], shift=0.05 * GROWING, log_evidence=0.0)
    nothing = replace(Fit.nothing(READINGS), log_evidence=-100.0)
    _, *sharp = _sharpened(bench, [nothing, link, replace(both, log_evidence=-3.5)])
    assert {fit.effects for fit in sharp} == {link.effects, both.effects}
    for fit in sharp:
        np.testing.assert_allclose(fit.terms[0].slope, GROWING, rtol=1e-9)  # the bench is linear


def test_what_is_all_but_in_reach_is_simulated_anew_with_what_is() -> None:
    slopes = {"link_resistance": GROWING, "auxiliary_power": FLAT}
    bench = refinery(0.05 * GROWING, [Signature(entry=effect(n), slope=s) for n, s in slopes.items()], SIGMA)
    both = joint_fit(slopes, 0.05 * (GROWING + FLAT), value=0.05)
    link = replace(both, terms=both.terms[:1], log_evidence=0.0)
    nothing = replace(Fit.nothing(READINGS), log_evidence=-100.0)

    def behind(by: float) -> Fit:
        return replace(both, log_evidence=bench.log_prior(link) - bench.log_prior(both) - by)

    # in log probability: 3 is in reach for one cause more, and 0.5 further off goes along
    near, far = behind(3.4), behind(3.6)
    assert _to_sharpen(bench, [], [nothing, link, near]) == [link, near]
    assert _to_sharpen(bench, [], [nothing, link, far]) == [link]
    assert _to_sharpen(bench, [link], [nothing, near]) == []
