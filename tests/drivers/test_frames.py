"""Frames: what was encoded comes back, and nothing else is taken for a frame."""

import contextlib

import pytest
from cobs import cobs
from hypothesis import assume, given
from hypothesis import strategies as st

from drivers.errors import ReplyError
from drivers.frames import LONGEST_PAYLOAD, Frame, crc16, decode, encode

FRAMES = st.builds(Frame, st.integers(0, 0xFFFF), st.integers(0, 0xFF), st.binary(max_size=LONGEST_PAYLOAD))


@given(frame=FRAMES)
def test_a_frame_survives_the_wire(frame: Frame) -> None:
    wire = encode(frame)
    assert wire[0] == wire[-1] == 0
    assert 0 not in wire[1:-1]
    assert decode(wire[1:-1]) == frame


@given(coded=st.binary(max_size=100))
def test_any_bytes_are_a_frame_or_a_typed_error(coded: bytes) -> None:
    try:
        frame = decode(coded)
    except ReplyError:
        return
    assert encode(frame)[1:-1] == coded


@given(frame=FRAMES, data=st.data())
def test_one_wrong_bit_is_noticed(frame: Frame, data: st.DataObject) -> None:
    """A 16-bit CRC finds every single-bit error within the body; COBS codes are part of what it guards."""
    wire = bytearray(encode(frame)[1:-1])
    bit = data.draw(st.integers(0, 8 * len(wire) - 1))
    wire[bit // 8] ^= 1 << bit % 8
    assume(0 not in wire)
    with contextlib.suppress(ReplyError):
        assert decode(bytes(wire)) != frame


def test_a_body_with_a_wrong_crc_version_or_length_is_refused() -> None:
    good = b"\x01\x05\x00\x06"
    for body, reason in (
        (good + (crc16(good) ^ 1).to_bytes(2, "little"), "CRC"),
        (b"\x02" + good[1:] + crc16(b"\x02" + good[1:]).to_bytes(2, "little"), "version 2"),
        (good[:2] + crc16(good[:2]).to_bytes(2, "little"), "too short"),
    ):
        with pytest.raises(ReplyError, match=reason):
            decode(cobs.encode(body))


def test_a_payload_that_does_not_fit_is_an_error() -> None:
    with pytest.raises(ValueError, match="1000"):
        encode(Frame(1, 1, bytes(LONGEST_PAYLOAD + 1)))
