"""Which model is in use, since when and why: a journal beside the models, one line per decision.

::

    <root>/journal.jsonl     {"when": ..., "decision": "promoted", "model": ..., "reason": ..., ...}

The journal is only ever added to, a whole line at a time. The model in use follows from it: ``promoted`` and
``used`` put a model on top, ``rolled_back`` takes it off again, ``kept_out`` changes nothing.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path

from models.registry import RegistryError


class Choice(StrEnum):
    """What was decided about a model."""

    PROMOTED = "promoted"  # by retraining: it was judged, and is in use
    KEPT_OUT = "kept_out"  # by retraining: it was judged, and is not
    USED = "used"  # by a person
    ROLLED_BACK = "rolled_back"  # by a person: the one in use before is in use again


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """One decision about ``model``; ``errors`` are mean absolute errors on the same held-out rows, by model."""

    when: str  # ISO 8601
    decision: Choice
    model: str
    reason: str
    replaced: str | None = None
    data_sha256: str = ""
    errors: Mapping[str, float] = field(default_factory=dict)


class Journal:
    """The decisions about the models below one folder."""

    def __init__(self, root: Path) -> None:
        self.path = root / "journal.jsonl"

    def decisions(self) -> tuple[Decision, ...]:
        """All of them, the oldest first; RegistryError names a line that is none."""
        if not self.path.is_file():
            return ()
        found = []
        for number, line in enumerate(self.path.read_text(encoding="utf-8").splitlines(), start=1):
            try:
                entry = json.loads(line)
                found.append(Decision(**(entry | {"decision": Choice(entry["decision"])})))
            except (KeyError, TypeError, ValueError) as error:
                raise RegistryError(
                    f"{self.path}:{number}: not a decision about a model ({error})"
                ) from error
        return tuple(found)

    def in_use(self) -> str | None:
        """The id of the model in use, None while there is none."""
        stack = self._stack()
        return stack[-1] if stack else None

    def note(self, decision: Decision) -> Decision:
        """Add a decision; it is on the disk when this returns."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        line = json.dumps(asdict(decision)) + "\n"
        handle = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            os.write(handle, line.encode())
            os.fsync(handle)
        finally:
            os.close(handle)
        return decision

    def use(self, model: str, *, when: str, reason: str) -> Decision:
        """A person puts a model into use."""
        return self.note(
            Decision(when=when, decision=Choice.USED, model=model, reason=reason, replaced=self.in_use())
        )

    def roll_back(self, *, when: str, reason: str) -> Decision:
        """The model before the one in use is in use again; RegistryError when there is none before it."""
        stack = self._stack()
        if len(stack) < 2:
            said = f"model {stack[0]} is the first in use" if stack else "no model is in use"
            raise RegistryError(f"{said}: there is none before it to go back to")
        return self.note(
            Decision(
                when=when, decision=Choice.ROLLED_BACK, model=stack[-2], reason=reason, replaced=stack[-1]
            )
        )

    def rolled_back(self) -> frozenset[str]:
        """Models that a person took out of use."""
        out = {entry.replaced for entry in self.decisions() if entry.decision is Choice.ROLLED_BACK}
        return frozenset(model for model in out if model)

    def _stack(self) -> list[str]:
        """The models put into use and not taken back, the one in use last."""
        stack: list[str] = []
        for entry in self.decisions():
            if entry.decision is Choice.ROLLED_BACK:
                if not stack:
                    raise RegistryError(
                        f"{self.path}: {entry.replaced} was taken back on {entry.when}, but no entry before says that "
                        "it was in use: entries are missing"
                    )
                stack.pop()
            elif entry.decision is not Choice.KEPT_OUT and stack[-1:] != [entry.model]:
                stack.append(entry.model)
        return stack
