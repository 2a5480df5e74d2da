"""Intervals and stated probabilities against the truth, with effects drawn from the prior."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from experiments.blind.draws import coverage, nothing
from experiments.blind.part import Outcome, Part, Run
from experiments.blind.scoring import Scored, Share, judged
from experiments.blind.trial import ORDINARY
from experiments.blind.verdicts import NOTHINGS, notes
from experiments.harness.result import Goal, Table

COVERAGES = 1000
RELIABILITY = "Reliability of stated probabilities"  # the table's title
LISTED = 0.5  # probability from which an interval is judged: what a reader takes for a cause
_EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0 + 1e-9)
_CONFIDENCE = 0.99
_LEAST = 5  # statements in a bin, below which it says nothing


def intervals(scored: Sequence[Scored]) -> Share:
    """How many 95 % intervals of hidden effects that are thought likely hold the hidden value."""
    found = []
    for s in judged(scored):
        for name, value in s.trial.headlines.items():
            cause = s.said.cause(name)
            if cause is not None and cause.probability >= LISTED:
                found.append(cause.holds(value))
    return Share.of(found)


def statements(scored: Sequence[Scored]) -> list[tuple[float, bool]]:
    """Every stated probability of a cause, and whether that cause was there."""
    return [
        (cause.probability, cause.effect in s.trial.names) for s in judged(scored) for cause in s.said.causes
    ]


def reliability(stated: Sequence[tuple[float, bool]]) -> tuple[Table, int]:
    """The curve by bins, and how many bins are off by more than their 99 % interval."""
    rows, off = [], 0
    for low, high in pairwise(_EDGES):
        own = [(p, hit) for p, hit in stated if low <= p < high]
        share = Share.of(hit for _, hit in own)
        mean = 100 * float(np.mean([p for p, _ in own])) if own else None
        ci = share.interval(_CONFIDENCE)
        if mean is None or len(own) < _LEAST:
            said = "too few"
        elif ci[0] <= mean <= ci[1]:
            said = "agrees"
        else:
            said = "off"
        off += said == "off"
        label = f"{low:.2f} to {min(high, 1.0):.2f}"
        observed = share.per_cent if own else None
        rows.append((label, len(own), mean, observed, ci[0], ci[1], said))
    columns = ("stated probability", "statements", "mean stated, %", "observed, %", "99 % from", "to", "")
    return Table(title=RELIABILITY, columns=columns, rows=tuple(rows)), off


def _coverage(run: Run) -> Outcome:
    scored = run.scored(coverage, COVERAGES)
    empty = [s for s in run.scored(nothing, NOTHINGS) if s.trial.noise == ORDINARY]
    as_many = min(len(scored), len(empty))  # the prior has one lab with nothing in it for each with something
    held = intervals(scored)
    table, off = reliability(statements([*scored[:as_many], *empty[:as_many]]))
    goals = (
        held.goal("coverage: 95 % intervals hold the value, at least", 93.0, at_least=True),
        held.goal("coverage: 95 % intervals hold the value, at most", 97.0, at_least=False),
        Goal(name="coverage: reliability bins off", value=off, bar=0, at_least=False),
    )
    said = f"reliability: {as_many} labs with effects from the prior and as many with none"
    return Outcome(goals=goals, tables=(table,), notes=(*notes("coverage", scored), said))


COVERAGE_PART = Part(name="coverage", says="intervals and stated probabilities", run=_coverage)
