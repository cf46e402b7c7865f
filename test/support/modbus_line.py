# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the tests of the Modbus driver share: emulated rigs and their drivers."""

from contextlib import contextmanager

from soft_continuum.hardware.modbus.bus import ModbusBus
from soft_continuum.hardware.modbus.jamming import (
    ModbusJamming,
    ModbusRegulators,
    Outputs,
    Relays,
    Transmitters,
)
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.sim.emulators.modbus import ModbusEmulator
from support.virtual_clock import VirtualClock

AMBIENT = 101325.0
TIMEOUT = 0.1  # s


def parameters(port, segments=3, **changes):
    """Return the parameters of a driver of an emulated rig; changes without their prefix."""
    return {p.name: p.default for p in ModbusJamming.PARAMETERS} | {
        'arm.segment_lengths': (0.07,) * segments,
        'ambient_pressure': AMBIENT,
        'modbus.port': str(port),
        'modbus.baud_rate': 115200,
        'modbus.timeout': TIMEOUT,
        'modbus.valve_coils': tuple(float(i + 1) for i in range(segments)),
        'modbus.pressure_registers': tuple(float(i) for i in range(segments)),
    } | {f'modbus.{name}': value for name, value in changes.items()}


def emulated(segments=3, **options):
    """An emulated rig on a clock of its own."""
    return ModbusEmulator(segments, clock=VirtualClock(), **options)


def driver_of(emulator, **changes):
    """A driver, not opened, of an emulated rig, in its time."""
    values = parameters(emulator.link or emulator.port, len(emulator.segments), **changes)
    bus = ModbusBus(values['modbus.port'], values['modbus.baud_rate'], values['modbus.timeout'],
                    emulator.clock)
    driver, board = ((ModbusRegulators, Outputs) if values['modbus.regulators'] else
                     (ModbusJamming, Relays))
    return driver(bus, board.from_parameters(values), Transmitters.from_parameters(values))


@contextmanager
def connected(emulator, **changes):
    """An open driver of an emulated rig."""
    driver = driver_of(emulator, **changes)
    eventually(emulator, lambda: driver.open() or True)
    try:
        yield driver
    finally:
        driver.close()


def receive(emulator, line, size, timeout=20.0):
    """Return ``size`` bytes from an open port, or what came within a time (s)."""
    data, deadline = b'', emulator.clock() + timeout
    while len(data) < size and emulator.clock.wait(
            [line.fileno()], deadline - emulator.clock()):
        data += line.read(min(size - len(data), line.in_waiting))
    return data


def eventually(emulator, action, accept=lambda result: True):
    """Return what ``action`` returns once it succeeds and is accepted."""
    clock = emulator.clock
    deadline = clock() + 30.0
    while True:
        try:
            result = action()
            if accept(result):
                return result
            problem = AssertionError(f'still {result}')
        except HardwareError as error:
            problem = error
        if clock() > deadline:
            raise problem
        clock.sleep(0.01)
