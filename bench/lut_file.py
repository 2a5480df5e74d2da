"""The optimum over load as a file for people (.csv), programs (.json) or firmware (.h)."""

import json
from pathlib import Path

import pandas as pd

from bench.errors import InputError
from bench.table_file import write_table
from bench.toml_file import write_atomically
from models.optimise import OptimumTable

ENDINGS = (".csv", ".json", ".h")


def check_lut_ending(path: Path) -> None:
    """InputError for a file name of another kind."""
    if path.suffix not in ENDINGS:
        raise InputError.of("command line", "--out", str(path), f"the name must end in {', '.join(ENDINGS)}")


def write_lut(optimum: OptimumTable, path: Path, *, model: str) -> None:
    """Write the loads that can be carried; ``model`` says where the numbers are from."""
    check_lut_ending(path)
    table = optimum.frame().dropna(subset=["D1", "D2"]).rename(columns={"power_W": "P_W"})
    if path.suffix == ".csv":
        write_table(table, path)
    elif path.suffix == ".json":
        rows = json.loads(table.to_json(orient="records"))
        content = {"schema": 1, "model": model, "optimiser": optimum.optimiser, "table": rows}
        write_atomically(path, json.dumps(content, indent=2) + "\n")
    else:
        write_atomically(path, _header(table, model))


def _header(table: pd.DataFrame, model: str) -> str:
    rows = [f"    {{{row.P_W:.1f}f, {row.D1:.6f}f, {row.D2:.6f}f}}," for row in table.itertuples()]
    return "\n".join(
        [
            f"/* Best modulation over load, from model {model}. D1 and D2 in units of the half period. */",
            "#ifndef D2EA_LUT_H",
            "#define D2EA_LUT_H",
            "",
            f"#define D2EA_LUT_ROWS {len(rows)}",
            "",
            "/* output power in W, D1, D2; rising power, to be interpolated */",
            "static const struct { float power_W, D1, D2; } d2ea_lut[D2EA_LUT_ROWS] = {",
            *rows,
            "};",
            "",
            "#endif",
            "",
        ]
    )
