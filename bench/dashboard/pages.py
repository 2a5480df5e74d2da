"""The pages: what of ``view`` and ``charts`` stands where, and how it stays up to date."""

import asyncio
from datetime import UTC, datetime

from nicegui import ui

from bench.comparison import compare
from bench.dashboard import charts, view
from bench.dashboard.asking import Request
from bench.dashboard.desk import Chart, Desk, Panel, frame
from bench.dashboard.kept import chosen_optimum, decision_rows, model_errors, model_rows
from bench.dashboard.progress import progress
from bench.dashboard.watcher import Feed
from bench.errors import BenchError
from bench.verdict_wording import verdict_text
from bench.wording import effect_name, parameter_text, probability_text, probable_causes

HINT = "No diagnosis of this campaign yet: d2ea diagnose {id}, or d2ea retrain --watch beside it."


def register(desk: Desk) -> None:
    """Put all pages in place."""

    @ui.page("/", title="d2ea")
    def bench_page(campaign: int | None = None) -> None:
        BenchPage(desk, campaign).build()

    @ui.page("/campaigns", title="Campaigns – d2ea")
    def campaigns_page() -> None:
        _campaigns(desk)

    @ui.page("/diagnosis", title="Diagnosis – d2ea")
    def diagnosis_page(campaign: int | None = None) -> None:
        _diagnosis(desk, campaign)

    @ui.page("/models", title="Models – d2ea")
    def models_page() -> None:
        _models(desk)

    @ui.page("/optimum", title="Optimum – d2ea")
    def optimum_page() -> None:
        _optimum(desk)


class BenchPage:
    """The live page of one campaign: the one named, else whichever runs or ran last."""

    def __init__(self, desk: Desk, campaign: int | None) -> None:
        self._desk, self._asked = desk, campaign
        self._seen: tuple[int, int, str] | None = None  # campaign, version, band: what is shown
        self._band = "all loads"

    def build(self) -> None:
        """Put the pieces in place."""
        with frame(self._desk, "/") as live:
            with ui.element("div").classes("cols"):
                with ui.element("div").classes("col"):
                    self._progress = Panel("progress")
                    self._controls()
                    self._limits = Panel("limits")
                    self._verdict = Panel("verdict")
                with ui.element("div").classes("col"):
                    self._gap = Panel("gap")
                    with ui.element("div").classes("pickers"):
                        ui.toggle(list(charts.BANDS), value=self._band, on_change=self._pick).props(
                            "no-caps unelevated dense padding='4px 12px' toggle-color=primary"
                        )
                    with ui.element("div").classes("maps"):
                        self._maps = {
                            "measured": Chart("Measured efficiency"),
                            "simulated": Chart("Simulated efficiency"),
                            "difference": Chart("Measured − simulated"),
                        }
                    self._difference = Chart("Measured − simulated over load, with 95 % intervals")
            self._links = Panel("links")
            self._events = Panel("events")
            live(self._refresh)

    def _controls(self) -> None:
        self._buttons: dict[Request, ui.button] = {}
        with ui.element("div").classes("controls") as self._row:
            for request in Request:
                style = "abort" if request is Request.ABORT else "pause"
                button = ui.button(
                    request.capitalize(), color=None, on_click=lambda r=request: self._confirm(r)
                )
                self._buttons[request] = button.classes(style).props("unelevated no-caps")
        self._row.set_visibility(False)

    async def _confirm(self, request: Request) -> None:
        """Ask the person once more; an abort cannot be taken back."""
        feed = self._feed()
        if feed is None:
            return
        number, name = feed.campaign["id"], feed.campaign["name"]
        with ui.dialog() as dialog, ui.element("div").classes("confirm"):
            ui.html("", sanitize=False).set_content(f"<h2>{request.capitalize()} campaign {number}?</h2>")
            ui.label(f"{name}: {CONSEQUENCE[request]}")
            with ui.element("div").classes("controls"):
                ui.button("Leave it as it is", color=None, on_click=lambda: dialog.submit(False)).classes(
                    "pause"
                )
                style = "sure" if request is Request.ABORT else "pause"
                ui.button(f"Yes, {request}", color=None, on_click=lambda: dialog.submit(True)).classes(
                    style
                ).props("unelevated")
        if await dialog:
            await self._desk.ask(number, request)
        dialog.delete()

    def _pick(self, event: object) -> None:
        self._band = str(getattr(event, "value", self._band))
        self._refresh()

    def _feed(self) -> Feed | None:
        watcher = self._desk.watcher
        number = self._asked or watcher.overview.newest
        return None if number is None else watcher.feed(number)

    def _refresh(self) -> None:
        feed = self._feed()
        if feed is None:
            self._row.set_visibility(False)
            return
        shared, number = self._desk.shared, feed.campaign["id"]
        now = datetime.now(UTC)
        tick = (feed.version, int(now.timestamp()))  # ages grow by the second
        self._progress.put(shared.get(("progress", number), tick, lambda: self._render_progress(feed, now)))
        self._links.put(shared.get(("links", number), tick, lambda: self._render_links(feed, now)))
        self._show_controls(feed)
        seen = (number, feed.version, self._band)
        if seen == self._seen:
            return
        self._seen = seen
        pieces = shared.get(("pieces", number), feed.version, lambda: self._render(feed))
        for panel, text in zip((self._gap, self._limits, self._events, self._verdict), pieces, strict=True):
            panel.put(text)
        drawn = shared.get(("charts", number, self._band), feed.version, lambda: self._draw(feed))
        for name, chart in (self._maps | {"over load": self._difference}).items():
            chart.show(drawn[name])

    def _render_progress(self, feed: Feed, now: datetime) -> str:
        return self._progress.render(progress(feed, now), view.PHASES)

    def _render_links(self, feed: Feed, now: datetime) -> str:
        moment = feed.moment if feed.campaign["is_live"] else None
        return self._links.render(view.links(feed.campaign, moment, now))

    def _render(self, feed: Feed) -> tuple[str, str, str, str]:
        moment = feed.moment if feed.campaign["is_live"] else None
        trips = feed.moment.faults if feed.moment else ()
        return (
            self._gap.render(view.gap(feed.rows)),
            self._limits.render(view.limits(feed.campaign, moment), trips),
            self._events.render(view.happened(feed)),
            self._render_verdict(feed),
        )

    def _draw(self, feed: Feed) -> dict[str, charts.Figure]:
        over_load = charts.difference_over_power(feed.rows, feed.planned, self._band)
        return charts.maps(feed.rows, feed.planned, self._band) | {"over load": over_load}

    def _show_controls(self, feed: Feed) -> None:
        row = feed.campaign
        self._row.set_visibility(bool(row["is_live"]) and not self._desk.read_only)
        paused = row["shown"] == "paused" or row["request"] == "pause"
        self._buttons[Request.PAUSE].set_visibility(not paused)
        self._buttons[Request.RESUME].set_visibility(paused)

    def _render_verdict(self, feed: Feed) -> str:
        kept = feed.diagnosis
        if kept is None:
            return self._verdict.render(None, "", "", [], HINT.format(id=feed.campaign["id"]))
        verdict = kept["verdict"]
        causes = [
            {
                "name": effect_name(cause["effect"]),
                "probability": probability_text(cause["probability"]),
                "share": cause["probability"],
                "value": "; ".join(parameter_text(p) for p in cause["parameters"]),
            }
            for cause in probable_causes(verdict)[:3]
        ]
        when = f"as of {view.clock(kept['created'])}"
        return self._verdict.render(verdict, when, verdict_text(verdict), causes, "")


CONSEQUENCE = {
    Request.PAUSE: "it finishes the point it is at, switches the bench off and waits.",
    Request.RESUME: "it switches the bench on again and goes on with the next point.",
    Request.ABORT: "it switches the bench off and ends. What was measured stays; d2ea resume can take it up again.",
}


def _campaigns(desk: Desk) -> None:
    with frame(desk, "/campaigns") as live:
        with ui.element("div").classes("pickers"):
            first = ui.select({}, label="Compare").props("outlined dense options-dense")
            second = ui.select({}, label="with").props("outlined dense options-dense")
            ui.button("Compare", color=None, on_click=lambda: show()).classes("pause").props(
                "unelevated"
            ).props("unelevated no-caps")
        comparison = Panel("comparison")
        with ui.element("div") as picture:
            chart = Chart("Efficiency of the second less the first, at common set points")
        picture.set_visibility(False)
        table, queue = Panel("campaigns"), Panel("queue")

        async def show() -> None:
            if first.value is None or second.value is None:
                ui.notify("choose two campaigns", classes="said wrong")
                return
            try:
                found = await asyncio.to_thread(compare, desk.watcher.store, first.value, second.value)
            except BenchError as error:
                ui.notify(str(error), classes="said wrong")
                return
            comparison.show({"title": f"{found.names[0]} and {found.names[1]}", "lines": found.lines()})
            picture.set_visibility(bool(len(found.rows)))
            columns = (found.rows[name].tolist() for name in ("P_set_W", "difference", "u"))
            chart.show(charts.compared(*columns))

        def refresh() -> None:
            overview = desk.watcher.overview
            table.show(view.campaign_rows(overview))
            queue.show(overview.queue)
            options = {row["id"]: f"{row['id']} {row['name']}" for row in reversed(overview.campaigns)}
            for picker in (first, second):
                if picker.options != options:
                    picker.set_options(options)

        live(refresh)


def _diagnosis(desk: Desk, campaign: int | None) -> None:
    with frame(desk, "/diagnosis") as live:
        content, nothing = Panel("diagnosis"), Panel("note")

        def refresh() -> None:
            number = campaign or desk.watcher.overview.newest
            feed = desk.watcher.feed(number) if number is not None else None
            if feed is None or feed.diagnosis is None:
                content.clear()
                nothing.show(HINT.format(id=number) if number is not None else "No campaign yet.")
                return
            nothing.clear()
            content.show(feed.diagnosis["verdict"], verdict_text(feed.diagnosis["verdict"]))

        live(refresh)


def _models(desk: Desk) -> None:
    with frame(desk, "/models") as live:
        with ui.element("div") as picture:
            chart = Chart("Error on measurements that were not fitted")
        table = Panel("models")

        def refresh() -> None:
            table.show(model_rows(desk.registry), decision_rows(desk.registry))
            errors = model_errors(desk.registry)
            picture.set_visibility(bool(errors))
            chart.show(charts.model_errors(errors))

        live(refresh)


def _optimum(desk: Desk) -> None:
    with frame(desk, "/optimum") as live:
        with ui.element("div").classes("two") as pictures:
            modulation, efficiency = Chart("D1 and D2 over load"), Chart("Predicted efficiency over load")
        table, nothing = Panel("optimum"), Panel("note")

        def refresh() -> None:
            found = chosen_optimum(desk.registry)
            pictures.set_visibility(found.table is not None)
            if found.table is None:
                table.clear()
                nothing.show(found.said)
                return
            nothing.clear()
            figures = charts.optimum(found.table["rows"])
            modulation.show(figures["modulation"])
            efficiency.show(figures["efficiency"])
            table.show(found.table)

        live(refresh)
