"""The verb dashboard: campaigns, bench, models and diagnosis on a live page, from a process of its own."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from bench.commands.options import DEFAULT_FOLDER, Database, Folder
from bench.commands.streams import out
from bench.errors import InputError
from bench.processes import behind_the_campaign
from bench.store import Store, database_url
from bench.wording import counted
from models.registry import Registry

app = typer.Typer()

TOKEN = "D2EA_TOKEN"
SHORTEST_TOKEN = 16


@app.command()
def dashboard(
    host: Annotated[
        str, typer.Option(help="address to listen on; any but this machine's own needs a token")
    ] = ("127.0.0.1"),
    port: Annotated[int, typer.Option(min=0, max=65535, help="port; 0 for any free one")] = 8080,
    read_only: Annotated[
        bool, typer.Option("--read-only", help="show, but ask campaigns for nothing")
    ] = False,
    token_file: Annotated[
        Path | None, typer.Option(metavar="FILE", help=f"file with the token; else the variable {TOKEN}")
    ] = None,
    folder: Folder = DEFAULT_FOLDER,
    db: Database = None,
) -> None:
    """Show bench, campaigns, models and diagnosis in a browser, live; pause, resume and abort from there."""
    from bench.dashboard.desk import Desk  # here: only this verb needs a web server
    from bench.dashboard.guard import Door, is_loopback
    from bench.dashboard.server import Address, serve
    from bench.dashboard.watcher import Watcher

    token = read_token(token_file)
    if token is None and not is_loopback(host):
        allowed = f"needs a token: set {TOKEN} or --token-file; without one only this machine may look"
        raise InputError.of("command line", "--host", host, allowed)
    behind_the_campaign()
    with Store(database_url(db)) as store:
        desk = Desk(watcher=Watcher(store), registry=Registry(folder), read_only=read_only)
        desk.watcher.look()  # a page shows something at once

        def said(url: str) -> None:
            out.print(escape(f"dashboard of {store.url} at {url}  Ctrl-C ends it."))

        with suppress(KeyboardInterrupt):  # as it is told to be ended
            serve(desk, Door(token), Address(host=host, port=port), said=said)


def read_token(file: Path | None) -> str | None:
    """The token from a file or the environment, never from an argument; InputError when it is too short."""
    if file is not None:
        try:
            token = file.read_text(encoding="utf-8").strip()
        except OSError as error:
            raise InputError.of(
                "command line", "--token-file", str(file), f"cannot be read: {error}"
            ) from error
    else:
        token = os.environ.get(TOKEN, "").strip()
    if not token and file is None:
        return None
    if len(token) < SHORTEST_TOKEN:
        where, option = ("environment", TOKEN) if file is None else (str(file), "token")
        raise InputError.of(where, option, None, _too_short(token))
    return token


def _too_short(token: str) -> str:
    """What is wrong with a token, without saying it, and how to make a better one."""
    make = "python3 -c 'import secrets; print(secrets.token_urlsafe(24))'"
    return f"holds {counted(len(token), 'character')}; at least {SHORTEST_TOKEN} are needed: {make} makes a token"
