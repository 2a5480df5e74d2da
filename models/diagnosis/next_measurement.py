"""What to measure next: the points and actions that tell the remaining explanations apart, best per minute.

How far an option separates two of them, and which steps are worth it, is :mod:`models.diagnosis.race`. Where all
of them leave a pair tied, it is said what they tell at most, and which channel would do, in as many rows or in as
many as were measured: the cheapest that separates all such pairs, or the one that tells most, if that is a sigma
(:mod:`models.diagnosis.missing_channel`). What the verdict states as tied comes first, however improbable one of it is.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.bench_options import (
    ANYTHING,
    UNLOADED,
    Again,
    Allowed,
    bench_options,
    usual_sigma,
    with_room,
)
from models.diagnosis.evidence import Hypothesis
from models.diagnosis.hypotheses import Fit
from models.diagnosis.measured_again import telling_rows
from models.diagnosis.missing_channel import missing_channel
from models.diagnosis.observations import CHANNELS, Observations
from models.diagnosis.race import SEPARATED, NextMeasurement, Race, Rival
from models.diagnosis.refinery import Refinery

Array = NDArray[np.float64]

MOST_STEPS = 10
_LEAST = 0.03  # probability from which an explanation takes part
_MOST_RIVALS = 6
_MANY = 60  # measured points that lie as close as a grid over their ranges would
_LOOKED_AT = 40  # of them: those that tell most if they were measured again


def rivals_of(
    hypotheses: Sequence[Hypothesis], refinery: Refinery, tied: Collection[str] = ()
) -> list[Rival]:
    """The most probable explanations, one for each set of effects, at their own everyday spreads.

    Of causes that are stated as ``tied`` the best explanation by each is one, improbable as it may be.
    """
    total: dict[tuple[str, ...], float] = {}
    fits: dict[tuple[str, ...], Fit] = {}
    for h in hypotheses:
        fits.setdefault(h.fit.effects, h.fit)
        total[h.fit.effects] = total.get(h.fit.effects, 0.0) + h.probability
    ranked = sorted(((p, e) for e, p in total.items()), reverse=True)
    stated = {next(e for _, e in ranked if name in e) for name in tied}
    others = [e for p, e in ranked if p >= _LEAST and e not in stated]
    taking_part = stated | set(others[: max(_MOST_RIVALS - len(stated), 0)])
    chosen = [(p, e) for p, e in ranked if e in taking_part]
    return [
        Rival(
            effects=e,
            probability=p,
            model=refinery.model(fits[e], refinery.spreads(fits[e])),
            fit=fits[e],
            stated=e in stated,
        )
        for p, e in chosen
    ]


def next_measurements(
    observations: Observations,
    rivals: Sequence[Rival],
    *,
    refinery: Refinery | None = None,
    most: int = MOST_STEPS,
    allowed: Allowed = ANYTHING,
) -> list[NextMeasurement]:
    """The allowed steps to take, in their order, until the rivals are apart; none where one explanation is left.

    First what is best per minute. Where some of it is done by hand, behind it what set points alone can tell; where
    they leave a pair tied, the channel that is missing. The ``refinery`` knows what the measurements leave open;
    without one every rival is taken at its word.
    """
    if len(rivals) < 2:
        return []
    again, like = None, None if refinery is None else refinery.baseline
    if refinery is not None and allowed.set_points is None:
        again = _again(refinery, rivals)
    options = bench_options(observations, [r.model for r in rivals], CHANNELS, allowed, again, like)
    if refinery is not None:
        options = options.noisier(_noisier_than_usual(refinery))
    everything = Race.of(options, rivals, refinery)
    present = [k for k, c in enumerate(CHANNELS) if c in observations.channels]
    steps, reached = everything.among(range(len(options.what)), present).steps(most, allowed)
    alone = [k for k, option in enumerate(options.what) if not option.by_hand]
    if any(step.by_hand for step in steps):
        others, reached = everything.among(alone, present).steps(most, allowed)
        steps += [step for step in others if step.action not in {s.action for s in steps}]
    absent = [c.column for c in CHANNELS if c not in observations.channels]
    tied = [k for k, d2 in enumerate(reached) if d2 < SEPARATED**2]
    if tied and absent:
        # with other channels a diagnosis keeps further from the most that can be carried
        room = with_room(replace(observations, channels=CHANNELS), [r.model for r in rivals], options.points)
        rows = [k for k in alone if room[k]]
        measured = np.unique(observations.row).size
        for pairs in (everything.stated(tied), tied):
            told = float(np.sqrt(min((reached[k] for k in pairs), default=0.0)))
            if asked := missing_channel(everything.of_pairs(pairs), rows, absent, most, measured, told):
                return steps + asked
    return steps


def _noisier_than_usual(refinery: Refinery) -> Array:
    """How many times the usual noise a reading of each of all channels has on this bench; 1 at least, and unread."""
    o, times = refinery.observations, np.ones(len(CHANNELS))
    converter = refinery.baseline.converter
    usual = usual_sigma(CHANNELS, np.asarray(o.points.power_W)[o.row], converter)
    for k, channel in enumerate(CHANNELS):
        loaded = o.of(channel.name) & o.loaded[o.row]
        if np.any(loaded):
            times[k] = max(float(np.median(refinery.noise[loaded] / usual[loaded, k])), 1.0)
    return times


def asks_again(refinery: Refinery) -> bool:
    """Whether measured rows are asked for again: there are enough of them and nothing has to be simulated anew."""
    kind = _measured_kinds(refinery)
    return refinery.near is not None and int(np.sum(kind == "load")) >= _MANY and set(UNLOADED) <= set(kind)


def _measured_kinds(refinery: Refinery) -> NDArray[np.str_]:
    """Of the rows with readings."""
    o = refinery.observations
    return np.asarray(o.frame["kind"].to_numpy()[np.unique(o.row)])


def _again(refinery: Refinery, rivals: Sequence[Rival]) -> Again | None:
    """The measured rows that tell most, where they are asked for again."""
    if refinery.near is None or not asks_again(refinery):
        return None
    among = np.unique(refinery.observations.row)[_measured_kinds(refinery) == "load"]
    rows = telling_rows(refinery, [(r.fit, r.probability) for r in rivals], among)
    return Again(rows=rows[:_LOOKED_AT], near=refinery.near)
