"""Verdicts from made-up probabilities, and isolability from made-up shifts."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.evidence import Hypothesis
from models.diagnosis.hypotheses import Fit
from models.diagnosis.leftover import Leftover
from models.diagnosis.unexplained import Unexplained
from models.diagnosis.verdict import BY_CHANCE, Verdict, isolability, judge, telling_of
from models.diagnosis.whitener import Whitener
from tests.models.diagnosis.fabricated import joint_fit

SIGMA = 0.5
WHITENER = Whitener.of(SIGMA**2 * np.eye(4))
ALONG, ACROSS = np.array([30.0, 0.0, 0.0, 0.0]), np.array([0.0, 40.0, 0.0, 0.0])

Entry = tuple[str | None, np.ndarray, float, float]


def _fit(effects: str | None, shift: np.ndarray) -> Fit:
    """A fit of "a + b": each an equal part of the shift."""
    names = effects.split(" + ") if effects else []
    return joint_fit({name: shift / len(names) for name in names}, shift)


def _leftover(amplitude: float) -> Leftover | None:
    return Leftover(location="input", amplitude=amplitude, columns=np.arange(0)) if amplitude else None


def judged(*entries: Entry, misfit: float = 1.0, leftover: float = 0.0) -> Verdict:
    """The verdict over (effects or None, shift, leftover in W, probability), in any order."""
    hypotheses = [
        Hypothesis(fit=_fit(effects, shift), leftover=_leftover(amplitude), probability=probability)
        for effects, shift, amplitude, probability in entries
    ]
    return judge(sorted(hypotheses, key=lambda h: -h.probability), WHITENER, misfit, leftover)


def test_identical_shifts_cannot_be_told_apart() -> None:
    assert isolability(ALONG, 3 * ALONG, WHITENER) == pytest.approx(0.0, abs=1e-5)  # root of a rounding error


def test_orthogonal_shifts_are_apart_by_their_length() -> None:
    assert isolability(ALONG, ACROSS, WHITENER) == pytest.approx(30.0 / SIGMA, rel=1e-12)
    assert isolability(ACROSS, ALONG, WHITENER) == pytest.approx(40.0 / SIGMA, rel=1e-12)


def test_one_cause_with_95_per_cent_is_named() -> None:
    verdict = judged(("link_resistance", ALONG, 0.0, 0.97), (None, 0 * ALONG, 0.0, 0.03))
    assert verdict.kind == "named"
    assert [c.effect for c in verdict.causes] == ["link_resistance"]
    assert verdict.groups == ()


def test_a_cause_counts_with_and_without_leftover() -> None:
    verdict = judged(("link_resistance", ALONG, 0.0, 0.5), ("link_resistance", ALONG, 1.5, 0.46),
                     (None, 0 * ALONG, 0.0, 0.04))  # fmt: skip
    assert verdict.kind == "named"
    assert verdict.causes[0].probability == pytest.approx(0.96)


def test_a_leftover_beside_a_name_is_said() -> None:
    fit = joint_fit({"link_resistance": ALONG}, ALONG, value=3.0)  # 30 sigmas from off
    named = Hypothesis(fit=fit, leftover=_leftover(1.5), probability=1.0)
    verdict = judge([named], WHITENER, leftover=15.0)
    assert (verdict.kind, verdict.unknown_probability) == ("named", 1.0)
    assert judge([named], WHITENER, leftover=7.0).unknown_probability == 0.0  # the model's own shortcomings


@pytest.mark.parametrize(("effect", "said_from"), [("link_resistance", 7.4), ("skin_effect", 11.0)])
def test_how_long_a_leftover_is_a_causes_own_goes_by_its_law(effect: str, said_from: float) -> None:
    fit = joint_fit({effect: ALONG}, ALONG, value=3.0)  # 60 sigmas of readings: of 2 % of them 1.2, of 15 % 9
    named = Hypothesis(fit=fit, leftover=_leftover(1.5), probability=1.0)
    for leftover, said in ((said_from - 0.1, 0.0), (said_from + 0.1, 1.0)):
        assert judge([named], WHITENER, leftover=leftover).unknown_probability == said


def test_what_only_laws_that_are_off_explain_is_listed_and_not_stated() -> None:
    sure = Hypothesis(fit=_fit("link_resistance", ALONG), leftover=None, probability=1.0)
    verdict = judge([sure], WHITENER, strained=True)
    assert (verdict.kind, verdict.stated, verdict.unknown_probability) == ("unknown", (), 1.0)
    assert [c.effect for c in verdict.causes] == ["link_resistance"]


def test_laws_that_are_off_are_no_fault() -> None:
    nothing = Hypothesis(fit=_fit(None, 0 * ALONG), leftover=None, probability=1.0)
    verdict = judge([nothing], WHITENER, strained=True)
    assert (verdict.kind, verdict.strained) == ("consistent", False)


def test_tied_causes_make_a_group() -> None:
    verdict = judged(("auxiliary_power", ALONG, 0.0, 0.6), ("analyzer_offset", ALONG, 0.0, 0.38),
                     (None, 0 * ALONG, 0.0, 0.02))  # fmt: skip
    assert verdict.kind == "group"
    assert verdict.groups == (("auxiliary_power", "analyzer_offset"),)
    assert verdict.causes[0].tied_with == ("analyzer_offset",)


@pytest.mark.parametrize(("instead", "kind"), [(0.02, "group"), (0.005, "named")])
def test_a_sure_cause_is_stated_with_what_could_be_there_instead(instead: float, kind: str) -> None:
    verdict = judged(("auxiliary_power", ALONG, 0.0, 1 - instead), ("analyzer_offset", ALONG, 0.0, instead))
    assert (verdict.kind, verdict.stated) == (kind, ("auxiliary_power",))


@pytest.mark.parametrize(
    ("behind", "sigma", "kind"), [(2.5, 0.1, "group"), (3.5, 0.1, "named"), (3.5, 0.01, "group")]
)
def test_what_readings_exclude_is_not_stated_beside_a_sure_cause(
    behind: float, sigma: float, kind: str
) -> None:
    """Evidence behind for what priors say of a value, ln 10 for one known ten times as well, is no reading's."""

    def known(effect: str, evidence: float, share: float) -> Fit:
        (term,) = joint_fit({effect: ALONG}, ALONG).terms
        term = replace(term, value=term.head.prior, sigma=share * term.head.prior)
        return Fit(terms=(term,), shift=ALONG, log_evidence=evidence)

    here, there = known("cable_resistance_input", 0.0, 0.1), known("cable_resistance_output", -behind, sigma)
    cases = ((here, 0.97), (there, 0.03))
    verdict = judge([Hypothesis(fit=fit, leftover=None, probability=p) for fit, p in cases], WHITENER)
    assert (verdict.kind, verdict.stated) == (kind, ("cable_resistance_input",))


def test_what_is_there_beside_a_sure_cause_is_not_there_instead() -> None:
    verdict = judged(
        ("auxiliary_power + analyzer_offset", ALONG, 0.0, 0.1), ("auxiliary_power", ALONG, 0.0, 0.9)
    )
    assert (verdict.kind, verdict.groups) == ("named", ())


def test_causes_that_the_data_leave_open_are_a_group_though_the_design_parts_them() -> None:
    verdict = judged(("auxiliary_power", ALONG, 0.0, 0.6), ("gate_delay_skew", ACROSS, 0.0, 0.38),
                     (None, 0 * ALONG, 0.0, 0.02))  # fmt: skip
    assert (verdict.kind, verdict.stated, verdict.left_open) == ("group", ("auxiliary_power",), True)
    assert verdict.groups == (("auxiliary_power", "gate_delay_skew"),)


def test_a_rival_that_the_design_parts_from_a_sure_cause_is_in_no_group() -> None:
    verdict = judged(("auxiliary_power", ALONG, 0.0, 0.96), ("gate_delay_skew", ACROSS, 0.0, 0.04))
    assert (verdict.kind, verdict.groups, verdict.left_open) == ("named", (), False)


def test_what_a_leftover_carries_is_left_open_to_no_group() -> None:
    entries = (("auxiliary_power", ALONG, 5.0, 0.6), ("gate_delay_skew", ACROSS, 0.0, 0.4))
    verdict = judged(*entries, leftover=15.0)
    assert (verdict.kind, verdict.groups) == ("unknown", ())


def test_what_is_there_beside_the_first_cause_is_not_what_the_data_leave_open() -> None:
    verdict = judged(("auxiliary_power + link_resistance", ALONG, 0.0, 0.5), ("auxiliary_power", ALONG, 0.0, 0.4),
                     ("gate_delay_skew", ACROSS, 0.0, 0.08), (None, 0 * ALONG, 0.0, 0.02))  # fmt: skip
    assert verdict.groups == (("auxiliary_power", "gate_delay_skew"),)


def test_a_leftover_that_is_large_but_not_probable_is_nothing_ordinary() -> None:
    entries = ((None, 0 * ALONG, 5.0, 0.4), ("link_resistance", ALONG, 0.0, 0.6))
    assert judged(*entries, leftover=4.0).kind == "consistent"
    verdict = judged(*entries, leftover=20.0)
    assert (verdict.kind, verdict.consistent_probability) == ("unknown", 0.0)
    assert verdict.unknown_probability == pytest.approx(0.4)


def test_an_unknown_says_how_probable_is_what_stands_in_the_way_of_a_name() -> None:
    fit = joint_fit({"link_resistance": ALONG}, ALONG)  # ten sigmas from off
    verdict = judge([Hypothesis(fit=fit, leftover=_leftover(1.5), probability=1.0)], WHITENER, leftover=9.0)
    assert (verdict.kind, verdict.unknown_probability) == ("unknown", 1.0)


def test_where_nothing_cannot_be_excluded_no_cause_is_named() -> None:
    verdict = judged(("link_resistance", ALONG, 0.0, 0.85), (None, 0 * ALONG, 0.0, 0.15))
    assert verdict.kind == "consistent"
    assert verdict.consistent_probability == pytest.approx(0.15)


def test_a_leftover_without_a_cause_is_unknown() -> None:
    entries = ((None, 0 * ALONG, 5.0, 0.9), ("link_resistance", ALONG, 5.0, 0.1))
    verdict = judged(*entries, leftover=40.0)
    assert verdict.kind == "unknown"
    assert judged(*entries, leftover=4.0).kind == "consistent"  # as faint as the model's own shortcomings
    assert verdict.unknown_probability == pytest.approx(1.0)


def test_a_gain_that_wanders_a_little_is_of_any_room() -> None:
    nothing = _fit(None, 0 * ALONG)
    for place, kind in (("gain over time", "consistent"), ("timing", "unknown")):
        leftover = Leftover(location=place, amplitude=0.5, columns=np.arange(0))
        hypothesis = Hypothesis(fit=nothing, leftover=leftover, probability=1.0)
        assert judge([hypothesis], WHITENER, leftover=9.0).kind == kind


@pytest.mark.parametrize(("place", "kind"), [("input", "unknown"), ("gain of I_L_rms_A", "named")])
def test_a_sensor_that_is_off_hides_no_cause(place: str, kind: str) -> None:
    fit = joint_fit({"link_resistance": ALONG}, ALONG, value=3.0)
    leftover = Leftover(location=place, amplitude=5.0, columns=np.arange(0))
    hypothesis = Hypothesis(fit=fit, leftover=leftover, probability=1.0)
    assert judge([hypothesis], WHITENER, leftover=2.0 * fit.terms[0].significance).kind == kind


def test_a_name_that_leaves_the_data_unexplained_is_not_given() -> None:
    entries = (("link_resistance", ALONG, 0.0, 0.97), (None, 0 * ALONG, 0.0, 0.03))
    assert judged(*entries, misfit=2.0).kind == "named"  # noise understated by a third: still a name
    assert judged(*entries, misfit=9.0).kind == "unknown"


def test_no_cause_explains_outliers_that_confirm_each_other() -> None:
    fit = joint_fit({"link_resistance": ALONG}, ALONG, value=3.0)
    named = [Hypothesis(fit=fit, leftover=None, probability=1.0)]
    assert judge(named, WHITENER, agreement=0.9 * BY_CHANCE).kind == "named"
    verdict = judge(named, WHITENER, agreement=1.1 * BY_CHANCE)
    assert (verdict.kind, verdict.stated, verdict.unknown_probability) == ("unknown", (), 1.0)
    assert [cause.effect for cause in verdict.causes] == ["link_resistance"]  # more is wrong than it explains


def test_two_causes_that_are_there_together_are_both_named() -> None:
    verdict = judged(
        ("auxiliary_power + link_resistance", ALONG, 0.0, 0.96), ("link_resistance", ALONG, 0.0, 0.04)
    )
    assert verdict.kind == "named"
    assert verdict.stated == ("link_resistance", "auxiliary_power")
    assert verdict.causes[0].probability == pytest.approx(1.0)


def test_a_sure_cause_stands_beside_a_pair_that_ties() -> None:
    verdict = judged(("auxiliary_power + link_resistance", ALONG, 0.0, 0.5),
                     ("analyzer_offset + link_resistance", ALONG, 0.0, 0.5))  # fmt: skip
    assert (verdict.kind, verdict.stated) == ("named", ("link_resistance",))
    assert set(verdict.groups[0]) == {"auxiliary_power", "analyzer_offset"}


def test_while_all_may_be_in_order_there_is_no_group() -> None:
    verdict = judged(("auxiliary_power", ALONG, 0.0, 0.5), ("analyzer_offset", ALONG, 0.0, 0.44),
                     (None, 0 * ALONG, 0.0, 0.06))  # fmt: skip
    assert (verdict.kind, verdict.groups) == ("consistent", ())


def test_a_cause_that_is_small_beside_what_is_left_over_is_not_named() -> None:
    entries = (("link_resistance", ALONG, 1.5, 0.99), (None, 0 * ALONG, 5.0, 0.01))
    assert judged(*entries, leftover=7.0).kind == "named"
    assert judged(*entries, leftover=13.0).kind == "unknown"  # the made-up values are 10 sigmas from off


@pytest.mark.parametrize(("leftover", "without", "kind"), [
    (12.0, 1e-60, "named"),  # odds of 16.6 sigmas; asked for are 1.25 times 12
    (12.0, 1e-40, "unknown"),  # 13.6 sigmas
    (10.0, 1e-40, "named"),  # what the law of any cause may leave
])  # fmt: skip
def test_a_cause_that_another_leftover_may_stand_for_is_not_named(
    leftover: float, without: float, kind: str
) -> None:
    fit = joint_fit({"link_resistance": ALONG}, ALONG, value=3.0)  # 30 sigmas from off
    rival = joint_fit({"skin_effect": ALONG}, ALONG)
    hypotheses = [
        Hypothesis(fit=fit, leftover=_leftover(1.5), probability=1.0),
        Hypothesis(fit=rival, leftover=_leftover(5.0), probability=without),
    ]
    assert judge(hypotheses, WHITENER, leftover=leftover).kind == kind


def test_a_cause_smaller_than_even_a_faint_leftover_is_not_named() -> None:
    fit = joint_fit({"link_resistance": ALONG}, ALONG)  # ten sigmas from off
    for leftover, kind in ((7.0, "named"), (9.0, "unknown")):
        assert judge([Hypothesis(fit=fit, leftover=_leftover(1.5), probability=1.0)], WHITENER,
                     leftover=leftover).kind == kind  # fmt: skip


def test_beside_a_name_a_cause_below_the_leftover_is_part_of_what_is_left() -> None:
    fit = joint_fit({"skin_effect": ALONG, "link_resistance": ACROSS}, ALONG + ACROSS)
    large = replace(fit.terms[0], value=3.0)  # 30 sigmas from off, the other one ten
    fit = replace(fit, terms=(large, fit.terms[1]))
    for leftover, listed, unknown in ((9.0, 2, 0.0), (10.5, 1, 1.0)):
        verdict = judge([Hypothesis(fit=fit, leftover=_leftover(1.5), probability=1.0)], WHITENER,
                        leftover=leftover)  # fmt: skip
        assert (len(verdict.causes), verdict.unknown_probability) == (listed, unknown)
        assert verdict.causes[0].effect == verdict.stated[0] == "skin_effect"


@pytest.mark.parametrize(("watts", "size", "said"), [(31.0, 6.0, 0.9), (29.0, 6.0, 0.0), (31.0, 4.0, 0.0)])
def test_what_is_left_is_said_where_it_carries_more_watts_than_the_name(
    watts: float, size: float, said: float
) -> None:
    named = judged(("leakage_inductance", ALONG, 0.0, 1.0))  # 30 W in the first reading
    first = np.array([0])
    left = Unexplained(location="input", rms_W=watts, formula="", explained=1.0, rows=first, readings=first,
                       watts=np.array([watts]), size=size, probability=0.9, at_place=0.9)  # fmt: skip
    assert telling_of(named, left).unknown_probability == said


@pytest.mark.parametrize(("beyond", "stated", "listed"), [(0.02, 1, 1), (0.9, 1, 2), (0.96, 2, 2)])
def test_beside_a_sure_cause_what_is_not_surely_beyond_the_line_is_not_stated(
    beyond: float, stated: int, listed: int
) -> None:
    far = joint_fit({"link_resistance": ALONG, "thermal_resistance": ACROSS}, ALONG + ACROSS)
    usual = replace(far, terms=(far.terms[0], replace(far.terms[1], value=0.05)))
    hypotheses = [
        Hypothesis(fit=fit, leftover=None, probability=probability)
        for fit, probability in ((far, beyond), (usual, 1.0 - beyond))
    ]
    verdict = judge(sorted(hypotheses, key=lambda h: -h.probability), WHITENER)
    assert (verdict.kind, len(verdict.stated)) == ("named", stated)
    assert verdict.stated[0] == "link_resistance"
    assert len(verdict.causes) == listed  # and what is rather ordinary not as hardly probable


def test_what_is_there_in_any_case_takes_no_others_place() -> None:
    """Neither in a group of the design, nor in one of the data: what stands beside it is stated."""
    both = joint_fit({"thermal_resistance": ACROSS, "link_resistance": ALONG}, ALONG + ACROSS)
    usual = replace(both.terms[0], value=0.05)
    for other, open_ in ((ALONG, False), (np.array([0.0, 0.0, 30.0, 0.0]), True)):
        sic = joint_fit({"sic_on_resistance": other}, other).terms[0]
        cases = (((both.terms[0], both.terms[1]), 0.51), ((usual, sic), 0.39), ((both.terms[0], sic), 0.1))
        hypotheses = [
            Hypothesis(fit=replace(both, terms=terms), leftover=None, probability=probability)
            for terms, probability in cases
        ]
        verdict = judge(hypotheses, WHITENER)
        assert verdict.groups == (("link_resistance", "sic_on_resistance"),)
        assert verdict.left_open == open_
        assert verdict.causes[0].effect == "thermal_resistance"  # likeliest, and listed


def test_what_the_data_leave_open_is_open_between_causes() -> None:
    """One that is there, and beyond the line with less than 95 %, leaves nothing open to another."""
    both = joint_fit({"thermal_resistance": ACROSS, "link_resistance": ALONG}, ALONG + ACROSS)
    usual = replace(both, terms=(replace(both.terms[0], value=0.05), both.terms[1]))
    far = replace(both, terms=both.terms[:1])
    verdict = judge(
        [
            Hypothesis(fit=fit, leftover=None, probability=probability)
            for fit, probability in ((far, 0.5), (usual, 0.46), (_fit(None, 0 * ALONG), 0.04))
        ],
        WHITENER,
    )
    assert (verdict.kind, verdict.stated) == ("unknown", ())
    assert [c.effect for c in verdict.causes] == ["thermal_resistance", "link_resistance"]


def test_what_is_rather_ordinary_is_not_stated_alone_either() -> None:
    """Beside a leftover that hides the only sure cause: nothing is named, and what is stated is always listed."""
    both = joint_fit({"link_resistance": ALONG, "thermal_resistance": ACROSS}, ALONG + ACROSS)
    usual = replace(both.terms[0], value=0.01, sigma=0.001)  # ten sigmas, and as large as on any bench
    short = replace(both.terms[1], value=1.0, sigma=0.25)  # four sigmas
    far = replace(usual, value=0.02)
    cases = ((0.96, (usual, short)), (0.03999, (usual,)), (0.00001, (far,)))
    hypotheses = [
        Hypothesis(fit=replace(both, terms=terms), leftover=_leftover(1.5), probability=probability)
        for probability, terms in cases
    ]
    verdict = judge(hypotheses, WHITENER, leftover=8.0)
    assert (verdict.kind, verdict.stated) == ("unknown", ())
    assert [cause.effect for cause in verdict.causes] == ["thermal_resistance"]


def test_what_is_tied_is_listed_though_most_of_it_is_ordinary() -> None:
    """Either cable, or the first with the second as large as on any bench."""
    first, second = (joint_fit({f"cable_resistance_{port}": ALONG}, ALONG) for port in ("input", "output"))
    usual = replace(second.terms[0], value=second.terms[0].head.tolerance)
    both = replace(first, terms=(*first.terms, usual))
    cases = ((first, 0.55), (both, 0.35), (second, 0.1))
    verdict = judge([Hypothesis(fit=fit, leftover=None, probability=p) for fit, p in cases], WHITENER)
    assert verdict.groups == (("cable_resistance_input", "cable_resistance_output"),)
    assert [round(cause.probability, 9) for cause in verdict.causes] == [0.9, 0.1]


@pytest.mark.parametrize(("beyond", "groups"), [(0.02, 0), (0.96, 1)])
def test_beside_a_sure_cause_two_that_are_ordinary_are_no_group(beyond: float, groups: int) -> None:
    """Surely one of two is there, as large as on any bench: only what is surely beyond that is said beside a name."""
    sure = joint_fit({"link_resistance": ALONG}, ALONG).terms[0]
    either = [
        joint_fit({name: ACROSS}, ACROSS).terms[0] for name in ("thermal_resistance", "sic_on_resistance")
    ]
    hypotheses = [
        Hypothesis(
            fit=replace(_fit(None, ALONG + ACROSS), terms=(sure, other)),
            leftover=None,
            probability=0.5 * probability,
        )
        for far in either
        for other, probability in ((far, beyond), (replace(far, value=0.01), 1.0 - beyond))
    ]
    verdict = judge(sorted(hypotheses, key=lambda h: -h.probability), WHITENER)
    assert (verdict.kind, verdict.stated) == ("named", ("link_resistance",))
    assert len(verdict.groups) == groups
