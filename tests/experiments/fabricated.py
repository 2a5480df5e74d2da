"""Scored trials and an experiment made up by hand."""

import base64
import math

from experiments.blind.scoring import Scored
from experiments.blind.trial import Answer, BlindTrial
from experiments.harness.registry import Entry, Experiment
from experiments.harness.result import Comparison, Goal, Picture, Result, Table
from experiments.harness.settings import Settings

PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


def scored(
    effect: str | None, verdict: str, *stated: str, seed: int = 20_000, value: float | None = None
) -> Scored:
    """A trial that hid 0.1 of ``effect``; a verdict that stands for ``stated``, with a ``value`` ± 0.02."""
    hidden = None if effect is None else 0.1
    trial = BlindTrial(effect=effect, value=hidden, size="small", seed=seed)
    answer = Answer(
        verdict=verdict,
        stated=stated,
        first=stated[0] if stated else "fan_step",
        probability=0.9,
        value=value,
        half_width=None if value is None else 0.02,
    )
    return Scored(trial=trial, answer=answer)


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
    name="made_up", about="One line.\n\nAnd a paragraph.", experiment=Experiment(title="T", run=result)
)
