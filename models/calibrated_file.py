"""Calibrated physics as a file: JSON, whose numbers read back as the very same ones.

::

    schema      5
    model       the calibrated simulator as plain data: modulation, converter, effects with their values
    variants    the same, one standard deviation along each axis of what the measurements left open
    leftover    its readings' places, weights and noise, (N, 18), (N,) and (N,), lengths (4,), sizes
    bench       V1_V, V2_V, ambient_C and time_s that it speaks of, and what rows have shown of the most that it carries
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from models.calibrated import PLAIN, CalibratedPhysics, Leftover
from models.law_doubts import COLUMNS
from sim.model import Model

SCHEMA = 5
_BENCH = ("V1_V", "V2_V", "ambient_C", "time_s", "shown")


class CalibratedFileError(ValueError):
    """A text that holds no calibrated physics; says what is wrong with it."""


def calibrated_text(physics: CalibratedPhysics) -> str:
    """All that the predictions, and how sure they are, depend on."""
    plain = {
        "schema": SCHEMA,
        "model": physics.model.as_plain(),
        "variants": [variant.as_plain() for variant in physics.variants],
        "leftover": {k: np.asarray(v).tolist() for k, v in asdict(physics.leftover).items()},
        "bench": {name: getattr(physics, name) for name in _BENCH},
    }
    return json.dumps(plain, allow_nan=False) + "\n"


def read_calibrated(text: str) -> CalibratedPhysics:
    """What :func:`calibrated_text` wrote; CalibratedFileError names what is missing, wrong or of another version."""
    try:
        plain = json.loads(text)
        if plain["schema"] != SCHEMA:
            raise CalibratedFileError(
                f"schema {plain['schema']}: this version reads schema {SCHEMA} only; make it again with d2ea train, "
                "and put the new one into use with d2ea models use"
            )
        return CalibratedPhysics(
            model=Model.from_plain(plain["model"]),
            variants=tuple(map(Model.from_plain, plain["variants"])),
            leftover=_leftover(plain["leftover"]),
            **{name: float(plain["bench"][name]) for name in _BENCH},
        )
    except CalibratedFileError:
        raise
    except KeyError as error:
        raise CalibratedFileError(f"{error} is missing") from error
    except (TypeError, ValueError) as error:  # ParameterError and JSON's own are ValueErrors
        raise CalibratedFileError(str(error)) from error


def _leftover(plain: Mapping[str, Any]) -> Leftover:
    values = {f.name: np.asarray(plain[f.name], dtype=np.float64) for f in fields(Leftover)}
    rows = values["weight"].size
    exact = values["place"].shape == (rows, PLAIN)  # the model's laws are not doubted
    wanted = {
        "place": (rows, PLAIN if exact else PLAIN + COLUMNS),
        "weight": (rows,),
        "noise_W": (rows,),
        "length": (4,),
    }
    for name, value in values.items():
        if value.shape != wanted.get(name, ()) or not np.isfinite(value).all():
            raise CalibratedFileError(
                f"leftover.{name} has shape {value.shape}; finite numbers of {wanted.get(name, ())} are wanted"
            )
    numbers: dict[str, Any] = {k: v if k in wanted else float(v) for k, v in values.items()}
    return Leftover(**numbers)
