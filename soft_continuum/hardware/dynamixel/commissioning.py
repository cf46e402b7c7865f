# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of Dynamixel servos, and the end of a provisional zero; nothing moves."""

from collections.abc import Iterator, Mapping
from typing import Any

from soft_continuum.hardware.commissioning import Check, check_reference, Drive, FAIL, OK, WARN
from soft_continuum.hardware.dynamixel.bus import DynamixelBus, latency_timer
from soft_continuum.hardware.dynamixel.reference import clear_marks, find_zeros, ZeroFile
from soft_continuum.hardware.dynamixel.registers import (
    PRESENT_CURRENT,
    RETURN_DELAY,
    TORQUE_ENABLE,
)
from soft_continuum.hardware.dynamixel.setup import (
    find_servos,
    FoundServo,
    problems,
    read_states,
    Spools,
)
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.user_files import dynamixel_zeros

PORT = 'dynamixel.port'
DRIVE = Drive('dynamixel.signs', 'dynamixel.spool_radii', inverse=True)

MAX_LATENCY = 1  # ms that a USB adapter may keep what it receives


def checks(values: Mapping[str, Any]) -> Iterator[Check]:
    """Check Dynamixel servos; nothing is written to them."""
    port = values['dynamixel.port']
    spools = Spools.from_parameters(values)
    try:
        bus = DynamixelBus.from_parameters(values)
    except HardwareError as error:
        yield Check('tendon port', FAIL, str(error))
        return
    yield _check_latency(port)
    try:
        servos = find_servos(bus, spools)
        unfit = False
        for servo in servos:
            yield (check := _check_servo(servo, spools))
            unfit |= check.status == FAIL
        if not unfit:
            states = read_states(bus, servos)
            zeros = find_zeros(bus, servos, states, spools, ZeroFile(dynamixel_zeros(), port))
            why = '; '.join(zero.unknown for zero in zeros if zero.unknown)
            yield check_reference(not why, why)
    except HardwareError as error:
        yield Check('tendon servos', FAIL, str(error))
    finally:
        bus.close()


def _check_latency(port: str) -> Check:
    step, message = 'tendon port', f'{port} opened, no other program uses it'
    if (latency := latency_timer(port)) is not None and latency > MAX_LATENCY:
        return Check(step, WARN, f'{message}; its adapter buffers received data for {latency} ms, '
                     f'which slows every cycle: set it to {MAX_LATENCY} with a udev rule '
                     '(docs/how_to/use_dynamixel_servos.md)')
    return Check(step, OK, message)


def _check_servo(servo: FoundServo, spools: Spools) -> Check:
    if found := problems(servo, spools.speed_limit):
        return Check(str(servo), FAIL, '; '.join(
            line.removeprefix(f'{servo}: ') for line in found))
    sign = spools.signs[spools.ids.index(servo.id)]
    tension = max(0.0, sign * servo.tension(servo.get(PRESENT_CURRENT)))
    torque = 'holds' if servo.get(TORQUE_ENABLE) else 'torque off'
    message = (f'{servo.describe()}, {torque}, about {tension:.1f} N '
               f'(standard deviation {servo.stddev(tension):.1f} N)')
    if servo.get(RETURN_DELAY):
        return Check(str(servo), WARN, f'{message}; {RETURN_DELAY} is '
                     f'{servo.get(RETURN_DELAY)}, which slows every cycle: set it to 0')
    return Check(str(servo), OK, message)


def clear_zero(values: Mapping[str, Any]) -> None:
    """Clear the zeros in the servos and in their file; raises HardwareError."""
    spools, port = Spools.from_parameters(values), values['dynamixel.port']
    bus = DynamixelBus.from_parameters(values)
    try:
        clear_marks(bus, spools.ids, ZeroFile(dynamixel_zeros(), port))
    finally:
        bus.close()
