# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the tests of the Modbus driver share: drivers of an emulated rig, and patience."""

from time import monotonic, sleep

from soft_continuum.hardware.modbus_jamming import ModbusJamming
from soft_continuum.hardware.protocols import HardwareError

AMBIENT = 101325.0
TIMEOUT = 0.2  # s; a busy computer may need some of it


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


def driver_of(emulator, **changes):
    """Return a driver, not opened, of an emulated rig."""
    values = parameters(emulator.link or emulator.port, len(emulator.segments), **changes)
    return ModbusJamming.from_parameters(values, monotonic)


def eventually(action, accept=lambda result: True, seconds=30.0):
    """Return what ``action`` returns once it fails no longer and is accepted."""
    deadline = monotonic() + seconds
    while True:
        try:
            result = action()
            if accept(result):
                return result
            problem = AssertionError(f'still {result}')
        except HardwareError as error:
            problem = error
        if monotonic() > deadline:
            raise problem
        sleep(0.01)
