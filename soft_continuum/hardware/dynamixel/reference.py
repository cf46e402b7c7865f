# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
How the zero of Dynamixel servos survives restarts and losses of power.

A servo counts its turns while it has power.  So the zero is marked in four spare bytes of its RAM:
after a restart of node or computer, the mark proves that turns and zero are valid.  A servo that
lost power, or was rebooted, has lost the mark and measures its angle only within one turn.  For
that case the zero is also stored in a file of the user; the turn is determined if only one lies
within pull_limits.
"""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
import contextlib
from dataclasses import dataclass
import json
from math import ceil, floor
from pathlib import Path

from soft_continuum.hardware.dynamixel.bus import DamagedReplyError, DynamixelBus, NoReplyError
from soft_continuum.hardware.dynamixel.registers import PULSES_PER_TURN, SPARE, WATCHDOG_TRIGGERED
from soft_continuum.hardware.dynamixel.setup import ATTEMPTS, FoundServo, ServoState, Spools
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.text import read_bytes, write_whole

ZERO_BITS = 22
CHECK_BASE = 1021
MAX_ZERO = 1 << ZERO_BITS - 1
TURN_MARGIN = 0.1
"""Turns beyond pull_limits that a tendon may have moved without power."""
MAX_FILE = 100_000  # bytes


def mark(servo: int, zero: int) -> int:
    """Return the four bytes that mark a zero (pulses without Homing Offset) in a servo's RAM."""
    bits = zero % (1 << ZERO_BITS)
    return bits | _check(servo, bits) << ZERO_BITS


def marked_zero(servo: int, value: int) -> int | None:
    """Return the zero (pulses) of a mark; None where there is no mark."""
    bits = value % (1 << ZERO_BITS)
    if value >> ZERO_BITS != _check(servo, bits):
        return None
    return bits - (1 << ZERO_BITS) if bits >= MAX_ZERO else bits


def _check(servo: int, bits: int) -> int:
    """Return a number of ten bits, never 0 as RAM is after a reset."""
    return 1 + (bits * 31 + servo * 7919 + 17) % CHECK_BASE


@dataclass(frozen=True)
class Zero:
    """The zero of a servo, pulses without Homing Offset; unknown: why it is unknown."""

    position: int
    unknown: str = ''


def zero_within_turn(servo: str, position: int, kept: int | None, pull_per_pulse: float,
                     limits: tuple[float, float]) -> Zero:
    """
    Return the zero of a servo that lost power since its zero was stored.

    position: now.  kept: the stored zero, None if there is none.  pull_per_pulse: m.
    limits: smallest and largest pull, m.
    """
    if kept is None:
        return Zero(position, f'{servo} lost power or was rebooted, and no zero of it is stored '
                              'on this computer')
    low, high = sorted(limit / pull_per_pulse for limit in limits)
    low, high = low - TURN_MARGIN * PULSES_PER_TURN, high + TURN_MARGIN * PULSES_PER_TURN
    # position - zero is between low and high, where zero is kept and any number of turns.
    turns = range(ceil((position - kept - high) / PULSES_PER_TURN),
                  floor((position - kept - low) / PULSES_PER_TURN) + 1)
    zeros = [kept + PULSES_PER_TURN * turn for turn in turns]
    if len(zeros) == 1:
        return Zero(zeros[0])
    reason = f'{servo} lost power or was rebooted, so its turn count is lost: '
    if not zeros:
        return Zero(position, reason + 'its angle matches no pull within pull_limits')
    pulls = ' or '.join(f'{1e3 * pull_per_pulse * (position - zero):.1f} mm' for zero in zeros)
    return Zero(position, f'{reason}it may be at {pulls}')


class ZeroFile:
    """
    The file with the zeros of the servos behind each port of this computer.

    ``{"/dev/serial/by-id/...": {"1": 2048, "2": 2050}}``: port, ID, pulses.
    """

    def __init__(self, path: Path, port: str) -> None:
        """Keep the zeros of the servos behind a port."""
        self._path, self._port = path, port
        self._last: Future[None] | None = None

    def read(self, servo: int) -> int | None:
        """Return the zero of a servo; None without a readable one."""
        zero = self._all().get(self._port, {}).get(str(servo))
        return zero if isinstance(zero, int) else None

    def write(self, servos: Sequence[int], zeros: Sequence[int | None]) -> None:
        """
        Keep zeros, None for none.

        Raises HardwareError if it cannot, since an older stored zero would be wrong.
        """
        known = self._all()
        known[self._port] = known.get(self._port, {}) | {
            str(servo): zero for servo, zero in zip(servos, zeros, strict=True)}
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._path, json.dumps(known, indent=1, sort_keys=True) + '\n')
        except OSError as error:
            raise HardwareError(f'the zero cannot be saved in {self._path} ({error.strerror}); '
                                'make it writable, and reference again') from None

    def begin_write(self, servos: Sequence[FoundServo], zeros: Sequence[int]) -> None:
        """
        Keep zeros (Present Positions), as ``write``, on a thread of its own.

        A busy disk would hold up the thread of the bus for longer than the servos' watchdogs wait.
        ``check_written`` reports a failure.
        """
        before, pool = self._last, ThreadPoolExecutor(1, 'dynamixel_zeros')

        def write() -> None:
            if before is not None:
                wait([before])  # the newest is written last
            self.write([servo.id for servo in servos], _raw(servos, zeros))

        self._last = pool.submit(write)
        pool.shutdown(wait=False)  # its thread ends with the write

    @property
    def writing(self) -> bool:
        """Whether zeros are being written."""
        return self._last is not None and not self._last.done()

    def check_written(self) -> None:
        """Raise HardwareError, once, if the last zeros could not be written."""
        if self._last is not None and self._last.done():
            last, self._last = self._last, None
            last.result()

    def _all(self) -> dict[str, dict[str, int | None]]:
        try:
            known = json.loads(read_bytes(self._path, MAX_FILE))
        except (OSError, ValueError):
            return {}
        if not isinstance(known, dict):
            return {}
        return {str(port): zeros for port, zeros in known.items() if isinstance(zeros, dict)}


def find_zeros(bus: DynamixelBus, servos: Sequence[FoundServo], states: Sequence[ServoState],
               spools: Spools, zero_file: ZeroFile) -> list[Zero]:
    """Return the zero of every servo, as a Present Position, as far as it is known."""
    zeros = []
    for servo, state, scale in zip(servos, states, spools.pull_per_pulse, strict=True):
        offset = servo.homing_offset
        zero = marked_zero(servo.id, bus.read(servo.id, SPARE))
        # A change of the operating mode loses the turns too, and resets the profile.
        if zero is not None and (state.written.velocity
                                 or state.written.watchdog == WATCHDOG_TRIGGERED):
            zeros.append(Zero(zero + offset))
        else:
            found = zero_within_turn(str(servo), state.position - offset,
                                     zero_file.read(servo.id), scale, spools.pull_limits)
            zeros.append(Zero(found.position + offset, found.unknown))
    return zeros


def clear_marks(bus: DynamixelBus, ids: Sequence[int], zero_file: ZeroFile) -> None:
    """Clear the zeros in servos and on this computer; raises HardwareError."""
    zero_file.write(ids, [None] * len(ids))
    for servo in ids:
        bus.write(servo, SPARE, 0)


def _raw(servos: Sequence[FoundServo], zeros: Sequence[int]) -> list[int]:
    """Return Present Positions without Homing Offset."""
    return [zero - servo.homing_offset for zero, servo in zip(zeros, servos, strict=True)]


def mark_zeros(bus: DynamixelBus, servos: Sequence[FoundServo], zeros: Sequence[int]) -> None:
    """Mark zeros (Present Positions) in the servos; raises HardwareError."""
    marks = {servo.id: mark(servo.id, zero)
             for servo, zero in zip(servos, _raw(servos, zeros), strict=True)}
    for _ in range(ATTEMPTS):
        bus.sync_write(SPARE, marks)
        with contextlib.suppress(NoReplyError, DamagedReplyError):
            replies = bus.sync_read([*marks], SPARE.address, SPARE.end)
            if [SPARE.decode(reply.data) for reply in replies] == [*marks.values()]:
                return
    raise HardwareError(
        f'the servos lose their zero in {SPARE}: does another program change their Indirect '
        'Addresses?  With slack tendons switch the servos off and on')
