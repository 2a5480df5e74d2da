"""What can go wrong between this program and an instrument.

::

    InstrumentError              anything an instrument or its link did wrong
    ├── LinkError                the connection itself
    │   ├── LinkUnavailable      cannot be opened: no such port, refused, busy
    │   ├── LinkLost             was open and is gone: hang-up, unplugged, reset
    │   └── LinkTimeout          no reply, or no whole reply, before the deadline
    ├── ReplyError               a reply came and is not the answer to the query
    ├── InstrumentRefused        the instrument answered that it will not (exception code, error queue, NACK)
    │   └── SetPointRefused      the controller runs, and will not take this set point
    ├── IdentityError            something else than the expected instrument answered
    ├── LimitError               refused here, before anything was sent
    ├── ReadbackError            a set point or state read back differs from what was sent
    └── InstrumentTripped        a latched alarm: overvoltage, overcurrent, overtemperature, fault word

Context (instrument, resource, command, reply, elapsed time) is attached as the error rises, by
``with_context``; the first value given to a key stays.
"""

from typing import Self


class InstrumentError(Exception):
    """Something an instrument, or the link to it, did wrong; carries its context."""

    def __init__(self, message: str, **context: object) -> None:
        super().__init__(message)
        self.message = message
        self.context: dict[str, object] = dict(context)

    def with_context(self, **context: object) -> Self:
        """Add what is known at this level (instrument, resource, ...) and return the error itself."""
        for key, value in context.items():
            self.context.setdefault(key, value)
        return self

    def __str__(self) -> str:
        details = ", ".join(f"{key}={value!r}" for key, value in self.context.items())
        return f"{self.message} ({details})" if details else self.message


class LinkError(InstrumentError):
    """The connection itself failed."""


class LinkUnavailable(LinkError):
    """The connection cannot be opened: no such port, refused, or busy."""


class LinkLost(LinkError):
    """The connection was open and is gone."""


class LinkTimeout(LinkError):
    """No reply, or no whole reply, came before the deadline."""


class ReplyError(InstrumentError):
    """A reply came that is not the answer to the query: wrong kind, count, unit, checksum or sequence."""


class InstrumentRefused(InstrumentError):
    """The instrument answered that it will not do this."""


class SetPointRefused(InstrumentRefused):
    """The controller runs, and will not take this set point: a pulse too short, a value out of range."""


class IdentityError(InstrumentError):
    """Something else than the expected instrument answered."""


class LimitError(InstrumentError):
    """A set point outside the limits; refused before anything was sent."""


class ReadbackError(InstrumentError):
    """What was read back differs from what was sent."""


class InstrumentTripped(InstrumentError):
    """The instrument protects itself: a latched alarm stands."""
