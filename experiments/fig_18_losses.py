"""Fig. 18: where the losses are at the optimum, at 600, 1000 and 1600 W: in the simulation and in the lab.

The optimum is the calibrated physics', of lab 0. The paper's figure has no numbers in its text; what it says of them is
checked: the secondary bridge leads at light load, its share falls with load while that of inductor and transformer
rises, and the primary's share is below the secondary's.
"""

from collections.abc import Mapping

import numpy as np

from experiments.harness.registry import Experiment
from experiments.harness.result import Cell, Goal, Picture, Result, Table
from experiments.harness.settings import Settings
from experiments.study.labs import ASSUMED, SUPPLY_V, laboratory
from experiments.study.optima import Optimum, of_method, optima
from experiments.study.pictures import COLOURS, dress, panels, picture
from models.boosting import Floats
from models.surrogate import CALIBRATED
from sim.model import Model
from sim.simulate import Points, simulate

LOADS_W = (600.0, 1000.0, 1600.0)
PLACES = ("primary bridge", "secondary bridge", "inductor and transformer", "other")
_OTHER = ("auxiliary", "input_cable", "output_cable", "added")

Shares = dict[str, Floats]


def run(settings: Settings) -> Result:
    """Both break-downs."""
    one = of_method(optima(settings), CALIBRATED)[0]
    at = _at(one)
    parts = simulated_parts(*at)
    simulated, lab = by_place(parts), lab_places(one.lab, *at)
    return Result(
        virtual=True,
        goals=(*_claims("simulation", simulated), *_claims("lab", lab)),
        tables=(_parts(parts, at[2]), _places(simulated, lab, at[2])),
        pictures=(_picture(simulated, lab, at[2]),),
        notes=(
            "the lab's parts cannot be measured one by one; they are read from the virtual lab itself, for this alone",
            "the simulation's parts sum to P1 - P2 to 1e-6 W, as its tests hold it to",
        ),
        assumed=(*ASSUMED, "core, turns and windings of inductor and transformer: not in the paper"),
    )  # fmt: skip


def _at(one: Optimum) -> tuple[Floats, Floats, Floats]:
    rows = [int(np.argmin(np.abs(one.power_W - load))) for load in LOADS_W]
    return one.D1[rows], one.D2[rows], one.power_W[rows]


def simulated_parts(D1: Floats, D2: Floats, power_W: Floats) -> dict[str, Floats]:
    """Every loss part of the baseline simulation in W."""
    columns = simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W)).values
    return {
        name.removeprefix("loss_").removesuffix("_W"): value
        for name, value in columns.items()
        if name.startswith("loss_")
    }


def by_place(parts: Mapping[str, Floats]) -> Shares:
    """Parts summed by place, in W."""

    def total(*starts: str) -> Floats:
        chosen = [value for name, value in parts.items() if name.startswith(starts)]
        return np.asarray(np.sum(chosen, axis=0))

    primary, secondary, other = total("primary"), total("secondary"), total(*_OTHER)
    magnetic = np.sum(list(parts.values()), axis=0) - primary - secondary - other
    return dict(zip(PLACES, (primary, secondary, magnetic, other), strict=True))


def lab_places(number: int, D1: Floats, D2: Floats, power_W: Floats) -> Shares:
    """Losses of a lab by place in W; ``other`` is all that its terminals lose besides."""
    lab = laboratory(number)
    supply = np.full(D1.size, SUPPLY_V)
    now, heat = lab.settled(D1, D2, power_W, supply, np.zeros(D1.size))
    _, P1_W = lab.input_terminals(now, heat.heatsink_C, 0.0)
    secondary = now.losses.secondary_conduction + now.losses.secondary_switching
    inner = now.losses.primary + secondary + now.losses.link
    places = (now.losses.primary, secondary, now.losses.link, P1_W - now.P2_W - inner)
    return dict(zip(PLACES, places, strict=True))


def _shares(places: Shares) -> Shares:
    whole = np.sum(list(places.values()), axis=0)
    return {name: 100 * value / whole for name, value in places.items()}


def _claims(said: str, places: Shares) -> list[Goal]:
    shares = _shares(places)
    primary, secondary, magnetic, _ = (shares[name] for name in PLACES)
    lead = secondary[0] - max(primary[0], magnetic[0])
    return [
        Goal(name=f"{said}: lead of the secondary bridge at 600 W", value=float(lead), bar=0.0, at_least=True,
             unit="% of all losses"),
        Goal(name=f"{said}: change of the secondary's share, 600 to 1600 W", value=float(secondary[-1] - secondary[0]),
             bar=0.0, at_least=False, unit="% of all losses"),
        Goal(name=f"{said}: change of inductor's and transformer's share, 600 to 1600 W",
             value=float(magnetic[-1] - magnetic[0]), bar=0.0, at_least=True, unit="% of all losses"),
        Goal(name=f"{said}: primary's less secondary's share, largest", value=float(np.max(primary - secondary)),
             bar=0.0, at_least=False, unit="% of all losses"),
    ]  # fmt: skip


def _places(simulated: Shares, lab: Shares, power_W: Floats) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (said, name, *map(float, places[name]), *map(float, _shares(places)[name]))
        for said, places in (("simulation", simulated), ("lab", lab))
        for name in PLACES
    ]
    columns = ("where", "place", *(f"{p:.0f} W: W" for p in power_W), *(f"{p:.0f} W: %" for p in power_W))
    return Table(title="Losses by place, and their shares", columns=columns, rows=tuple(rows))


def _parts(parts: Mapping[str, Floats], power_W: Floats) -> Table:
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (name.replace("_", " "), *map(float, value)) for name, value in parts.items()
    )
    columns = ("part", *(f"{p:.0f} W: W" for p in power_W))
    return Table(title="Losses of the simulation, part by part", columns=columns, rows=rows)


def _picture(simulated: Shares, lab: Shares, power_W: Floats) -> Picture:
    figure, axes = panels(1, 2, width_in=8.4, height_in=3.6)
    for axis, (said, places) in zip(axes, (("Simulation", simulated), ("Lab", lab)), strict=True):
        below = np.zeros(len(power_W))
        for colour, name in zip(COLOURS, PLACES, strict=False):
            value, share = places[name], _shares(places)[name]
            axis.bar(range(len(power_W)), value, 0.6, bottom=below, color=colour, label=name)
            for k in range(len(power_W)):
                if share[k] > 6:
                    axis.text(k, below[k] + value[k] / 2, f"{share[k]:.0f} %", ha="center", va="center", fontsize=8,
                              color="white")  # fmt: skip
            below = below + value
        dress(axis, said, "output power (W)", "losses (W)")
        axis.set_xticks(range(len(power_W)), [f"{p:.0f}" for p in power_W])
    axes[0].legend(fontsize=8, frameon=False, loc="upper left")
    top = max(axis.get_ylim()[1] for axis in axes)
    for axis in axes:
        axis.set_ylim(0, top)
    return picture(figure, "losses", "Losses by place at the best modulation, and their shares.")


EXPERIMENT = Experiment(title="Fig. 18: loss breakdown at the optimum", run=run)
