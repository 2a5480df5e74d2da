"""Finds the experiments: every module beside ``command`` in the package ``experiments`` is one.

An experiment is a file with a docstring and ``EXPERIMENT = Experiment(title=..., run=...)``; its name is the
file's.
"""

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches

import experiments
from experiments.harness.result import Result
from experiments.harness.settings import Settings

_NOT_ONE = ("command",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """A title, the function that runs it, and the parts of it that can be run alone, if any.

    One may compare with a ``reference`` file of other people's points, and ``spread`` its trials over a cluster.
    ``all`` is the paper, table by table and figure by figure; trials and benchmarks stand ``apart``.
    """

    title: str
    run: Callable[[Settings], Result]
    parts: tuple[str, ...] = ()
    apart: bool = False
    reference: bool = False
    spread: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """An experiment as found: its file's name, and the file's docstring as its description."""

    name: str
    about: str
    experiment: Experiment


class UnknownExperiment(ValueError):
    """No experiment of that name; the message lists those there are."""


def names() -> list[str]:
    """The names of all experiments, sorted."""
    modules = pkgutil.iter_modules(experiments.__path__)
    return sorted(m.name for m in modules if not m.ispkg and m.name not in _NOT_ONE)


def entry(name: str) -> Entry:
    """The experiment of that name; ``TypeError`` for a file that declares none."""
    known = names()
    if name not in known:
        near = get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise UnknownExperiment(f"no experiment {name!r}; {hint}known: {', '.join(known)}")
    module = importlib.import_module(f"{experiments.__name__}.{name}")
    found, about = getattr(module, "EXPERIMENT", None), module.__doc__
    if not isinstance(found, Experiment) or not about:
        raise TypeError(f"experiments/{name}.py needs a docstring and EXPERIMENT = Experiment(title=, run=)")
    return Entry(name=name, about=about.strip(), experiment=found)
