# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Taking over the servos that were found: their zeros, and holding torque.

Nothing moves.  Servos that hold goals of this driver keep them.  Others with torque keep their
present goal, for example where their watchdog stopped them, which under load is a little ahead of
their position.  Those without torque hold their position.
"""

from collections.abc import Sequence
import contextlib
from dataclasses import replace

from soft_continuum.hardware.dynamixel.bus import (
    DamagedReplyError,
    DynamixelBus,
    NoReplyError,
    RefusedError,
)
from soft_continuum.hardware.dynamixel.path import MAX_LEAD
from soft_continuum.hardware.dynamixel.reference import (
    mark,
    marked_zero,
    Zero,
    zero_within_turn,
    ZeroFile,
)
from soft_continuum.hardware.dynamixel.registers import (
    BUS_WATCHDOG,
    GOAL_CURRENT,
    GOAL_POSITION,
    GOAL_PWM,
    POSITION_TRAJECTORY,
    PROFILE_ACCELERATION,
    PROFILE_VELOCITY,
    PWM_LIMIT,
    RADIANS_PER_PULSE,
    Register,
    SPARE,
    STATUS_RETURN_LEVEL,
    TORQUE_ENABLE,
    VELOCITY_UNIT,
    WATCHDOG_TRIGGERED,
)
from soft_continuum.hardware.dynamixel.setup import Servo, Spools
from soft_continuum.hardware.dynamixel.state import BLOCK, ServoState, Written
from soft_continuum.hardware.protocols import HardwareError

WATCHDOG = 10  # units of WATCHDOG_UNIT
SPEED_MARGIN = 1.5
"""Factor over speed_limit that lets servos catch up after a delay."""
MAX_LEAD_FOUND = 0.002
"""Largest lead (m) of a goal that was not set by this driver."""
ATTEMPTS = 5  # to read all servos, and to write what they must have or keep


def read_states(bus: DynamixelBus, servos: Sequence[Servo]) -> list[ServoState]:
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


def find_zeros(bus: DynamixelBus, servos: Sequence[Servo], states: Sequence[ServoState],
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


def keep_zeros(bus: DynamixelBus, servos: Sequence[Servo], zeros: Sequence[int],
               zero_file: ZeroFile) -> None:
    """Mark zeros (Present Positions) in the servos and store them here; raises HardwareError."""
    ids = [servo.id for servo in servos]
    raw = [zero - servo.homing_offset for zero, servo in zip(zeros, servos, strict=True)]
    zero_file.write(ids, raw)
    marks = {servo: mark(servo, zero) for servo, zero in zip(ids, raw, strict=True)}
    for _ in range(ATTEMPTS):
        bus.sync_write(SPARE, marks)
        with contextlib.suppress(NoReplyError, DamagedReplyError):
            replies = bus.sync_read(ids, SPARE.address, SPARE.end)
            if [SPARE.decode(reply.data) for reply in replies] == [*marks.values()]:
                return
    raise HardwareError(
        f'the servos lose their zero in {SPARE}: does another program change their Indirect '
        'Addresses?  With slack tendons switch the servos off and on')


def take_over(bus: DynamixelBus, servos: Sequence[Servo], spools: Spools,
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
        raise HardwareError(f'the servos do not keep the values written to them: {held_by} '
                            f'instead of {wanted}; check the line')
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
    held_by = [state.written for state in found]
    raise HardwareError(f'the servos do not keep the values written to them: {held_by} instead '
                        f'of {wanted}; check the line')


def _switch_on(bus: DynamixelBus, servo: Servo) -> None:
    for attempt in range(ATTEMPTS):
        try:
            bus.write(servo.id, TORQUE_ENABLE, 1)
            return
        except RefusedError as error:
            raise HardwareError(f'{servo} cannot switch its torque on: {error}; switch it off and '
                                'on') from None
        except (NoReplyError, DamagedReplyError):
            if attempt == ATTEMPTS - 1:
                raise


def _profile_velocity(servo: Servo, spools: Spools) -> int:
    return max(1, round(SPEED_MARGIN * spools.speed_limit / servo.radius / VELOCITY_UNIT))
