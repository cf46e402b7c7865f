# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An emulated GRBL 1.1 board on a pseudo-terminal, with its motors and its faults."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
import os
import random
from typing import TypeVar

from soft_continuum.emulators.device import EmulatedDevice
from soft_continuum.emulators.grbl_firmware import GrblFirmware
from soft_continuum.emulators.grbl_planner import Steps
from soft_continuum.hardware.clock import Clock, STEADY

TIME_STEP = 0.002  # s, while something happens
RESTING_STEP = 0.02  # s

T = TypeVar('T')


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
        self.hang = False
        self.drop_ok = 0
        self.late_ok = 0.0
        self.garble = 0.0
        self.random = random.Random(1)
        self._late: list[tuple[float, str]] = []
        self.firmware = GrblFirmware(settings or {}, self.say, self._acknowledge, switches)
        self._time = clock()
        self.plug()

    # The truth, whatever the firmware reports

    @property
    def motors(self) -> Steps:
        """Steps that the motors have made since the beginning."""
        return self._read(lambda firmware: firmware.made)

    @property
    def moving(self) -> bool:
        """Whether the motors move."""
        return self._read(lambda firmware: not firmware.planner.standing)

    @property
    def energised(self) -> bool:
        """Whether the motors hold their load."""
        return self._read(lambda firmware: firmware.energised)

    @property
    def time(self) -> float:
        """Emulated time, s."""
        return self._read(lambda firmware: firmware.time)

    def remaining_time(self) -> float:
        """Return for how long (s) the motors would move if no more came."""
        return self._read(lambda firmware: firmware.planner.remaining_time())

    def _read(self, value: Callable[[GrblFirmware], T]) -> T:
        with self.lock:
            self._advance()
            return value(self.firmware)

    # Faults

    def reset(self, banner: bool = True) -> None:
        """Reset at the board: power, button, or DTR when a computer opens the port."""
        with self.lock:
            self._advance()
            self._late.clear()
            self.firmware.reset(banner)

    def alarm(self, number: int) -> None:
        """Stop at once and lock; 1 and 2 answer nothing before a soft reset."""
        with self.lock:
            self._advance()
            self.firmware.alarm(number)

    def hold(self) -> None:
        """Press the feed hold button at the board for a moment."""
        with self.lock:
            self.firmware.hold()

    def door(self) -> None:
        """Open the safety door."""
        with self.lock:
            self.firmware.door()

    # Time and bytes

    def _run(self) -> None:
        while not self._closing:
            with self.lock:
                master = self._master
                resting = self.firmware.resting and not self._late
            with suppress(OSError, ValueError):  # nothing was sent, or it was unplugged meanwhile
                self.clock.wait([master] if master >= 0 else [],
                                RESTING_STEP if resting else TIME_STEP)
                with self.lock:
                    self._advance()
                    if self._master == master >= 0:
                        data = os.read(master, 4096)
                        if not self.hang:
                            self.firmware.take(data)

    def _advance(self) -> None:
        """Let the emulated time catch up."""
        now = self.clock()
        elapsed, self._time = now - self._time, now
        while elapsed > 0.0:
            step = elapsed if self.firmware.resting else min(elapsed, TIME_STEP)
            self.firmware.advance(step)
            elapsed -= step
        while self._late and self._late[0][0] <= now:
            self.say(self._late.pop(0)[1])

    def _acknowledge(self, text: str) -> None:
        if self.drop_ok > 0:
            self.drop_ok -= 1
        elif self.late_ok > 0.0:
            self._late.append((self.clock() + self.late_ok, text))
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
