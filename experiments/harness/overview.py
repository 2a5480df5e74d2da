"""All experiments on one page, ``all.html``, and every row of them in ``all.json``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.whole_file import write_whole
from experiments.harness.page import Page, environment, json_text
from experiments.harness.result import Cell


@dataclass(frozen=True, slots=True, kw_only=True)
class Overview:
    """The pages of one run of all experiments, in the order of their names."""

    pages: tuple[Page, ...]
    scale: float
    created: str

    columns = ("experiment", "what", "paper or bar", "here", "unit", "difference", "tolerance", "verdict")

    @property
    def seconds(self) -> float:
        """Work that is in it, of earlier runs too."""
        return sum(page.seconds for page in self.pages)

    def rows(self) -> list[tuple[Cell, ...]]:
        """One row per comparison with the paper and per goal."""
        found: list[tuple[Cell, ...]] = []
        for page in self.pages:
            for plain in page.result.as_plain()["comparisons"]:
                cells = ("name", "paper", "ours", "unit", "difference", "tolerance", "verdict")
                found.append((page.entry.name, *(plain[cell] for cell in cells)))
            for plain in page.result.as_plain()["goals"]:
                bar = f"{plain['sense']} {plain['bar']:g}"
                found.append(
                    (page.entry.name, plain["name"], bar, plain["value"], plain["unit"], None, None, plain["verdict"])
                )  # fmt: skip
        return found

    def count(self, verdict: str) -> int:
        """How many rows came out so."""
        return sum(row[-1] == verdict for row in self.rows())

    def as_plain(self) -> dict[str, Any]:
        """The content of ``all.json``, schema 1: verdicts counted, every row, every experiment."""
        return {
            "schema": 1,
            "virtual": True,
            "scale": self.scale,
            "seconds": self.seconds,
            "created": self.created,
            "verdicts": {verdict: self.count(verdict) for verdict in ("met", "missed", "shown")},
            "rows": [dict(zip(self.columns, row, strict=True)) for row in self.rows()],
            "experiments": {page.entry.name: page.as_plain() for page in self.pages},
        }

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Write both files."""
        json_file, html_file = folder / "all.json", folder / "all.html"
        write_whole(json_file, json_text(self.as_plain()))
        write_whole(html_file, environment().get_template("all.html").render(overview=self))
        return json_file, html_file
