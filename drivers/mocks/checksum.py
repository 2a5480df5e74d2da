"""The checksum of Modbus RTU."""

import struct


def crc16(data: bytes) -> bytes:
    """The checksum that ends an RTU frame, low byte first.

    >>> crc16(bytes.fromhex("01 03 00 00 00 01")).hex(" ")
    '84 0a'
    """
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return struct.pack("<H", crc)
