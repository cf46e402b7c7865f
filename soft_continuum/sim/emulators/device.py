# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Emulated devices: a pseudo-terminal that can be unplugged, a thread, and what may be typed.

``emulate`` serves the device of a driver.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from math import inf, nan
import os
from pathlib import Path
import sys
import termios
import threading
import tty
from typing import Any, Self, TypeVar

from soft_continuum.hardware.clock import Clock
from soft_continuum.hardware.drivers import emulated_devices
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.real_time import ask_for_a_larger_share, ask_for_real_time
from soft_continuum.parameters.arguments import number_in, Parser
from soft_continuum.parameters.files import parameters_text
from soft_continuum.parameters.parameter import Value

POLL_INTERVAL = 0.005  # s
TIME_STEP, RESTING_STEP = 0.002, 0.02  # s, while something happens, and while nothing does
Ranges = Mapping[str, tuple[float, float]]
RANGES: Ranges = {
    'SECONDS': (0.0, 3600.0), 'SHARE': (0.0, 1.0), 'COUNT': (0, 1000000), 'BYTES': (1, 4096)}
"""Ranges of arguments that several emulators share; integer arguments have int bounds."""
T = TypeVar('T')
Emulator = TypeVar('Emulator')


class EmulatedDevice:
    """
    A device that a thread serves inside a ``with`` statement; times are s on ``clock``.

    The port appears under a new ``name`` whenever it is plugged in, as a real one might.  No other
    thread changes the device while ``lock`` is held.
    """

    MAX_LATENESS = inf
    """s that are made up for, where the computer is too slow for the device."""

    def __init__(self, link: str | Path | None, clock: Clock) -> None:
        """Stay unplugged; link: path of a symbolic link to the port, which stays the same."""
        self.link = Path(link) if link else None
        self.clock = clock
        self.name = ''
        self.lock = threading.RLock()
        self._master = self._slave = -1  # negative while unplugged
        self._outgoing: list[tuple[float, Callable[[], object]]] = []  # when, what sends it
        self._closing = False
        self._time = clock()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        """Plug in and start to reply; raises OSError if another file exists at the link."""
        self.plug()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Unplug and end."""
        self._closing = True
        while self._thread.is_alive():
            self.clock.sleep(POLL_INTERVAL)
        self.unplug()

    @property
    def port(self) -> str:
        """The path of the port: of its link, if it has one."""
        return str(self.link or self.name)

    def plug(self) -> None:
        """Connect the cable; nothing is reset."""
        with self.lock:
            if self._master >= 0:
                return
            # An open slave side keeps the line alive while no program has opened the port.
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self.name = os.ttyname(self._slave)
            if self.link is not None:
                self._remove_link()
                try:
                    self.link.symlink_to(self.name)
                except FileExistsError:
                    raise FileExistsError(
                        f'{self.link} exists and is not a symbolic link; give another '
                        'path') from None

    def unplug(self) -> None:
        """Unplug the cable: the port disappears; motors, pump and valves keep their state."""
        with self.lock:
            if self._master < 0:
                return
            os.close(self._master)
            os.close(self._slave)
            self._master = self._slave = -1
            self._remove_link()

    def send(self, data: bytes) -> None:
        """Put bytes on the line; bytes that nothing reads are lost, as on a wire."""
        with self.lock:
            if self._master >= 0:
                with suppress(OSError):
                    os.write(self._master, data)

    def _remove_link(self) -> None:
        if self.link is not None and self.link.is_symlink():
            self.link.unlink()

    def read(self, value: Callable[[], T]) -> T:
        """Return a consistent value, or make a change, while the device stands still."""
        with self.lock:
            self._advance()
            return value()

    def _later(self, due: float, send: Callable[[], object]) -> None:
        """Call ``send`` when it is due (s)."""
        self._outgoing.append((due, send))
        self._outgoing.sort(key=lambda each: each[0])

    def _serve(self) -> None:
        ask_for_real_time()  # a board waits for no other program
        while not self._closing:
            with suppress(OSError, ValueError, termios.error):  # unplugged meanwhile
                self._turn()

    def _turn(self) -> None:
        """Wait until something comes, is due, or time has to pass; do what follows."""
        with self.lock:
            master, due = self._master, self._outgoing[0][0] if self._outgoing else inf
            pause = min(self._pause(), due - self.clock())
        ready = self.clock.wait([master] if master >= 0 else [], pause)
        with self.lock:
            self._advance()
            while self._outgoing and self._outgoing[0][0] <= self.clock():
                self._outgoing.pop(0)[1]()
            same = self._master == master
            self._take(os.read(master, 4096) if ready and same else b'')

    def _pause(self) -> float:
        """Return how long the device can wait for bytes before time has to pass, s."""
        return RESTING_STEP if self._resting() else TIME_STEP

    def _advance(self) -> None:
        """Let the time of the device catch up with the clock."""
        now = self.clock()
        elapsed, self._time = min(now - self._time, self.MAX_LATENESS), now
        while elapsed > 0.0:
            step = min(elapsed, self._pause())
            self._step(step)
            elapsed -= step

    def _resting(self) -> bool:
        """Whether nothing but bytes changes the device soon."""
        return True

    def _step(self, time: float) -> None:
        """Let a short time pass, s."""

    def _take(self, data: bytes) -> None:
        """Receive bytes, or see that none have come."""
        raise NotImplementedError


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
        main = devices[options.device].emulator.main
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
