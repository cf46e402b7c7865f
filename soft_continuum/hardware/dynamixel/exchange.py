# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Bus traffic with servos that hold: taking them over, goals, and validated replies.

A write is not acknowledged.  Each reply contains the values that the driver wrote: a reply that
does not repeat them is not the present one of this servo, or a write was lost and is repeated.
For the one thread that owns the bus.

Nothing moves when servos are taken over.  Those that hold goals of this driver keep them.  Others
with torque keep their present goal, for example where their watchdog stopped them, which under
load is a little ahead of their position.  Those without torque hold their position.
"""

from collections.abc import Sequence
import contextlib
from dataclasses import dataclass, replace

from soft_continuum.hardware.dynamixel.bus import (
    DamagedReplyError,
    DynamixelBus,
    NoReplyError,
    Reply,
    ServoRejectedError,
)
from soft_continuum.hardware.dynamixel.registers import (
    BUS_WATCHDOG,
    explain_hardware_error,
    GOAL_CURRENT,
    GOAL_POSITION,
    GOAL_PWM,
    HARDWARE_ERROR,
    POSITION_TRAJECTORY,
    PRESENT_CURRENT,
    PRESENT_POSITION,
    PROFILE_ACCELERATION,
    PROFILE_VELOCITY,
    PWM_LIMIT,
    RADIANS_PER_PULSE,
    REALTIME_TICK,
    Register,
    STATUS_RETURN_LEVEL,
    TICK_RANGE,
    TORQUE_ENABLE,
    VELOCITY_UNIT,
    WATCHDOG_TRIGGERED,
    WATCHDOG_UNIT,
)
from soft_continuum.hardware.dynamixel.setup import CALIBRATE, FoundServo, Spools
from soft_continuum.hardware.protocols import HardwareError

BLOCK = TORQUE_ENABLE.address, PRESENT_POSITION.end
TICK_TOLERANCE = 0.1
"""Largest advance of a servo's clock over the computer's between two replies, s."""
SILENCE_TIMEOUT, MIN_MISSED = 0.15, 4
"""Time (s) and number of successive cycles without a valid reply that are a failure."""
WATCHDOG = 10  # units of WATCHDOG_UNIT
SPEED_MARGIN = 1.5
"""Factor over speed_limit that lets servos catch up after a delay."""
MAX_LEAD, MAX_LEAD_FOUND = 0.01, 0.002
"""Largest lead (m) of a goal, and of one that was not set by this driver."""
ATTEMPTS = 5  # to read all servos, and to write what they must have or keep


@dataclass(frozen=True)
class Written:
    """What the driver wrote to a servo: Bus Watchdog, Goal Current, Profile Velocity, goal."""

    watchdog: int
    current: int
    velocity: int
    goal: int


def profile_speed(written: Written) -> float:
    """Return the largest speed of a servo with the written values, pulses/s."""
    return written.velocity * VELOCITY_UNIT / RADIANS_PER_PULSE


@dataclass(frozen=True)
class ServoState:
    """
    One servo at a time between asked and time (s), when its reply was received.

    position: pulses.  current: counts.  tick: ms.  alert: whether it has a hardware error.
    torque: whether it is on.
    """

    asked: float
    time: float
    written: Written
    position: int
    current: int
    tick: int
    alert: bool
    torque: bool = True

    @classmethod
    def from_reply(cls, reply: Reply, asked: float, time: float) -> 'ServoState':
        """Return the state in a reply to a sync read of BLOCK."""
        def get(register: Register) -> int:
            return register.decode(reply.data, BLOCK[0])

        return cls(asked, time, Written(get(BUS_WATCHDOG), get(GOAL_CURRENT),
                                        get(PROFILE_VELOCITY),
                                        get(GOAL_POSITION)),
                   get(PRESENT_POSITION), get(PRESENT_CURRENT), get(REALTIME_TICK), reply.alert,
                   bool(get(TORQUE_ENABLE)))

    def follows(self, earlier: 'ServoState', fastest: float) -> bool:
        """Whether this state is plausible after ``earlier``; fastest: pulses/s."""
        elapsed = self.time - earlier.asked  # at most: a busy computer sees a reply late
        ticks = (self.tick - earlier.tick) % TICK_RANGE
        new = ticks > 0 or self.time - earlier.time < 0.002
        return (new and 1e-3 * ticks <= elapsed + TICK_TOLERANCE
                and abs(self.position - earlier.position) <= fastest * (elapsed + 0.02) + 20)


def read_states(bus: DynamixelBus, servos: Sequence[FoundServo]) -> list[ServoState]:
    """Return the state of all servos, by the fastest read instruction that they support."""
    ids = [servo.id for servo in servos]
    fast = bus.fast is not False
    for attempt in range(ATTEMPTS):
        bus.fast = fast and attempt < 2  # older firmware has no Fast Sync Read
        asked = bus.clock()
        try:
            replies = bus.sync_read(ids, *BLOCK)
        except (NoReplyError, DamagedReplyError) as error:
            reason = error
            continue
        return [ServoState.from_reply(reply, asked, bus.clock()) for reply in replies]
    raise HardwareError(f'the servos reply individually, but not together: {reason}')


def take_over(bus: DynamixelBus, servos: Sequence[FoundServo], spools: Spools,
              states: Sequence[ServoState]) -> list[ServoState]:
    """
    Let all servos hold, within their tension limits and with their watchdogs armed.

    Returns their states with what was written.  Raises HardwareError for a servo that rejects it.
    """
    goals, off = [], []
    for servo, state in zip(servos, states, strict=True):
        goal, most = state.position, MAX_LEAD
        if servo.get(TORQUE_ENABLE) != 1:
            off.append(servo)
        elif state.written.velocity > 0 and state.written.watchdog != WATCHDOG_TRIGGERED:
            goal = state.written.goal
        else:
            goal, most = bus.read(servo.id, POSITION_TRAJECTORY), MAX_LEAD_FOUND
        ahead = abs(goal - state.position) * RADIANS_PER_PULSE * servo.radius
        goals.append(goal if ahead <= most else state.position)
    wanted = [Written(WATCHDOG, servo.goal_current, _profile_velocity(servo, spools), goal)
              for servo, goal in zip(servos, goals, strict=True)]

    def write(register: Register, values: Sequence[int]) -> None:
        bus.sync_write(register, dict(zip(spools.ids, values, strict=True)))

    for _ in range(ATTEMPTS):
        # Goals first: after a watchdog is cleared the first goal counts, and it must be this one.
        write(BUS_WATCHDOG, [0] * len(servos))
        write(GOAL_POSITION, goals)
        write(STATUS_RETURN_LEVEL, [2] * len(servos))
        write(PROFILE_ACCELERATION, [0] * len(servos))
        write(PROFILE_VELOCITY, [w.velocity for w in wanted])
        write(GOAL_CURRENT, [w.current for w in wanted])
        write(GOAL_PWM, [servo.get(PWM_LIMIT) for servo in servos])
        held_by = [state.written for state in read_states(bus, servos)]
        if [(w.goal, w.current, w.velocity) for w in held_by] == [
                (w.goal, w.current, w.velocity) for w in wanted]:
            break
    else:
        raise _unkept(held_by, wanted)
    for servo in off:
        _switch_on(bus, servo)
    if off:  # one may have been turned by hand meanwhile
        for i, state in enumerate(read_states(bus, servos)):
            if servos[i] in off:
                goals[i] = state.position
                wanted[i] = replace(wanted[i], goal=state.position)
    for _ in range(ATTEMPTS):
        write(GOAL_POSITION, goals)  # switching on sets it to the present position
        write(BUS_WATCHDOG, [WATCHDOG] * len(servos))
        found = read_states(bus, servos)
        if [state.written for state in found] == wanted:
            return found
    raise _unkept([state.written for state in found], wanted)


def _unkept(held_by: Sequence[Written], wanted: Sequence[Written]) -> HardwareError:
    return HardwareError(f'the servos do not keep the values written to them: {held_by} instead '
                         f'of {wanted}; check the line')


def _switch_on(bus: DynamixelBus, servo: FoundServo) -> None:
    for attempt in range(ATTEMPTS):
        try:
            bus.write(servo.id, TORQUE_ENABLE, 1)
            return
        except ServoRejectedError as error:
            raise HardwareError(f'{servo} cannot switch its torque on: {error}; switch it off and '
                                'on') from None
        except (NoReplyError, DamagedReplyError):
            if attempt == ATTEMPTS - 1:
                raise


def _profile_velocity(servo: FoundServo, spools: Spools) -> int:
    return max(1, round(SPEED_MARGIN * spools.speed_limit / servo.radius / VELOCITY_UNIT))


class Exchange:
    """
    Writes to servos and reads them.

    missed: number of successive reads without a valid reply.
    """

    def __init__(self, bus: DynamixelBus, servos: Sequence[FoundServo],
                 found: Sequence[ServoState]) -> None:
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
            if not state.follows(before, 2.0 * profile_speed(wanted)):  # it swings
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

    def _why_other(self, servo: FoundServo, found: Written, written: Written) -> str:
        """Explain why a servo does not hold the written values."""
        if found.watchdog == WATCHDOG_TRIGGERED:
            return (f'the watchdog of {servo} stopped it, because it received nothing for '
                    f'{written.watchdog * WATCHDOG_UNIT:g} s; the computer is too busy')
        if found.watchdog == 0:
            return (f'{servo} was reset or lost power for a moment: its torque was off, and its '
                    'turn count is lost; check its supply')
        return f'{servo} does not keep the values written to it ({found} instead of {written})'

    def _explain_alert(self, servo: FoundServo) -> None:
        with contextlib.suppress(NoReplyError, DamagedReplyError):
            if status := self._bus.read(servo.id, HARDWARE_ERROR):
                raise HardwareError(
                    f'{servo} has shut down or is about to: {explain_hardware_error(status)}; '
                    f'its tendon may have no tension; {CALIBRATE} reboots it')
