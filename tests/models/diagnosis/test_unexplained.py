"""How long a leftover is beside a cause whose own law may be a little wrong."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.evidence import Hypothesis
from models.diagnosis.hypotheses import Fit
from models.diagnosis.signatures import Signature
from models.diagnosis.unexplained import Unexplained, unexplained
from sim.effects.catalogue import effect
from tests.models.diagnosis.fabricated import fit_of, loads, refinery

READINGS, LAW, RESISTANCE_OHM = 40, 0.1, 0.1
SIGMA = np.full(READINGS, 0.1)
POWER_W = np.linspace(200.0, 1800.0, READINGS)
GROWING = 100.0 * (POWER_W / 1800.0) ** 2  # W per Ohm
LINK = Signature(entry=effect("link_resistance"), slope=GROWING)
BENT = 0.1 * GROWING * np.cos(np.pi * POWER_W / 1800.0)  # W per Ohm: what the law gets wrong
CAUSE = fit_of("link_resistance", RESISTANCE_OHM * GROWING, slope=GROWING, value=RESISTANCE_OHM)
MATRIX = np.diag(SIGMA**2)


def beside(fit: Fit) -> Unexplained:
    """What is left over beside a fit of 0.1 Ohm whose loss is bent, where the law may be."""
    value = RESISTANCE_OHM * (GROWING + BENT)
    there = refinery(value, [LINK], SIGMA, laws=[(LINK, BENT[None])])
    there = replace(there, observations=replace(loads(POWER_W), value=value))
    leftover = there.geometry.leftovers.configurations[1]
    found = unexplained([Hypothesis(fit=fit, leftover=leftover, probability=1.0)], there)
    assert found is not None
    return found


def test_what_the_causes_law_may_be_wrong_by_counts_for_little() -> None:
    left = beside(CAUSE)
    of_law = RESISTANCE_OHM * BENT
    law_too = np.linalg.solve(MATRIX + np.outer(of_law, of_law), left.watts)
    assert left.size == pytest.approx(np.sqrt(left.watts @ law_too), rel=1e-9)  # rounding
    assert left.size < 1.0  # of a law that is off by one sigma


def test_beside_no_cause_noise_alone_measures_it() -> None:
    left = beside(fit_of(None, np.zeros(READINGS)))
    # rounding
    assert left.size == pytest.approx(np.sqrt(left.watts @ np.linalg.solve(MATRIX, left.watts)), rel=1e-9)


@pytest.mark.parametrize(("drift", "place"), [(0.05, "input"), (0.5, "over time")])
def test_what_stands_still_is_not_over_time(drift: float, place: str) -> None:
    """A load beyond all that is searched is explained by what may change; of it the most is always there."""
    there = refinery(60.0 * (1.0 + drift * np.linspace(-1.0, 1.0, READINGS)), [LINK], SIGMA)
    there = replace(there, observations=replace(loads(POWER_W), value=there.observations.value))
    free = there.geometry.leftovers.configurations[1]
    leftover = replace(free, location="over time")
    there = replace(
        there, geometry=replace(there.geometry, admitted={leftover.key: there.geometry.admitted[free.key]})
    )
    nothing = Hypothesis(fit=fit_of(None, np.zeros(READINGS)), leftover=leftover, probability=1.0)
    found = unexplained([nothing], there)
    assert found is not None
    assert found.location == place


@pytest.mark.parametrize(
    ("place", "share", "called"),
    [
        ("leakage_inductance over T_inductor_C", 0.97, True),
        ("leakage_inductance over T_inductor_C", 0.8, False),
        ("gain of D0", 0.97, True),
        ("gain of D0", 0.8, False),
    ],
)
def test_what_a_leftover_is_called_is_sure_of_all_leftovers(place: str, share: float, called: bool) -> None:
    there = refinery(10.0 * np.ones(READINGS), [LINK], SIGMA)
    there = replace(there, observations=replace(loads(POWER_W), value=there.observations.value))
    plain = there.geometry.leftovers.configurations[1]
    specific = replace(plain, location=place)
    admitted = there.geometry.admitted | {specific.key: there.geometry.admitted[plain.key]}
    there = replace(there, geometry=replace(there.geometry, admitted=admitted))
    nothing = fit_of(None, np.zeros(READINGS))
    hypotheses = [
        Hypothesis(fit=nothing, leftover=specific, probability=share),
        Hypothesis(fit=nothing, leftover=plain, probability=1.0 - share),
    ]
    found = unexplained(hypotheses, there)
    assert found is not None
    assert found.location == (place if called else plain.location)
    # rounding
    assert found.at_place == pytest.approx(share if called else 1.0 - share, rel=1e-12)
    assert found.probability == pytest.approx(1.0, rel=1e-12)
