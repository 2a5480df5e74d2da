"""The channel that is missing: what to measure too where no point tells explanations apart by those that there are."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from models.diagnosis.bench_options import Allowed
from models.diagnosis.observations import CHANNELS
from models.diagnosis.race import SEPARATED, NextMeasurement, Race

_SAID = 0.1  # sigmas
_WORTH_A_CHANNEL = 1.0  # sigmas that it tells of some pair
_HOWEVER_LITTLE = Allowed(least_sigma=0.0)
# Assumption: the controller has D0, a temperature needs a sensor, a current a probe, an ac power an analyzer's element.
_CHEAPEST_FIRST = (
    "D0", "T_heatsink_C", "T_transformer_C", "T_inductor_C", "I_L_rms_A", "P_link1_W", "P_link2_W",
)  # fmt: skip


def _bare(action: str) -> str:
    """What is measured, as it stands inside a sentence."""
    return action.removeprefix("measure ").replace("_", " ")


def missing_channel(
    race: Race, rows: Sequence[int], columns: Sequence[str], most: int, measured: int, told: float
) -> list[NextMeasurement]:
    """The channel of these columns that a race's pairs need, and where to begin with it; or none that tells a sigma.

    It is judged by what it tells in the best rows, ``most`` of them, or if as many as were ``measured`` had it.
    Rows of the channels that there are have ``told`` so many sigmas of the worst pair.
    """
    if not len(race.pairs):
        return []
    weight, found = race.weight(), list[tuple[float, str, NextMeasurement]]()
    for column in (c for c in _CHEAPEST_FIRST if c in columns):
        place = next(k for k, channel in enumerate(CHANNELS) if channel.column == column)
        alone = race.among(rows, [place])
        everywhere = alone.altogether(measured)  # before any step is taken as measured
        steps, reached = alone.steps(most, _HOWEVER_LITTLE)
        apart = np.maximum(reached, everywhere)
        if np.max(apart) >= _WORTH_A_CHANNEL**2:
            found.append((float(weight @ np.minimum(apart, SEPARATED**2)), column, steps[0]))
    if not found:
        return []
    _, column, step = max(found, key=lambda each: each[0])  # the first of several that separate all
    so_far = f" (the channels measured so far tell {told:.1f} sigma at most)" if told > _SAID else ""
    action = f"measure {column} too{so_far}, beginning with {_bare(step.action)}"
    return [replace(step, action=action, by_hand=True)]
