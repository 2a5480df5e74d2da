"""The log: every record knows its campaign and point, and every byte on a wire can be in it.

``D2EA_LOG=info`` sets the level of what is said on standard error; ``D2EA_LOG=debug:run.jsonl`` also writes every
record of that level to a file, one JSON object per line: ``time``, ``level``, ``said``, and whatever is known of
``campaign``, ``point``, ``instrument``, ``command``, ``reply``, ``detail``. Level ``debug`` holds the wires.
"""

import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import UTC, datetime

KEYS = ("campaign", "point", "instrument", "command", "reply", "detail")
log = logging.getLogger("d2ea.campaign")
wire = logging.getLogger("d2ea.wire")
_ABOUT: ContextVar[dict[str, object]] = ContextVar("about", default={})  # noqa: B039  never changed in place


@contextmanager
def about(**what: object) -> Iterator[None]:
    """Every record written inside is about this: ``campaign``, ``point``."""
    token = _ABOUT.set({**_ABOUT.get(), **what})
    try:
        yield
    finally:
        _ABOUT.reset(token)


class JsonLines(logging.Formatter):
    """One JSON object per record."""

    def format(self, record: logging.LogRecord) -> str:
        """The record as one line."""
        when = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line = {
            "time": when,
            "level": record.levelname.lower(),
            "from": record.name,
            "said": record.getMessage(),
        }
        if record.exc_info:
            line["error"] = self.formatException(record.exc_info)
        return json.dumps({**line, **known(record)}, ensure_ascii=False, default=str)


class Plain(logging.Formatter):
    """One line for people."""

    def format(self, record: logging.LogRecord) -> str:
        """The record as one line."""
        told = " ".join(f"{key}={value}" for key, value in known(record).items())
        line = f"{record.levelname} {record.name}: {record.getMessage()}" + (f" [{told}]" if told else "")
        return f"{line}\n{self.formatException(record.exc_info)}" if record.exc_info else line


def known(record: logging.LogRecord) -> dict[str, object]:
    """What a record is about: what surrounds it, and what it says itself."""
    own = {key: getattr(record, key) for key in KEYS if hasattr(record, key)}
    return {**_ABOUT.get(), **own}


def start_log(setting: str) -> str | None:
    """Set the log up from ``LEVEL`` or ``LEVEL:FILE``; returns what is wrong with the setting, if anything is."""
    word, _, file = setting.partition(":")
    levels = logging.getLevelNamesMapping()
    level = levels.get(word.upper(), logging.WARNING)
    root = logging.getLogger()
    said = logging.StreamHandler(sys.stderr)
    said.setFormatter(Plain())
    said.setLevel(max(level, logging.WARNING) if file else level)
    root.handlers[:] = [said]
    root.setLevel(level)
    if file:
        try:
            kept = logging.FileHandler(file, encoding="utf-8")
        except OSError as error:
            return f"D2EA_LOG: {file} cannot be written: {error.strerror}"
        kept.setFormatter(JsonLines())
        root.addHandler(kept)
    for noisy in ("pymodbus", "matplotlib", "asyncio", "sqlalchemy"):
        logging.getLogger(noisy).setLevel(max(level, logging.WARNING))
    if word.upper() in levels:
        return None
    return f"D2EA_LOG = {word!r} is no level; one of {', '.join(levels).lower()}, then :FILE where wanted"
