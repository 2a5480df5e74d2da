"""Templates of pages: every value escaped, and said as ``wording`` says it."""

from pathlib import Path

from jinja2 import ChainableUndefined, Environment, FileSystemLoader

from bench.verdict_wording import verdict_class
from bench.wording import (
    added_power,
    channel_name,
    counted,
    duration,
    effect_name,
    fixed,
    parameter_text,
    per_cent,
    points_text,
    probability_text,
    step_text,
    told_by,
    unbroken,
)

_FILTERS = {
    "added_power": added_power,
    "channel": channel_name,
    "counted": counted,
    "duration": duration,
    "fixed": fixed,
    "parameter": lambda parameter: unbroken(parameter_text(parameter)),
    "per_cent": per_cent,
    "points": points_text,
    "probability": probability_text,
    "step": step_text,
    "told_by": told_by,
    "verdict_class": verdict_class,
    "words": effect_name,
}


def environment(folder: Path) -> Environment:
    """The templates of a folder, with the filters that they use."""
    made = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=ChainableUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= _FILTERS
    return made
