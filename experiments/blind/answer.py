"""What a diagnosis said, read from its JSON answer and from nothing else."""

from dataclasses import dataclass
from typing import Any, Self

NO_ANSWER = "no answer"


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """One ranked cause with the value and the 95 % interval of its headline parameter."""

    effect: str
    probability: float
    value: float
    low: float
    high: float

    @classmethod
    def of(cls, plain: dict[str, Any]) -> Self:
        """An entry of ``causes``."""
        headline = plain["parameters"][0]
        low, high = headline["ci95"]
        return cls(
            effect=plain["effect"],
            probability=float(plain["probability"]),
            value=float(headline["value"]),
            low=float(low),
            high=float(high),
        )

    def holds(self, truth: float) -> bool:
        """Whether the interval holds a value."""
        return self.low <= truth <= self.high


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The verdict, the ranked causes, the named ones, and the tied groups; ``refused`` says why there was no answer."""

    verdict: str
    causes: tuple[Cause, ...] = ()
    named: tuple[str, ...] = ()
    groups: tuple[tuple[str, ...], ...] = ()
    unknown: float | None = None
    cpu_s: float = 0.0
    refused: str = ""

    @classmethod
    def of(cls, plain: dict[str, Any], cpu_s: float) -> Self:
        """From the JSON answer, schema 1."""
        return cls(
            verdict=plain["verdict"],
            causes=tuple(Cause.of(cause) for cause in plain["causes"]),
            named=tuple(plain["named"]),
            groups=tuple(tuple(group) for group in plain["groups"]),
            unknown=plain["unknown"]["probability"],
            cpu_s=cpu_s,
        )

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> Self:
        """An answer read back from a journal."""
        causes = tuple(Cause(**cause) for cause in plain["causes"])
        groups = tuple(tuple(group) for group in plain["groups"])
        return cls(**{**plain, "causes": causes, "named": tuple(plain["named"]), "groups": groups})

    @property
    def first(self) -> str | None:
        """The most probable cause, whatever the verdict."""
        return self.causes[0].effect if self.causes else None

    @property
    def stated(self) -> tuple[str, ...]:
        """All effects that the verdict stands for: named ones, and members of a stated group."""
        return tuple(dict.fromkeys((*self.named, *(name for group in self.groups for name in group))))

    def misnames(self, hidden: tuple[str, ...]) -> bool:
        """Something is said that is not there: a named cause, or a group without any of what is hidden."""
        groups_without = any(set(group).isdisjoint(hidden) for group in self.groups)
        return groups_without or any(name not in hidden for name in self.named)

    def cause(self, effect: str) -> Cause | None:
        """The entry of one effect, if it is listed."""
        return next((cause for cause in self.causes if cause.effect == effect), None)
