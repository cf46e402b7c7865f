# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
No bytes on a Modbus line crash or hang the driver, or are taken for a reply when they are none.

FUZZ_CASES=25000 in the environment runs that many of each of the four that need no line.
"""

from contextlib import suppress
from math import isnan
import os
import select
import socket

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from soft_continuum.emulators.modbus_rig import crc
from soft_continuum.hardware.clock import Clock
from soft_continuum.hardware.modbus import bus as modbus_bus
from soft_continuum.hardware.modbus.bus import ModbusBus
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.serial_ports import open_serial
from support.modbus_line import AMBIENT, connected, emulated, eventually, receive

CASES = int(os.environ.get('FUZZ_CASES', '300'))
EXCHANGES = {
    'coils': (lambda bus: bus.read_coils(1, 0, 4), bytes([1, 1, 1, 5])),
    'many coils': (lambda bus: bus.read_coils(1, 0, 20), bytes([1, 1, 3, 5, 6, 7])),
    'registers': (lambda bus: bus.read_input_registers(2, 0, 2), bytes([2, 4, 4, 15, 160, 0, 9])),
    'write': (lambda bus: bus.set_in_step() or bus.write_coil(1, 3, True),
              bytes([1, 5, 0, 3, 0xFF, 0])),
}


def sealed(data):
    return data + crc(data)


@st.composite
def streams(draw):
    """Bytes that may come after a request: nonsense, and replies with something wrong."""
    if draw(st.booleans()):
        return draw(st.binary(max_size=300))
    data = draw(st.sampled_from([reply for _, reply in EXCHANGES.values()] + [
        bytes([1, 0x81, 2]), bytes([1, 0x85, 4]), bytes([2, 0x84, 6])]))
    data = bytearray(data)
    for _ in range(draw(st.integers(0, 3))):
        data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    data = bytearray(sealed(bytes(data)) if draw(st.booleans()) else data)
    for _ in range(draw(st.integers(0, 2))):
        at = draw(st.integers(0, len(data)))
        if draw(st.booleans()):
            data[at:at] = draw(st.binary(max_size=5))
        else:
            del data[at:at + draw(st.integers(1, 5))]
    return bytes(data)


class Line(Clock):
    """A serial line on which every request is met by the next bytes to come, and its time."""

    def __init__(self, answers):
        self.answers = list(answers)
        self.near, self.far = socket.socketpair()
        self.far.setblocking(False)
        self.fileno = self.near.fileno
        self.now = 0.0

    def __call__(self):
        self.now += 1.0
        return self.now

    def wait(self, files, timeout):
        with suppress(BlockingIOError):
            if self.far.recv(4096) and self.answers:
                self.far.send(self.answers.pop(0))
        return select.select(files, [], [], 0.0)[0]

    def close(self):
        self.near.close()
        self.far.close()


def bus_on(line, monkeypatch):
    monkeypatch.setattr(modbus_bus, 'open_serial', lambda *_: line)
    bus = ModbusBus('line', 115200, 1e-9, line)
    bus.open()
    return bus


@pytest.mark.parametrize('ask, reply', EXCHANGES.values(), ids=EXCHANGES)
def test_only_a_reply_is_taken_for_a_reply(monkeypatch, ask, reply):
    @settings(max_examples=CASES, deadline=None, derandomize=True)
    @given(st.lists(streams(), min_size=1, max_size=3))
    def check(answers):
        bus = bus_on(Line(answers), monkeypatch)
        for answer in answers:
            try:
                ask(bus)
            except HardwareError:
                continue
            taken = answer.lstrip(b'\0')[:len(reply) + 2]
            assert crc(taken[:-2]) == taken[-2:] and len(taken) == len(reply) + 2
            assert taken[:3] == reply[:3] and (taken[1] != 5 or taken[:-2] == reply)
        bus.close()

    check()


def test_a_right_reply_is_taken(monkeypatch):
    for ask, reply in EXCHANGES.values():
        bus = bus_on(Line([sealed(reply)]), monkeypatch)
        ask(bus)
        bus.close()


def test_the_driver_survives_any_bytes_on_a_real_line_and_reads_again_afterwards():
    with emulated() as emulator, connected(emulator, timeout=0.02) as driver:

        @settings(max_examples=min(CASES, 40), deadline=None, derandomize=True)
        @given(streams(), st.booleans())
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


@settings(max_examples=min(CASES, 50), deadline=None, derandomize=True)
@given(st.lists(st.one_of(st.binary(max_size=40), st.binary(max_size=20).map(sealed)),
                max_size=4))
def test_the_emulated_boards_survive_any_request(boards, requests):
    request = sealed(bytes([1, 1, 0, 0, 0, 4]))
    with open_serial(boards.port, 115200) as line:
        for data in requests:
            line.write(data)

        def answer():
            line.reset_input_buffer()
            line.write(request)
            return receive(boards, line, 6, 0.05)

        reply = eventually(boards, answer, lambda reply: reply[:3] == b'\1\1\1')
    assert reply == sealed(reply[:-2])


@pytest.fixture(scope='module')
def boards():
    with emulated() as emulator:
        yield emulator
