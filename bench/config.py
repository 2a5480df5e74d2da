"""The operator's files as checked objects: bench.toml and campaign.toml.

Unknown keys are refused and the nearest known one is named; all problems of its keys are reported at once, each with
its line, the value found, and what is allowed, and after them what contradicts itself.
"""

import hashlib
import json
import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from bench.checking import SectionT
from bench.checking import check as check
from bench.plan_config import PlanConfig, RangesConfig
from bench.section import Duty, NotNegative, Positive, Section
from bench.toml_file import read_toml
from drivers.analyzer_model import load_analyzer_model
from drivers.modbus_map import load_map

# --- bench.toml -------------------------------------------------------------------------------------


class WiringConfig(Section):
    """Which analyzer element measures what."""

    input: int = Field(default=1, ge=1, le=6, description="element on the dc input")
    output: int = Field(default=2, ge=1, le=6, description="element on the dc output")
    link1: int | None = Field(default=None, ge=1, le=6, description="element before the inductor, if wired")
    link2: int | None = Field(
        default=None, ge=1, le=6, description="element behind the transformer, if wired"
    )

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        used = [element for element in (self.input, self.output, self.link1, self.link2) if element]
        if len(set(used)) < len(used):
            raise ValueError("each quantity needs an element of its own")
        return self


class AnalyzerConfig(Section):
    """The power analyzer."""

    model: str = Field(default="wt3000", min_length=1, description="name of a model in drivers/maps")
    resource: str = Field(min_length=1, description="serial device or URL, e.g. /dev/serial/by-id/...")
    baud: int = Field(default=9600, gt=0, description="baud rate")
    update_s: Positive = Field(default=0.5, le=20.0, description="update interval in seconds, 0.05 to 20")
    ranges: dict[str, float] = Field(
        default_factory=dict, description="fixed ranges, e.g. U1 = 300; else auto"
    )
    scaled: bool = Field(
        default=False,
        description="whether elements multiply by ratios of sensors that were set at the instrument",
    )
    wiring: WiringConfig = WiringConfig()
    timeout_s: Positive = Field(default=2.0, le=60.0, description="longest wait for an immediate reply")
    lateness_s: Positive = Field(default=1.0, le=60.0, description="no reply comes later after its deadline")

    @field_validator("model")
    @classmethod
    def _known_model(cls, name: str) -> str:
        load_analyzer_model(name)
        return name

    @field_validator("ranges")
    @classmethod
    def _known_ranges(cls, ranges: dict[str, float]) -> dict[str, float]:
        for key, value in ranges.items():
            if len(key) != 2 or key[0] not in "UI" or not key[1].isdigit() or not value > 0:
                raise ValueError(f"{key} = {value}: a range is U or I and an element, with a value above 0")
        return ranges


class DcDeviceConfig(Section):
    """A dc supply or an electronic load on Modbus."""

    map: str = Field(min_length=1, description="name of a register map in drivers/maps")
    resource: str = Field(min_length=1, description="tcp://host:port, or a serial device")
    unit: int | None = Field(default=None, ge=0, le=247, description="Modbus unit; as delivered unless given")
    baud: int = Field(default=115200, gt=0, description="baud rate of a serial device")
    timeout_s: Positive = Field(default=1.0, le=60.0, description="longest wait for a reply, in real seconds")
    lateness_s: Positive = Field(default=1.0, le=60.0, description="no reply comes later after its deadline")

    @field_validator("map")
    @classmethod
    def _known_map(cls, name: str) -> str:
        load_map(name)
        return name


class ControllerConfig(Section):
    """The converter's controller."""

    resource: str = Field(min_length=1, description="serial device or URL")
    baud: int = Field(default=115200, gt=0, description="baud rate")
    heartbeat_s: Positive = Field(default=2.0, le=60.0, description="time between two heartbeats in seconds")
    timeout_s: Positive = Field(default=1.0, le=60.0, description="longest wait for a reply, in real seconds")
    lateness_s: Positive = Field(default=1.0, le=60.0, description="no reply comes later after its deadline")


class LimitsConfig(Section):
    """What no reading and no set point may exceed."""

    voltage_V: Positive = Field(description="input voltage")
    current_A: Positive = Field(description="input current; also the supply's current limit")
    power_W: Positive = Field(description="input power, and the largest set point")
    output_voltage_V: Positive = Field(description="output voltage")
    heatsink_C: Positive = Field(default=90.0, description="heatsink temperature")
    winding_C: Positive = Field(default=120.0, description="transformer and inductor temperature")
    link_peak_A: Positive | None = Field(default=None, description="simulated peak of the link current")
    power_step_W: Positive = Field(default=500.0, description="largest change of the load's power at once")
    safe_voltage_V: Positive = Field(default=60.0, description="discharged is below this, input and output")
    discharge_s: Positive = Field(default=30.0, description="longest time that the discharge may take")
    recover_s: NotNegative = Field(
        default=60.0,
        description="real time in which a lost instrument may come back; the bench is off meanwhile",
    )
    again_s: NotNegative = Field(
        default=10.0, description="real time in which failed steps of a power-off are tried again"
    )


class ConverterConfig(Section):
    """The voltages of the converter under test, and the simulation model that belongs to it."""

    input_voltage_V: Positive = Field(default=300.0, description="dc input, held by the supply")
    output_voltage_V: Positive = Field(default=140.0, description="dc output, held by the controller")
    model: Path | None = Field(default=None, description="simulation model file; without it the baseline")
    modulation: Literal["hybrid", "sps", "dps", "eps", "tps"] | None = Field(
        default=None, description="how the bridges are driven; without it as in the simulation model"
    )
    start_D1: Duty = Field(default=0.8, description="D1 to start with and to change the power at")
    start_D2: Duty = Field(default=0.0, description="D2 to start with and to change the power at")


class BenchConfig(Section):
    """bench.toml: the instruments of one bench and its safety limits."""

    name: str = Field(min_length=1, description="name of the bench")
    virtual: bool = Field(False, description="true for mock instruments; stamped on all that is stored")
    speed: Positive = Field(default=1.0, description="clock speed of a virtual bench")
    database: str | None = Field(default=None, description="SQLAlchemy URL")
    analyzer: AnalyzerConfig
    supply: DcDeviceConfig
    load: DcDeviceConfig
    controller: ControllerConfig
    limits: LimitsConfig
    converter: ConverterConfig = ConverterConfig()

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        if wrong := list(self._contradictions()):
            raise ValueError("; ".join(wrong))
        return self

    def _contradictions(self) -> Iterator[str]:
        """What no single key is wrong in."""
        analyzer, controller, limits, converter = self.analyzer, self.controller, self.limits, self.converter
        if self.speed != 1.0 and not self.virtual:
            yield f"speed = {self.speed:g}: only a virtual bench can run at another speed than 1"
        if analyzer.update_s > controller.heartbeat_s:
            yield (
                f"analyzer.update_s = {analyzer.update_s:g} must not exceed controller.heartbeat_s = "
                f"{controller.heartbeat_s:g}: waiting for an update would starve the heartbeat"
            )
        for key, limit in (("input_voltage_V", "voltage_V"), ("output_voltage_V", "output_voltage_V")):
            set_V, most_V = getattr(converter, key), getattr(limits, limit)
            if set_V > most_V:
                yield f"converter.{key} = {set_V:g} is above limits.{limit} = {most_V:g}"

    def settings(self) -> dict[str, object]:
        """All of it as plain data but the database's URL, which may hold a password."""
        return self.model_dump(mode="json", exclude={"database"})


# --- campaign.toml ----------------------------------------------------------------------------------


class SettlingConfig(Section):
    """When a point counts as settled."""

    window_s: Positive = Field(default=20.0, description="length of the window looked at")
    slope: Positive = Field(default=1e-5, description="of efficiency and of relative power, largest, per s")
    spread: Positive = Field(default=5e-4, description="largest relative deviation about that drift")
    temperature_slope_K_per_s: Positive = Field(default=0.02, description="largest drift of any temperature")
    limit_s: Positive = Field(default=600.0, description="after this the point is measured as not settled")
    sample_every_s: Positive = Field(default=4.0, description="time between two samples")

    @model_validator(mode="after")
    def _enough_samples(self) -> Self:
        if self.window_s < 3 * self.sample_every_s:
            raise ValueError(
                f"window_s = {self.window_s:g} holds too few samples; at least 3 × sample_every_s = "
                f"{3 * self.sample_every_s:g}"
            )
        if self.limit_s < self.window_s:
            raise ValueError(f"limit_s = {self.limit_s:g} must be at least window_s = {self.window_s:g}")
        return self


class MeasureConfig(Section):
    """How a settled point is measured, and when its row is rejected."""

    samples: int = Field(default=8, ge=2, description="fresh analyzer updates averaged into one row")
    power_tolerance: Positive = Field(
        default=0.05, description="largest relative deviation of P2 from its set value"
    )
    voltage_tolerance: Positive = Field(default=0.02, description="of V2 about its target, relative")


_PERIOD = re.compile(r"(\d+(?:\.\d+)?) *(s|min|h|d)")
_SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}


class ScheduleConfig(Section):
    """When the campaign starts, and how often; ``every`` becomes seconds."""

    start_at: datetime | None = Field(default=None, description="date and time; local time without an offset")
    every: Positive | None = Field(default=None, description='how often in the queue: "90 min", "6 h", "1 d"')

    @field_validator("every", mode="before")
    @classmethod
    def _period(cls, value: object) -> object:
        if not isinstance(value, str):
            return value
        if not (found := _PERIOD.fullmatch(value.strip())):
            raise ValueError("a number and s, min, h or d is a period")
        return float(found[1]) * _SECONDS[found[2]]


class CampaignConfig(Section):
    """campaign.toml: what to measure and how."""

    name: str = Field(min_length=1, description="name of the campaign")
    seed: int = Field(default=1, ge=0, description="seed of everything random in the plan")
    plan: PlanConfig
    ranges: RangesConfig = RangesConfig()
    settling: SettlingConfig = SettlingConfig()
    measure: MeasureConfig = MeasureConfig()
    schedule: ScheduleConfig = ScheduleConfig()


# --- reading ----------------------------------------------------------------------------------------


def read_bench(path: Path) -> BenchConfig:
    """bench.toml; a relative ``converter.model`` is taken from the file's own folder."""
    bench = _read(path, BenchConfig)
    if bench.converter.model is None:
        return bench
    model = path.parent / bench.converter.model
    return bench.model_copy(update={"converter": bench.converter.model_copy(update={"model": model})})


def read_campaign(path: Path) -> CampaignConfig:
    """campaign.toml; a relative ``plan.file`` is taken from the file's own folder."""
    campaign = _read(path, CampaignConfig)
    if campaign.plan.file is None:
        return campaign
    plan = campaign.plan.model_copy(update={"file": path.parent / campaign.plan.file})
    return campaign.model_copy(update={"plan": plan})


def config_hash(*sections: Section) -> str:
    """SHA-256 over the sections' values, the same for the same settings however they were written."""
    text = json.dumps([section.model_dump(mode="json") for section in sections], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _read(path: Path, kind: type[SectionT]) -> SectionT:
    data = read_toml(path)
    return check(data, kind, file=str(path), text=path.read_text(encoding="utf-8"))
