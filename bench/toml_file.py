"""TOML in and out: parse errors with their line, and a key's line."""

import json
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

from bench.errors import InputError, Problem

Plain = Mapping[str, object]

_HEADER = re.compile(r"^\s*\[\[?\s*([^\]]+?)\s*\]\]?")
_KEY = re.compile(r"^\s*([A-Za-z0-9_\-.\"']+)\s*=")
_BARE = re.compile(r"^[A-Za-z0-9_-]+$")
_LINE = re.compile(r"at line (\d+)")


def read_toml(path: Path) -> dict[str, object]:
    """The file as plain data; InputError names the file, and the line of a syntax error."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError.of(path, "file", None, "there is no such file") from None
    except (IsADirectoryError, PermissionError, UnicodeDecodeError) as error:
        raise InputError.of(path, "file", None, f"cannot be read as text: {error}") from error
    except tomllib.TOMLDecodeError as error:
        found = _LINE.search(str(error))
        problem = Problem(
            file=str(path),
            field="TOML syntax",
            value=None,
            allowed=str(error),
            line=int(found.group(1)) if found else None,
        )
        raise InputError([problem]) from error


def line_of(text: str, keys: Sequence[str]) -> int | None:
    """Line (from 1) where the dotted ``keys`` are set, else that of the deepest table holding them."""
    wanted, depth = tuple(keys), 0
    table: tuple[str, ...] = ()
    best: int | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = tuple(part.strip(" \"'") for part in header.group(1).split("."))
            if wanted[: len(table)] == table and len(table) > depth:
                best, depth = number, len(table)
        elif key := _KEY.match(line):
            full = (*table, *(part.strip(" \"'") for part in key.group(1).split(".")))
            if wanted[: len(full)] == full and len(full) > depth:
                best, depth = number, len(full)
    return best


def to_toml(data: Plain) -> str:
    """Plain data as TOML text: scalars first, then one table per mapping."""
    return "\n".join(_lines(data, ())) + "\n"


def _lines(data: Plain, path: tuple[str, ...]) -> list[str]:
    lines: list[str] = []
    nested = {key: value for key, value in data.items() if isinstance(value, Mapping)}
    for key, value in data.items():
        if key not in nested and value is not None:
            lines.append(f"{_key(key)} = {_value(value)}")
    for key, table in nested.items():
        inner = (*path, key)
        lines += ["", f"[{'.'.join(map(_key, inner))}]", *_lines(table, inner)]
    return lines


def _key(key: str) -> str:
    return key if _BARE.match(key) else json.dumps(key, ensure_ascii=False)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else ("nan" if math.isnan(value) else f"{value:+}")
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    raise TypeError(f"{value!r} ({type(value).__name__}) has no TOML form here")
