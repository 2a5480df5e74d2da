"""Where commands print: results to standard output, what went wrong and progress to standard error."""

from rich.console import Console

out = Console(highlight=False, soft_wrap=True)
err = Console(stderr=True, highlight=False, soft_wrap=True)

VIRTUAL = "VIRTUAL LAB: mock instruments, no hardware data"


def stamp(virtual: bool) -> None:
    """Say it before anything from a virtual lab is printed."""
    if virtual:
        out.print(f"[bold yellow]{VIRTUAL}[/]")
