# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
No bytes on a Modbus line crash or hang the driver, or are taken for a reply when they are none.

FUZZ_CASES=25000 in the environment runs that many of each of the four that need no line.
"""

from math import isnan
import os

from hypothesis import given, settings
from hypothesis import strategies as st
from modbus_line import AMBIENT, driver_of, eventually
import pytest

from soft_continuum.emulators.modbus_rig import crc, ModbusEmulator
from soft_continuum.hardware import modbus_bus
from soft_continuum.hardware.modbus_bus import ModbusBus
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.serial_ports import open_serial

CASES = int(os.environ.get('FUZZ_CASES', '300'))
EXCHANGES = {
    'coils': (lambda bus: bus.read_coils(1, 0, 4), bytes([1, 1, 1, 5])),
    'many coils': (lambda bus: bus.read_coils(1, 0, 20), bytes([1, 1, 3, 5, 6, 7])),
    'registers': (lambda bus: bus.read_input_registers(2, 0, 2), bytes([2, 4, 4, 15, 160, 0, 9])),
    'write': (lambda bus: bus.write_coil(1, 3, True), bytes([1, 5, 0, 3, 0xFF, 0])),
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


class Line:
    """A serial line at the other end of which every write is met by the next bytes to come."""

    def __init__(self, answers):
        self.answers = list(answers)
        self.coming = b''

    def write(self, data):
        self.coming += self.answers.pop(0) if self.answers else b''

    @property
    def in_waiting(self):
        return len(self.coming)

    def read(self, size):
        data, self.coming = self.coming[:size], self.coming[size:]
        return data

    def close(self):
        """Nothing to close."""


@pytest.mark.parametrize('ask, reply', EXCHANGES.values(), ids=EXCHANGES)
def test_only_a_reply_is_taken_for_a_reply(monkeypatch, ask, reply):
    monkeypatch.setattr(modbus_bus, 'sleep', lambda seconds: None)

    @settings(max_examples=CASES, deadline=None, derandomize=True)
    @given(st.lists(streams(), min_size=1, max_size=3))
    def check(answers):
        line = Line(answers)
        monkeypatch.setattr(modbus_bus, 'open_serial', lambda *_, **__: line)
        bus = ModbusBus('line', 115200, 1e-9)
        bus.open()
        for answer in answers:
            try:
                ask(bus)
            except HardwareError:
                continue
            taken = answer[:len(reply) + 2]
            assert crc(taken[:-2]) == taken[-2:] and len(taken) == len(reply) + 2
            assert taken[:3] == reply[:3] and (taken[1] != 5 or taken[:-2] == reply)

    check()


def test_a_right_reply_is_taken(monkeypatch):
    for ask, reply in EXCHANGES.values():
        line = Line([sealed(reply)])
        monkeypatch.setattr(modbus_bus, 'open_serial', lambda *_, line=line, **__: line)
        bus = ModbusBus('line', 115200, 1.0)
        bus.open()
        ask(bus)


def test_the_driver_survives_any_bytes_on_a_real_line_and_reads_again_afterwards():
    with ModbusEmulator() as emulator:
        driver = driver_of(emulator, timeout=0.02)
        eventually(lambda: driver.open() or True)

        @settings(max_examples=min(CASES, 40), deadline=None, derandomize=True)
        @given(streams(), st.booleans())
        def check(data, unasked):
            emulator.transform = None
            eventually(driver.read)
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
        reading = eventually(driver.read)
        assert reading.pressures == (AMBIENT,) * 3 and not any(reading.evacuated)
        driver.close()


@settings(max_examples=min(CASES, 50), deadline=None, derandomize=True)
@given(st.lists(st.one_of(st.binary(max_size=40), st.binary(max_size=20).map(sealed)),
                max_size=4))
def test_the_emulated_boards_survive_any_request(emulated, requests):
    request = sealed(bytes([1, 1, 0, 0, 0, 4]))
    with open_serial(emulated.port, 115200, timeout=0.05) as line:
        for data in requests:
            line.write(data)

        def answer():
            line.reset_input_buffer()
            line.write(request)
            return line.read(6)

        reply = eventually(answer, lambda reply: reply[:3] == b'\1\1\1')
    assert reply == sealed(reply[:-2])


@pytest.fixture(scope='module')
def emulated():
    with ModbusEmulator() as emulator:
        yield emulator
