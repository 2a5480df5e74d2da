"""An experiment's files: ``<name>.json`` for machines, ``<name>.html`` with the same tables for people."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from bench.commands.streams import VIRTUAL
from experiments.harness.registry import Entry
from experiments.harness.result import Result, shown

_TEMPLATES = Path(__file__).parent


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """What is written of one run; ``created`` in ISO format."""

    entry: Entry
    result: Result
    scale: float
    seconds: float
    created: str

    def as_plain(self) -> dict[str, Any]:
        """The content of the JSON file, schema 1."""
        head = {"schema": 1, "experiment": self.entry.name, "title": self.entry.experiment.title}
        run = {"scale": self.scale, "seconds": self.seconds, "created": self.created}
        return head | run | self.result.as_plain()

    def html(self) -> str:
        """The page."""
        environment = Environment(
            loader=FileSystemLoader(_TEMPLATES), autoescape=True, undefined=StrictUndefined
        )
        environment.filters["shown"] = shown
        paragraphs = [" ".join(part.split()) for part in self.entry.about.split("\n\n")]
        return environment.get_template("page.html").render(page=self, paragraphs=paragraphs, virtual=VIRTUAL)

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Write both files in one step each."""
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.as_plain(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        written = {".json": text, ".html": self.html()}
        paths = [folder / f"{self.entry.name}{ending}" for ending in written]
        for path, content in zip(paths, written.values(), strict=True):
            beside = path.with_name(path.name + ".part")
            beside.write_text(content, encoding="utf-8")
            os.replace(beside, path)
        return paths[0], paths[1]
