# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
No bytes on a line crash or hang a driver, or are taken for a reply when they are none.

FUZZ_CASES=25000 in the environment runs that many of each exchange.  ``./run soak --only fuzz``
sends 100,000 inputs to each driver.
"""

from contextlib import suppress
from math import isnan
import os
import select
import socket

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from soft_continuum.hardware import serial_tendons
from soft_continuum.hardware.clock import Clock
from soft_continuum.hardware.dynamixel import bus as dynamixel_bus
from soft_continuum.hardware.dynamixel.registers import TORQUE_ENABLE
from soft_continuum.hardware.modbus import bus as modbus_bus
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.sim.emulators import dynamixel_packets, modbus
from soft_continuum.sim.emulators.dynamixel_packets import (
    BROADCAST,
    fast_blocks,
    HEADER,
    MARK,
    PacketReader,
    status,
    STUFFED,
)
from support.modbus_line import AMBIENT, connected, emulated, eventually, receive

CASES = int(os.environ.get('FUZZ_CASES', '60'))


class Line(Clock):
    """A serial port on which every request is met by the next bytes to come, and its time."""

    port, baudrate, timeout = 'line', 1000000, 0

    def __init__(self, answers, tick):
        self.answers, self.tick, self.now = list(answers), tick, 0.0
        self.near, self.far = socket.socketpair()
        self.near.setblocking(False)
        self.far.setblocking(False)
        self.fileno = self.near.fileno

    def __call__(self):
        self.now += self.tick
        return self.now

    def wait(self, files, timeout):
        self.now += max(0.0, min(timeout, 0.005))
        with suppress(BlockingIOError):
            if self.far.recv(4096) and self.answers:
                self.far.send(self.answers.pop(0))
        return select.select(files, [], [], 0.0)[0]

    def reset_input_buffer(self):
        self.read(4096)

    def write(self, data):
        return self.near.send(bytes(data))

    def read(self, length):
        self.wait([], 0.0)
        try:
            return self.near.recv(length)
        except BlockingIOError:
            return b''

    def close(self):
        self.near.close()
        self.far.close()


@st.composite
def streams(draw, replies, seal, places):
    """
    Bytes that may come after a request: nonsense, and replies with something wrong.

    seal: adds the checksum.  places: of bytes that say whose reply it is, and how long.
    """
    if draw(st.integers(0, 3)) == 0:
        return draw(st.binary(max_size=300)) + draw(st.sampled_from([b'', replies[0][:9]]))
    parts = [bytearray(reply) for reply in replies]
    for _ in range(draw(st.integers(0, 3))):
        part = parts[draw(st.integers(0, len(parts) - 1))]
        at = draw(st.integers(0, len(part)))
        kind = draw(st.sampled_from([0, 1, 2, 3, 3, 3]))
        if kind == 0:
            part[at:at + 1] = bytes([draw(st.integers(0, 255))])
        elif kind == 1:
            del part[at:at + draw(st.integers(1, 5))]
        elif kind == 2:
            part[at:at] = draw(st.binary(min_size=1, max_size=5))
        elif len(part) > max(places) + 2:  # something else, with a right checksum
            part[draw(st.sampled_from(places))] = draw(st.integers(0, 255))
            part[-2:] = seal(bytes(part[:-2]))[-2:]
    return b''.join(draw(st.permutations([bytes(part) for part in parts])))


# Modbus


def sealed(data):
    return data + modbus.crc(data)


MODBUS = {
    'coils': (lambda bus: bus.read_coils(1, 0, 4), bytes([1, 1, 1, 5])),
    'many coils': (lambda bus: bus.read_coils(1, 0, 20), bytes([1, 1, 3, 5, 6, 7])),
    'registers': (lambda bus: bus.read_input_registers(2, 0, 2), bytes([2, 4, 4, 15, 160, 0, 9])),
    'write': (lambda bus: bus.set_in_step() or bus.write_coil(1, 3, True),
              bytes([1, 5, 0, 3, 0xFF, 0])),
}
ANSWERS = [*(reply for _, reply in MODBUS.values()), bytes([1, 0x81, 2]), bytes([1, 0x85, 4]),
           bytes([2, 0x84, 6])]


def modbus_streams(*replies):
    """Bytes that begin as replies, or as the answer to any request."""
    return st.sampled_from([*replies * len(ANSWERS), *ANSWERS]).flatmap(
        lambda data: streams([sealed(data)], sealed, range(min(len(data), 6))))


def modbus_on(line, monkeypatch):
    monkeypatch.setattr(modbus_bus, 'open_serial', lambda *_: line)
    bus = modbus_bus.ModbusBus('line', 115200, 1e-9, line)
    bus.open()
    return bus


def check_modbus(monkeypatch, name, answers):
    """Send bytes after each request; what is taken must be a reply to it."""
    ask, reply = MODBUS[name]
    bus = modbus_on(Line(answers, 1.0), monkeypatch)
    for answer in answers:
        try:
            ask(bus)
        except HardwareError:
            continue
        taken = answer.lstrip(b'\0')[:len(reply) + 2]
        assert sealed(taken[:-2]) == taken and len(taken) == len(reply) + 2
        assert taken[:3] == reply[:3] and (taken[1] != 5 or taken[:-2] == reply)
    bus.close()


# Dynamixel


def with_crc(data):
    return data + dynamixel_packets.crc(data).to_bytes(2, 'little')


DATA = b'\x0a\xff\xff\xfd\x00\x01'  # with what looks like a header
SIZE = len(DATA)
FAST = b''.join(fast_blocks([(1, 0, DATA), (2, 0, DATA)], 1 + 2 * (4 + SIZE)))


def _fast(bus):
    bus.fast = True
    return bus.sync_read([1, 2], 128, 128 + SIZE)


DYNAMIXEL = {
    'ping': (lambda bus: bus.ping(1), [status(1, 0, b'\xfc\x03\x30')]),
    'read': (lambda bus: bus.read_bytes(1, 128, SIZE), [status(1, 0, DATA)]),
    'write': (lambda bus: bus.write(1, TORQUE_ENABLE, 1), [status(1, 0)]),
    'sync read': (lambda bus: bus.sync_read([1, 2], 128, 128 + SIZE),
                  [status(1, 0, DATA), status(2, 0x80, DATA)]),
    'fast sync read': (_fast, [FAST]),
}


def well_formed(data, device, size):
    """The data of every whole status packet of a device in a stream, by this reading of it."""
    found = []
    for begin in range(len(data)):
        part = data[begin:]
        length = int.from_bytes(part[5:7], 'little')
        whole = part[:7 + length]
        if (part[:5] == HEADER + bytes([device]) and part[7:8] == b'\x55' and length >= 4
                and len(whole) == 7 + length and with_crc(whole[:-2]) == whole):
            body = whole[9:-2] if device == BROADCAST else whole[8:-2].replace(STUFFED, MARK)[1:]
            if device == BROADCAST or len(body) == size:
                found.append(body)
    return found


def dynamixel_on(line, monkeypatch):
    monkeypatch.setattr(serial_tendons, 'open_serial', lambda *_: line)
    return dynamixel_bus.DynamixelBus('line', 1000000, line)


def check_dynamixel(monkeypatch, name, data):
    """Send bytes after a request; what is taken must stand in them."""
    ask, _ = DYNAMIXEL[name]
    line = Line([data], 0.002)
    try:
        taken = ask(dynamixel_on(line, monkeypatch))
    except HardwareError:
        return
    finally:
        line.close()
    if name == 'fast sync read':
        assert well_formed(data, BROADCAST, 0)
    elif name == 'ping':
        assert taken in [int.from_bytes(body[:2], 'little') for body in well_formed(data, 1, 3)]
    elif name == 'write':
        assert well_formed(data, 1, 0)
    else:
        for device, reply in enumerate(taken if name == 'sync read' else [taken], 1):
            assert reply.data in well_formed(data, device, SIZE)


EXCHANGES = {
    **{f'modbus {name}': (check_modbus, name, st.lists(
        modbus_streams(reply), min_size=1, max_size=3)) for name, (_, reply) in MODBUS.items()},
    **{f'dynamixel {name}': (check_dynamixel, name, streams(replies, with_crc, (4, 5, 7, 8)))
       for name, (_, replies) in DYNAMIXEL.items()}}
"""What checks an input, of which request, and the inputs."""


@pytest.mark.parametrize(('check', 'name', 'inputs'), EXCHANGES.values(), ids=EXCHANGES)
def test_only_a_reply_is_taken_for_a_reply(monkeypatch, check, name, inputs):
    @settings(max_examples=CASES)
    @given(inputs)
    def fuzz(data):
        check(monkeypatch, name, data)

    fuzz()


def test_a_right_reply_is_taken(monkeypatch):
    for ask, reply in MODBUS.values():
        bus = modbus_on(Line([sealed(reply)], 1.0), monkeypatch)
        ask(bus)
        bus.close()
    for name, (ask, replies) in DYNAMIXEL.items():
        taken = ask(dynamixel_on(Line([b''.join(replies)], 0.002), monkeypatch))
        if 'read' in name:
            assert {reply.data for reply in (taken if 'sync' in name else [taken])} == {DATA}


# Real lines, and the emulators


def test_the_driver_survives_any_bytes_on_a_real_line_and_reads_again_afterwards():
    with emulated() as emulator, connected(emulator, timeout=0.02) as driver:

        @settings(max_examples=min(CASES, 30))
        @given(modbus_streams(), st.booleans())
        def check(data, unasked):
            emulator.transform = None
            eventually(emulator, driver.read)
            emulator.transform = None if unasked else lambda reply: data
            if unasked:
                emulator.send(data)
            for call in (driver.read, lambda: driver.set_evacuated(0, False)):
                try:
                    reading = call()
                except HardwareError:
                    continue
                if reading is not None:
                    assert len(reading.pressures) == len(reading.evacuated) == 3
                    assert all(isnan(p) or -1e4 < p < 2e5 for p in reading.pressures)

        check()
        emulator.transform = None
        reading = eventually(emulator, driver.read)
        assert reading.pressures == (AMBIENT,) * 3 and not any(reading.evacuated)


def test_the_emulated_boards_survive_any_request():
    request = sealed(bytes([1, 1, 0, 0, 0, 4]))
    with emulated() as boards, open_serial(boards.port, 115200) as line:
        def answer():
            line.reset_input_buffer()
            line.write(request)
            return receive(boards, line, 6, 0.05)

        @settings(max_examples=min(CASES, 40))
        @given(st.lists(st.one_of(st.binary(max_size=40), st.binary(max_size=20).map(sealed)),
                        max_size=4))
        def check(requests):
            for data in requests:
                line.write(data)
            reply = eventually(boards, answer, lambda reply: reply[:3] == b'\1\1\1')
            assert reply == sealed(reply[:-2])

        check()


@settings(max_examples=CASES)
@given(st.lists(st.binary(max_size=40), max_size=5))
def test_the_emulated_bus_survives_any_bytes(chunks):
    reader = PacketReader()
    for chunk in chunks:
        list(reader.feed(chunk))
    reader.clear()
    assert [p.id for p in reader.feed(status(3, 0)) if p.intact] == [3]
