"""A linear bench of 24 readings, its signatures and noise, and what a search on it comes to."""

import numpy as np

from models.diagnosis.evidence import BesideLeftovers, Hypothesis, posterior
from models.diagnosis.refinery import Refinery
from models.diagnosis.search import search
from models.diagnosis.signatures import Signature
from sim.effects.catalogue import effect

READINGS = 24
SIGMA = np.linspace(0.2, 0.4, READINGS)
GROWING = np.linspace(5.0, 60.0, READINGS)  # W per Ohm
LINK = Signature(entry=effect("link_resistance"), slope=GROWING)
FLAT = np.ones(READINGS)
AUXILIARY = Signature(entry=effect("auxiliary_power"), slope=FLAT)
WARM_UP = effect("warm_up_drift")
# W per unit
SLANTED = Signature(entry=effect("analyzer_gain"), slope=300.0 * np.cos(0.7 * np.arange(READINGS)))


def noise(seed: int) -> np.ndarray:
    return SIGMA * np.random.default_rng(seed).standard_normal(READINGS)


def weighed(bench: Refinery) -> list[Hypothesis]:
    return posterior(BesideLeftovers.of(bench, search(bench)))


def stated(bench: Refinery) -> tuple[str, ...]:
    return weighed(bench)[0].fit.effects
