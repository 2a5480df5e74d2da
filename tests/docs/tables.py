"""Tables of a page, by the headings that they stand under."""

import re
from dataclasses import dataclass
from pathlib import Path

Row = tuple[str, ...]


@dataclass(frozen=True)
class PageTable:
    """One table: its headings of the second and third level, and its rows, cells without code marks."""

    part: str
    heading: str
    rows: tuple[Row, ...]


def tables(page: Path) -> list[PageTable]:
    """All tables of a page, in order."""
    found: list[PageTable] = []
    part = heading = ""
    rows: list[Row] | None = None
    for line in [*page.read_text(encoding="utf-8").splitlines(), ""]:
        if rows is not None and not line.startswith("|"):
            found.append(PageTable(part, heading, tuple(rows)))
            rows = None
        if line.startswith("## "):
            part, heading = _plain(line[3:]), ""
        elif line.startswith("### "):
            heading = _plain(line[4:])
        elif line.startswith("|---"):
            rows = []
        elif rows is not None:
            rows.append(tuple(_plain(cell) for cell in re.split(r"(?<!\\)\|", line.strip().strip("|"))))
    return found


def _plain(text: str) -> str:
    return text.strip().replace("`", "")
