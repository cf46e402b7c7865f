# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of nodes that drive emulated boards."""

from math import ceil
from pathlib import Path

from soft_continuum.emulators.grbl import STEPS_PER_MM

AXES = 3
"""Of an emulated board; arms with more tendons have several, which share them evenly."""
SPOOL_RADIUS = 0.01
"""m, of an emulated servo."""
MODBUS_TIMEOUT = 0.4  # s: boards that share a processor with a plant answer later than real ones


def board_links(first: str | Path, tendons: int) -> tuple[str, ...]:
    """Return a link to the port of each GRBL board of an arm: the first, then with _2, _3, ..."""
    return tuple(str(first) + (f'_{n}' if n > 1 and str(first) else '')
                 for n in range(1, ceil(tendons / AXES) + 1))


def driving_parameters(grbl: str | Path, modbus: str | Path, tendons: int = 2
                       ) -> dict[str, object]:
    """
    Return what the nodes have to be given for boards at these ports.

    grbl: of the tendons, with spaces between; tendons: how many.
    """
    return {'tendon_driver': 'grbl', 'grbl.port': str(grbl),
            'grbl.steps_per_mm': [float(STEPS_PER_MM)] * tendons, 'grbl.signs': [1.0] * tendons,
            'jamming_driver': 'modbus', 'modbus.port': str(modbus),
            'modbus.timeout': MODBUS_TIMEOUT}


def dynamixel_parameters(port: str | Path, tendons: int, baud_rate: int = 1000000
                         ) -> dict[str, object]:
    """Return the parameters of servos with the IDs 1, 2, ... at a port."""
    return {'dynamixel.port': str(port), 'dynamixel.baud': baud_rate,
            'dynamixel.ids': [n + 1 for n in range(tendons)],
            'dynamixel.spool_radii': [SPOOL_RADIUS] * tendons,
            'dynamixel.signs': [1.0] * tendons}
