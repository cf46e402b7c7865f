# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of nodes that drive emulated boards."""

from math import ceil
from pathlib import Path

from soft_continuum.parameters.parameter import Value
from soft_continuum.planning.settings import MotionLimits
from soft_continuum.sim.emulators.dynamixel_models import MODELS

STEPS_PER_MM = 200
"""Steps per mm of the emulated motors and drums; a GRBL board itself counts steps."""
AXES = 3
"""Axes of an emulated board; boards share the tendons of larger arms evenly."""
BAUD_RATE = 1000000
SPOOL_RADIUS = 0.01
"""m, of an emulated servo."""
SERVO_MODEL = 'XM430-W350'
TENSION_LIMIT, STALL_SHARE = MotionLimits.tension_limit, 0.5
"""N, limited to this share of the stall tension of the servo."""
MODBUS_TIMEOUT = 0.4  # s: boards that share a processor with a plant answer later than real ones


def board_links(first: str | Path, tendons: int) -> tuple[str, ...]:
    """Return a link to the port of each GRBL board of an arm: the first, then with _2, _3, ..."""
    return tuple(str(first) + (f'_{n}' if n > 1 and str(first) else '')
                 for n in range(1, ceil(tendons / AXES) + 1))


def grbl_parameters(ports: str | Path, tendons: int) -> dict[str, Value]:
    """Return the parameters of stepper boards at ports with spaces between."""
    return {'tendon_driver': 'grbl', 'grbl.port': str(ports),
            'grbl.steps_per_mm': (float(STEPS_PER_MM),) * tendons, 'grbl.signs': (1.0,) * tendons}


def tension_limit(model: str) -> float:
    """Return the tension limit (N) of a servo on an emulated spool."""
    return min(TENSION_LIMIT, STALL_SHARE * MODELS[model].stall_torque / SPOOL_RADIUS)


def dynamixel_parameters(port: str | Path, tendons: int, baud_rate: int = BAUD_RATE,
                         model: str = SERVO_MODEL) -> dict[str, Value]:
    """Return the parameters of servos with the IDs 1, 2, ... at a port."""
    return {'tendon_driver': 'dynamixel', 'dynamixel.port': str(port),
            'dynamixel.baud': baud_rate,
            'dynamixel.ids': tuple(range(1, tendons + 1)),
            'dynamixel.spool_radii': (SPOOL_RADIUS,) * tendons,
            'dynamixel.signs': (1.0,) * tendons,
            'dynamixel.tension_limits': (tension_limit(model),) * tendons,
            'dynamixel.torque_constants': (0.0,) * tendons}


def modbus_parameters(port: str | Path) -> dict[str, Value]:
    """Return the parameters of valves and sensors at a port."""
    return {'jamming_driver': 'modbus', 'modbus.port': str(port),
            'modbus.timeout': MODBUS_TIMEOUT}


def driving_parameters(grbl: str | Path = '', modbus: str | Path = '', tendons: int = 2, *,
                       dynamixel: str | Path = '') -> dict[str, Value]:
    """
    Return the node parameters for boards at these ports.

    grbl: of the tendons, with spaces between; or dynamixel: of servos.  tendons: how many.
    """
    moving = (dynamixel_parameters(dynamixel, tendons) if dynamixel
              else grbl_parameters(grbl, tendons))
    return moving | modbus_parameters(modbus)
