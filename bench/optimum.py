"""The best modulation over load as a table for firmware: search, choice of rows, and what lies between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bench.training import feasible_map
from models.calibrated import Vouched
from models.exhaustive import ensembles
from models.feasibility import FeasibleMap
from models.lattice import optimise_on_lattice
from models.lut import Lut, Surroundings, make_lut
from models.optimise import OptimumTable, optimise, optimise_exactly
from models.pso import PSO_SAVL_POLISHED
from models.surrogate import EfficiencyModel
from sim.model import Model

LOADS = 19  # from a tenth of the rated power to all of it: steps of 100 W for the prototype


def loads_of(simulator: Model) -> tuple[float, ...]:
    """The output powers that a table is made for where nobody says others."""
    rated_W = simulator.converter.rated_power_W
    return tuple(np.linspace(0.1 * rated_W, rated_W, LOADS).tolist())


@dataclass(frozen=True, kw_only=True)
class BestModulation:
    """A search over the same loads for one model after another; the simulator's mask is asked for once."""

    simulator: Model
    loads_W: Sequence[float]

    @cached_property
    def mask(self) -> FeasibleMap:
        """Which D1 and D2 carry each load."""
        return feasible_map(self.simulator, self.loads_W)

    def swarm(self, model: EfficiencyModel, seed: int) -> OptimumTable:
        """The optimum that PSO-SAVL finds, with its regret."""
        return optimise(model, self.loads_W, self.mask, seed=seed, optimiser=PSO_SAVL_POLISHED)

    def best(self, model: EfficiencyModel, seed: int) -> OptimumTable:
        """By the swarm where the model is made of trees, which it asks some thousand times; else on a lattice."""
        return self.swarm(model, seed) if ensembles(model) is not None else self.exactly(model)

    def exactly(self, model: EfficiencyModel) -> OptimumTable:
        """The optimum without a search where the model is made of trees, else on a lattice."""
        if ensembles(model) is None:
            return optimise_on_lattice(model, np.asarray(self.loads_W, dtype=np.float64))
        return optimise_exactly(model, self.loads_W, self.mask)

    def table(self, model: EfficiencyModel, optimum: OptimumTable, half_width: float = float("nan")) -> Lut:
        """The rows for a controller; a calibrated model says itself what lies between them."""
        simulator = model.of.model if isinstance(model, Vouched) else self.simulator
        return make_lut(optimum, Surroundings(model=model, simulator=simulator), half_width=half_width)
