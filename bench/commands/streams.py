"""Where commands print: results to standard output, what went wrong and progress to standard error."""

from rich.console import Console

# a time h:m:s or a column Pin:x:W is text, not the name of a symbol between colons
out = Console(highlight=False, soft_wrap=True, emoji=False)
err = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)

VIRTUAL = "VIRTUAL LAB: mock instruments, no hardware data"


def stamp(virtual: bool) -> None:
    """Say it before anything from a virtual lab is printed."""
    if virtual:
        out.print(f"[bold yellow]{VIRTUAL}[/]")
