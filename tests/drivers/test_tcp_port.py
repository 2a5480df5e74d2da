"""A TCP connection as a port: closed at once, nothing left open, and an end that is told."""

import os
import socket

import pytest

from drivers.errors import LinkLost
from drivers.mocks.modbus_dc import MockSupply
from drivers.mocks.modbus_wire import TcpServer
from drivers.modbus_link import open_link
from drivers.modbus_map import Space
from drivers.transport import ByteLink, deadline_in
from tests.drivers.fake_dc_plant import FakeDcPlant


def open_files() -> int:
    return len(os.listdir("/proc/self/fd"))


def test_bytes_go_both_ways() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        link = ByteLink.open(f"socket://127.0.0.1:{listener.getsockname()[1]}")
        peer, _ = listener.accept()
        with link, peer:
            link.write(b"?")
            assert peer.recv(1) == b"?"
            peer.sendall(b"one\ntwo")
            assert link.read_until(b"\n", deadline_in(2.0)) == b"one"
            assert link.drain() == b"two"


def test_a_connection_that_the_peer_resets_is_lost_and_leaves_no_descriptor() -> None:
    before = open_files()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        link = ByteLink.open(f"socket://127.0.0.1:{listener.getsockname()[1]}")
        peer, _ = listener.accept()
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # closing is a reset
        peer.close()
        with pytest.raises(LinkLost):
            link.read_some(deadline_in(2.0))
    assert open_files() == before


def test_an_idle_connection_that_was_closed_is_opened_anew_before_the_request() -> None:
    with TcpServer(MockSupply(FakeDcPlant(), unit=0)) as server:
        link = open_link(server.resource)
        first = link.read(0, Space.HOLDING, 0, 1)
        server.drop_clients()
        assert link.read(0, Space.HOLDING, 0, 1) == first
        assert link.health.failures == 0
        link.close()
