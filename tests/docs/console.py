"""Documented commands: found in the pages, run as they stand, and compared with what the page says they print."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
FILE_NAME = re.compile(r"^# (\S+\.toml)\n")


@dataclass(frozen=True)
class Command:
    """One documented command line and the lines that it prints, as far as the page tells."""

    words: tuple[str, ...]
    expected: str

    def __str__(self) -> str:
        return shlex.join(self.words)

    @property
    def background(self) -> bool:
        return self.words[-1] == "&"


def commands(page: Path) -> list[Command]:
    """The commands of a page's blocks, in order; those of a ``sh`` block print what the page does not tell."""
    found = []
    for language, body in BLOCK.findall(page.read_text(encoding="utf-8")):
        if language == "console":
            for part in re.split(r"^\$ ", body, flags=re.MULTILINE)[1:]:
                line, _, expected = part.partition("\n")
                found.append(Command(tuple(shlex.split(line)), expected))
        elif language == "sh":
            lines = (shlex.split(line, comments=True) for line in body.splitlines())
            found += [Command(tuple(words), "") for words in lines if words]
    return found


def files(page: Path) -> dict[str, str]:
    """The TOML files that a page has its reader write, by name."""
    blocks = [
        body for language, body in BLOCK.findall(page.read_text(encoding="utf-8")) if language == "toml"
    ]
    return {match[1]: body for body in blocks if (match := FILE_NAME.match(body))}


def mismatch(command: Command, printed: str) -> str:
    """What does not fit, empty where all does.

    ``...`` stands for anything in its line, alone in a line for any number of lines; blanks for any blanks.
    """
    pattern = "".join(_line(line) for line in command.expected.splitlines() if line.strip())
    lines = "".join(f"{line.strip()}\n" for line in printed.splitlines() if line.strip())
    return (
        ""
        if re.fullmatch(pattern, lines)
        else f"{command}\nsays the page:\n{command.expected}\nprinted was:\n{printed}"
    )


def _line(line: str) -> str:
    if line.strip() == "...":
        return r"(?:[^\n]*\n)*?"
    pieces = [r"\s+".join(map(re.escape, piece.split())) for piece in line.strip().split("...")]
    return r"[^\n]*".join(pieces) + r"[ ]*\n"
