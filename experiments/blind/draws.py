"""Draws what each trial hides, by its seed alone."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from drivers.mocks.lab.foreign.families import FOREIGN
from drivers.mocks.lab.hidden import HIDDEN
from experiments.blind.reach import hideable
from experiments.blind.seeds import Seeds
from experiments.blind.trial import NOISES, BlindTrial
from sim.effects.catalogue import CATALOGUE

DESIGNS = 6  # of the pool: each costs the reach of far more than a hundred labs
SIZES = (30, 200, 400)  # points of the trials that ask how many are needed, and whether more do harm
HOW_MANY = {1: 0.75, 2: 0.2, 3: 0.05}  # causes at once, where anything is wrong

# Pairs that efficiency does not tell apart, or hardly; either may be the hidden one.
TIED_PAIRS = (
    ("auxiliary_power", "analyzer_offset"),
    ("sic_on_resistance", "link_resistance"),
    ("turn_off_energy_primary", "igbt_saturation_voltage"),
    ("analyzer_gain", "igbt_saturation_voltage"),
    ("cable_resistance_input", "cable_resistance_output"),
    ("thermal_resistance", "sic_on_resistance"),
)


def log_uniform(drawn: tuple[float, float], rng: np.random.Generator) -> float:
    """A value from a lab's range."""
    low, high = map(math.log, drawn)
    return math.exp(low + (high - low) * float(rng.uniform()))


def from_prior(name: str, rng: np.random.Generator) -> float:
    """A headline value from its normal prior about off, inside its bounds."""
    head = CATALOGUE[name].headline
    while True:
        value = head.off + head.prior * float(rng.standard_normal())
        if head.lower <= value <= head.upper:
            return value


def _rng(seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, 11])


def singles(seeds: Seeds) -> Iterator[BlindTrial]:
    """One effect after the other, each with a value from the lab's range."""
    names = hideable()
    for k, seed in enumerate(seeds.of("single")):
        name = names[k % len(names)]
        value = log_uniform(HIDDEN[name].drawn, _rng(seed))
        yield BlindTrial(row="single", seed=seed, hidden=((name, value),), design=seeds.design(k % DESIGNS))


def sizes(seeds: Seeds) -> Iterator[BlindTrial]:
    """One effect after the other, in a short table and in long ones."""
    names = hideable()
    for k, seed in enumerate(seeds.of("sizes")):
        name = names[k // len(SIZES) % len(names)]
        value = log_uniform(HIDDEN[name].drawn, _rng(seed))
        yield BlindTrial(row="sizes", seed=seed, hidden=((name, value),), points=SIZES[k % len(SIZES)])


def pairs(seeds: Seeds) -> Iterator[BlindTrial]:
    """Two different effects at once."""
    for k, seed in enumerate(seeds.of("pairs")):
        rng = _rng(seed)
        names = rng.choice(hideable(), size=2, replace=False)
        hidden = tuple((str(name), log_uniform(HIDDEN[name].drawn, rng)) for name in names)
        yield BlindTrial(row="pairs", seed=seed, hidden=hidden, design=seeds.design(k % DESIGNS))


def nothing(seeds: Seeds) -> Iterator[BlindTrial]:
    """Nothing but tolerances, with one kind of noise after the other."""
    for k, seed in enumerate(seeds.of("nothing")):
        yield BlindTrial(row="nothing", seed=seed, noise=NOISES[k % len(NOISES)])


def foreign(seeds: Seeds) -> Iterator[BlindTrial]:
    """One family after the other."""
    names = list(FOREIGN)
    for k, seed in enumerate(seeds.of("foreign")):
        name = names[k % len(names)]
        value = log_uniform(FOREIGN[name].drawn, _rng(seed))
        yield BlindTrial(row="foreign", seed=seed, hidden=((name, value),), design=seeds.design(k % DESIGNS))


def foreign_alone(seeds: Seeds) -> Iterator[BlindTrial]:
    """The same labs, seen in efficiency alone."""
    for trial in foreign(seeds):
        yield replace(trial, row="foreign_alone", efficiency_only=True)


def coverage(seeds: Seeds) -> Iterator[BlindTrial]:
    """One to three effects of any size, as the prior has them."""
    for seed in seeds.of("coverage"):
        rng = _rng(seed)
        count = int(rng.choice(list(HOW_MANY), p=list(HOW_MANY.values())))
        names = rng.choice(hideable(), size=count, replace=False)
        hidden = tuple((str(name), from_prior(str(name), rng)) for name in names)
        yield BlindTrial(row="coverage", seed=seed, hidden=hidden)


def efficiency_only(seeds: Seeds) -> Iterator[BlindTrial]:
    """Single effects, seen in efficiency alone."""
    names = hideable()
    for k, seed in enumerate(seeds.of("efficiency_only")):
        name = names[k % len(names)]
        value = log_uniform(HIDDEN[name].drawn, _rng(seed))
        yield BlindTrial(
            row="efficiency_only", seed=seed, hidden=((name, value),), efficiency_only=True,
            design=seeds.design(k % DESIGNS),
        )  # fmt: skip


def tied(seeds: Seeds) -> Iterator[BlindTrial]:
    """Either effect of each tied pair in turn, seen in efficiency alone."""
    for k, seed in enumerate(seeds.of("tied")):
        pair = TIED_PAIRS[k // 2 % len(TIED_PAIRS)]
        name, rival = pair if k % 2 == 0 else pair[::-1]
        value = log_uniform(HIDDEN[name].drawn, _rng(seed))
        yield BlindTrial(
            row="tied", seed=seed, hidden=((name, value),), efficiency_only=True, rival=rival,
            design=seeds.design(0), points=60,
        )  # fmt: skip


def extension(seeds: Seeds) -> Iterator[BlindTrial]:
    """Single effects whose extension is judged on power that was not measured."""
    names = hideable()
    for k, seed in enumerate(seeds.of("extension")):
        name = names[k % len(names)]
        value = log_uniform(HIDDEN[name].drawn, _rng(seed))
        yield BlindTrial(row="extension", seed=seed, hidden=((name, value),), points=130)


Draw = Callable[[Seeds], Iterator[BlindTrial]]
