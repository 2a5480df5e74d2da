"""What an effect on several parts takes the place of, and what stays everyday beside it."""

from dataclasses import replace

import numpy as np
import pytest

from models.dataset import load_measurements
from models.diagnosis.common_mode import CommonModes
from models.diagnosis.diagnose import diagnose
from models.diagnosis.hypotheses import Fit, Term
from models.diagnosis.observations import observe
from models.diagnosis.signatures import Signatures, signatures
from sim.effects.catalogue import effect
from sim.model import Model
from sim.parameters import leaves
from sim.prototype import prototype
from sim.spread import everyday_spread, shifted_together
from tests.models.diagnosis.fabricated import refinery
from tests.models.diagnosis.virtual_campaign import simulated_campaign

SPREADS = everyday_spread(prototype())
MODES = CommonModes.of(SPREADS, prototype())
TOGETHER = ["skin_effect", "sic_on_resistance", "turn_off_energy_primary", "output_capacitance"]


def test_the_axes_are_turned_and_nothing_else() -> None:
    # rounding of some ten sums
    np.testing.assert_allclose(MODES.axes @ MODES.axes.T, np.eye(len(MODES)), atol=1e-14)
    parts = np.random.default_rng(1).standard_normal(len(MODES))
    np.testing.assert_allclose(MODES.parts(MODES.along(parts)), parts, atol=1e-14)
    assert len(set(MODES.names)) == len(MODES)


@pytest.mark.parametrize("name", TOGETHER)
def test_a_step_along_the_common_axis_is_a_little_of_the_effect(name: str) -> None:
    along = np.zeros(len(MODES))
    along[MODES.names.index(name)] = 1.0
    parts = MODES.parts(along)
    moved = leaves(shifted_together(prototype(), zip(SPREADS, parts.tolist(), strict=True)))
    headline = effect(name).headline.name
    there = leaves(Model.baseline().with_effect(name, **{headline: 0.1}).altered_converter())
    before = leaves(prototype())
    changed = [path for path in before if before[path] != there[path]]
    assert changed == [path for path in before if before[path] != moved[path]]
    shares = [(moved[p] - before[p]) / (there[p] - before[p]) for p in changed]  # type: ignore[operator]
    np.testing.assert_allclose(shares, shares[0], rtol=1e-9)  # rounding
    assert shares[0] > 0


def test_a_diode_that_recovers_nothing_is_no_part() -> None:
    plain = prototype()
    clamp = replace(plain.three_level.clamp, recovery=replace(plain.three_level.clamp.recovery, charge_C=0.0))
    schottky = replace(plain, primary=replace(plain.three_level, clamp=clamp))
    modes = CommonModes.of(everyday_spread(schottky), schottky)
    own = modes.axes[modes.names.index("reverse_recovery")]
    assert [modes.spreads[k].path for k in np.flatnonzero(own)] == [
        "primary.outer.recovery.charge_C",
        "secondary.switch.recovery.charge_C",
    ]


@pytest.fixture(scope="module")
def known() -> Signatures:
    frame = simulated_campaign(Model.baseline(), seed=1, count=30)
    return signatures(observe(frame, prototype()), Model.baseline())


def test_an_effect_takes_the_place_of_what_its_parts_have_in_common(known: Signatures) -> None:
    (own,) = known.own_spreads("sic_on_resistance")
    (signature,) = (s for s in known.effects if s.effect == "sic_on_resistance")
    common = known.spreads[own]
    shape = common / np.linalg.norm(common) - signature.slope / np.linalg.norm(signature.slope)
    assert np.linalg.norm(shape) < 0.02  # one is straight over 3.5 %, the other over 8 % of the resistance


def test_what_parts_are_off_by_moves_readings_as_the_simulator_says(known: Signatures) -> None:
    frame = simulated_campaign(Model.baseline(), seed=1, count=30)
    sigmas = np.where([s.path.endswith("on.resistance_Ohm") for s in SPREADS], [0.5, -0.5] * 42 + [0.5], 0.0)
    off = shifted_together(prototype(), zip(SPREADS, sigmas.tolist(), strict=True))
    ((seen, _),) = observe(frame, prototype()).solved([replace(Model.baseline(), converter=off)])
    moved = seen - known.baseline
    # what is not linear in half a sigma
    np.testing.assert_allclose(known.moved(sigmas), moved, atol=0.05 * np.max(np.abs(moved)))


@pytest.mark.parametrize("apart", [-1.5, 1.5])
def test_parts_that_differ_as_any_two_do_are_one_cause_together(apart: float) -> None:
    own = [s for s in SPREADS if s.path.endswith("capacitance.zero_bias_F") and "inner" not in s.path]
    off = [(s, apart if s.path.startswith("secondary") else -apart) for s in own if "clamp" not in s.path]
    truth = replace(Model.baseline(), converter=shifted_together(prototype(), off))
    frame = simulated_campaign(truth.with_effect("output_capacitance", relative_error=0.8), seed=3, count=60)
    noise = 1 + 1.5e-4 * np.random.default_rng(3).standard_normal(len(frame))
    frame = frame.assign(P1_W=frame["P1_W"] * noise, efficiency=frame["efficiency"] / noise)
    alone = load_measurements(frame[["kind", "time_s", "D1", "D2", "P1_W", "P2_W", "efficiency"]])
    found = diagnose(alone)
    assert found.verdict.stated == ("output_capacitance",)
    (cause, *_) = found.verdict.causes
    assert abs(cause.term.value - 0.8) < 2 * cause.term.sigma


RECOVERY = [s for s in SPREADS if s.path.endswith("recovery.charge_C") and "inner" not in s.path]
APART = [(s, sigmas) for s, sigmas in zip(RECOVERY, (1.0, -1.0, 0.5), strict=True)]


def with_recovery(apart: bool) -> Model:
    converter = shifted_together(prototype(), APART) if apart else prototype()
    return replace(Model.baseline(), converter=converter).with_effect("reverse_recovery", relative_error=5.0)


def test_what_an_effect_makes_more_of_differs_by_more(known: Signatures) -> None:
    frame = simulated_campaign(Model.baseline(), seed=1, count=30)
    parts = np.array([{s.path: z for s, z in APART}.get(s.path, 0.0) for s in SPREADS])
    differences = known.modes.differences("reverse_recovery")
    along = known.modes.along(parts)
    along[~np.isin(np.arange(along.size), differences)] = 0.0  # what they have in common is the effect
    parts = known.modes.parts(along)
    (even, _), (uneven, _) = observe(frame, prototype()).solved(
        [
            with_recovery(apart=False),
            replace(
                with_recovery(apart=False),
                converter=shifted_together(prototype(), zip(SPREADS, parts.tolist(), strict=True)),
            ),
        ]
    )
    (signature,) = (s for s in known.effects if s.effect == "reverse_recovery")
    term = Term(signature=signature, value=5.0, sigma=0.1, slope=signature.slope)
    bench = replace(refinery(known.baseline, [], np.ones(known.baseline.size)), known=known)
    moved = known.moved(parts, bench.larger(Fit(terms=(term,), shift=np.zeros(known.baseline.size))))
    # on straight lines, but for what more heat does to charges: a tenth
    np.testing.assert_allclose(moved, uneven - even, atol=0.15 * np.max(np.abs(moved)))


def test_a_large_effect_on_parts_that_differ_is_found_where_it_is() -> None:
    """Steps that took their difference for as large as without the effect would go six times as far as they aim."""
    frame = simulated_campaign(with_recovery(apart=True), seed=3, count=60)
    noise = 1 + 1.5e-4 * np.random.default_rng(3).standard_normal(len(frame))
    found = diagnose(
        load_measurements(frame.assign(P1_W=frame["P1_W"] * noise, efficiency=frame["efficiency"] / noise))
    )
    assert found.verdict.stated == ("reverse_recovery",)
    assert found.verdict.unknown_probability < 0.05  # what is worth a word beside a name
    refinery, (cause, *_) = found.refinery, found.verdict.causes
    (again,) = refinery.simulated([cause.fit])
    # where it was said to be, the simulator says the same, to less than what tells two explanations apart
    assert again.log_evidence > cause.fit.log_evidence - 1.0
