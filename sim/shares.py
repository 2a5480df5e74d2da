"""Which circuits are solved in one call, and by which process: what takes the least time.

A call takes as long as so many rows before it has solved any, since every step of it is an operation of numpy. Circuits
whose inductor saturates take longer, and make all of their call do so: they have calls of their own where others are
many, and few processes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

_CALL = 1700  # rows that take as long as a call does by itself
_SATURATING = 6  # times as long does each row take, if any of them saturates
_SENT = 400  # rows that take as long as to ask another process


@dataclass(frozen=True, slots=True)
class Share:
    """What one process solves: circuits by their numbers, the ``plain`` ones and those that saturate, ``rows`` each."""

    plain: tuple[int, ...]
    saturating: tuple[int, ...]
    rows: int

    @property
    def circuits(self) -> tuple[int, ...]:
        """All of them, in their order."""
        return tuple(sorted((*self.plain, *self.saturating)))

    @property
    def calls(self) -> list[list[int]]:
        """The circuits of each call."""
        if self.cost == _together(len(self.plain), len(self.saturating), self.rows):
            return [list(self.circuits)]
        return [list(self.plain), list(self.saturating)]

    @property
    def cost(self) -> int:
        """Rows that take as long."""
        return _least(len(self.plain), len(self.saturating), self.rows)


def _together(plain: int, saturating: int, rows: int) -> int:
    """Rows that take as long as one call of so many circuits."""
    return _CALL + rows * (plain + saturating) * (_SATURATING if saturating else 1)


def _least(plain: int, saturating: int, rows: int) -> int:
    """The same in one call, or in one for each kind, whichever takes less."""
    whole = _together(plain, saturating, rows)
    if not plain or not saturating:
        return whole
    return min(whole, _together(plain, 0, rows) + _together(0, saturating, rows))


def shares(saturates: Sequence[bool], rows: int, processes: int) -> list[Share]:
    """The share of each process, of as many as are worth it: what the slowest one does takes the least time.

    >>> [share.circuits for share in shares([False, False, True], 2000, 2)]
    [(2,), (0, 1)]
    >>> len(shares([False] * 4, 100, 2))
    1
    """
    every = _plan(saturates, rows, 1, 1)
    plans = [_plan(saturates, rows, processes, apart) for apart in range(1, processes + 1) if processes > 1]
    return min([every, *plans], key=lambda plan: max(share.cost for share in plan) + _SENT * (len(plan) - 1))


def _plan(saturates: Sequence[bool], rows: int, processes: int, apart: int) -> list[Share]:
    """Shares of which so many have all that saturate; each of the others goes where least is done with it."""
    kinds = [[k for k, own in enumerate(saturates) if own == kind] for kind in (False, True)]
    saturating = [tuple(kinds[True][first::apart]) for first in range(apart)] + [()] * (processes - apart)
    plain: list[list[int]] = [[] for _ in range(processes)]
    for k in kinds[False]:
        costs = [_least(len(own) + 1, len(hard), rows) for own, hard in zip(plain, saturating, strict=True)]
        plain[costs.index(min(costs))].append(k)
    dealt = [Share(tuple(own), hard, rows) for own, hard in zip(plain, saturating, strict=True)]
    return [share for share in dealt if share.circuits]
