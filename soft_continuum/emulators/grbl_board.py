# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An emulated GRBL 1.1 board on a pseudo-terminal, with its motors and its faults."""

from collections.abc import Mapping, Sequence
from functools import partial
import random

from soft_continuum.emulators.device import EmulatedDevice
from soft_continuum.emulators.grbl_firmware import GrblFirmware
from soft_continuum.emulators.grbl_planner import Steps
from soft_continuum.hardware.clock import Clock, STEADY


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
