"""The byte link: opening, deadlines, hang-ups, late bytes."""

import os
import socket
import threading
from pathlib import Path

import pytest

from drivers.errors import LinkLost, LinkTimeout, LinkUnavailable, ReplyError
from drivers.mocks.wire import PtyServer
from drivers.transport import LONGEST_REPLY, ByteLink, deadline_in
from tests.drivers.scripted_port import ScriptedPort

SOON_S = 0.05  # a deadline that is meant to pass
LATE_S = 10.0  # a deadline that is not


def echo(chunk: bytes) -> bytes:
    return chunk


def test_splits_what_comes_at_the_terminator() -> None:
    link = ByteLink(ScriptedPort([(b"?", b"one\r\ntwo\r\nthr")]), "scripted")
    link.write(b"?")
    assert link.read_until(b"\r\n", deadline_in(LATE_S)) == b"one"
    assert link.read_until(b"\r\n", deadline_in(LATE_S)) == b"two"
    with pytest.raises(LinkTimeout) as caught:
        link.read_until(b"\r\n", deadline_in(SOON_S))
    assert caught.value.context["reply"] == b"thr"
    assert link.read_exactly(3, deadline_in(LATE_S)) == b"thr"


def test_a_terminator_split_over_two_reads_is_found() -> None:
    link = ByteLink(ScriptedPort([(b"a", b"line\r"), (b"b", b"\nrest")]), "scripted")
    link.write(b"a")
    with pytest.raises(LinkTimeout):
        link.read_until(b"\r\n", deadline_in(SOON_S))
    link.write(b"b")
    assert link.read_until(b"\r\n", deadline_in(LATE_S)) == b"line"


def test_reads_what_a_pty_sends() -> None:
    with PtyServer(echo) as server, ByteLink.open(server.path) as link:
        link.write(b"hello\n")
        assert link.read_until(b"\n", deadline_in(LATE_S)) == b"hello"
        assert link.read_some(deadline_in(SOON_S)) == b""


def test_opens_a_socket_by_url() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        with ByteLink.open(f"socket://127.0.0.1:{port}") as link:
            connection, _ = listener.accept()
            with connection:
                connection.sendall(b"hello\n")
                assert link.read_until(b"\n", deadline_in(LATE_S)) == b"hello"
            with pytest.raises(LinkLost):
                link.read_until(b"\n", deadline_in(LATE_S))


def test_a_port_that_does_not_exist_is_unavailable() -> None:
    with pytest.raises(LinkUnavailable, match="no such port") as caught:
        ByteLink.open("/dev/serial/by-id/no-such-instrument")
    assert caught.value.context["resource"] == "/dev/serial/by-id/no-such-instrument"


def test_a_port_in_use_is_unavailable_and_says_so() -> None:
    with (
        PtyServer(echo) as server,
        ByteLink.open(server.path),
        pytest.raises(LinkUnavailable, match="another program holds it"),
    ):
        ByteLink.open(server.path)


def test_a_port_that_was_closed_can_be_opened_again() -> None:
    with PtyServer(echo) as server:
        for _ in range(2):
            ByteLink.open(server.path).close()


def test_a_refused_connection_is_unavailable() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        free = listener.getsockname()[1]
    with pytest.raises(LinkUnavailable, match="nothing listens there"):
        ByteLink.open(f"socket://127.0.0.1:{free}")


@pytest.mark.parametrize("resource", ["carrier-pigeon://loft", ""])
def test_a_resource_that_is_none_is_unavailable(resource: str) -> None:
    with pytest.raises(LinkUnavailable):
        ByteLink.open(resource)


def test_a_file_that_is_no_port_is_unavailable(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(LinkUnavailable):
        ByteLink.open(str(tmp_path / "notes.txt"))


def test_hang_up_is_link_lost_whatever_is_done_next() -> None:
    server = PtyServer(echo).start()
    with ByteLink.open(server.path) as link:
        server.stop()
        for use in (
            lambda: link.read_some(deadline_in(LATE_S)),
            lambda: link.write(b"?"),
            link.drain,
            lambda: link.quarantine(LATE_S),
        ):
            with pytest.raises(LinkLost, match=r"is gone|still gone|was lost"):
                use()


def test_hang_up_ends_a_read_that_waits() -> None:
    server = PtyServer(echo).start()
    with ByteLink.open(server.path) as link:
        stopper = threading.Thread(target=server.stop)
        stopper.start()
        with pytest.raises(LinkLost):
            link.read_until(b"\n", deadline_in(LATE_S))
        stopper.join()


def test_a_link_that_takes_no_more_bytes_times_out() -> None:
    """Nobody reads the other end of this pseudo-terminal, whose buffer holds some kilobytes."""
    master, slave = os.openpty()
    try:
        with ByteLink.open(os.ttyname(slave), timeout_s=SOON_S) as link, pytest.raises(LinkTimeout):
            link.write(b"x" * 1_000_000)
    finally:
        os.close(slave)
        os.close(master)


def test_drain_throws_away_what_has_come_and_does_not_wait() -> None:
    link = ByteLink(ScriptedPort([(b"?", b"line\nlate")]), "scripted")
    assert link.drain() == b""
    link.write(b"?")
    assert link.read_until(b"\n", deadline_in(LATE_S)) == b"line"
    assert link.drain() == b"late"
    assert link.read_some(deadline_in(SOON_S)) == b""


def test_quarantine_swallows_bytes_that_come_late() -> None:
    """The late reply comes within the quarantine, so nothing of it is left for the next reader."""
    with PtyServer(echo) as server, ByteLink.open(server.path) as link:
        late = threading.Timer(0.05, server.send, [b"late reply\n"])
        late.start()
        link.quarantine(0.5)
        late.join()
        assert link.read_some(deadline_in(SOON_S)) == b""


def test_a_babbling_line_is_not_a_reply() -> None:
    link = ByteLink(ScriptedPort([(b"?", b"x" * (2 * LONGEST_REPLY))]), "scripted")
    link.write(b"?")
    with pytest.raises(ReplyError, match="without an end"):
        link.read_until(b"\n", deadline_in(LATE_S))
