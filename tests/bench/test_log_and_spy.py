"""The log knows campaign and point; the spy hears every byte."""

import json
import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.log import JsonLines, about, start_log, wire
from bench.spy import file_spy, log_of, readable
from drivers.mocks.wire import PtyServer
from drivers.transport import ByteLink, deadline_in
from tests.bench.command_line import d2ea


@pytest.fixture
def own_log() -> Iterator[None]:
    """The log as it was, afterwards."""
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    yield
    for handler in root.handlers:
        if handler not in handlers:
            handler.close()
    root.handlers[:], root.level = handlers, level


def test_a_record_tells_campaign_point_instrument_and_command(own_log: None, tmp_path: Path) -> None:
    assert start_log(f"debug:{tmp_path}/log.jsonl") is None
    with about(campaign=7), about(point=3):
        wire.debug(">", extra={"instrument": "load", "command": "01 03"})
    logging.getLogger("d2ea").warning("outside")
    first, second = map(json.loads, (tmp_path / "log.jsonl").read_text().splitlines())
    assert {**first, "time": 0} == {
        "time": 0, "level": "debug", "from": "d2ea.wire", "said": ">",
        "campaign": 7, "point": 3, "instrument": "load", "command": "01 03",
    }  # fmt: skip
    assert "campaign" not in second


@pytest.mark.parametrize(
    ("setting", "said"), [("loud", "'loud' is no level"), ("info:/no/such/folder/x", "cannot be written")]
)
def test_a_wrong_setting_is_said(own_log: None, setting: str, said: str) -> None:
    assert said in str(start_log(setting))


def test_an_error_is_one_line_too() -> None:
    record = logging.LogRecord("d2ea", logging.ERROR, "", 0, "broke", (), (ValueError, ValueError("x"), None))
    assert "ValueError: x" in json.loads(JsonLines().format(record))["error"]


def test_where_a_command_failed_is_in_the_log(
    own_log: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_path: object) -> None:
        raise ValueError("operands could not be broadcast together")

    monkeypatch.setattr("bench.commands.bench.read_bench", fail)
    monkeypatch.setenv("D2EA_LOG", f"debug:{tmp_path}/log.jsonl")
    assert d2ea("check", "any.toml") == 1
    assert "in fail" in json.loads((tmp_path / "log.jsonl").read_text())["error"]


def test_the_spy_writes_what_goes_over_the_wire(tmp_path: Path) -> None:
    with file_spy(tmp_path / "spy.txt") as spy, PtyServer(lambda _: b"\x00\xff") as server:
        assert spy is not None
        with ByteLink.open(server.path, spy=spy("analyzer")) as link:
            link.write(b"*IDN?\n")
            link.read_exactly(2, deadline_in(2.0))
    sent, *came = (line.split(" ", 1)[1] for line in (tmp_path / "spy.txt").read_text().splitlines())
    assert sent == "analyzer > '*IDN?\\n'"
    assert " ".join(line.removeprefix("analyzer < ") for line in came) == "00 ff"  # in one piece, or in two


def test_a_spy_whose_disk_is_full_says_so_once_and_disturbs_nobody(caplog: pytest.LogCaptureFixture) -> None:
    with file_spy(Path("/dev/full")) as spy:
        assert spy is not None
        for hear in (spy("controller"), spy("load")):
            hear(">", b"off")
    assert [record.getMessage() for record in caplog.records] == [
        "the spy hears no more: /dev/full cannot be written: No space left on device"
    ]


def test_nobody_listens_unless_asked() -> None:
    assert log_of("analyzer") is None
    with file_spy(None) as spy:
        assert spy is None
    assert readable(b"\xc3\xa4") == "c3 a4"
