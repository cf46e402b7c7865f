# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A driver on servos of a pseudo-terminal, and what tests ask of both."""

from contextlib import contextmanager
from math import pi

import pytest

from soft_continuum.hardware.dynamixel.setup import Spools
from soft_continuum.hardware.dynamixel.tendons import DynamixelTendons
from soft_continuum.hardware.protocols import HardwareError
from support.driver_waits import until
from support.dynamixel_slave import Bus, Slave
from support.virtual_clock import VirtualClock

TENDONS = ('right_tendon', 'left_tendon')
RADIUS = 0.01
PULSE = 2 * pi * RADIUS / 4096  # m
KEPT = 'zeros.json'


def spools(**changes):
    """Parameters of the driver."""
    return Spools(**{
        'tendons': TENDONS, 'ids': (1, 2), 'radii': (RADIUS,) * 2, 'signs': (1.0, 1.0),
        'tension_limits': (20.0, 20.0), 'torque_constants': (0.0, 0.0), 'speed_limit': 0.03,
        'acceleration_limit': 0.3, 'pull_limits': (-0.06, 0.06), **changes})


def driver(bus, folder, **changes):
    """A driver, not opened, of servos behind a port."""
    return DynamixelTendons(bus.port, 1000000, spools(**changes), folder / KEPT, bus.clock)


def servos(*slaves, **options):
    """Servos without a driver, on a clock of their own."""
    return Bus(slaves or (Slave(1), Slave(2)), VirtualClock(), **options)


@contextmanager
def rig(folder, *slaves, referenced=True, **changes):
    """Servos and an open driver at zero pull."""
    with servos(*slaves) as bus:
        tendons = driver(bus, folder, **changes)
        tendons.open()
        try:
            if referenced:
                tendons.reference()
                bus.clock.sleep(0.2)
            yield bus, tendons
        finally:
            tendons.close()


def refusal(tendons):
    """Return why a driver does not open."""
    with pytest.raises(HardwareError) as error:
        tendons.open()
    return str(error.value)


def in_motion(bus, tendons, pull=0.04):
    """Start a long motion and wait until it is well under way."""
    start = bus.slaves[0].turned
    tendons.move((pull, -pull), 2.0)
    until(bus, lambda: abs(bus.slaves[0].turned - start) > 300, 'in motion')


def standing(bus):
    """Whether no tendon moves by more than 0.5 mm/s."""
    return bus.now(lambda: all(abs(slave.speed) * PULSE < 5e-4 for slave in bus.slaves))
