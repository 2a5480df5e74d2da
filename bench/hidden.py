"""``--hide EFFECT[=VALUE]``: what a virtual lab has that nobody is told of."""

from collections.abc import Sequence

from bench.errors import InputError, Problem
from sim.effects.catalogue import effect
from sim.parameters import ParameterError

OPTION = "--hide"


def parse_hidden(options: Sequence[str]) -> dict[str, float | None]:
    """Effect → headline value, None to let the lab's seed draw one; InputError lists every wrong option."""
    hidden: dict[str, float | None] = {}
    problems = []
    for option in options:
        name, _, value = option.partition("=")
        try:
            entry = effect(name)
            hidden[name] = float(value) if value else None
            if value:
                entry.check({entry.headline.name: float(value)})
        except (ParameterError, ValueError) as error:
            problems.append(Problem(file="command line", field=OPTION, value=option, allowed=str(error)))
    if problems:
        raise InputError(problems)
    return hidden
