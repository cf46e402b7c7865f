# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A driver on an emulated GRBL board, and what tests ask of both."""

from contextlib import contextmanager

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.grbl.motion import Motors
from soft_continuum.hardware.grbl.tendons import GrblTendons
from soft_continuum.sim.emulators.grbl import GrblEmulator
from support.driver_waits import until
from support.virtual_clock import VirtualClock

TENDONS = ('right_tendon', 'left_tendon')
STEPS_PER_MM = 200.0
STEP = 1e-3 / STEPS_PER_MM  # m
SPEED, ACCELERATION = 0.03, 0.3


def driver(device, tendons=TENDONS, signs=None, **changes):
    """A driver, not opened, of an emulated board, in its time, or of a port."""
    emulated = isinstance(device, GrblEmulator)
    motors = Motors(**{
        'tendons': tendons, 'steps_per_mm': (STEPS_PER_MM,) * len(tendons),
        'signs': signs or (1.0,) * len(tendons), 'speed_limit': SPEED,
        'acceleration_limit': ACCELERATION, 'pull_limits': (-0.06, 0.06), **changes})
    return GrblTendons(device.port if emulated else str(device), 115200, motors,
                       device.clock if emulated else STEADY)


def board(**options):
    """An emulated board without a driver, on a clock of its own."""
    return GrblEmulator(clock=VirtualClock(), **options)


@contextmanager
def rig(referenced=True, settings=None, link='', switches=(), **changes):
    """An emulated board and an open driver at zero pull."""
    with board(settings=settings, link=link, switches=switches) as emulator:
        tendons = driver(emulator, **changes)
        tendons.open()
        if referenced:
            tendons.reference()
        try:
            yield emulator, tendons
        finally:
            tendons.close()


def in_motion(emulator, tendons, pull=0.04):
    """Start a long motion and wait until it is well under way."""
    start = emulator.motors[0]
    tendons.move((pull, -pull), 2.0)
    until(emulator, lambda: abs(emulator.motors[0] - start) > 300, 'in motion')


def standing(emulator):
    """Wait until the motors stand; return where."""
    until(emulator, lambda: not emulator.moving, 'motors stand')
    return emulator.motors


def steps(pulls):
    """Motor steps of pulls (m)."""
    return tuple(round(p / STEP) for p in pulls)


def settled(tendons):
    """Wait until no line to the controller is under way."""
    session = tendons._session
    until(tendons, lambda: not session._setup_lines and not session.link.unanswered, 'settled')
