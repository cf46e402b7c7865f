# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A driver on an emulated GRBL board, and what tests ask of both."""

from contextlib import contextmanager
import time

import pytest

from soft_continuum.emulators.grbl_board import GrblEmulator
from soft_continuum.hardware.grbl_tendons import GrblTendons
from soft_continuum.hardware.protocols import HardwareError

STEPS_PER_MM = 200.0
STEP = 1e-3 / STEPS_PER_MM  # m
SPEED, ACCELERATION = 0.03, 0.3
PATIENCE = 20.0  # s until a test gives up waiting; a loaded computer is slow


def driver(port, **changes):
    values = {
        'port': str(port), 'baud_rate': 115200, 'steps_per_mm': (STEPS_PER_MM, STEPS_PER_MM),
        'signs': (1.0, 1.0), 'speed_limit': SPEED, 'acceleration_limit': ACCELERATION,
        'pull_limits': (-0.06, 0.06)}
    return GrblTendons(**{**values, **changes})


@contextmanager
def board(**options):
    """An emulated board without a driver."""
    with GrblEmulator(**options) as emulator:
        yield emulator


@contextmanager
def rig(referenced=True, settings=None, **changes):
    """An emulated board and an open driver at zero pull."""
    with GrblEmulator(settings=settings) as emulator:
        tendons = driver(emulator.port, **changes)
        tendons.open()
        if referenced:
            tendons.reference()
        try:
            yield emulator, tendons
        finally:
            tendons.close()


def until(condition, what=''):
    """Wait until something is true; fail if it never is."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, f'never: {what or condition}'
        time.sleep(0.002)


def at_rest(tendons):
    """Wait for the end of all motion; return the reading there."""
    until(lambda: not tendons.read().moving, 'at rest')
    return tendons.read()


def failed(tendons):
    """Wait for the driver to give up; return what it says."""
    def gives_up():
        try:
            tendons.read()
        except HardwareError:
            return True
        return False
    until(gives_up, 'a HardwareError')
    with pytest.raises(HardwareError) as error:
        tendons.read()
    with pytest.raises(HardwareError):
        tendons.move((0.0, 0.0), 1.0)
    return str(error.value)


def in_motion(emulator, tendons, pull=0.04):
    """Start a long motion and wait until it is well under way."""
    start = emulator.motors[0]
    tendons.move((pull, -pull), 2.0)
    until(lambda: abs(emulator.motors[0] - start) > 300, 'in motion')


def standing(emulator):
    """Wait until the motors stand; return where."""
    until(lambda: not emulator.moving, 'motors stand')
    return emulator.motors


def steps(pulls):
    """Motor steps of pulls (m)."""
    return tuple(round(p / STEP) for p in pulls)
