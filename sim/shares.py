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
    """Circuits ``saturates`` tells of, each of so many ``rows``, by their numbers, that one process solves."""

    circuits: tuple[int, ...]
    saturates: Sequence[bool]
    rows: int

    @property
    def calls(self) -> list[list[int]]:
        """The circuits of each call; none of a share without any."""
        kinds = [[k for k in self.circuits if self.saturates[k] == kind] for kind in (False, True)]
        apart = [kind for kind in kinds if kind]
        whole = [list(self.circuits)]
        return whole if len(apart) > 1 and self._cost(whole) <= self._cost(apart) else apart

    @property
    def cost(self) -> int:
        """Rows that take as long."""
        return self._cost(self.calls)

    def _cost(self, calls: Sequence[Sequence[int]]) -> int:
        return sum(
            _CALL + self.rows * len(call) * (_SATURATING if any(self.saturates[k] for k in call) else 1)
            for call in calls
        )


def shares(saturates: Sequence[bool], rows: int, processes: int) -> list[Share]:
    """The share of each process, of as many as are worth it: what the slowest one does takes the least time.

    >>> [share.circuits for share in shares([False, False, True], 2000, 2)]
    [(2,), (0, 1)]
    >>> len(shares([False] * 4, 100, 2))
    1
    """
    every = [Share(tuple(range(len(saturates))), saturates, rows)]
    plans = [every, *(_plan(saturates, rows, processes, apart) for apart in range(1, processes + 1))]
    return min(plans, key=lambda plan: max(share.cost for share in plan) + _SENT * (len(plan) - 1))


def _plan(saturates: Sequence[bool], rows: int, processes: int, apart: int) -> list[Share]:
    """Shares of which so many have all that saturate; each of the others goes where least is done with it."""
    own: list[list[int]] = [[] for _ in range(processes)]
    hard = [k for k, saturating in enumerate(saturates) if saturating]
    for n, k in enumerate(hard):
        own[n % apart].append(k)

    def with_one_more(k: int, process: int) -> int:
        return Share((*own[process], k), saturates, rows).cost

    for k in (k for k, saturating in enumerate(saturates) if not saturating):
        own[min(range(processes), key=lambda process: with_one_more(k, process))].append(k)
    return [Share(tuple(sorted(part)), saturates, rows) for part in own if part]
