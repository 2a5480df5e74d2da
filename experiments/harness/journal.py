"""Finished trials on disk, one JSON line each, so that a run that was stopped goes on where it was.

A line belongs to the code that wrote it: trials of other code are not taken for this one's, and stay in the
file. A last line that was cut off by a crash is dropped.
"""

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

Record = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Journal:
    """The file, and the hash of the code whose trials count."""

    path: Path
    code: str

    def read(self) -> dict[str, Record]:
        """Records of this code by key; a file with a torn line is put right."""
        lines = [line for line in self._lines() if line["code"] == self.code]
        return {line["key"]: line["record"] for line in lines}

    def append(self, key: str, record: Record) -> None:
        """Add a record."""
        line = json.dumps({"key": key, "code": self.code, "record": record}, allow_nan=False)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")

    def _lines(self) -> list[dict[str, Any]]:
        if not self.path.exists():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            return []
        text = self.path.read_text(encoding="utf-8")
        whole, torn = text.rpartition("\n")[0], not text.endswith("\n") and text != ""
        if torn:
            beside = self.path.with_suffix(".part")
            beside.write_text(whole + "\n" if whole else "", encoding="utf-8")
            os.replace(beside, self.path)
        return [json.loads(line) for line in whole.splitlines()]


def code_hash(*modules: ModuleType) -> str:
    """SHA-256, shortened, over the Python and TOML files of packages, and the files of single modules."""
    digest = hashlib.sha256()
    for module in modules:
        for path in _files(module):
            digest.update(f"{module.__name__} {path.name}\n".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _files(module: ModuleType) -> list[Path]:
    if not hasattr(module, "__path__"):
        return [Path(module.__file__ or "")]
    return sorted(p for p in Path(module.__path__[0]).rglob("*") if p.suffix in (".py", ".toml"))
