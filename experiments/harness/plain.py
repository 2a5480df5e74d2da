"""Tables as plain aligned text, for files and pipes."""

from experiments.harness.result import Table, shown


def plain_lines(table: Table) -> list[str]:
    """Title, header and one line a row; numbers to the right.

    >>> table = Table(title="Speed", columns=("what", "s"), rows=(("grid", 2.5), ("swarm", 12.0)))
    >>> plain_lines(table)
    ['Speed', 'what     s', 'grid   2.5', 'swarm   12']
    """
    cells = [[shown(cell) for cell in row] for row in table.rows]
    numbers = [all(is_number(row[k]) for row in table.rows) for k in range(len(table.columns))]
    widths = [max(map(len, column)) for column in zip(table.columns, *cells, strict=True)]

    def line(texts: tuple[str, ...] | list[str]) -> str:
        parts = zip(texts, widths, numbers, strict=True)
        return "  ".join(t.rjust(w) if right else t.ljust(w) for t, w, right in parts).rstrip()

    return [table.title, line(table.columns), *map(line, cells), *([] if cells else ["none"])]


def is_number(cell: object) -> bool:
    """Whether a cell belongs to the right; one that is not known disturbs no column of numbers."""
    return cell is None or (isinstance(cell, int | float) and not isinstance(cell, bool))
