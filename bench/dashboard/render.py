"""Values of ``view`` as HTML: templates with every value escaped."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from jinja2 import ChainableUndefined, Environment, FileSystemLoader

from bench.verdict_wording import verdict_class
from bench.wording import (
    action_text,
    added_power,
    channel_name,
    effect_name,
    fixed,
    parameter_text,
    per_cent,
    points_text,
    probability_text,
)

TEMPLATES = Path(__file__).with_name("templates")

_environment = Environment(
    loader=FileSystemLoader(TEMPLATES),
    autoescape=True,
    undefined=ChainableUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_environment.filters |= {
    "action": action_text,
    "channel": channel_name,
    "points": points_text,
    "per_cent": per_cent,
    "added_power": added_power,
    "probability": probability_text,
    "words": effect_name,
    "fixed": fixed,
    "parameter": parameter_text,
    "verdict_class": verdict_class,
}


def piece(name: str) -> Callable[..., str]:
    """A macro of ``templates/panels.html`` as a function that returns HTML."""
    macro: Callable[..., Any] = getattr(_environment.get_template("panels.html").module, name)
    return lambda *values: str(macro(*values))


def page(name: str, **values: object) -> str:
    """A whole template."""
    return _environment.get_template(name).render(**values)


def css() -> str:
    """The pages' style."""
    return (TEMPLATES / "dashboard.css").read_text(encoding="utf-8")
