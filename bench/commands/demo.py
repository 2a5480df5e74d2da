"""The verb demo: the main loop on the mock bench, to a report."""

import json
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from bench.commands.live import live
from bench.commands.options import check_folder
from bench.commands.streams import err, out, stamp
from bench.hidden import parse_hidden
from bench.verdict_wording import verdict_text
from bench.whole_file import write_whole
from bench.wording import MODEL_NAMES

app = typer.Typer()


@app.command()
def demo(
    out_dir: Annotated[Path, typer.Option("--out", metavar="DIR", help="where the results go")] = Path(
        "demo"
    ),
    points: Annotated[int, typer.Option(min=20, max=5000, help="points of the campaign")] = 200,
    seed: Annotated[int, typer.Option(min=0, help="of the virtual lab and of everything drawn")] = 1,
    hide: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT[=VALUE]",
            help="what the lab hides; may be repeated; without it the seed chooses an effect",
        ),
    ] = None,
    figures: Annotated[
        bool, typer.Option("--figures", help="the report's figures as PNG for a paper, too")
    ] = False,
) -> None:
    """Run the main loop on the mock bench: measure, simulate, learn, optimise, diagnose, report."""
    from bench.demo import DemoPlan, run_demo, summary_of  # here: only this verb loads the mocks

    check_folder(out_dir, "--out")
    hidden = parse_hidden(hide) if hide else drawn_effect(seed)
    stamp(virtual=True)
    plan = DemoPlan(out=out_dir, points=points, seed=seed, hidden=hidden)
    with live() as progress:
        result = run_demo(plan, say=lambda said: err.print(escape(said)), progress=progress)
    summary = summary_of(result)
    write_whole(out_dir / "summary.json", json.dumps(summary, indent=1, allow_nan=False, default=float))
    _write_report(out_dir, result, summary, figures=figures)
    _tell(summary, out_dir)


def drawn_effect(seed: int) -> dict[str, float | None]:
    """One effect of the lab's, chosen by the seed; its size is the seed's too."""
    from drivers.mocks.lab.hidden import HIDDEN

    names = sorted(HIDDEN)
    return {names[int(np.random.default_rng([seed, 3]).integers(len(names)))]: None}


def _write_report(out_dir: Path, result: Any, summary: dict[str, Any], *, figures: bool) -> None:
    from bench.figures import overview_png
    from bench.paper_figures import write_figures
    from bench.report import ReportData, write_report

    report = result.campaigns[-1].power_off
    data = ReportData(
        title="Main loop on the mock bench",
        bench=result.bench.name,
        virtual=result.bench.virtual,
        created=datetime.now().strftime("%Y-%m-%d %H:%M"),
        simulation=result.simulation,
        measurements=result.measurements,
        losses=result.losses,
        summary=summary,
        diagnosis=result.diagnosis,
        power_off={"confirmed": report.safe, "devices": {step.step: step.said for step in report.steps}},
        optimiser=summary["optimiser"],
    )
    write_report(out_dir / "report.html", data)
    overview_png(out_dir / "overview.png", data)
    if figures:
        write_figures(out_dir / "figures", data)


def _tell(summary: dict[str, Any], out_dir: Path) -> None:
    from bench.report import hidden_text

    stamp(virtual=True)
    table = Table("model", "mean abs error / points", box=None)
    for name, value in summary["error"].items():
        table.add_row(MODEL_NAMES.get(name, name), f"{100 * value:.4f}")
    out.print(table)
    out.print(escape(f"verdict: {verdict_text(summary['diagnosis'])}"))
    told = (
        ", ".join(hidden_text(name, value) for name, value in summary["hidden_values"].items()) or "nothing"
    )
    out.print(escape(f"hidden: {told} – {'found' if summary['found'] else 'NOT found'}"))
    for search in summary["swarm"]:
        regret = f"largest regret {100 * search['regret']:.4f} points over {len(summary['optimum'])} loads"
        out.print(escape(f"{search['name']} on D²EA: {regret}, {search['evaluations']} evaluations a load"))
    out.print(escape(f"bench: {summary['power_off']}"))
    out.print(f"{summary['seconds']['total']:.1f} s in all; report: {escape(str(out_dir / 'report.html'))}")
