# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An emulated GRBL 1.1 board on a pseudo-terminal: motors, faults that are typed, port."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
import random

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.parameters.parameter import Value
from soft_continuum.sim.emulators.device import (
    Command,
    device_parser,
    EmulatedDevice,
    execute,
    RANGES,
    serve,
    set_to,
)
from soft_continuum.sim.emulators.grbl_firmware import GrblFirmware, Steps

STEPS_PER_MM = 200
"""Steps per mm of the emulated motors and drums; a GRBL board itself counts steps."""


class GrblEmulator(EmulatedDevice):
    """
    A controller at ``port``, which is plugged in at once; use it in a ``with`` statement.

    Faults, to be set while it runs: ``hang`` (answers nothing, motors continue), ``drop_ok``
    (this many acknowledgements are lost), ``late_ok`` (s that they take), ``garble`` (share of
    lines that arrive damaged), ``firmware.race`` (the next jog runs as a program),
    ``firmware.stalled`` (motors make no step, whatever is reported).  Others are methods.  While
    ``lock`` is held no time passes for the board.
    """

    def __init__(self, link: str = '', clock: Clock = STEADY,
                 settings: Mapping[int, float] | None = None,
                 switches: Sequence[float] = ()) -> None:
        """
        Switch the board on; ``link``: a path at which its port can always be found.

        clock: the time in which it moves.  settings: ``$`` numbers that are not as usual.
        switches: where the limit switches of X and Y close, in the unit of the settings (steps)
        from where the motors now are.
        """
        super().__init__(link, clock)
        self.random = random.Random(1)
        self.firmware = GrblFirmware(settings or {}, self.say, self._acknowledge, switches)
        self.repair()
        self.plug()

    # The truth, whatever the firmware reports

    @property
    def motors(self) -> Steps:
        """Steps that the motors have made since the beginning."""
        return self.read(lambda: self.firmware.made)

    @property
    def moving(self) -> bool:
        """Whether the motors move."""
        return self.read(lambda: not self.firmware.planner.standing)

    @property
    def energised(self) -> bool:
        """Whether the motors hold their load."""
        return self.read(lambda: self.firmware.energised)

    @property
    def time(self) -> float:
        """Emulated time, s."""
        return self.read(lambda: self.firmware.time)

    def remaining_time(self) -> float:
        """Return for how long (s) the motors would move if no more came."""
        return self.read(lambda: self.firmware.planner.remaining_time())

    # Faults

    def reset(self, banner: bool = True) -> None:
        """Reset at the board: power, button, or DTR when a computer opens the port."""
        with self.lock:
            self._advance()
            self._outgoing.clear()
            self.firmware.reset(banner)

    def repair(self) -> None:
        """Clear all lasting faults."""
        self.hang = self.firmware.race = self.firmware.stalled = False
        self.drop_ok, self.late_ok, self.garble = 0, 0.0, 0.0

    def alarm(self, number: int) -> None:
        """Stop at once and lock; 1 and 2 answer nothing before a soft reset."""
        self.read(lambda: self.firmware.alarm(number))

    def hold(self) -> None:
        """Press the feed hold button at the board for a moment."""
        with self.lock:
            self.firmware.hold()

    def door(self) -> None:
        """Open the safety door."""
        with self.lock:
            self.firmware.door()

    # Time and bytes

    def _resting(self) -> bool:
        return self.firmware.resting

    def _step(self, time: float) -> None:
        self.firmware.advance(time)

    def _take(self, data: bytes) -> None:
        if not self.hang:
            self.firmware.take(data)

    def _acknowledge(self, text: str) -> None:
        if self.drop_ok > 0:
            self.drop_ok -= 1
        elif self.late_ok > 0.0:
            self._later(self.clock() + self.late_ok, partial(self.say, text))
        else:
            self.say(text)

    def say(self, line: str) -> None:
        """Send a line, as far as faults let it through."""
        if self.hang:
            return
        data = bytearray(line.encode('ascii') + b'\r\n')
        if self.garble and self.random.random() < self.garble:
            data[self.random.randrange(len(data))] = self.random.randrange(256)
        self.send(bytes(data))


def grbl_parameters(ports: str | Path, tendons: int) -> dict[str, Value]:
    """Return the parameters of stepper boards at ports with spaces between."""
    return {'tendon_driver': 'grbl', 'grbl.port': str(ports),
            'grbl.steps_per_mm': (float(STEPS_PER_MM),) * tendons, 'grbl.signs': (1.0,) * tendons}


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
