"""The door: who may look, who may ask, and what another web site cannot do."""

import logging

import pytest

from bench.dashboard.guard import COOKIE, Asked, Door
from bench.dashboard.server import _in_words

TOKEN = "a token of sixteen letters"


def asked(method: str = "GET", path: str = "/", *, websocket: bool = False, **headers: str) -> Asked:
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return Asked(method=method, path=path, headers={"host": "127.0.0.1:8080"} | named, websocket=websocket)


def status(door: Door, request: Asked) -> int | None:
    refusal = door.judge(request)
    return None if refusal is None else refusal.status


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080", "localhost"])
def test_this_machine_may_look(host: str) -> None:
    assert status(Door(), asked(host=host)) is None


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example:8080", "", "]["])
def test_another_name_for_this_machine_is_not_answered_to(host: str) -> None:
    assert status(Door(), asked(host=host)) == 421


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:9999"])
def test_another_site_opens_no_websocket_and_posts_nothing(origin: str) -> None:
    assert status(Door(), asked(websocket=True, origin=origin)) == 403
    assert status(Door(), asked("POST", origin=origin)) == 403


def test_our_own_pages_do() -> None:
    assert status(Door(), asked(websocket=True, origin="http://127.0.0.1:8080")) is None
    assert status(Door(), asked("POST", origin="http://127.0.0.1:8080")) is None


def test_a_browser_that_sends_no_origin_still_tells_a_foreign_site() -> None:
    assert status(Door(), asked("POST", sec_fetch_site="cross-site")) == 403
    assert status(Door(), asked("POST", sec_fetch_site="same-origin")) is None


def test_with_a_token_nobody_passes_without_it() -> None:
    door = Door(TOKEN)
    assert status(door, asked(host="lab-pc:8080")) == 401
    assert status(door, asked(host="lab-pc:8080", websocket=True, origin="http://lab-pc:8080")) == 401
    assert status(door, asked(path="/login")) is None


def test_the_right_token_opens_a_session_and_a_wrong_one_does_not() -> None:
    door = Door(TOKEN)
    assert door.admit("a guess") is None
    session = door.admit(TOKEN)
    assert status(door, asked(cookie=f"{COOKIE}={session}")) is None
    assert status(door, asked(cookie=f"{COOKIE}={session}x")) == 401
    assert status(door, asked(cookie=f"{COOKIE}={TOKEN}")) == 401


def test_a_program_brings_the_token_itself() -> None:
    door = Door(TOKEN)
    assert status(door, asked(authorization=f"Bearer {TOKEN}")) is None
    assert status(door, asked(authorization="Bearer something else")) == 401


def test_a_door_without_a_token_admits_nobody_by_one() -> None:
    assert Door().admit("") is None


def record(error: Exception) -> logging.LogRecord:
    info = (type(error), error, None)
    return logging.LogRecord(
        "uvicorn.error", logging.ERROR, "x.py", 1, "Exception in ASGI application\n", (), info
    )


def test_what_goes_wrong_in_a_page_is_said_in_one_line() -> None:
    told = record(ValueError("half a number"))
    assert _in_words(told)
    assert told.getMessage() == "Exception in ASGI application: ValueError: half a number"
    assert told.exc_info is None


def test_a_browser_that_left_is_no_error() -> None:
    assert not _in_words(record(RuntimeError("No response returned.")))
