"""The command line ``d2ea``: families of verbs put together, and every error turned into words.

Verbs of this package live in ``bench/commands``, one module per family, each with an ``app``. Verbs of other
packages are found by the entry point group ``d2ea.verbs``, so that nothing above is imported here.

Exit codes: 0 done, 1 failed or aborted from elsewhere, 2 wrong use, 3 bench left unsafe, 130 interrupted by Ctrl-C or
another signal (as shells have it). What has no other end than Ctrl-C, such as ``d2ea mock``, is then done.
"""

import importlib
import logging
import os
import pkgutil
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points
from typing import NoReturn

import typer
from rich.markup import escape
from typer.main import get_command

import bench.commands
from bench.commands.streams import err
from bench.errors import Aborted, BenchError, BenchUnsafe, InputError, Interrupted
from bench.log import start_log
from bench.whole_file import NO_ROOM, what_to_do, why_not
from drivers.errors import InstrumentError

FAILED, WRONG_USE, UNSAFE, INTERRUPTED = 1, 2, 3, 130
VERBS = "d2ea.verbs"
log = logging.getLogger("d2ea")


def build(verb: str | None = None) -> typer.Typer:
    """The whole command line, or only the family named like a verb of its own: what others need is not imported."""
    app = typer.Typer(
        no_args_is_help=True,
        add_completion=True,
        pretty_exceptions_enable=False,
        help="A lab bench in software: measure, simulate, learn, optimise, and say what is wrong.",
    )
    families = [module.name for module in pkgutil.iter_modules(bench.commands.__path__)]
    if verb in families and verb in _verbs_of(family := _family(verb)):
        app.add_typer(family)
        return app
    for name in families:
        app.add_typer(_family(name))
    for point in entry_points(group=VERBS):
        try:
            app.add_typer(point.load(), name=point.name)
        except (ImportError, AttributeError) as error:
            err.print(escape(f"the verb {point.name} is not available: {error}"))
    return app


def _family(name: str) -> typer.Typer:
    """The verbs of a module of ``bench/commands``; none where it only helps the others."""
    verbs = getattr(importlib.import_module(f"bench.commands.{name}"), "app", None)
    return verbs if isinstance(verbs, typer.Typer) else typer.Typer()


def _verbs_of(family: typer.Typer) -> set[str]:
    """Names on the command line: a function's own where none is given."""
    return {
        command.name or command.callback.__name__
        for command in family.registered_commands
        if command.callback
    }


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run one command; never returns, never shows a traceback."""
    if wrong := start_log(os.environ.get("D2EA_LOG", "warning")):
        err.print(escape(wrong))
    said = sys.argv[1:] if arguments is None else arguments
    try:
        get_command(build(said[0] if said else None))(args=said, prog_name="d2ea")
    except SystemExit as ended:
        if ended.code == INTERRUPTED:
            err.print("[bold red]interrupted:[/] nothing is left half-written")
        raise
    except BenchUnsafe as error:
        _say("BENCH NOT SAFE", "switch it off by hand and see that it is off, then: d2ea clear")
        err.print(escape(str(error)))
        sys.exit(UNSAFE)
    except Aborted as error:
        _say("aborted", error)
        sys.exit(INTERRUPTED if isinstance(error, Interrupted) else FAILED)
    except InputError as error:
        _say("wrong input", error)
        sys.exit(WRONG_USE)
    except OSError as error:
        _say("failed", _told(error))
        sys.exit(FAILED)
    except (BenchError, InstrumentError, ValueError) as error:
        log.debug("failed", exc_info=error)  # a ValueError may be this program's own fault
        _say("failed", error)
        sys.exit(FAILED)
    except Exception as error:
        log.debug("unexpected", exc_info=error)
        _say("failed, and this program did not expect it", f"{type(error).__name__}: {error}")
        err.print("Set D2EA_LOG=debug and run it again for the details.")
        sys.exit(FAILED)
    sys.exit(0)


def _told(error: OSError) -> str:
    """What was wrong with which file; where it is room that is missing, what to do."""
    if error.errno in NO_ROOM:
        return f"{error.filename or 'a file'} cannot be written: {why_not(error)}; {what_to_do(error)}"
    return f"{error.filename}: {error.strerror}" if error.filename else str(error)


def _say(what: str, error: object) -> None:
    err.print(f"[bold red]{what}:[/] {escape(str(error))}")
