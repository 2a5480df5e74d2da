"""The verb waveform: vp, vs and iL of an operating point, and what the simulator says of it."""

import math
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from bench.commands.options import D1, D2, ModelFile, Power, check_folder, point_problems
from bench.commands.streams import out
from bench.errors import InputError, Problem
from bench.model_file import model_from
from bench.oscillogram_figure import PICTURES, oscillogram_figure, oscillogram_table
from bench.paper_figures import DPI
from bench.table_file import ENDINGS, write_table
from bench.whole_file import replacing
from bench.wording import join, words
from sim.modulation import EDGES
from sim.operating_points import Points
from sim.oscillogram import oscillogram_of
from sim.solved import solve_points

app = typer.Typer()

_SHOWN_W = 0.005  # less is no loss at two decimals


@app.command("waveform")
def waveform_(
    D1: D1,
    D2: D2,
    power_W: Power,
    out_files: Annotated[
        list[Path],
        typer.Option("--out", metavar="FILE", help=f"a picture ({' '.join(PICTURES)}) or a table of samples "
                     f"({' '.join(ENDINGS)}); may be repeated"),
    ],
    voltages_V: Annotated[
        tuple[float, float] | None,
        typer.Option("--V", metavar="V1 V2", help="input and output voltage; else the model's own"),
    ] = None,
    model_file: ModelFile = None,
) -> None:  # fmt: skip
    """Show a switching period as an oscilloscope would: vp, vs, iL, with currents, losses and edges in words."""
    problems = point_problems(D1=D1, D2=D2, power_W=power_W)
    allowed = (*PICTURES, *ENDINGS)
    problems += [
        Problem(
            file="command line", field="--out", value=str(file), allowed=f"an ending of {', '.join(allowed)}"
        )
        for file in out_files
        if file.suffix not in allowed
    ]
    problems += [
        Problem(file="command line", field="--V", value=value, allowed="two voltages above 0 V")
        for value in voltages_V or ()
        if not 0 < value < math.inf
    ]
    if problems:
        raise InputError(problems)
    for file in out_files:
        check_folder(file.parent, "--out")
    model = model_from(model_file)
    V1_V, V2_V = voltages_V or (model.converter.V1_V, model.converter.V2_V)
    point = Points(D1=D1, D2=D2, power_W=power_W, V1_V=V1_V, V2_V=V2_V)
    solved = solve_points(model, point)
    trace = oscillogram_of(solved)
    for line in _lines({name: float(values[0]) for name, values in solved.result.values.items()}):
        out.print(escape(line))
    title = f"simulated: D1 = {D1:g}, D2 = {D2:g}, {power_W:g} W\n{V1_V:g} V to {V2_V:g} V"
    for file in out_files:
        if file.suffix in PICTURES:
            with replacing(file) as written:
                oscillogram_figure(trace, title).savefig(written, dpi=DPI, format=file.suffix[1:])
        else:
            write_table(oscillogram_table(trace), file)
    out.print(escape(f"written to {', '.join(map(str, out_files))}"))


def _lines(point: dict[str, float]) -> list[str]:
    """What a person asks first of an operating point."""
    losses = {
        words(name.removeprefix("loss_").removesuffix("_W")): loss
        for name, loss in point.items()
        if name.startswith("loss_") and abs(loss) >= _SHOWN_W
    }
    largest = sorted(losses.items(), key=lambda part: -part[1])
    soft = [words(edge) for edge in EDGES if point[f"zvs_{edge}"]]
    hard = [words(edge) for edge in EDGES if not point[f"zvs_{edge}"]]
    return [
        f"D0 {point['D0']:.4f}, input {point['P1_W']:.2f} W, efficiency {100 * point['efficiency']:.3f} %",
        f"link current {point['I_L_rms_A']:.3f} A rms, {point['I_L_pp_A']:.3f} A peak to peak",
        f"heatsink {point['T_heatsink_C']:.1f} °C, transformer {point['T_transformer_C']:.1f} °C, "
        f"inductor {point['T_inductor_C']:.1f} °C",
        f"zero-voltage switching at {join(soft) or 'no edge'}"
        + (f", not at {join(hard, 'or')}" if hard else ""),
        "losses: " + ", ".join(f"{part} {loss:.2f} W" for part, loss in largest),
    ]
