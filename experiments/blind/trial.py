"""One blind trial: a virtual lab hides an effect, is measured, and the diagnosis is asked."""

import math
import time
from dataclasses import asdict, dataclass
from typing import Any, Self

from drivers.mocks.lab.laboratory import Laboratory
from experiments.harness.lab_data import measured_table
from models.dataset import load_measurements
from models.diagnosis.diagnose import Diagnosis, diagnose

_Z95 = 1.96
NO_ANSWER = "no answer"


@dataclass(frozen=True, slots=True, kw_only=True)
class BlindTrial:
    """What one seed hides: an effect with its headline value, or nothing."""

    effect: str | None
    value: float | None
    size: str
    seed: int
    points: int = 100

    @property
    def key(self) -> str:
        """Everything that the outcome depends on."""
        if self.effect is None:
            return f"nothing hidden, seed {self.seed}, {self.points} points"
        return f"{self.effect} = {self.value!r} ({self.size}), seed {self.seed}, {self.points} points"


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What the diagnosis said.

    ``stated`` are the effects that the verdict stands for: the causes when named, the tied group when
    group, none otherwise. ``first`` is the most probable cause whatever the verdict; ``half_width`` that of
    the 95 % interval of its value. ``refused`` says why there was no answer.
    """

    verdict: str
    stated: tuple[str, ...] = ()
    first: str | None = None
    probability: float | None = None
    value: float | None = None
    half_width: float | None = None
    consistent: float | None = None
    leftover: float | None = None
    gap_W: float | None = None
    cpu_s: float = 0.0
    refused: str = ""

    @classmethod
    def of(cls, diagnosis: Diagnosis, cpu_s: float) -> Self:
        """The answer in a diagnosis."""
        verdict = diagnosis.verdict
        first = verdict.causes[0] if verdict.causes else None
        stated = verdict.stated if verdict.kind == "named" else next(iter(verdict.groups), verdict.stated)
        return cls(
            verdict=verdict.kind,
            stated=stated,
            first=None if first is None else first.effect,
            probability=None if first is None else first.probability,
            value=None if first is None else first.term.value,
            half_width=None
            if first is None or not math.isfinite(first.term.sigma)
            else _Z95 * first.term.sigma,
            consistent=verdict.consistent_probability,
            leftover=verdict.unknown_probability,
            gap_W=diagnosis.gap["mean_loss_W"],
            cpu_s=cpu_s,
        )

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> Self:
        """An answer read back."""
        return cls(**{**plain, "stated": tuple(plain["stated"])})


def ask(trial: BlindTrial) -> dict[str, Any]:
    """Hide, measure, diagnose; the answer as plain data. The diagnosis gets the table alone."""
    start_s = time.process_time()
    hidden = {} if trial.effect is None else {trial.effect: trial.value}
    table = measured_table(Laboratory.draw(seed=trial.seed, hidden=hidden), trial.points, seed=trial.seed)
    try:
        diagnosis = diagnose(load_measurements(table))
    except ValueError as error:  # of whatever kind: no answer is an answer that counts against it
        refused = f"{type(error).__name__}: {error}"
        return asdict(Answer(verdict=NO_ANSWER, refused=refused, cpu_s=time.process_time() - start_s))
    return asdict(Answer.of(diagnosis, time.process_time() - start_s))
