"""What an experiment hands back: goals and comparisons with their verdicts, tables, pictures, and notes."""

import math
from dataclasses import asdict, dataclass
from typing import Any, Self

Cell = str | int | float | bool | None
POINTS = 100.0  # of efficiency in a unit

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

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> Self:
        """A goal read back."""
        return cls(
            name=plain["name"],
            value=math.nan if plain["value"] is None else plain["value"],
            bar=plain["bar"],
            at_least=plain["sense"] == "at least",
            unit=plain["unit"],
            ci95=None if plain["ci95"] is None else tuple(plain["ci95"]),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A figure of the paper beside ours: met where they differ by at most ``tolerance``, which has a ``reason``.

    ``spread`` is the standard deviation of ours, over labs or runs. A tolerance of infinity takes no verdict: the
    paper gives nothing to compare, or what it gives depends on its machine.
    """

    name: str
    paper: float
    ours: float
    unit: str
    tolerance: float
    reason: str
    spread: float | None = None

    @property
    def difference(self) -> float:
        """Ours less the paper's."""
        return self.ours - self.paper

    @property
    def verdict(self) -> str:
        """``met``, ``missed``, or ``shown`` where nothing is demanded; what is not known is missed."""
        if math.isinf(self.tolerance):
            return "shown"
        return "met" if abs(self.difference) <= self.tolerance else "missed"

    def as_plain(self) -> dict[str, Any]:
        """Plain data."""
        plain = {name: _finite(value) for name, value in asdict(self).items()}
        return plain | {"difference": _finite(self.difference), "verdict": self.verdict}

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> Self:
        """A comparison read back."""
        kept = {name: value for name, value in plain.items() if name not in ("difference", "verdict")}
        unknown = {name: math.nan for name in ("paper", "ours") if kept[name] is None}
        endless = {"tolerance": math.inf} if kept["tolerance"] is None else {}
        return cls(**kept | unknown | endless)


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure as a PNG, with what it shows."""

    name: str
    caption: str
    png: bytes

    def as_plain(self) -> dict[str, Any]:
        """Name and caption; the image is a file of its own."""
        return {"name": self.name, "caption": self.caption}


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

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> Self:
        """A table read back."""
        return cls(
            title=plain["title"], columns=tuple(plain["columns"]), rows=tuple(map(tuple, plain["rows"]))
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """All of an experiment's outcome; ``virtual`` when any of it was measured in a virtual lab.

    ``assumed`` lists what the paper does not give and was chosen here.
    """

    goals: tuple[Goal, ...] = ()
    tables: tuple[Table, ...] = ()
    notes: tuple[str, ...] = ()
    virtual: bool = False
    comparisons: tuple[Comparison, ...] = ()
    pictures: tuple[Picture, ...] = ()
    assumed: tuple[str, ...] = ()

    def goal_table(self) -> Table:
        """The goals as a table, met and missed."""
        rows = tuple((g.name, _value(g), _bar(g), g.verdict) for g in self.goals)
        return Table(title="Goals", columns=("goal", "value", "bar", "verdict"), rows=rows)

    def comparison_table(self) -> Table:
        """The paper's figures beside ours."""
        columns = ("what", "paper", "here", "±", "unit", "difference", "tolerance", "verdict", "reason")
        rows = tuple(
            (
                c.name, c.paper, c.ours, c.spread, c.unit, c.difference,
                None if math.isinf(c.tolerance) else c.tolerance, c.verdict, c.reason,
            )
            for c in self.comparisons
        )  # fmt: skip
        return Table(title="Beside the paper", columns=columns, rows=rows)

    def judged_tables(self) -> tuple[Table, ...]:
        """Comparisons and goals, where there are any."""
        found = [self.comparison_table()] if self.comparisons else []
        return (*found, self.goal_table()) if self.goals else tuple(found)

    def as_plain(self) -> dict[str, Any]:
        """Plain data; pictures by name."""
        return {
            "virtual": self.virtual,
            "comparisons": [comparison.as_plain() for comparison in self.comparisons],
            "goals": [goal.as_plain() for goal in self.goals],
            "tables": [table.as_plain() for table in self.tables],
            "pictures": [picture.as_plain() for picture in self.pictures],
            "notes": list(self.notes),
            "assumed": list(self.assumed),
        }

    @classmethod
    def from_plain(cls, plain: dict[str, Any], images: dict[str, bytes]) -> Self:
        """A result read back, with its pictures' images by name."""
        return cls(
            goals=tuple(Goal.from_plain(goal) for goal in plain["goals"]),
            tables=tuple(Table.from_plain(table) for table in plain["tables"]),
            notes=tuple(plain["notes"]),
            virtual=plain["virtual"],
            comparisons=tuple(Comparison.from_plain(c) for c in plain["comparisons"]),
            pictures=tuple(Picture(png=images[p["name"]], **p) for p in plain["pictures"]),
            assumed=tuple(plain["assumed"]),
        )


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
