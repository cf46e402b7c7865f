# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``emulate``: devices to test the hardware drivers with."""

import argparse
from collections.abc import Sequence

from soft_continuum.arguments import Parser
from soft_continuum.hardware.drivers import emulated_devices
from soft_continuum.hardware.protocols import HardwareError


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the emulated device of a driver until Ctrl-C; return the exit status."""
    devices = emulated_devices()
    parser = Parser('emulate', 'Emulate the device of a driver. DEVICE --help shows the options '
                    'of a device.')
    parser.add_argument('device', choices=devices,
                        help='grbl: the stepper controller; dynamixel: servos; modbus: pump, '
                        'valves and sensors; others: of the package with that driver')
    parser.add_argument('options', nargs=argparse.REMAINDER, metavar='OPTION')
    options = parser.parse_args(argv)
    try:
        serve = devices[options.device]().main
    except HardwareError as error:
        return parser.fail(error)
    return int(serve(options.options))
