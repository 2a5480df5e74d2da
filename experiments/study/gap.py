"""What the gap between a lab and the simulation is made of: the lab made ideal step by step."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.mocks.lab.hidden import Quirks, hide
from drivers.mocks.lab.instruments import InstrumentErrors
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import noise_free_efficiency
from experiments.harness.result import POINTS, Cell, Table
from experiments.harness.settings import Settings
from experiments.study.labs import CAMPAIGN_S, SUPPLY_V, Array, lab_numbers, laboratory, set_points
from sim.model import Model
from sim.prototype import prototype
from sim.simulate import Points, simulate

SET_POINTS, LEAST = 300, 60
STEPS = ("as it is", "instruments ideal", "and all parts nominal", "and nothing hidden")


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """Mean gap (simulated less shown, points) and mean absolute gap of one lab, one value per step."""

    lab: int
    hidden: dict[str, float]
    mean: tuple[float, ...]
    absolute: tuple[float, ...]


def gaps(settings: Settings) -> list[Gap]:
    """The gap of every lab of a run, at points that were drawn for it."""
    count = max(LEAST, settings.thinned(SET_POINTS))
    points = set_points(count, np.random.default_rng(23))
    simulated = simulate(Model.baseline(), Points(D1=points[:, 0], D2=points[:, 1], power_W=points[:, 2]))
    return [_gap(number, points, simulated["efficiency"]) for number in lab_numbers(settings)]


def _gap(number: int, points: Array, simulated: Array) -> Gap:
    lab = laboratory(number)
    shown = [_shown(step, points) for step in _idealised(lab)]
    differences = [POINTS * (simulated - one) for one in shown]
    return Gap(
        lab=number,
        hidden=lab.hidden,
        mean=tuple(float(np.nanmean(d)) for d in differences),
        absolute=tuple(float(np.nanmean(np.abs(d))) for d in differences),
    )


def _idealised(lab: Laboratory) -> Sequence[Laboratory]:
    exact = replace(lab, errors=_exact(lab.errors))
    converter, quirks = hide(prototype(), lab.hidden)
    nominal = replace(exact, converter=converter, quirks=quirks)
    return lab, exact, nominal, replace(nominal, converter=prototype(), quirks=Quirks(), hidden={})


def _exact(errors: InstrumentErrors) -> InstrumentErrors:
    """Instruments and supply without any error."""

    def nothing(values: dict[int, float]) -> dict[int, float]:
        return dict.fromkeys(values, 0.0)

    return replace(
        errors,
        voltage_gain=nothing(errors.voltage_gain),
        current_gain=nothing(errors.current_gain),
        offset_A=nothing(errors.offset_A),
        offset_W=nothing(errors.offset_W),
        temperature_K=dict.fromkeys(errors.temperature_K, 0.0),
        output_sense=0.0,
        supply_V=0.0,
    )


def _shown(lab: Laboratory, points: Array) -> Array:
    D1, D2, power_W = points.T
    return noise_free_efficiency(lab, D1, D2, power_W, supply_V=SUPPLY_V, time_s=CAMPAIGN_S / 2)


def gap_table(found: Sequence[Gap]) -> Table:
    """One row per lab and their mean: the gap, and what is left of it at each step."""
    rows: list[tuple[Cell, ...]] = [
        (str(gap.lab), ", ".join(f"{name} {value:.3g}" for name, value in gap.hidden.items()),
         gap.absolute[0], *gap.mean)
        for gap in found
    ]  # fmt: skip
    means = np.mean([(gap.absolute[0], *gap.mean) for gap in found], axis=0)
    rows.append(("mean", "–", *(float(value) for value in means)))
    columns = ("lab", "hidden in it", "mean |gap|, points", *(f"mean gap {step}" for step in STEPS))
    return Table(
        title="What the gap is made of: simulated less shown efficiency, the lab made ideal step by step",
        columns=columns,
        rows=tuple(rows),
    )
