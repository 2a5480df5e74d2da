"""The dashboard in a real browser: a campaign followed live, paused, aborted, and the bench seen off."""

import shutil
import threading
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from bench.campaign import run_campaign
from bench.errors import Aborted
from bench.job import Job
from bench.progress import Progress
from bench.store import Store
from experiments.harness.viewers import dashboard
from tests.bench.dashboard.stored import BENCH, running_campaign
from tests.bench.fake_bench import FakeInstruments, bench_config, campaign_config, predict

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="missing program: chromium")
WAIT_MS = 20_000  # a busy machine; nothing here is timed


# what does not depend on how the database tells of changes; the journeys above are asked of either
ONE_DATABASE = pytest.mark.parametrize("url", ["sqlite"], indirect=True)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


class Campaign:
    """A campaign on the fake bench in a thread that measures a point when it is told to."""

    def __init__(self, url: str) -> None:
        self.fake = FakeInstruments()
        self.store = Store(url)
        self.turns = threading.Semaphore(0)
        self.error: Aborted | None = None
        self.job = Job.prepare(campaign_config(), bench_config(), predict=predict)
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        try:
            run_campaign(
                self.job, self.store, self.fake.clock, around=self.fake.around(), progress=self._wait
            )
        except Aborted as error:
            self.error = error

    def _wait(self, progress: Progress) -> None:
        if progress.said in ("accepted", "rejected"):
            self.turns.acquire(timeout=60)

    def measure(self, points: int) -> None:
        """Let so many more points be measured."""
        self.turns.release(points)

    def close(self) -> None:
        self.measure(100)
        self.thread.join(timeout=60)
        self.store.close()


@pytest.fixture
def campaign(url: str) -> Iterator[Campaign]:
    started = Campaign(url)
    yield started
    started.close()


def done(page: Page, rows: int) -> None:
    """The page shows so many rows as measured."""
    expect(page.locator(f".progress[data-done='{rows}']")).to_be_visible(timeout=WAIT_MS)


def press(page: Page, button: str) -> None:
    """Press a button and confirm."""
    page.get_by_role("button", name=button, exact=True).click()
    page.get_by_role("button", name=f"Yes, {button.lower()}").click()


def banner(page: Page, level: str) -> None:
    expect(page.locator(f".banner[data-level='{level}']")).to_be_visible(timeout=WAIT_MS)


def test_a_campaign_is_followed_paused_resumed_aborted_and_seen_off(
    browser: Browser, campaign: Campaign, url: str
) -> None:
    with dashboard(url) as address:
        page = browser.new_page()
        page.goto(address)
        banner(page, "running")
        done(page, 1)
        campaign.measure(2)
        done(page, 3)
        expect(page.locator(".js-plotly-plot .main-svg").first).to_be_visible(timeout=WAIT_MS)
        press(page, "Pause")
        expect(page.get_by_text("asked to pause")).to_be_visible(timeout=WAIT_MS)
        campaign.measure(1)
        banner(page, "paused")
        assert campaign.fake.off
        press(page, "Resume")
        banner(page, "running")
        press(page, "Abort")
        expect(page.get_by_text("asked to abort")).to_be_visible(timeout=WAIT_MS)
        campaign.measure(1)
        banner(page, "off")
        expect(page.locator(".banner")).to_contain_text("PWM off; load off; supply off")
        expect(page.locator(".state.aborted")).to_be_visible()
        expect(page.get_by_role("button", name="Abort", exact=True)).to_be_hidden()
        campaign.thread.join(timeout=60)
        assert campaign.error is not None
        assert campaign.fake.off


def test_two_people_press_abort_and_a_third_comes_back(
    browser: Browser, campaign: Campaign, url: str
) -> None:
    with dashboard(url) as address:
        first, second, third = (browser.new_context().new_page() for _ in range(3))
        for page in (first, second, third):
            page.goto(address)
            done(page, 1)
        third.context.set_offline(True)
        second.get_by_role("button", name="Abort", exact=True).click()
        press(first, "Abort")
        expect(first.get_by_text("asked campaign 1 to abort")).to_be_visible(timeout=WAIT_MS)
        second.get_by_role("button", name="Yes, abort").click()
        expect(second.get_by_text("was already asked to abort")).to_be_visible(timeout=WAIT_MS)
        campaign.measure(1)
        banner(first, "off")
        third.context.set_offline(False)
        banner(third, "off")


@ONE_DATABASE
def test_unsafe_cannot_be_missed_on_any_page(browser: Browser, url: str) -> None:
    with Store(url) as store:
        running_campaign(store)
        store.benches.latch(BENCH, "load NOT confirmed off: no reply")
        with dashboard(url) as address:
            page = browser.new_page(viewport={"width": 390, "height": 844})
            for path in ("", "campaigns", "models", "optimum", "diagnosis"):
                page.goto(address + path)
                banner(page, "unsafe")
                expect(page.get_by_role("alert")).to_contain_text("Switch it off by hand")
                expect(page).to_have_title("UNSAFE: bench one – d2ea")


@ONE_DATABASE
def test_read_only_shows_and_asks_for_nothing(browser: Browser, campaign: Campaign, url: str) -> None:
    with dashboard(url, "--read-only") as address:
        page = browser.new_page()
        page.goto(address)
        done(page, 1)
        expect(page.get_by_text("read-only")).to_be_visible()
        expect(page.get_by_role("button", name="Abort", exact=True)).to_be_hidden()


@ONE_DATABASE
def test_a_token_is_asked_for_once(browser: Browser, url: str) -> None:
    token = "sixteen letters or more"
    with dashboard(url, token=token) as address:
        page = browser.new_page()
        page.goto(address)
        page.get_by_label("Token").fill("not the token of this one")
        page.get_by_role("button", name="Open").click()
        expect(page.get_by_role("alert")).to_contain_text("not the token")
        page.get_by_label("Token").fill(token)
        page.get_by_role("button", name="Open").click()
        expect(page.locator(".banner")).to_be_visible(timeout=WAIT_MS)
        page.goto(f"{address}models")
        expect(page.get_by_text("No models yet")).to_be_visible(timeout=WAIT_MS)


@ONE_DATABASE
def test_another_site_gets_no_live_connection(url: str) -> None:
    import httpx

    with dashboard(url) as address:
        handshake = {
            "connection": "Upgrade", "upgrade": "websocket", "sec-websocket-version": "13",
            "sec-websocket-key": "MDEyMzQ1Njc4OWFiY2RlZg==", "origin": "http://evil.example",
        }  # fmt: skip
        path = f"{address}_nicegui_ws/socket.io/?EIO=4&transport=websocket"
        assert httpx.get(path, headers=handshake).status_code == 403
        own = handshake | {"origin": address.rstrip("/")}
        with httpx.stream("GET", path, headers=own) as answer:
            assert answer.status_code == 101
        assert httpx.get(address).headers["x-frame-options"] == "DENY"
