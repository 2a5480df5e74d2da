"""The verb compare: two campaigns at the set points that both measured."""

from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from bench.commands.options import Database
from bench.commands.streams import out, stamp
from bench.comparison import compare as find
from bench.store import Store, database_url
from bench.wording import per_cent, points_text

app = typer.Typer()

SHOWN = 20


@app.command()
def compare(
    first: Annotated[int, typer.Argument(metavar="A", min=1, help="a campaign, as listed by d2ea runs")],
    second: Annotated[int, typer.Argument(metavar="B", min=1, help="another one")],
    everything: Annotated[
        bool, typer.Option("--all", help=f"every set point, not the first {SHOWN}")
    ] = False,
    db: Database = None,
) -> None:
    """Compare the efficiency of two campaigns at common set points, and say how their settings differ."""
    with Store(database_url(db)) as store:
        found = find(store, first, second)
    stamp(found.virtual)
    shown = found.rows if everything else found.rows.head(SHOWN)
    if len(shown):
        table = Table("P / W", "D1", "D2", str(first), str(second), "difference / points", box=None)
        for row in shown.to_dict("records"):
            place = (f"{row['P_set_W']:.0f}", f"{row['D1']:.3f}", f"{row['D2']:.3f}")
            table.add_row(
                *place, per_cent(row["first"], 3), per_cent(row["second"], 3), points_text(row["difference"])
            )
        out.print(table)
    if len(shown) < len(found.rows):
        out.print(f"and {len(found.rows) - len(shown)} more; --all shows them")
    for line in found.lines():
        out.print(escape(line))
