"""Scored trials and an experiment made up by hand."""

import base64
import math
from dataclasses import replace

from experiments.blind.answer import Answer, Cause
from experiments.blind.scoring import Scored
from experiments.blind.trial import BlindTrial
from experiments.harness.registry import Entry, Experiment
from experiments.harness.result import Comparison, Goal, Picture, Result, Table
from experiments.harness.settings import Settings

PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


def answer(
    verdict: str, *stated: str, probability: float = 0.97, ci95: tuple[float, float] = (0.08, 0.12)
) -> Answer:
    """An answer that names the first, or for a group ties all, with an interval of each value."""
    low, high = ci95
    causes = tuple(
        Cause(effect=name, probability=probability, value=0.5 * (low + high), low=low, high=high)
        for name in (stated or ("fan_step",))
    )
    if verdict == "group":
        causes = tuple(replace(cause, probability=probability / len(causes)) for cause in causes)
    groups = (stated,) if verdict == "group" else ()
    named = tuple(cause.effect for cause in causes) if verdict == "named" else ()
    return Answer(verdict=verdict, causes=causes, named=named, groups=groups, unknown=0.01, cpu_s=1.0)


def scored(
    hidden: str | None, said: Answer | None, *, seed: int = 100_000, tied: tuple[str, ...] = ()
) -> Scored:
    """A trial that hid 0.1 of ``hidden``, several joined by +; excluded where nothing was said."""
    values = () if hidden is None else tuple((name, 0.1) for name in hidden.split("+"))
    trial = BlindTrial(row="single", seed=seed, hidden=values)
    return Scored(trial=trial, isolability=20.0, tied=tied, answer=said)


def result(_: Settings | None = None) -> Result:
    """One goal met, one missed, one table."""
    return Result(
        virtual=True,
        goals=(
            Goal(name="found", value=93.0, bar=90.0, at_least=True, unit="%", ci95=(88.0, 96.0)),
            Goal(name="regret", value=0.5, bar=0.01, at_least=False, unit="points"),
        ),
        tables=(Table(title="Speed", columns=("what", "s"), rows=(("grid <1>", 2.5), ("[swarm]", None))),),
        notes=("seeds 1 to 2",),
        comparisons=(
            Comparison(name="gap", paper=1.1, ours=1.3, unit="points", tolerance=0.5, reason="another one"),
            Comparison(
                name="time",
                paper=9.0,
                ours=0.5,
                unit="h",
                tolerance=math.inf,
                reason="another machine",
                spread=0.1,
            ),
        ),
        pictures=(Picture(name="dot", caption="One pixel.", png=PIXEL),),
        assumed=("the colour",),
    )


ENTRY = Entry(
    name="made_up", about="One line.\n\nAnd ``a <paragraph>``.", experiment=Experiment(title="T", run=result)
)
