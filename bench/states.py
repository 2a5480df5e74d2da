"""Where a campaign and each of its points can stand, and the only ways from one state to the next.

What is stored, shown and returned comes from here. A campaign whose process died is ``interrupted``: stored as
what it was, since nobody was left to write, and shown by ``shown_state`` as what it is.
"""

from collections.abc import Mapping
from enum import StrEnum

from bench.errors import StateError


class State(StrEnum):
    """Where a campaign stands."""

    PLANNED = "planned"
    WAITING = "waiting"  # for its time
    CHECKING = "checking"
    RUNNING = "running"
    PAUSED = "paused"  # bench off, the operator will say when
    INTERRUPTED = "interrupted"  # its process died; the bench was not seen off
    DONE = "done"
    ABORTED = "aborted"
    FAILED = "failed"
    UNSAFE = "unsafe"  # ended, and the bench could not be seen off
    IMPORTED = "imported"  # somebody else's measurements


LIVE = frozenset({State.PLANNED, State.WAITING, State.CHECKING, State.RUNNING, State.PAUSED})
STOPPED = frozenset({State.INTERRUPTED, State.ABORTED, State.FAILED, State.UNSAFE})  # can be resumed
_ENDS = frozenset({State.ABORTED, State.FAILED, State.UNSAFE, State.INTERRUPTED})
TRANSITIONS: Mapping[State, frozenset[State]] = {
    State.PLANNED: frozenset({State.WAITING, State.CHECKING}) | _ENDS,
    State.WAITING: frozenset({State.CHECKING}) | _ENDS,
    State.CHECKING: frozenset({State.RUNNING}) | _ENDS,
    State.RUNNING: frozenset({State.PAUSED, State.DONE}) | _ENDS,
    State.PAUSED: frozenset({State.CHECKING}) | _ENDS,
    State.INTERRUPTED: frozenset({State.CHECKING, State.ABORTED, State.UNSAFE}),
    State.ABORTED: frozenset({State.CHECKING}),
    State.FAILED: frozenset({State.CHECKING}),
    State.UNSAFE: frozenset({State.CHECKING}),  # once the operator has cleared the bench
    State.DONE: frozenset(),
    State.IMPORTED: frozenset(),
}


class PointState(StrEnum):
    """Where a point stands."""

    PLANNED = "planned"
    SET = "set"
    SETTLED = "settled"  # or out of time: the row's ``settled`` tells
    MEASURED = "measured"
    ACCEPTED = "accepted"
    REJECTED = "rejected"


FINISHED = frozenset({PointState.ACCEPTED, PointState.REJECTED})
POINT_TRANSITIONS: Mapping[PointState, frozenset[PointState]] = {
    PointState.PLANNED: frozenset({PointState.SET, PointState.REJECTED}),
    PointState.SET: frozenset({PointState.SETTLED, PointState.REJECTED, PointState.PLANNED}),
    PointState.SETTLED: frozenset({PointState.MEASURED, PointState.REJECTED, PointState.PLANNED}),
    PointState.MEASURED: FINISHED,
    PointState.ACCEPTED: frozenset(),
    PointState.REJECTED: frozenset(),
}


def check_transition(old: State, new: State) -> None:
    """Raises StateError when the table does not lead from ``old`` to ``new``."""
    if new not in TRANSITIONS[old]:
        allowed = ", ".join(sorted(TRANSITIONS[old])) or "nothing: it has ended"
        raise StateError(f"a campaign that is {old} cannot become {new}; allowed: {allowed}")


def before(new: PointState) -> list[str]:
    """The states that a point may come from when it becomes ``new``."""
    return sorted(old.value for old, following in POINT_TRANSITIONS.items() if new in following)


def shown_state(stored: str, *, alive: bool) -> State:
    """What a campaign is, from what is stored of it and whether its process lives.

    >>> shown_state("running", alive=False).value, shown_state("done", alive=False).value
    ('interrupted', 'done')
    """
    state = State(stored)
    return State.INTERRUPTED if state in LIVE and not alive else state
