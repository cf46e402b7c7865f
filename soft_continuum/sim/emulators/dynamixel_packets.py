# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Packets of the Dynamixel protocols, as a servo reads and writes them.

Protocol 2.0: https://emanual.robotis.com/docs/en/dxl/protocol2/ (CRC: .../dxl/crc/), and of 1.0
what a servo that is set to it needs to answer: https://emanual.robotis.com/docs/en/dxl/protocol1/.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum

HEADER = b'\xff\xff\xfd\x00'
MARK, STUFFED = b'\xff\xff\xfd', b'\xff\xff\xfd\xfd'
BROADCAST = 0xFE
MAX_ID = 252
MAX_LENGTH = 1024
"""Largest value of the length field.  The buffers of the maker's SDK."""
STATUS = 0x55
ALERT = 0x80
"""Bit in the error of a status packet: the Hardware Error Status is not 0."""


class Instruction(IntEnum):
    """Instructions of packets."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class Error(IntEnum):
    """Why an instruction was not carried out."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


@dataclass(frozen=True)
class Packet:
    """An instruction packet; size: bytes on the wire.  intact: whether its checksum is right."""

    id: int
    instruction: int
    parameters: bytes
    size: int
    intact: bool = True


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        remainder = byte << 8
        for _ in range(8):
            remainder = (remainder << 1 ^ (0x8005 if remainder & 0x8000 else 0)) & 0xFFFF
        table.append(remainder)
    return tuple(table)


_TABLE = _crc_table()


def crc(data: bytes) -> int:
    """Return the CRC-16 of data (polynomial 0x8005, no reflection)."""
    remainder = 0
    for byte in data:
        remainder = (remainder << 8 & 0xFFFF) ^ _TABLE[remainder >> 8 ^ byte]
    return remainder


def _with_crc(data: bytes) -> bytes:
    return data + crc(data).to_bytes(2, 'little')


def packet(device: int, instruction: int, parameters: bytes = b'') -> bytes:
    """Return a packet as it is sent, with stuffing and CRC."""
    body = (bytes([instruction]) + parameters).replace(MARK, STUFFED)
    return _with_crc(HEADER + bytes([device]) + (len(body) + 2).to_bytes(2, 'little') + body)


def status(device: int, error: int, data: bytes = b'') -> bytes:
    """Return a status packet; error: an Error, with ALERT."""
    return packet(device, STATUS, bytes([error]) + data)


def fast_blocks(answers: Iterable[tuple[int, int, bytes]], length: int) -> list[bytes]:
    """
    Return what each servo sends in answer to a Fast Sync Read or Fast Bulk Read.

    answers: ID, error and data of each, in the order of the request.  length: how many bytes the
    packet would have from its instruction to its end if every servo of the request answered.  All
    of it is one packet from the broadcast ID; after the data of each servo comes the CRC of all
    bytes so far.  Nothing is stuffed.
    """
    blocks, so_far = [], HEADER + bytes([BROADCAST]) + length.to_bytes(2, 'little')
    so_far += bytes([STATUS])
    begin = 0
    for device, error, data in answers:
        so_far = _with_crc(so_far + bytes([error, device]) + data)
        blocks.append(so_far[begin:])
        begin = len(so_far)
    return blocks


class PacketReader:
    """Extracts packets of Protocol 2.0 from a stream of bytes."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._buffer = bytearray()

    def clear(self) -> None:
        """Drop an incomplete packet whose rest was not received in time."""
        self._buffer.clear()

    def feed(self, data: bytes) -> Iterator[Packet]:
        """Return the packets that end in these bytes; damaged ones as far as parsed."""
        buffer = self._buffer
        buffer += data
        while True:
            begin = buffer.find(MARK)
            if begin < 0:
                del buffer[:max(0, len(buffer) - 2)]  # a header may have begun
                return
            del buffer[:begin]
            if len(buffer) < 7:
                return
            length = int.from_bytes(buffer[5:7], 'little')
            if buffer[3] != 0 or buffer[4] > BROADCAST or not 3 <= length <= MAX_LENGTH:
                del buffer[:1]
                continue
            size = 7 + length
            if len(buffer) < size:
                return
            whole = bytes(buffer[:size])
            intact = crc(whole[:-2]).to_bytes(2, 'little') == whole[-2:]
            # Of a damaged packet the length may be wrong, and the next one inside it.
            del buffer[:size if intact else 1]
            body = whole[7:-2].replace(STUFFED, MARK)
            yield Packet(whole[4], body[0], body[1:], size, intact)


class OldPacketReader(PacketReader):
    """The same for packets of Protocol 1.0; those that are damaged are left out."""

    def feed(self, data: bytes) -> Iterator[Packet]:
        """Return the packets that end in these bytes."""
        buffer = self._buffer
        buffer += data
        while len(buffer) >= 4:
            length = buffer[3]
            if buffer[:2] != b'\xff\xff' or buffer[2] > BROADCAST or length < 2:
                del buffer[:1]
                continue
            size = 4 + length
            if len(buffer) < size:
                return
            whole = bytes(buffer[:size])
            intact = sum(whole[2:]) & 0xFF == 0xFF
            del buffer[:size if intact else 1]
            if intact:
                yield Packet(whole[2], whole[4], whole[5:-1], size)


def old_status(device: int, error: int, data: bytes = b'') -> bytes:
    """Return a status packet of Protocol 1.0; error: its own bits."""
    body = bytes([device, len(data) + 2, error]) + data
    return b'\xff\xff' + body + bytes([~sum(body) & 0xFF])
