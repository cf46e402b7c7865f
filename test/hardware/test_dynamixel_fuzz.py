# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
No bytes on the line of Dynamixel servos crash or hang the driver, or are taken for a reply.

``./run soak --only fuzz`` sends it 100,000 packets.
"""

import os

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from soft_continuum.emulators.dynamixel_packets import (
    BROADCAST,
    crc,
    fast_blocks,
    HEADER,
    MARK,
    PacketReader,
    status,
    STUFFED,
)
from soft_continuum.hardware.clock import Clock
from soft_continuum.hardware.dynamixel import bus as dynamixel_bus
from soft_continuum.hardware.dynamixel.bus import DynamixelBus
from soft_continuum.hardware.dynamixel.registers import TORQUE_ENABLE
from soft_continuum.hardware.protocols import HardwareError

CASES = int(os.environ.get('FUZZ_CASES', '100'))
DATA = b'\x0a\xff\xff\xfd\x00\x01'  # with what looks like a header
SIZE = len(DATA)
FAST = b''.join(fast_blocks([(1, 0, DATA), (2, 0, DATA)], 1 + 2 * (4 + SIZE)))


def _fast(bus):
    bus.fast = True
    return bus.sync_read([1, 2], 128, 128 + SIZE)


EXCHANGES = {
    'ping': (lambda bus: bus.ping(1), [status(1, 0, b'\xfc\x03\x30')]),
    'read': (lambda bus: bus.read_bytes(1, 128, SIZE), [status(1, 0, DATA)]),
    'write': (lambda bus: bus.write(1, TORQUE_ENABLE, 1), [status(1, 0)]),
    'sync read': (lambda bus: bus.sync_read([1, 2], 128, 128 + SIZE),
                  [status(1, 0, DATA), status(2, 0x80, DATA)]),
    'fast sync read': (_fast, [FAST]),
}


@st.composite
def streams(draw, replies):
    """Bytes that may come after a request: nonsense, and replies with something wrong."""
    if draw(st.integers(0, 3)) == 0:
        return draw(st.binary(max_size=60)) + draw(st.sampled_from([b'', HEADER, replies[0][:9]]))
    parts = [bytearray(reply) for reply in replies]
    for _ in range(draw(st.integers(1, 3))):
        part = parts[draw(st.integers(0, len(parts) - 1))]
        at = draw(st.integers(0, len(part)))
        kind = draw(st.integers(0, 3))
        if kind == 0:
            part[at:at + 1] = bytes([draw(st.integers(0, 255))])
        elif kind == 1:
            del part[at:at + draw(st.integers(1, 5))]
        elif kind == 2:
            part[at:at] = draw(st.binary(min_size=1, max_size=5))
        elif len(part) > 9:  # another ID, instruction or length, with a right checksum
            part[draw(st.sampled_from([4, 5, 7, 8]))] = draw(st.integers(0, 255))
            part[-2:] = crc(bytes(part[:-2])).to_bytes(2, 'little')
    return b''.join(draw(st.permutations([bytes(part) for part in parts])))


class Line(Clock):
    """A serial port that answers each request with the next bytes, and its time."""

    port, baudrate, timeout = 'line', 1000000, 0

    def __init__(self, answers):
        self.answers, self.received, self.now = list(answers), b'', 0.0

    def __call__(self):
        self.now += 0.002
        return self.now

    def wait(self, files, timeout):
        self.now += max(0.0, min(timeout, 0.005))
        return []

    def fileno(self):
        return 0

    def reset_input_buffer(self):
        self.received = b''

    def write(self, data):
        self.received += self.answers.pop(0) if self.answers else b''
        return len(data)

    def read(self, length):
        data, self.received = self.received[:length], self.received[length:]
        return data


def well_formed(data, device, size):
    """The data of every whole status packet of a device in a stream, by this reading of it."""
    found = []
    for begin in range(len(data)):
        part = data[begin:]
        length = int.from_bytes(part[5:7], 'little')
        whole = part[:7 + length]
        if (part[:5] == HEADER + bytes([device]) and part[7:8] == b'\x55' and length >= 4
                and len(whole) == 7 + length
                and crc(whole[:-2]).to_bytes(2, 'little') == whole[-2:]):
            body = whole[9:-2] if device == BROADCAST else whole[8:-2].replace(STUFFED, MARK)[1:]
            if device == BROADCAST or len(body) == size:
                found.append(body)
    return found


def bus_on(line, monkeypatch):
    monkeypatch.setattr(dynamixel_bus, 'open_serial', lambda *_: line)
    return DynamixelBus('line', 1000000, line)


def check(monkeypatch, name, data):
    """Send bytes after a request; what is taken must stand in them."""
    ask, replies = EXCHANGES[name]
    bus = bus_on(Line([data]), monkeypatch)
    try:
        taken = ask(bus)
    except HardwareError:
        return
    if name == 'fast sync read':
        assert well_formed(data, BROADCAST, 0)
    elif name == 'ping':
        assert taken in [int.from_bytes(body[:2], 'little') for body in well_formed(data, 1, 3)]
    elif name == 'write':
        assert well_formed(data, 1, 0)
    else:
        for device, reply in enumerate(taken if name == 'sync read' else [taken], 1):
            assert reply.data in well_formed(data, device, SIZE)


@pytest.mark.parametrize('name', EXCHANGES)
def test_only_a_reply_is_taken_for_a_reply(monkeypatch, name):
    @settings(max_examples=CASES, deadline=None, derandomize=True)
    @given(streams(EXCHANGES[name][1]))
    def fuzz(data):
        check(monkeypatch, name, data)

    fuzz()


@pytest.mark.parametrize('name', EXCHANGES)
def test_a_right_reply_is_taken(monkeypatch, name):
    ask, replies = EXCHANGES[name]
    taken = ask(bus_on(Line([b''.join(replies)]), monkeypatch))
    if 'read' in name:
        assert {reply.data for reply in (taken if 'sync' in name else [taken])} == {DATA}


@settings(max_examples=CASES, deadline=None, derandomize=True)
@given(st.lists(st.binary(max_size=40), max_size=5))
def test_the_emulated_bus_survives_any_bytes(chunks):
    reader = PacketReader()
    for chunk in chunks:
        list(reader.feed(chunk))
    reader.clear()
    assert [p.id for p in reader.feed(status(3, 0)) if p.intact] == [3]
