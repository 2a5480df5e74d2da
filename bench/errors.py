"""What can go wrong in a campaign, apart from the instruments themselves.

::

    BenchError
    ├── InputError        the operator's file or option is wrong; lists every problem at once (exit 2)
    ├── CampaignStopped   a campaign ended early, and the bench was seen off (exit 1)
    │   ├── LimitReached  a reading left the safety limits, or was missing
    │   │   └── OutputLost    the converter could not hold its output at this set point
    │   └── Aborted       the operator asked for it
    │       └── Interrupted   by Ctrl-C or another signal to the process that runs it (exit 130)
    ├── StateError        a step that the transition table does not allow, or an unknown campaign
    ├── BenchTaken        another campaign owns the bench
    ├── StoreError        the database cannot be read or written: full, read-only, locked, gone
    ├── NotWritten        a file of results cannot be written: full disk, read-only, not allowed
    └── BenchUnsafe       the power-off could not be confirmed, or UNSAFE is latched (exit 3)
"""

from collections.abc import Sequence
from dataclasses import dataclass


class BenchError(Exception):
    """Anything the campaign engine or the command line has to say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One thing that is wrong in a file or an option, and what would be right."""

    file: str
    field: str
    value: object
    allowed: str
    line: int | None = None

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}" if self.line else self.file
        value = "" if self.value is None else f" = {self.value!r}"
        return f"{where}: {self.field}{value}: {self.allowed}"


class InputError(BenchError):
    """The operator's input is wrong; carries all problems found, not the first."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = tuple(problems)

    @classmethod
    def of(cls, file: object, field: str, value: object, allowed: str) -> "InputError":
        """One problem."""
        return cls([Problem(file=str(file), field=field, value=value, allowed=allowed)])


class CampaignStopped(BenchError):
    """A campaign ended before its last point; the bench was seen off."""


class LimitReached(CampaignStopped):
    """A reading is outside the safety limits, or there is none."""


class OutputLost(LimitReached):
    """The converter could not hold its output at this set point; nothing else is wrong."""


class Aborted(CampaignStopped):
    """The operator asked the campaign to stop."""


class Interrupted(Aborted):
    """The operator interrupted the process that runs the campaign."""


class StateError(BenchError):
    """A step that is not allowed from where the campaign stands."""


class BenchTaken(BenchError):
    """Another campaign owns the bench, or its ports."""


class StoreError(BenchError):
    """The database cannot be read or written now; what was committed before is safe."""


class NotWritten(BenchError):
    """A file of results cannot be written; one that was there before is as it was."""


class BenchUnsafe(BenchError):
    """At least one part of the bench could not be seen off, now or in a run that nobody has cleared yet.

    What is known of each part is a line of its own.
    """


def named(error: BaseException) -> str:
    """An error with its kind, as the ledger keeps it; what the operator asked for needs none.

    >>> named(LimitReached("output voltage has no reading")), named(Aborted("interrupted by the operator"))
    ('LimitReached: output voltage has no reading', 'interrupted by the operator')
    """
    return str(error) if isinstance(error, Aborted) else f"{type(error).__name__}: {error}"
