"""The dashboard in a process, and viewers without a browser: each loads a page, stays connected, notes what comes."""

import asyncio
import json
import os
import re
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import aiohttp
import socketio

_QUERY = re.compile(r"query: (\{.*?\}),\n", re.DOTALL)
_PAIR = re.compile(r"""['"](\w+)['"]:\s*['"]?([^'",}]+)['"]?""")
_DONE = re.compile(r'data-done=\\?"(\d+)\\?"')
_NICE = 10
PATH = "/_nicegui_ws/socket.io"


@dataclass(slots=True)
class Viewer:
    """One page that is looked at; ``seen`` maps a number of measured rows to when it was first told, in seconds."""

    address: str
    now: Callable[[], float]
    seen: dict[int, float] = field(default_factory=dict)
    received: int = 0  # characters
    _client: socketio.AsyncClient | None = None
    _session: aiohttp.ClientSession | None = None

    async def open(self) -> None:
        """Load the page and connect as its script does."""
        self._session = aiohttp.ClientSession()
        async with self._session.get(self.address) as answer:
            page = await answer.text()
        found = _QUERY.search(page)
        if found is None:
            raise RuntimeError(f"{self.address} is no page of the dashboard: {page[:200]!r}")
        given = dict(_PAIR.findall(found[1]))  # names in quotes, values as they come
        query = given | {"tab_id": str(uuid.uuid4()), "document_id": str(uuid.uuid4())}
        query |= {"implicit_handshake": "true"}
        self._client = socketio.AsyncClient(http_session=self._session, reconnection=False)
        self._client.on("*", self._take)
        parameters = "&".join(f"{name}={value}" for name, value in query.items())
        base = self.address.rstrip("/")
        await self._client.connect(f"{base}?{parameters}", socketio_path=PATH, transports=["websocket"])

    async def _take(self, _event: str, *data: object) -> None:
        text = json.dumps(data)
        self.received += len(text)
        for rows in _DONE.findall(text):
            self.seen.setdefault(int(rows), self.now())

    async def close(self) -> None:
        """Go away."""
        if self._client is not None:
            await self._client.disconnect()
        if self._session is not None:
            await self._session.close()


@contextmanager
def dashboard(url: str, *options: str, token: str = "") -> Iterator[str]:
    """The dashboard of a database in a process of its own; yields its address."""
    verb = ["-c", "from bench.cli import main; main()", "dashboard", "--port", "0", "--db", url]
    environment = os.environ | {"D2EA_TOKEN": token, "COLUMNS": "200"}  # wide: its address stays on one line
    command = [sys.executable, *verb, *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().split(" at ")[1].split()[0]
        finally:
            process.terminate()


@contextmanager
def watching(
    address: str, count: int, now: Callable[[], float] = time.perf_counter
) -> Iterator[list[Viewer]]:
    """So many viewers of a page, in a thread that gets what others leave: they belong on other machines."""
    viewers = [Viewer(address=address, now=now) for _ in range(count)]
    loop = asyncio.new_event_loop()

    def run() -> None:
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
        loop.run_forever()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()

    def all_of(what: str) -> None:
        for viewer in viewers:
            asyncio.run_coroutine_threadsafe(getattr(viewer, what)(), loop).result(timeout=60)

    try:
        all_of("open")
        yield viewers
    finally:
        all_of("close")
        loop.call_soon_threadsafe(loop.stop)
        thread.join(timeout=10)
        loop.close()
