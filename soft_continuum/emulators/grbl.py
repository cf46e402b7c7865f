# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The command line of the emulated GRBL board: faults are typed while it runs."""

from collections.abc import Sequence

from soft_continuum.emulators.console import Command, device_parser, execute, RANGES, serve, set_to
from soft_continuum.emulators.driving import grbl_parameters, STEPS_PER_MM
from soft_continuum.emulators.grbl_board import GrblEmulator
from soft_continuum.hardware.clock import Clock


def describe(emulator: GrblEmulator) -> str:
    """Return the state and the motor positions as text."""
    x, y, _ = emulator.motors
    return (f'{emulator.port}: {emulator.firmware.state}, motors have made {x} and {y} steps, '
            f'{"holding" if emulator.energised else "without current"}, '
            f'{emulator.remaining_time():.3f} s of motion left')


COMMANDS = {
    'reset': Command('', 'reset the board, as opening the port of an Arduino does',
                     GrblEmulator.reset),
    'unplug': Command('', 'unplug the cable', GrblEmulator.unplug),
    'plug': Command('', 'put it back', GrblEmulator.plug),
    'hang': Command('', 'stop answering', set_to('hang', True)),
    'drop-ok': Command('COUNT', 'drop the next acknowledgements', set_to('drop_ok')),
    'late-ok': Command('SECONDS', 'acknowledge late', set_to('late_ok')),
    'garble': Command('SHARE', 'damage this share of the lines', set_to('garble')),
    'alarm': Command('ALARM', 'lock the board with this alarm', GrblEmulator.alarm),
    'hold': Command('', 'press the feed hold button', GrblEmulator.hold),
    'door': Command('', 'open the safety door', GrblEmulator.door),
    'stall': Command('', 'report motion without making steps',
                     lambda e: setattr(e.firmware, 'stalled', True)),
    'race': Command('', 'run the next jog as a program',
                    lambda e: setattr(e.firmware, 'race', True)),
    'repair': Command('', 'clear hang, drop-ok, late-ok, garble, stall and race',
                      GrblEmulator.repair),
    'state': Command('', 'print the state and the true motor positions', describe),
}


def execute_command(emulator: GrblEmulator, line: str) -> str:
    """Execute a typed line; return the text to print.  Raises ValueError for an invalid one."""
    return execute(COMMANDS, {**RANGES, 'ALARM': (1, 9)}, emulator, line)


def main(argv: Sequence[str] | None = None) -> int:
    """Serve an emulated board until ``quit`` or Ctrl-C; faults are typed on standard input."""
    parser = device_parser('grbl', 'A GRBL 1.1 stepper controller on a pseudo-terminal.')
    parser.add_argument('--switches', type=float, nargs=2, metavar=('RIGHT', 'LEFT'), default=[],
                        help='limit switches that close when the motors of the tendons are at '
                        'these mm, negative: paid out; the board is then locked until it is homed')
    arguments = parser.parse_args(argv)
    if any(not -1000.0 <= switch < 0.0 for switch in arguments.switches):
        parser.error('--switches must be negative, and not below -1000 mm')
    settings, homing = {}, {}
    if arguments.switches:
        settings = {22: 1.0, 23: 3.0, **dict.fromkeys((130, 131), 100.0 * STEPS_PER_MM)}
        homing = {'grbl.homed_pulls': tuple(  # 1 mm off: $27
            (switch + 1.0) * 1e-3 for switch in arguments.switches)}
    return serve(
        parser, lambda: GrblEmulator(
            arguments.link, Clock(arguments.time_factor), settings,
            [switch * STEPS_PER_MM for switch in arguments.switches]),
        lambda emulator: grbl_parameters(emulator.port, 2) | homing, execute_command)
