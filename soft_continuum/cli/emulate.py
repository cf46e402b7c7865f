# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``emulate grbl``, ``modbus`` and ``dynamixel``: devices to test the hardware drivers with."""

import argparse
from collections.abc import Sequence

from soft_continuum.arguments import Parser
from soft_continuum.cli.main import call
from soft_continuum.cli.registry import VERBS


def main(argv: Sequence[str] | None = None) -> int:
    """Serve an emulated device until Ctrl-C; return the exit status."""
    parser = Parser('emulate', 'Emulate a device on a pseudo-terminal. DEVICE --help shows the '
                    'options of a device.')
    parser.add_argument('device', choices=('grbl', 'dynamixel', 'modbus'),
                        help='grbl: the stepper controller; dynamixel: servos; '
                        'modbus: pump, valves and sensors')
    parser.add_argument('options', nargs=argparse.REMAINDER, metavar='OPTION')
    options = parser.parse_args(argv)
    return call(VERBS[f'{options.device}_emulator'], options.options)
