"""The pseudo-terminal plumbing under every mock."""

import os
import threading
import time

import pytest
import serial

from drivers.mocks.wire import PtyPort, PtyServer


def test_answers_a_client_byte_for_byte() -> None:
    """Raw mode: no echo, no translation of CR, LF or control bytes."""
    with (
        PtyServer(lambda chunk: bytes(byte ^ 0xFF for byte in chunk)) as server,
        serial.Serial(server.path, timeout=5) as client,
    ):
        client.write(bytes(range(256)))
        assert client.read(256) == bytes(range(256))[::-1]


def test_survives_a_client_that_closes_and_one_that_comes_after() -> None:
    with PtyServer(lambda chunk: chunk) as server:
        for _ in range(2):
            with serial.Serial(server.path, timeout=5) as client:
                client.write(b"hello")
                assert client.read(5) == b"hello"


def test_stop_hangs_up_and_start_opens_a_new_port() -> None:
    server = PtyServer(lambda chunk: chunk).start()
    with serial.Serial(server.path, timeout=5) as client:
        server.stop()
        with pytest.raises(OSError, match=r"."):
            _ = client.in_waiting
    with server, serial.Serial(server.path, timeout=5) as client:
        client.write(b"again")
        assert client.read(5) == b"again"


def test_stop_closes_every_descriptor() -> None:
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        PtyServer(lambda chunk: chunk).start().stop()
    assert len(os.listdir("/proc/self/fd")) == before


def test_stop_returns_though_nobody_reads_the_reply() -> None:
    """The kernel buffers some kilobytes for a client; a writer blocked behind them must still stop."""
    replied = b"x" * 1_000_000
    server = PtyServer(lambda _: replied).start()
    with serial.Serial(server.path, timeout=5) as client:
        client.write(b"?")
        assert client.read(1) == b"x"
        server.stop()


def test_two_servers_bridge_two_paths() -> None:
    near = PtyServer(lambda data: far.send(data))
    far = PtyServer(near.send)
    with near, far, serial.Serial(near.path, timeout=5) as left, serial.Serial(far.path, timeout=5) as right:
        left.write(b"to the right")
        assert right.read(12) == b"to the right"
        right.write(b"to the left")
        assert left.read(11) == b"to the left"


def test_a_mock_does_not_read_its_own_text() -> None:
    """A terminal that is not raw echoes what is written to it, before a client has opened it."""
    port = PtyPort()
    port.write(b"hello\n")
    assert port.read(timeout_s=0.05) == b""
    port.close()


def test_read_times_out_with_nothing() -> None:
    port = PtyPort()
    assert port.read(timeout_s=0.0) == b""
    port.close()
    port.write(b"into the void")


def test_path_of_a_server_that_does_not_run_is_an_error() -> None:
    with pytest.raises(RuntimeError, match="start"):
        _ = PtyServer(lambda chunk: chunk).path


def test_ticks_while_the_client_is_silent() -> None:
    ticked = threading.Event()
    with PtyServer(lambda chunk: chunk, tick=ticked.set, tick_s=0.001):
        assert ticked.wait(timeout=10)


def test_paces_its_replies() -> None:
    """120 bytes take 125 ms at 9600 Bd, ten bits each; sleeping is never shorter than asked for."""
    with (
        PtyServer(lambda _: bytes(120), baud=9600) as server,
        serial.Serial(server.path, timeout=5) as port,
    ):
        started = time.monotonic()
        port.write(b"?")
        port.read(120)
        assert time.monotonic() - started >= 0.125
