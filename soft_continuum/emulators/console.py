# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shared by the command lines of the emulators: serve, execute typed commands, end cleanly."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from math import nan
import os
import sys
import threading
from typing import Any, TypeVar

from soft_continuum.arguments import number_in, Parser
from soft_continuum.hardware.real_time import ask_for_a_larger_share

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
          introduce: Callable[[Emulator], str],
          execute_command: Callable[[Emulator, str], str]) -> int:
    """
    Serve an emulator until ``quit`` or Ctrl-C; return the exit status.

    introduce: what to print first.  execute_command: carries out a typed line and returns what to
    print; raises ValueError for one that is wrong.
    """
    ask_for_a_larger_share()  # as a device, it waits for no other program
    try:
        with make() as emulator:
            print(introduce(emulator), flush=True)
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
