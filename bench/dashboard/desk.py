"""What all pages share: the settings of the dashboard, what is read for it, and what hangs on every page."""

import asyncio
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

from nicegui import ui

from bench.dashboard.asking import Request, ask
from bench.dashboard.render import css, piece
from bench.dashboard.view import banner, lab_of
from bench.dashboard.watcher import Watcher
from bench.errors import BenchError
from models.registry import Registry

T = TypeVar("T")

LOOK_S = 0.2  # between two looks at the database
ANSWER_MS = 20_000  # what came of a request stays long enough to be read on a slow page
SHOW_S = 0.2  # between two looks of a page at what was read
PAGES = {
    "/": "Bench",
    "/campaigns": "Campaigns",
    "/diagnosis": "Diagnosis",
    "/models": "Models",
    "/optimum": "Optimum",
}
_LABEL = '<div class="virtual" role="note"><strong>VIRTUAL LAB</strong> {}</div>'
LABELS = {
    "hardware": "",
    "virtual": _LABEL.format("mock instruments, simulated converter: nothing here was measured on hardware"),
    "both": _LABEL.format("some of these campaigns: the list of campaigns says which"),
}


class Shared:
    """What is made once for all viewers: under each name the last value, and the key that it was made for."""

    def __init__(self) -> None:
        self._kept: dict[Hashable, tuple[Hashable, Any]] = {}

    def get(self, name: Hashable, key: Hashable, make: Callable[[], T]) -> T:
        """The value for ``key``, made anew only when the key has changed."""
        kept = self._kept.get(name)
        if kept is None or kept[0] != key:
            kept = self._kept[name] = (key, make())
        value: T = kept[1]
        return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Desk:
    """One dashboard: what it reads, whose models it shows, and whether it may ask for anything."""

    watcher: Watcher
    registry: Registry
    read_only: bool = False
    shared: Shared = field(default_factory=Shared)

    async def ask(self, campaign_id: int, request: Request) -> None:
        """Ask in the name of the person who looks, and tell them what came of it."""
        try:
            if self.read_only:
                raise BenchError("this dashboard is read-only: ask with d2ea pause, resume or abort")
            said = await asyncio.to_thread(ask, self.watcher.store, campaign_id, request)
            ui.notify(said, classes="said", timeout=ANSWER_MS, close_button="Seen")
        except BenchError as error:
            ui.notify(str(error), classes="said wrong", timeout=ANSWER_MS, close_button="Seen")

    async def look_forever(self) -> None:
        """Read what is new, over and over, for all who look."""
        while True:
            await asyncio.to_thread(self.watcher.look)
            await asyncio.sleep(LOOK_S)


class Panel:
    """A piece of HTML that is sent to the browser only when it has changed."""

    def __init__(self, macro: str) -> None:
        self._make = piece(macro)
        self._element = ui.html("", sanitize=False)

    def render(self, *values: object) -> str:
        """The template filled with values."""
        return self._make(*values)

    def show(self, *values: object) -> None:
        """Fill the template with values."""
        self.put(self.render(*values))

    def put(self, text: str) -> None:
        """Show what was rendered."""
        if text != self._element.content:
            self._element.set_content(text)

    def clear(self) -> None:
        """Show nothing."""
        self._element.set_content("")


class Chart:
    """A Plotly figure in a card."""

    def __init__(self, title: str) -> None:
        with ui.element("div").classes("card"):
            ui.html(piece_title(title), sanitize=False)
            self._plot = ui.plotly({"data": [], "layout": {}, "config": {}}).classes("chart")
        self._plot.props(f'role=img aria-label="{title}"')
        self._shown: Mapping[str, Any] = {}

    def show(self, figure: dict[str, Any]) -> None:
        """Draw, unless it is what is drawn."""
        if figure is not self._shown and figure != self._shown:
            self._shown = figure
            self._plot.update_figure(figure)


def piece_title(title: str) -> str:
    """A heading; titles are ours, never a stranger's."""
    return f"<h3>{title}</h3>"


@contextmanager
def frame(desk: Desk, path: str) -> Iterator[Callable[[Callable[[], None]], None]]:
    """The page around its contents: navigation, label of the virtual lab, banner; yields what makes it live.

    ``live(refresh)`` calls ``refresh`` at once and whenever it is time to look again.
    """
    ui.add_css(css())
    ui.colors(primary="#0072b2")
    links = "".join(
        f'<a href="{to}"{" aria-current=page" if to == path else ""}>{name}</a>' for to, name in PAGES.items()
    )
    mode = "read-only" if desk.read_only else ""
    ui.html(
        f'<header class="top"><a class="mark" href="/">d<i>²</i>ea</a><nav>{links}</nav>'
        f'<span class="mode">{mode}</span></header>',
        sanitize=False,
    )
    label = ui.html("", sanitize=False)
    with ui.element("main").classes("desk"):
        problem, top = Panel("problem"), Panel("banner")

        def refresh_frame() -> None:
            overview = desk.watcher.overview
            if label.content != (text := LABELS[lab_of(overview)]):
                label.set_content(text)
            problem.show(overview.problem)
            shown = desk.shared.get("banner", (id(overview), overview.version), lambda: banner(overview))
            top.put(desk.shared.get("banner, rendered", shown, lambda: top.render(shown)))
            ui.page_title(f"{shown.title} – d2ea")

        def live(refresh: Callable[[], None]) -> None:
            def both() -> None:
                refresh_frame()
                refresh()

            both()
            ui.timer(SHOW_S, both)

        yield live
