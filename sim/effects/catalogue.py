"""The catalogue: every effect by its name."""

from collections.abc import Iterable
from difflib import get_close_matches

from sim.effects.base import Effect
from sim.effects.bench_effects import BENCH_EFFECTS
from sim.effects.scalings import SCALINGS
from sim.parameters import ParameterError

CATALOGUE: dict[str, Effect] = {entry.name: entry for entry in (*SCALINGS, *BENCH_EFFECTS)}


def effect(name: str) -> Effect:
    """The effect of that name; ``ParameterError`` names the nearest where there is none."""
    if name not in CATALOGUE:
        near = get_close_matches(name, CATALOGUE, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ParameterError(f"no effect {name!r}; {hint}known: {', '.join(sorted(CATALOGUE))}")
    return CATALOGUE[name]


def left_out(names: Iterable[str]) -> frozenset[str]:
    """The effects of these names, to do without them; ``ParameterError`` where one is none, or where none stays."""
    found = frozenset(effect(name).name for name in names)
    if len(found) == len(CATALOGUE):
        raise ParameterError(f"all {len(found)} effects are to be left out; one at least has to stay")
    return found
