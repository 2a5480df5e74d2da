"""The dashboard's process: pages, downloads and the door in front of them, served until it is ended."""

import logging
import socket
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import parse_qs

import uvicorn
from fastapi import FastAPI, Request, Response
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse
from nicegui import app as pages_app
from nicegui import background_tasks, ui

from bench.dashboard.desk import Desk
from bench.dashboard.guard import COOKIE, LOGIN, Door, Guard
from bench.dashboard.pages import register
from bench.dashboard.render import page
from bench.errors import InputError
from bench.log import log
from bench.lut_file import BESIDE

RECONNECT_S = 30.0  # a browser that was away for less finds its page as it was
FAVICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><rect width="32" height="32" rx="7" fill="#0072b2"/>'
    '<path d="M5 20h6v-9h6v9h6v-5h4" fill="none" stroke="#fff" stroke-width="3" stroke-linejoin="round"/></svg>'
)
DAY_S = 24 * 3600


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """Where to listen; port 0 is any free one."""

    host: str
    port: int

    def listen(self) -> socket.socket:
        """An open socket; InputError when the address cannot be had."""
        try:
            family = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM)[0][0]
            return socket.create_server((self.host, self.port), family=family)
        except OSError as error:
            raise InputError.of(
                "command line",
                "--host, --port",
                f"{self.host}:{self.port}",
                f"cannot be listened on: {error.strerror or error}; --port 0 takes any free port",
            ) from error


def serve(desk: Desk, door: Door, address: Address, *, said: Callable[[str], None]) -> None:
    """Serve until the process is asked to end; ``said`` gets the URL once it can be opened."""
    listening = address.listen()
    server = FastAPI(openapi_url=None)
    _sign_in(server, door)
    _downloads(server, desk)
    register(desk)
    pages_app.on_startup(lambda: background_tasks.create(desk.look_forever(), name="look"))
    ui.run_with(
        server,
        title="d2ea",
        favicon=FAVICON,
        dark=None,
        tailwind=False,
        reconnect_timeout=RECONNECT_S,
        show_welcome_message=False,
    )
    host, port = listening.getsockname()[:2]
    said(f"http://{f'[{host}]' if ':' in host else host}:{port}/")
    for name in ("uvicorn.error", "nicegui"):
        logging.getLogger(name).addFilter(_in_words)
    config = uvicorn.Config(
        Guard(server, door), log_config=None, access_log=False, ws="websockets-sansio", lifespan="on"
    )
    uvicorn.Server(config).run(sockets=[listening])


def _in_words(record: logging.LogRecord) -> bool:
    """An error in one line; a request whose browser has left is none."""
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, RuntimeError) and str(error) == "No response returned.":
        return False
    if error is not None and not log.isEnabledFor(logging.DEBUG):
        record.msg, record.args = f"{record.getMessage().strip()}: {type(error).__name__}: {error}", ()
        record.exc_info = None
    return True


def _sign_in(server: FastAPI, door: Door) -> None:
    @server.get(LOGIN)
    def ask_for_token() -> HTMLResponse:
        return HTMLResponse(page("login.html", wrong=False))

    @server.post(LOGIN)
    async def take_token(request: Request) -> Response:
        offered = parse_qs((await request.body()).decode("utf-8", "replace")).get("token", [""])[0]
        session = door.admit(offered)
        if session is None:
            return HTMLResponse(page("login.html", wrong=True), status_code=401)
        answer = RedirectResponse("/", status_code=303)
        answer.set_cookie(COOKIE, session, max_age=DAY_S, httponly=True, samesite="strict")
        return answer


def _downloads(server: FastAPI, desk: Desk) -> None:
    @server.get("/files/{model}/{name}")
    def table(model: str, name: str) -> Response:
        known = {record.id for record in desk.registry.list()}
        file = desk.registry.root / model / name
        if model not in known or name not in BESIDE or not file.is_file():
            return Response("there is no such table\n", status_code=404, media_type="text/plain")
        return FileResponse(file, filename=f"{model}-{name}")
