"""Values of ``view`` as HTML: templates with every value escaped."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.html import environment

TEMPLATES = Path(__file__).with_name("templates")
_environment = environment(TEMPLATES)


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
