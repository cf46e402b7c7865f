# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Bus traffic while servos hold: goals, and validated replies.

A write is not acknowledged.  Each reply repeats the written values, so a lost write is detected
and repeated.  For the one thread that owns the bus.
"""

from collections.abc import Sequence
import contextlib

from soft_continuum.hardware.dynamixel.bus import (
    DamagedReplyError,
    DynamixelBus,
    NoReplyError,
)
from soft_continuum.hardware.dynamixel.registers import (
    explain_hardware_error,
    GOAL_CURRENT,
    GOAL_POSITION,
    HARDWARE_ERROR,
    REALTIME_TICK,
    Register,
    TORQUE_ENABLE,
    WATCHDOG_TRIGGERED,
    WATCHDOG_UNIT,
)
from soft_continuum.hardware.dynamixel.setup import CALIBRATE, Servo
from soft_continuum.hardware.dynamixel.state import BLOCK, fastest, ServoState, Written
from soft_continuum.hardware.protocols import HardwareError

SILENCE_TIMEOUT, MIN_MISSED = 0.15, 4
"""Time (s) and number of successive cycles without a valid reply that are a failure."""


class Exchange:
    """
    Writes to servos and reads them.

    missed: number of successive reads without a valid reply.
    """

    def __init__(self, bus: DynamixelBus, servos: Sequence[Servo], found: Sequence[ServoState]
                 ) -> None:
        """Go on with servos as they were ``found``."""
        self._bus, self._servos = bus, tuple(servos)
        self._ids = [servo.id for servo in servos]
        self._states = list(found)
        self._heard = bus.clock()
        self._repeat = False
        self.missed = 0

    def write(self, register: Register, values: Sequence[int]) -> None:
        """Write a register of every servo."""
        self._bus.sync_write(register, dict(zip(self._ids, values, strict=True)))

    def send(self, wanted: Sequence[Written]) -> None:
        """Write values that the servos have not confirmed; goals first: no current jumps."""
        known, repeat = [state.written for state in self._states], self._repeat
        self._repeat = False
        if repeat or any(a.goal != b.goal for a, b in zip(wanted, known, strict=True)):
            self.write(GOAL_POSITION, [w.goal for w in wanted])
        if repeat or any(a.current != b.current for a, b in zip(wanted, known, strict=True)):
            self.write(GOAL_CURRENT, [w.current for w in wanted])

    def receive(self, written: Sequence[Written]) -> list[ServoState] | None:
        """
        Return the state of all servos, or None if it is not valid.

        Raises HardwareError for a hardware error of a servo, a torque that was switched off, and
        when no valid reply was received for too long.
        """
        asked = self._bus.clock()
        try:
            replies = self._bus.sync_read(self._ids, *BLOCK)
        except (NoReplyError, DamagedReplyError) as error:
            self._miss(str(error), unanswered=True)
            return None
        now = self._bus.clock()
        states = [ServoState.from_reply(reply, asked, now) for reply in replies]
        for servo, state, before, wanted in zip(
                self._servos, states, self._states, written, strict=True):
            if state.alert:
                self._explain_alert(servo)
            if not state.torque:
                raise HardwareError(
                    self._why_other(servo, state.written, wanted) if not state.written.watchdog
                    else f'another program switched off the torque of {servo} ({TORQUE_ENABLE} is '
                    '0): its tendon has no tension; end that program')
            if state.written != wanted:
                self._repeat = True
                self._miss(self._why_other(servo, state.written, wanted))
                return None
            if not state.follows(before, fastest(wanted)):
                self._miss(f'implausible reply from {servo}: position {state.position} after '
                           f'{before.position}, {REALTIME_TICK} {state.tick} after {before.tick}')
                return None
        self._states, self._heard, self.missed = states, now, 0
        return states

    def _miss(self, why: str, unanswered: bool = False) -> None:
        """Count an invalid reply; raises HardwareError when there are too many."""
        self.missed += 1
        if self.missed < MIN_MISSED or self._bus.clock() - self._heard < SILENCE_TIMEOUT:
            return
        answering = self._bus.find(self._ids) if unanswered else self._ids
        silent = [str(servo) for servo in self._servos if servo.id not in answering]
        if silent:
            why = f'{" and ".join(silent)}: stopped replying; check its cable and supply'
        raise HardwareError(why)

    def _why_other(self, servo: Servo, found: Written, written: Written) -> str:
        """Explain why a servo does not hold the written values."""
        if found.watchdog == WATCHDOG_TRIGGERED:
            return (f'the watchdog of {servo} stopped it, because it received nothing for '
                    f'{written.watchdog * WATCHDOG_UNIT:g} s; the computer is too busy')
        if found.watchdog == 0:
            return (f'{servo} was reset or lost power for a moment: its torque was off, and its '
                    'turn count is lost; check its supply')
        return f'{servo} does not keep the values written to it ({found} instead of {written})'

    def _explain_alert(self, servo: Servo) -> None:
        with contextlib.suppress(NoReplyError, DamagedReplyError):
            if status := self._bus.read(servo.id, HARDWARE_ERROR):
                raise HardwareError(
                    f'{servo} has shut down or is about to: {explain_hardware_error(status)}; '
                    f'its tendon may have no tension; {CALIBRATE} reboots it')
