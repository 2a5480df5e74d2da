"""An experiment's files: ``<name>.json`` for machines, ``<name>.html`` with the same content for people, and a PNG
for each of its pictures."""

import base64
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from bench.commands.streams import VIRTUAL
from bench.whole_file import write_whole
from experiments.harness.registry import Entry
from experiments.harness.result import Picture, Result, shown

_TEMPLATES = Path(__file__).parent


def environment() -> Environment:
    """The templates beside this file."""
    made = Environment(
        loader=FileSystemLoader(_TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    made.filters["shown"] = shown
    made.filters["embedded"] = _embedded
    made.globals["virtual"] = VIRTUAL
    return made


def json_text(plain: dict[str, Any]) -> str:
    """Plain data as JSON that any parser takes."""
    return json.dumps(plain, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _embedded(picture: Picture) -> str:
    return "data:image/png;base64," + base64.b64encode(picture.png).decode("ascii")


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """What is written of one run; ``created`` in ISO format, ``code`` the hash of the code that ran."""

    entry: Entry
    result: Result
    scale: float
    seconds: float
    created: str
    code: str = ""

    def as_plain(self) -> dict[str, Any]:
        """The content of the JSON file, schema 1."""
        head = {"schema": 1, "experiment": self.entry.name, "title": self.entry.experiment.title}
        run = {"scale": self.scale, "seconds": self.seconds, "created": self.created, "code": self.code}
        return head | run | self.result.as_plain()

    def paragraphs(self) -> list[str]:
        """What the experiment's file says of itself."""
        return [" ".join(part.split()) for part in self.entry.about.split("\n\n")]

    def html(self) -> str:
        """The page."""
        return environment().get_template("page.html").render(page=self)

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Write all files, each in one step; the paths of JSON and page."""
        for picture in self.result.pictures:
            write_whole(folder / _image(self.entry, picture.name), picture.png)
        json_file, html_file = (folder / f"{self.entry.name}.{end}" for end in ("json", "html"))
        write_whole(html_file, self.html())
        write_whole(json_file, json_text(self.as_plain()))
        return json_file, html_file

    @classmethod
    def read(cls, folder: Path, entry: Entry) -> Self | None:
        """What an earlier run wrote; None where there is nothing whole."""
        try:
            plain = json.loads((folder / f"{entry.name}.json").read_text(encoding="utf-8"))
            images = {p["name"]: (folder / _image(entry, p["name"])).read_bytes() for p in plain["pictures"]}
            return cls(
                entry=entry,
                result=Result.from_plain(plain, images),
                **{name: plain[name] for name in ("scale", "seconds", "created", "code")},
            )
        except (OSError, ValueError, KeyError):
            return None


def _image(entry: Entry, name: str) -> str:
    return f"{entry.name}-{name}.png"
