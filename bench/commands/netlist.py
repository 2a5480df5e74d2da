"""The verb netlist: an operating point as a circuit for ngspice."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from bench.commands.options import D1, D2, ModelFile, Power, point_problems
from bench.commands.streams import out
from bench.errors import InputError, Problem
from bench.model_file import model_from
from bench.whole_file import write_whole
from sim.netlist import netlist
from sim.operating_points import Points

app = typer.Typer()

ENDING = ".cir"


@app.command("netlist")
def netlist_(
    D1: D1,
    D2: D2,
    power_W: Power,
    out_file: Annotated[Path, typer.Option("--out", metavar="FILE.cir", help="where to write it")],
    model_file: ModelFile = None,
) -> None:
    """Write an operating point as a switch-level circuit; `ngspice -b FILE.cir` runs it and prints what it measures."""
    _check(D1=D1, D2=D2, power_W=power_W, out_file=out_file)
    model = model_from(model_file)
    text = netlist(model, Points(D1=D1, D2=D2, power_W=power_W))
    write_whole(out_file, text)
    out.print(escape(f"{text.splitlines()[0].removeprefix('* ')}, written to {out_file}"))


def _check(*, D1: float, D2: float, power_W: float, out_file: Path) -> None:
    """InputError with everything that is wrong with the options."""
    problems = point_problems(D1=D1, D2=D2, power_W=power_W)
    if out_file.suffix != ENDING:
        said = f"the name must end in {ENDING}"
        problems.append(Problem(file="command line", field="--out", value=str(out_file), allowed=said))
    if problems:
        raise InputError(problems)
