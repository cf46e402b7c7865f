# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``calibrate servos``: sets up Dynamixel servos, and reboots those that have shut down."""

import argparse
from collections.abc import Sequence

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.dynamixel.bus import DynamixelBus
from soft_continuum.hardware.dynamixel.registers import explain_hardware_error, HARDWARE_ERROR
from soft_continuum.hardware.dynamixel.setup import (
    find_servos,
    FoundServo,
    Spools,
    unfit_settings,
    write_settings,
)
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.lab.analysis.verbs import run_verb
from soft_continuum.parameters.arguments import confirm, Parser
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.description import load_rig

NAME = 'calibrate servos'
REBOOT_TIME = 1.0  # s


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status, FAILED if a servo could not be set up."""
    parser = Parser(NAME, 'Write the settings that Dynamixel servos need into their EEPROM, and '
                    'reboot those that have shut down. Both switch the torque off: the tendons '
                    'must be slack. Changes are shown first. Nodes that use the servos must not '
                    'run.', '--params-file')
    parser.add_argument('--reboot', type=int, nargs='+', default=[], metavar='ID',
                        help='reboot these servos too; they lose their turn count')
    parser.add_argument('--yes', action='store_true',
                        help='do not ask: the tendons are slack')
    return run_verb(parser, _run, argv)


def _run(options: argparse.Namespace) -> None:
    values = load_rig(options.params_file, options.namespace)
    if values['tendon_driver'] != 'dynamixel':
        raise ParameterError(f'tendon_driver is {values["tendon_driver"]}; {NAME} is for '
                             'dynamixel: give its file with --params-file')
    spools = Spools.from_parameters(values)
    if unknown := set(options.reboot) - set(spools.ids):
        raise ParameterError(f'--reboot {" ".join(map(str, sorted(unknown)))}: dynamixel.ids are '
                             f'{" ".join(map(str, spools.ids))}')
    bus = DynamixelBus.from_parameters(values)
    try:
        for servo in find_servos(bus, spools):
            _set_up(bus, servo, spools.speed_limit, options)
    finally:
        bus.close()


def _set_up(bus: DynamixelBus, servo: FoundServo, speed_limit: float,
            options: argparse.Namespace) -> None:
    """Show the changes that one servo needs, ask, and make them."""
    unfit = unfit_settings(servo, speed_limit)
    error = servo.get(HARDWARE_ERROR)
    print(f'{servo}: {servo.describe()}')
    for item in unfit:
        print(f'  {item}')
    if error:
        print(f'  has shut down: {explain_hardware_error(error)}')
    reboot = bool(error) or servo.id in options.reboot
    if not unfit and not reboot:
        print('  nothing to change')
        return
    steps = [*(['writes this into its EEPROM'] if unfit else []),
             *(['reboots it, and its turn count is lost'] if reboot else [])]
    confirm(f'This {" and ".join(steps)}. Its torque is switched off meanwhile: the tendon must '
            'be slack and carry no load.', options.yes)
    if reboot:
        bus.reboot(servo.id)
        STEADY.sleep(REBOOT_TIME)
        if left := bus.read(servo.id, HARDWARE_ERROR):
            raise HardwareError(f'{servo} has the error again: {explain_hardware_error(left)}')
    if unfit:
        write_settings(bus, servo, unfit)
    print('  done; its torque is off until the nodes start')
