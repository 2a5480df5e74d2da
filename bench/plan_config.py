"""campaign.toml: what to measure, as checked objects."""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from bench.section import Count, Duty, NotNegative, Positive, Probability, Section


class SetPointConfig(Section):
    """One set point."""

    D1: Duty = Field(description="primary duty ratio, 0 to 1")
    D2: Duty = Field(description="secondary inner phase shift, 0 to 1")
    power_W: Positive = Field(description="output power, above 0")


class AdaptiveConfig(Section):
    """How an adaptive plan begins, goes on and ends."""

    start: int = Field(default=12, ge=8, description="set points with load to begin with, spread out")
    at_once: int = Field(default=4, ge=1, description="rows that one diagnosis chooses")
    candidates: int = Field(default=200, ge=12, description="feasible set points to choose from")
    minutes: Positive | None = Field(default=None, description="bench time to end after; without it no limit")
    probability: Probability = Field(default=0.95, description="of every stated cause, to end with")
    optimum: Positive = Field(
        default=5e-4, description="standard uncertainty of efficiency near the optimum, to end with"
    )
    lost: Positive = Field(
        default=1e-4, description="efficiency lost on average where another hill is the best one, to end with"
    )


_PLAN_KEYS = {
    "latin_hypercube": ("points",),
    "grid": ("shape",),
    "points": ("set_points", "file"),
    "adaptive": ("points", "adaptive"),
}
_REFERENCE_EVERY = 6  # of an adaptive plan: noise comes from replicates, and a diagnosis lives by it


class PlanConfig(Section):
    """Which points, how often, in which order."""

    kind: Literal["grid", "latin_hypercube", "points", "adaptive"] = Field(
        description="how the points are chosen"
    )
    points: int | None = Field(
        default=None,
        ge=1,
        description="latin_hypercube: number of feasible points; adaptive: most rows in all",
    )
    adaptive: AdaptiveConfig | None = Field(
        default=None, description="adaptive: how it begins, goes on, ends"
    )
    shape: tuple[int, int, int] | None = Field(default=None, description="grid: counts of D1, D2 and power")
    set_points: list[SetPointConfig] | None = Field(default=None, description="points: D1, D2, power_W each")
    file: Path | None = Field(default=None, description="points: a CSV with the columns D1, D2, P_set_W")
    repeats: int = Field(default=1, ge=1, description="how often each point is measured")
    reference_every: Count = Field(
        default=0, description="a reference after every N points; 0: none (adaptive: 6 by default)"
    )
    reference: SetPointConfig | None = Field(default=None, description="the reference; else a central point")
    heat_margin: NotNegative = Field(
        default=0.15, description="how much hotter than predicted a part may get, of its rise over ambient"
    )
    power_margin: NotNegative = Field(
        default=0.02, description="how much more current and power than predicted a point may take"
    )
    order: Literal["random", "given", "power"] = Field(
        default="random", description="random tells drift from load"
    )
    standby: Count = Field(default=2, description="rows with the PWM off, first")
    no_load: Count = Field(default=2, description="rows with the PWM on and the load off, after standby")

    @model_validator(mode="before")
    @classmethod
    def _of_its_kind(cls, given: object) -> object:
        if isinstance(given, dict) and given.get("kind") == "adaptive":
            return {"reference_every": _REFERENCE_EVERY, "adaptive": {}, **given}
        return given

    @field_validator("shape")
    @classmethod
    def _shape_counts(cls, shape: tuple[int, int, int] | None) -> tuple[int, int, int] | None:
        if shape is not None and min(shape) < 1:
            raise ValueError("each of the three counts must be at least 1")
        return shape

    @model_validator(mode="after")
    def _has_its_points(self) -> Self:
        given = {
            "latin_hypercube": ("points", self.points is not None),
            "grid": ("shape", self.shape is not None),
            "points": ("set_points or file (one of them)", (self.set_points is None) != (self.file is None)),
            "adaptive": ("points", self.points is not None),
        }
        needed, present = given[self.kind]
        if not present:
            raise ValueError(f'kind = "{self.kind}" needs {needed}')
        others = {name for names in _PLAN_KEYS.values() for name in names} - set(_PLAN_KEYS[self.kind])
        idle = sorted(name for name in others if getattr(self, name) is not None)
        if idle:
            raise ValueError(f'kind = "{self.kind}" does not use {", ".join(idle)}')
        return self


class RangesConfig(Section):
    """The box of a grid or a Latin hypercube."""

    D1: tuple[Duty, Duty] = Field(default=(0.3, 1.0), description="[low, high] within 0 to 1")
    D2: tuple[Duty, Duty] = Field(default=(0.0, 0.6), description="[low, high] within 0 to 1")
    power_W: tuple[Positive, Positive] = Field(
        default=(200.0, 2000.0), description="[low, high] in W, above 0"
    )

    @field_validator("D1", "D2", "power_W")
    @classmethod
    def _ordered(cls, pair: tuple[float, float]) -> tuple[float, float]:
        if pair[0] > pair[1]:
            raise ValueError("the first value is the low end, the second the high end")
        return pair
