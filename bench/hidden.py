"""``--hide EFFECT[=VALUE]``: what a virtual lab has that nobody is told of."""

from collections.abc import Sequence

from bench.errors import InputError, Problem
from sim.effects.catalogue import effect
from sim.parameters import ParameterError

OPTION = "--hide"


def parse_hidden(options: Sequence[str], *, foreign: bool = False) -> dict[str, float | None]:
    """Effect → headline value, None to let the lab's seed draw one; InputError lists every wrong option.

    With ``foreign`` the families that no catalogue has are allowed too, each with its size.
    """
    families = _families() if foreign else ()
    hidden: dict[str, float | None] = {}
    problems = []
    for option in options:
        name, _, text = option.partition("=")
        try:
            value = _number(text) if text else None
            if name not in families:
                _check(name, value)
            elif value is not None and not 0 <= value < float("inf"):
                raise ValueError(f"the size of {name} is {value:g}; allowed: 0 or more")
            hidden[name] = value
        except (ParameterError, ValueError) as error:
            problems.append(Problem(file="command line", field=OPTION, value=option, allowed=str(error)))
    if problems:
        raise InputError(problems)
    return hidden


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{text!r} is not a number; allowed is EFFECT or EFFECT=VALUE") from None


def _check(name: str, value: float | None) -> None:
    entry = effect(name)
    if value is not None:
        entry.check({entry.headline.name: value})


def _families() -> tuple[str, ...]:
    """The lab's foreign families, looked up only where a lab is about to be made."""
    from drivers.mocks.lab.foreign.families import FOREIGN

    return tuple(FOREIGN)
