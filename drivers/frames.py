"""Frames of the controller link: COBS, with version, sequence number, type and CRC.

A frame is ``00 <COBS of body> 00``; the leading zero ends whatever noise came before. The body is, little
endian::

    version  uint8     1
    sequence uint16    a reply repeats its request's
    type     uint8     a reply's is its request's with bit 7 set
    payload  0 to 1000 bytes
    crc      uint16    CRC-16/CCITT-FALSE of all the body before it (0x29B1 for "123456789")
"""

import binascii
import struct
from dataclasses import dataclass

from cobs import cobs

from drivers.errors import ReplyError

VERSION = 1
DELIMITER = b"\x00"
LONGEST_PAYLOAD = 1000
_HEAD = struct.Struct("<BHB")
_CRC = struct.Struct("<H")


@dataclass(frozen=True, slots=True)
class Frame:
    """One message; ``payload`` is what its type says it is."""

    sequence: int
    type: int
    payload: bytes = b""


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected.

    >>> hex(crc16(b"123456789"))
    '0x29b1'
    """
    return binascii.crc_hqx(data, 0xFFFF)


def encode(frame: Frame) -> bytes:
    """The frame's bytes on the wire, delimiters included.

    >>> encode(Frame(1, 0x06)).hex(" ")
    '00 03 01 01 04 06 82 a5 00'
    """
    if len(frame.payload) > LONGEST_PAYLOAD:
        raise ValueError(f"a payload of {len(frame.payload)} bytes: {LONGEST_PAYLOAD} fit into a frame")
    body = _HEAD.pack(VERSION, frame.sequence, frame.type) + frame.payload
    coded: bytes = cobs.encode(body + _CRC.pack(crc16(body)))
    return DELIMITER + coded + DELIMITER


def decode(coded: bytes) -> Frame:
    """The frame between two delimiters; ``ReplyError`` when it is not a whole one of this version."""
    try:
        body = bytes(cobs.decode(coded))
    except cobs.DecodeError as error:
        raise ReplyError(f"not a frame: {error}", reply=coded.hex(" ")) from error
    if len(body) < _HEAD.size + _CRC.size:
        raise ReplyError(f"a frame of {len(body)} bytes is too short to be one", reply=coded.hex(" "))
    content, (crc,) = body[: -_CRC.size], _CRC.unpack(body[-_CRC.size :])
    if crc16(content) != crc:
        raise ReplyError(f"wrong CRC: {crc:#06x}, {crc16(content):#06x} expected", reply=coded.hex(" "))
    version, sequence, type_ = _HEAD.unpack_from(content)
    if version != VERSION:
        raise ReplyError(f"protocol version {version}; this is version {VERSION}", reply=coded.hex(" "))
    return Frame(sequence, type_, content[_HEAD.size :])
