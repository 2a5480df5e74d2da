"""What an experiment hands back: goals with their verdicts, tables, and notes."""

import math
from dataclasses import dataclass
from typing import Any

Cell = str | int | float | bool | None

_NOTHING, _LARGE = 1e-15, 1e4  # smaller is not worth an exponent, larger has no decimals


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """A measured value beside the bar that it must reach; ``ci95`` is its 95 % interval, if it has one."""

    name: str
    value: float
    bar: float
    at_least: bool
    unit: str = ""
    ci95: tuple[float, float] | None = None

    @property
    def met(self) -> bool:
        """Whether the bar is reached; a value that is not known reaches none."""
        return self.value >= self.bar if self.at_least else self.value <= self.bar

    @property
    def verdict(self) -> str:
        """``met`` or ``missed``."""
        return "met" if self.met else "missed"

    def as_plain(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "name": self.name,
            "value": _finite(self.value),
            "ci95": None if self.ci95 is None else list(self.ci95),
            "unit": self.unit,
            "bar": self.bar,
            "sense": "at least" if self.at_least else "at most",
            "verdict": self.verdict,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of cells under named columns."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{self.title}: {len(row)} cells for {len(self.columns)} columns: {row}")

    def as_plain(self) -> dict[str, Any]:
        """Plain data."""
        rows = [[_finite(cell) for cell in row] for row in self.rows]
        return {"title": self.title, "columns": list(self.columns), "rows": rows}


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """All of an experiment's outcome; ``virtual`` when any of it was measured in a virtual lab."""

    goals: tuple[Goal, ...]
    tables: tuple[Table, ...]
    notes: tuple[str, ...] = ()
    virtual: bool = False

    def goal_table(self) -> Table:
        """The goals as a table, met and missed."""
        rows = tuple((g.name, _value(g), _bar(g), g.verdict) for g in self.goals)
        return Table(title="Goals", columns=("goal", "value", "bar", "verdict"), rows=rows)

    def as_plain(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "virtual": self.virtual,
            "goals": [goal.as_plain() for goal in self.goals],
            "tables": [table.as_plain() for table in self.tables],
            "notes": list(self.notes),
        }


def shown(cell: Cell) -> str:
    """A cell as people read it: four significant digits, a dash for what is not known.

    >>> shown(0.123456), shown(12500.0), shown(1e-65), shown(True), shown(None)
    ('0.1235', '12500', '0', 'yes', '–')
    """
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, float) and math.isfinite(cell):
        if abs(cell) < _NOTHING:
            return "0"
        return f"{cell:.0f}" if abs(cell) >= _LARGE else f"{cell:.4g}"
    return "–" if cell is None or isinstance(cell, float) else str(cell)


def _value(goal: Goal) -> str:
    value = f"{shown(float(goal.value))} {goal.unit}".rstrip()
    if goal.ci95 is None:
        return value
    low, high = (shown(float(bound)) for bound in goal.ci95)
    return f"{value} (95 %: {low} to {high})"


def _bar(goal: Goal) -> str:
    return f"{'≥' if goal.at_least else '≤'} {shown(float(goal.bar))} {goal.unit}".rstrip()


def _finite(cell: Cell) -> Cell:
    """JSON knows no NaN."""
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell
