# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The command line of the emulated GRBL board: faults are typed while it runs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf

from soft_continuum.arguments import Parser
from soft_continuum.emulators.console import serve
from soft_continuum.emulators.grbl_board import GrblEmulator
from soft_continuum.hardware.clock import Clock

CONFIGURATION = """\
Put this into the parameter file of tendon_actuation:
/**:
  ros__parameters:
    tendon_driver: grbl
    grbl:
      port: {port}
      steps_per_mm: [{x:.1f}, {y:.1f}]{homing}
Type a fault, or help.
"""


@dataclass(frozen=True)
class Command:
    """What may be typed: the range of its one number, if it takes one, its help and function."""

    low: float
    high: float
    whole: bool
    help: str
    run: Callable[[GrblEmulator, float], object]


def plain(function: Callable[[GrblEmulator], object], explanation: str) -> Command:
    """Return a command without a number."""
    return Command(inf, -inf, False, explanation, lambda emulator, _: function(emulator))


def setting(name: str, high: float, whole: bool, explanation: str) -> Command:
    """Return a command that sets an attribute."""
    return Command(0.0, high, whole, explanation,
                   lambda emulator, value: setattr(emulator, name, int(value) if whole else value))


def repair(emulator: GrblEmulator) -> None:
    """End the faults that last."""
    emulator.hang = emulator.firmware.race = emulator.firmware.stalled = False
    emulator.drop_ok, emulator.late_ok, emulator.garble = 0, 0.0, 0.0


def describe(emulator: GrblEmulator) -> str:
    """Return the state and what the motors have done, for a person to read."""
    x, y, _ = emulator.motors
    return (f'{emulator.port}: {emulator.firmware.state}, motors have made {x} and {y} steps, '
            f'{"holding" if emulator.energised else "without current"}, '
            f'{emulator.remaining_time():.3f} s of motion left')


COMMANDS = {
    'reset': plain(GrblEmulator.reset, 'reset the board, as opening the port of an Arduino does'),
    'unplug': plain(GrblEmulator.unplug, 'pull out the cable'),
    'plug': plain(GrblEmulator.plug, 'put it back'),
    'hang': plain(lambda e: setattr(e, 'hang', True), 'answer nothing'),
    'drop-ok': setting('drop_ok', 1e6, True, 'lose the next N acknowledgements'),
    'late-ok': setting('late_ok', 3600.0, False, 'acknowledge N seconds late'),
    'garble': setting('garble', 1.0, False, 'damage this share (0 to 1) of the lines'),
    'alarm': Command(1, 9, True, 'lock the board with alarm N', lambda e, n: e.alarm(int(n))),
    'hold': plain(GrblEmulator.hold, 'press the feed hold button'),
    'door': plain(GrblEmulator.door, 'open the safety door'),
    'stall': plain(lambda e: setattr(e.firmware, 'stalled', True),
                   'report motion, but make no step'),
    'race': plain(lambda e: setattr(e.firmware, 'race', True), 'run the next jog as a program'),
    'repair': plain(repair, 'end hang, drop-ok, late-ok, garble, stall and race'),
    'state': plain(describe, 'print the state and what the motors have really done'),
}


def obey(emulator: GrblEmulator, line: str) -> str:
    """Carry out a typed line; return what to print.  Raises ValueError for one that is wrong."""
    if line.strip() == 'help':
        return '\n'.join([*(f'{name + (" N" if c.low <= c.high else ""):<12} {c.help}'
                            for name, c in COMMANDS.items()), f'{"quit":<12} end'])
    name, *words = line.split()
    if name not in COMMANDS:
        raise ValueError(f'{name} is no command; type help')
    command, value = COMMANDS[name], 0.0
    if command.low > command.high:
        if words:
            raise ValueError(f'{name} takes nothing more')
    else:
        try:
            value = float(words[0]) if len(words) == 1 else inf
        except ValueError:
            value = inf
        if not command.low <= value <= command.high or (command.whole and value % 1.0):
            raise ValueError(f'{name} takes a {"whole " if command.whole else ""}number from '
                             f'{command.low:g} to {command.high:g}')
    done = command.run(emulator, value)
    return done if isinstance(done, str) else 'done'


def main(argv: Sequence[str] | None = None) -> int:
    """Serve an emulated board until ``quit`` or Ctrl-C; faults are typed on standard input."""
    parser = Parser('emulate grbl', 'A GRBL 1.1 stepper controller on a pseudo-terminal.')
    parser.add_argument('--link', metavar='PATH', default='',
                        help='a symbolic link to make, as a port name that stays the same')
    parser.add_argument('--time-factor', type=float, default=1.0, metavar='FACTOR',
                        help='emulated seconds per second (default: 1)')
    parser.add_argument('--switches', type=float, nargs=2, metavar=('RIGHT', 'LEFT'), default=[],
                        help='limit switches that close when the motors of the tendons are at '
                        'these mm, negative: paid out; the board is then locked until it is homed')
    arguments = parser.parse_args(argv)
    if not 0.0 < arguments.time_factor <= 1000.0:
        parser.error('--time-factor must be above 0 and at most 1000')
    if any(not -1000.0 <= switch < 0.0 for switch in arguments.switches):
        parser.error('--switches must be negative, and not below -1000 mm')
    settings, homing = {}, ''
    if arguments.switches:
        settings = {22: 1.0, 23: 3.0, 130: 100.0, 131: 100.0}
        right, left = ((switch + 1.0) * 1e-3 for switch in arguments.switches)  # 1 mm off: $27
        homing = f'\n      homed_pulls: [{right:.4f}, {left:.4f}]'
    return serve(
        parser.prog, lambda: GrblEmulator(
            arguments.link, Clock(arguments.time_factor), settings, arguments.switches),
        lambda emulator: CONFIGURATION.format(
            port=emulator.port, x=emulator.firmware.settings[100],
            y=emulator.firmware.settings[101], homing=homing), obey)
