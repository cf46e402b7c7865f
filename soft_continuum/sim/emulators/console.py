# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``emulate``, and what the emulators share: serve, execute typed commands, end cleanly."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from math import nan
import os
import sys
import threading
from typing import Any, TypeVar

from soft_continuum.hardware.drivers import emulated_devices
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.real_time import ask_for_a_larger_share
from soft_continuum.parameters.arguments import number_in, Parser
from soft_continuum.parameters.files import parameters_text
from soft_continuum.parameters.parameter import Value

Emulator = TypeVar('Emulator')
Ranges = Mapping[str, tuple[float, float]]
RANGES: Ranges = {
    'SECONDS': (0.0, 3600.0), 'SHARE': (0.0, 1.0), 'COUNT': (0, 1000000), 'BYTES': (1, 4096)}
"""Ranges of arguments that several emulators share; integer arguments have int bounds."""


@dataclass(frozen=True)
class Command:
    """
    A command that may be typed: the names of its arguments, its help and its function.

    The function takes the emulator and the arguments, and may return a text to print.
    """

    arguments: str
    help: str
    run: Callable[..., object]


def emulate(argv: Sequence[str] | None = None) -> int:
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
        main = devices[options.device]().main
    except HardwareError as error:
        return parser.fail(error)
    return int(main(options.options))


def set_to(name: str, value: object = None) -> Callable[..., None]:
    """Return the function of a command that sets an attribute, by default to its argument."""
    return lambda emulator, number=value: setattr(emulator, name, number)


def device_parser(device: str, description: str, *, timed: bool = True) -> Parser:
    """Return a parser of shared options; timed: whether the speed of time can be chosen."""
    parser = Parser(f'emulate {device}', description)
    parser.add_argument('--link', type=os.path.expanduser, metavar='PATH', default='',
                        help='symbolic link to create, as a stable port name')
    if timed:
        parser.add_argument('--time-factor', type=number_in(1e-6, 1000.0, ''), default=1.0,
                            metavar='FACTOR', help='emulated seconds per second (default: 1)')
    return parser


def execute(commands: Mapping[str, Command], ranges: Ranges, emulator: Any, line: str) -> str:
    """
    Execute a typed line; return the text to print.

    ranges: smallest and largest value of each argument.  Raises ValueError for an invalid line.
    """
    if line.strip() == 'help':
        return '\n'.join([*(f'{name + " " + c.arguments:<20} {c.help}'
                            for name, c in commands.items()), f'{"quit":<20} end'])
    name, *words = line.split()
    if name not in commands:
        raise ValueError(f'unknown command {name}; type help')
    arguments = commands[name].arguments.split()
    if len(words) != len(arguments):
        raise ValueError(f'{name} takes: {" ".join(arguments) or "no arguments"}')
    values = []
    for argument, word in zip(arguments, words, strict=True):
        low, high = ranges[argument]
        whole = isinstance(low, int)
        try:
            value = float(word)
        except ValueError:
            value = nan
        if not low <= value <= high or (whole and value % 1.0):
            raise ValueError(f'{argument} is {word}; allowed: {low:g} to {high:g}'
                             + (', whole numbers' if whole else ''))
        values.append(int(value) if whole else value)
    done = commands[name].run(emulator, *values)
    return done if isinstance(done, str) else 'done'


def serve(parser: Parser, make: Callable[[], AbstractContextManager[Emulator]],
          parameters: Callable[[Emulator], Mapping[str, Value]],
          execute_command: Callable[[Emulator, str], str], note: str = '') -> int:
    """
    Serve an emulator until ``quit`` or Ctrl-C; return the exit status.

    parameters: of nodes that drive it, which are printed first.  execute_command: carries out a
    typed line and returns what to print; raises ValueError for one that is wrong.  note: about
    its commands.
    """
    ask_for_a_larger_share()  # as a device, it waits for no other program
    try:
        with make() as emulator:
            print(parameters_text(parameters(emulator), [
                'Put this into the parameter file of all nodes; defaults may be left out.'])
                + f'Type a fault, or help.{note}', flush=True)
            for line in sys.stdin:
                if line.strip() == 'quit':
                    return 0
                try:
                    print(execute_command(emulator, line) if line.strip() else '', flush=True)
                except ValueError as error:
                    print(error, flush=True)
            threading.Event().wait()  # no terminal: serve until Ctrl-C
    except OSError as error:
        return parser.fail(error)
    except KeyboardInterrupt:
        pass
    return 0
