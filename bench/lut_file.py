"""The table of D1 and D2 over load as a file for people (.csv), programs (.json) or firmware (.h).

Every file says which model its numbers are from, which data that was fitted to, and whether those come from a
virtual lab. Any of the three can be read back and loaded into a controller.
"""

import json
import math
import re
from collections.abc import Callable, Hashable, Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import pandas as pd

from bench.converter_stated import in_c, stated_converter
from bench.errors import InputError, Problem
from bench.table_file import write_table
from bench.whole_file import write_whole
from drivers.controller_messages import TABLE_ROWS
from models.lut import Lut
from models.registry import ModelRecord
from sim.model import Model

ENDINGS = (".csv", ".json", ".h")
BESIDE = tuple(f"lut{ending}" for ending in ENDINGS)  # files beside a model
SCHEMA = 2
ROW = ("P_W", "D1", "D2")
STATED = ("model", "lab", "converter")  # of the origin, in every row of a CSV file
EXPECTED = ("predicted", "predicted_low", "predicted_high")
VIRTUAL, HARDWARE, UNKNOWN = "virtual lab", "hardware", "not stated"
_NUMBER = r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)f"
_C_ROW = re.compile(rf"\{{\s*{_NUMBER}\s*,\s*{_NUMBER}\s*,\s*{_NUMBER}\s*\}}")


@dataclass(frozen=True, slots=True, kw_only=True)
class LutOrigin:
    """What a table's numbers are from."""

    model: str
    kind: str
    data_sha256: str
    data: str
    lab: str
    converter: str = UNKNOWN

    @classmethod
    def of(cls, record: ModelRecord, simulator: Model | None = None) -> "LutOrigin":
        """That of a model in the registry; ``simulator``: what else it was searched beside."""
        beside = record.made_beside() or simulator
        lab = UNKNOWN if record.virtual is None else (VIRTUAL if record.virtual else HARDWARE)
        return cls(
            model=record.id,
            kind=record.kind,
            data_sha256=record.data_sha256,
            data=record.data,
            lab=lab,
            converter=UNKNOWN if beside is None else stated_converter(beside),
        )


def check_lut_ending(path: Path) -> None:
    """InputError for a file name of another kind."""
    if path.suffix not in ENDINGS:
        raise InputError.of("command line", "--out", str(path), f"the name must end in {', '.join(ENDINGS)}")


# --- writing ----------------------------------------------------------------------------------------


def write_lut(table: Lut, path: Path, origin: LutOrigin) -> None:
    """Write the table in the form that the file's name asks for, in one step."""
    check_lut_ending(path)
    if path.suffix == ".csv":
        write_table(table.frame().assign(**{name: getattr(origin, name) for name in STATED}), path)
    elif path.suffix == ".json":
        write_whole(path, json.dumps(as_plain(table, origin), indent=2, allow_nan=False) + "\n")
    else:
        write_whole(path, _header(table, origin))


def write_beside(folder: Path, table: Lut, origin: LutOrigin) -> tuple[Path, ...]:
    """The table in every form, beside the model in ``folder``: there the dashboard finds it."""
    files = tuple(folder / name for name in BESIDE)
    for file in files:
        write_lut(table, file, origin)
    return files


def as_plain(table: Lut, origin: LutOrigin) -> dict[str, object]:
    """The table as JSON holds it; a number that is not known is null."""
    rows = json.loads(table.frame().to_json(orient="records", double_precision=15))
    lines = [asdict(line) | {"dip": line.dip if math.isfinite(line.dip) else None} for line in table.lines]
    return {
        "schema": SCHEMA,
        **asdict(origin),
        "interpolation": "straight lines over output power, constant beyond the first and the last row",
        "units": {"P_W": "W", "D1": "half periods", "D2": "half periods", "predicted": "fraction"},
        "left_out_W": list(table.left_out_W),
        "lines": lines,
        "table": rows,
    }


def _header(table: Lut, origin: LutOrigin) -> str:
    rows = [
        f"    {{{_float(row['P_W'])}, {_float(row['D1'])}, {_float(row['D2'])}}}, /* {_expected(row)} */"
        for row in table.frame().to_dict("records")
    ]
    said = {name: in_c(value) for name, value in asdict(origin).items()}
    return _C.format(rows="\n".join(rows), count=len(rows), label=said["lab"].upper(), **said)


def _expected(row: Mapping[Hashable, float]) -> str:
    predicted, low, high = (100 * row[name] for name in ("predicted", "predicted_low", "predicted_high"))
    interval = f", 95 % from {low:.2f} to {high:.2f} %" if math.isfinite(low) else ""
    return f"{predicted:.2f} %{interval}"


def _float(value: float) -> str:
    return f"{value:#.9g}".rstrip("0").ljust(3, "0") + "f"


_C = """\
/* Best modulation of the converter over load, from d2ea.
 *
 * Source:  {label}
 * for      {converter}
 * model    {model} ({kind})
 * data     {data}
 * SHA-256  {data_sha256}
 *
 * Output power in W that rises; D1 and D2 in half switching periods; beside each row the efficiency predicted there.
 * Between rows, straight lines hold: they were checked. There is no state, hence no hysteresis. A pulse or zero
 * state that comes out shorter than the dead time is yours to make absent, or as long as the dead time.
 */
#ifndef D2EA_LUT_H
#define D2EA_LUT_H

#define D2EA_LUT_MODEL "{model}"
#define D2EA_LUT_CONVERTER "{converter}"
#define D2EA_LUT_ROWS {count}

struct d2ea_lut_row {{
    float power_W;
    float D1;
    float D2;
}};

static const struct d2ea_lut_row d2ea_lut[D2EA_LUT_ROWS] = {{
{rows}
}};

/* D1 and D2 at an output power; constant beyond the first and the last row. */
static inline struct d2ea_lut_row d2ea_lut_at(float power_W)
{{
    struct d2ea_lut_row at = d2ea_lut[0];
    int row;

    for (row = 1; row < D2EA_LUT_ROWS && power_W > d2ea_lut[row - 1].power_W; row++) {{
        const struct d2ea_lut_row *low = &d2ea_lut[row - 1];
        const struct d2ea_lut_row *high = &d2ea_lut[row];
        float share = (power_W - low->power_W) / (high->power_W - low->power_W);

        if (share > 1.0f)
            share = 1.0f;
        at.D1 = low->D1 + share * (high->D1 - low->D1);
        at.D2 = low->D2 + share * (high->D2 - low->D2);
    }}
    at.power_W = power_W;
    return at;
}}

#endif
"""


# --- reading ----------------------------------------------------------------------------------------


def read_lut(path: Path) -> pd.DataFrame:
    """The rows of a table: P_W, D1, D2, and ``predicted`` columns where the file has them.

    Raises InputError with everything that keeps a controller from using it.
    """
    readers: Mapping[str, Callable[[Path], pd.DataFrame]] = {
        ".csv": pd.read_csv,
        ".json": _read_json,
        ".h": _read_header,
    }
    if path.suffix not in readers:
        raise InputError.of(path, "name", path.suffix, f"the name must end in {', '.join(ENDINGS)}")
    try:
        rows = readers[path.suffix](path)
    except FileNotFoundError:
        raise InputError.of(path, "file", None, "there is no such file") from None
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise InputError.of(path, "file", None, f"is not a table of D1 and D2 over load: {error}") from error
    if problems := _problems(path, rows):
        raise InputError(problems)
    known = [name for name in (*ROW, *EXPECTED) if name in rows]
    return rows.assign(**{name: pd.to_numeric(rows[name], errors="coerce") for name in known}).astype(
        dict.fromkeys(known, float)
    )


def _read_json(path: Path) -> pd.DataFrame:
    return pd.DataFrame(json.loads(path.read_text(encoding="utf-8"))["table"])


def _read_header(path: Path) -> pd.DataFrame:
    found = _C_ROW.findall(path.read_text(encoding="utf-8"))
    return pd.DataFrame([[float(value) for value in row] for row in found], columns=list(ROW))


def _problems(path: Path, rows: pd.DataFrame) -> list[Problem]:
    def problem(field: str, value: object, allowed: str) -> Problem:
        return Problem(file=str(path), field=field, value=value, allowed=allowed)

    if missing := [name for name in ROW if name not in rows]:
        there = ", ".join(map(str, rows.columns)) or "none"
        return [problem("columns", None, f"{', '.join(missing)} missing; there are: {there}")]
    wrong = []
    if not 2 <= len(rows) <= TABLE_ROWS:
        wrong.append(problem("rows", len(rows), f"a controller takes 2 to {TABLE_ROWS}"))
    for name in ROW:
        values = pd.to_numeric(rows[name], errors="coerce")
        right = (
            values.between(0.0, math.inf, inclusive="neither") if name == "P_W" else values.between(0.0, 1.0)
        )
        for number in rows.index[~right]:
            allowed = "above 0" if name == "P_W" else "from 0 to 1"
            wrong.append(
                problem(f"row {number + 1}, {name}", rows[name].tolist()[number], f"a number {allowed}")
            )
    if not wrong and any(b <= a for a, b in pairwise(rows["P_W"].astype(float))):
        wrong.append(problem("P_W", None, "powers must rise from row to row"))
    return wrong


def model_of(path: Path) -> str:
    """The id of the model that a table's numbers are from; InputError when the file does not name it."""
    found = _stated(path, "model")
    if found is None:
        raise InputError.of(path, "model", None, "the file does not name its model; d2ea optimise writes it")
    return found


def converter_of(path: Path) -> str | None:
    """The converter that a table is for, as :func:`stated_converter` says it; None where the file does not say it."""
    found = _stated(path, "converter")
    return None if found == UNKNOWN else found


def _stated(path: Path, name: str) -> str | None:
    """What a file says of its origin."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".csv":
        found = next(iter(pd.read_csv(path).get(name, pd.Series(dtype=str))), None)
    elif path.suffix == ".json":
        found = json.loads(text).get(name)
    else:
        match = re.search(rf'^#define D2EA_LUT_{name.upper()} "([^"]+)"', text, re.MULTILINE)
        found = match[1] if match else None
    return found if isinstance(found, str) else None
