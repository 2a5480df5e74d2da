"""The small campaign that the survey runs over and over, on mock instruments that forget nothing of their seed."""

import numpy as np

from bench.config import BenchConfig, CampaignConfig, check
from bench.job import Job
from bench.prediction import Asked, Forecast
from drivers.mocks.rack import Rack
from experiments.survey.steady_plant import efficiency

_TIMEOUT_S = 0.15  # of a link on which faults strike; the rack tells how long the others are waited for
_LATENESS_S = 0.15  # of every link: no fault is later than this
RANGES = {"U1": 300.0, "I1": 10.0, "U2": 150.0, "I2": 20.0, "U3": 300.0, "I3": 10.0, "U4": 150.0, "I4": 20.0}


def campaign(points: int, seed: int) -> CampaignConfig:
    """So many random points, a reference every third, standby and no load."""
    settings = {
        "name": f"survey {seed}",
        "seed": seed,
        "plan": {
            "kind": "latin_hypercube",
            "points": points,
            "reference_every": 3,
            "standby": 1,
            "no_load": 1,
        },
        "ranges": {"D1": [0.6, 0.95], "D2": [0.03, 0.3], "power_W": [300.0, 1800.0]},
        "settling": {"window_s": 6.0, "sample_every_s": 2.0, "limit_s": 60.0},
        "measure": {"samples": 4},
    }
    return check(settings, CampaignConfig, file="survey")


def bench_of(rack: Rack) -> BenchConfig:
    """The rack as a bench, on fixed ranges and with little patience where faults strike."""
    settings = rack.bench_config()
    for name in ("analyzer", "supply", "load", "controller"):
        part = settings[name]
        assert isinstance(part, dict)
        part.setdefault("timeout_s", _TIMEOUT_S)
        part["lateness_s"] = _LATENESS_S
    analyzer, limits = settings["analyzer"], settings["limits"]
    assert isinstance(analyzer, dict)
    assert isinstance(limits, dict)
    analyzer["ranges"] = dict(RANGES)
    limits |= {"again_s": 3.0, "recover_s": 3.0}
    return check({**settings, "name": "survey bench"}, BenchConfig, file="survey")


def predict(asked: Asked) -> Forecast:
    """A simulator that carries everything and is half a point off."""
    power_W = np.maximum(asked.power_W, 1.0)
    simulated = np.array([efficiency(*row) + 0.005 for row in zip(asked.D1, asked.D2, power_W, strict=True)])
    count = len(simulated)
    return Forecast(
        feasible=np.ones(count, dtype=bool),
        reason=np.full(count, "", dtype="U8"),
        columns={"efficiency": simulated, "P1_W": asked.power_W / simulated},
    )


def job(rack: Rack, *, points: int, seed: int) -> Job:
    """The campaign on this rack, planned."""
    return Job.prepare(campaign(points, seed), bench_of(rack), predict=predict)
