# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tendons on spools of Dynamixel X servos, which limit their current and so the tension.

The servos are in mode 5, current-based position control.  One thread owns their bus: its ``cycle``
waits for their replies, while requests from other threads only take a lock.  Every cycle sends the
goals of the next hundredth of a second and reads all servos.  A write is not acknowledged, but
each reply contains the values that the driver wrote: a reply that does not repeat them is not the
present one of this servo, or a write was lost and is repeated.

Nothing moves when servos are taken over.  Those that hold goals of this driver keep them.  Others
with torque keep their present goal, for example where their watchdog stopped them, which under
load is a little ahead of their position.  Those without torque hold their position.  Torque stays
on, also after close; nothing here writes their EEPROM, reboots them or switches torque off.
"""

from collections.abc import Callable, Mapping, Sequence
import contextlib
from dataclasses import replace
from enum import Enum
import logging
from pathlib import Path
from typing import Any, ClassVar, Self

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.dynamixel import PARAMETERS
from soft_continuum.hardware.dynamixel.bus import (
    DamagedReplyError,
    DynamixelBus,
    NoReplyError,
    ServoRejectedError,
)
from soft_continuum.hardware.dynamixel.motion import (
    Following,
    HeldPath,
    MAX_LEAD,
    REST_TIME,
    TakeUp,
    Track,
)
from soft_continuum.hardware.dynamixel.reference import find_zeros, mark_zeros, Zero, ZeroFile
from soft_continuum.hardware.dynamixel.registers import (
    BUS_WATCHDOG,
    explain_hardware_error,
    GOAL_CURRENT,
    GOAL_POSITION,
    GOAL_PWM,
    HARDWARE_ERROR,
    MAX_POSITION,
    POSITION_TRAJECTORY,
    PROFILE_ACCELERATION,
    PROFILE_VELOCITY,
    PULSES_PER_TURN,
    PWM_LIMIT,
    RADIANS_PER_PULSE,
    REALTIME_TICK,
    Register,
    STATUS_RETURN_LEVEL,
    TORQUE_ENABLE,
    VELOCITY_UNIT,
    WATCHDOG_TRIGGERED,
    WATCHDOG_UNIT,
)
from soft_continuum.hardware.dynamixel.setup import (
    ATTEMPTS,
    BLOCK,
    CALIBRATE,
    find_servos,
    FoundServo,
    FRICTION_SHARE,
    problems,
    profile_speed,
    read_states,
    ServoState,
    Spools,
    Written,
)
from soft_continuum.hardware.protocols import Accuracy, HardwareError, TendonReading
from soft_continuum.hardware.serial_tendons import (
    POLL_INTERVAL,
    SerialTendons,
    Session,
    STOP_TIMEOUT,
)
from soft_continuum.parameters.parameter import Parameter
from soft_continuum.user_files import dynamixel_zeros

LOG = logging.getLogger('soft_continuum.hardware.dynamixel')
MAX_READ_TIME = 0.05  # s for all servos
SILENCE_TIMEOUT, MIN_MISSED = 0.15, 4
"""Time (s) and number of successive cycles without a valid reply that are a failure."""
WATCHDOG = 10  # units of WATCHDOG_UNIT
SPEED_MARGIN = 1.5
"""Factor over speed_limit that lets servos catch up after a delay."""
MAX_LEAD_FOUND = 0.002
"""Largest lead (m) of a goal that was not set by this driver."""
ARRIVAL_TIMEOUT = 2.0  # s after the end of the path
DISTANCE_BEHIND, TIME_BEHIND, BEHIND_TIMEOUT = 0.003, 0.15, 0.25
"""Allowed lag of a tendon, m and s of the fastest motion; s for which it may be exceeded."""


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


class MotionState(Enum):
    """What the tendons do."""

    RESTING = 'rest'
    MOVING = 'move'
    STOPPING = 'stop'
    TAKING_UP = 'take up slack'
    FAILED = 'failed'


BUSY = MotionState.MOVING, MotionState.STOPPING, MotionState.TAKING_UP


class DynamixelSession(Session[DynamixelBus]):
    """Servos that hold, and their known state."""

    CYCLE, RESTING_CYCLE = 0.01, 0.05

    def __init__(self, bus: DynamixelBus, servos: Sequence[FoundServo], spools: Spools,
                 found: Sequence[ServoState], zeros: Sequence[Zero], zero_file: ZeroFile) -> None:
        """Take over holding servos as they were ``found``, with the values written to them."""
        super().__init__(bus)
        self._servos, self._spools, self._zero_file = tuple(servos), spools, zero_file
        self.state = MotionState.RESTING
        self._exchange = Exchange(bus, servos, found)  # of the thread that owns the bus
        self._states = list(found)
        self._written = [state.written for state in found]
        self._unreferenced = '; '.join(zero.unknown for zero in zeros if zero.unknown)
        self._path = HeldPath(spools, [zero.position for zero in zeros], self._positions(),
                              [written.goal for written in self._written])
        self._track = Track(found[0].time, self._positions())
        self._following = Following(servos, spools, found)
        self._target: tuple[tuple[float, ...], float] | None = None  # and its arrival, s
        self._braked = False
        self._mark_due = not self._unreferenced  # where the zero was found in another way
        self._since = self._stepped = self._near = bus.clock()
        self._take_up: TakeUp | None = None
        self._accuracy = Accuracy(
            spools.arrival_tolerances, tuple(servo.least_stddev for servo in servos),
            (FRICTION_SHARE,) * len(servos))

    @property
    def moving(self) -> bool:
        """Whether the tendons may move."""
        return self.state in BUSY

    @property
    def busy(self) -> bool:
        """Whether the tendons may move, or writes or replies are pending."""
        return self.moving or self._mark_due or self._exchange.missed > 0

    # Requests

    def _reading(self) -> TendonReading:
        """Return the state of the last replies; it fails after 0.3 s without any."""
        scale = self._spools.pull_per_pulse
        speeds = self._shown(
            tuple(s * v for s, v in zip(scale, self._track.velocities(), strict=True)),
            tuple(abs(s) / REST_TIME for s in scale))
        # A tendon cannot push: what friction makes negative is no tension.
        tensions = tuple(
            max(0.0, sign * servo.tension(state.current)) for sign, servo, state in zip(
                self._spools.signs, self._servos, self._states, strict=True))
        return TendonReading(self._path.to_pulls(self._positions()), speeds,
                             not self._unreferenced, tensions, self._unreferenced, self._accuracy)

    def _move(self, pulls: tuple[float, ...], arrival: float) -> bool:
        rested = not self.busy
        if max(map(abs, self._path.to_pulses(pulls))) > MAX_POSITION - PULSES_PER_TURN:
            raise HardwareError(
                'a servo counts at most 256 turns and would exceed them; with slack tendons '
                'switch the servos off and on, and reference again')
        self._target = pulls, arrival
        if self.state is not MotionState.STOPPING:
            self._aim(self.link.clock())
        return rested  # cycles of a motion come regularly

    def _stop(self) -> None:
        """Brake as fast as the servos can, then hold."""
        self._target = None
        if self.state in (MotionState.MOVING, MotionState.TAKING_UP):
            self._braked = False
            self._enter(MotionState.STOPPING)

    def _reference(self) -> None:
        """Take the present position as zero pull, or begin to take up the slack."""
        if self._spools.take_up_tension > 0.0:
            self._unreferenced = 'the slack was not taken up'
            self._take_up = TakeUp(self._servos, self._spools, self._positions(),
                                   [w.goal for w in self._written], self.link.clock())
            self._enter(MotionState.TAKING_UP)
        else:
            self._take_zero([w.goal for w in self._written])

    def _enter(self, state: MotionState) -> None:
        self.state, self._since = state, self.link.clock()
        self._near = self._since

    def _aim(self, now: float) -> None:
        if self._target is not None:
            (pulls, arrival), self._target = self._target, None
            if self.state is MotionState.RESTING:
                self._path.place(self._positions(), [w.goal for w in self._written])
                self._following.place(self._states)
                self._enter(MotionState.MOVING)
            self._since = now
            self._path.aim(pulls, max(0.0, arrival - now))

    def _positions(self) -> tuple[int, ...]:
        return tuple(state.position for state in self._states)

    def _take_zero(self, goals: Sequence[int]) -> None:
        self._path.zeros[:] = self._positions()
        self._path.place(self._positions(), goals)
        self._unreferenced, self._mark_due = '', True

    # The cycle, on the thread that owns the bus

    def cycle(self) -> None:
        """Send what is due and read the servos; raises HardwareError when something fails."""
        with self._lock:
            braking = self.state is MotionState.STOPPING and not self._braked
            if not braking:
                self._plan(self.link.clock())
        if braking:  # from where the servos are now, not from where they were
            self._receive()
            with self._lock:
                if not self._exchange.missed:
                    self._brake()
        self._exchange.send(self._written)
        self._receive()
        with self._lock:
            self._judge(self.link.clock())
            marks, self._mark_due = self._mark_due, False
            zeros = list(self._path.zeros)
        if marks:
            self._zero_file.begin_write(self._servos, zeros)
            mark_zeros(self.link, self._servos, zeros)  # now, for the servos are at rest
        else:
            self._zero_file.check_written()

    def _plan(self, now: float) -> None:
        """Set what the servos are to do in this cycle."""
        elapsed, self._stepped = now - self._stepped, now
        if self.state is MotionState.TAKING_UP and self._take_up is not None:
            if not self._take_up.done:
                self._take_up.step(self._states, now)
            self._set(goals=self._take_up.goals, currents=self._take_up.currents)
        elif self.state in (MotionState.MOVING, MotionState.RESTING):
            if not self._exchange.missed:  # nothing moves on blindly
                self._path.advance(elapsed)
            if self._path.done and not self._exchange.missed:
                self._path.adapt(elapsed, self._positions(), [s.current for s in self._states],
                                 [w.current for w in self._written])
            self._set(goals=self._path.goals,
                      currents=[servo.goal_current for servo in self._servos])

    def _brake(self) -> None:
        """Send servos to where they come to rest soonest; once, or they would never rest."""
        self._braked = True
        self._set(goals=self._stop_goals())

    def _stop_goals(self) -> list[int]:
        held = self._path.holding_goals(self._positions(), [s.current for s in self._states])
        most = map(profile_speed, self._written)  # a reply that is dated late makes speeds larger
        return [round(goal + servo.stop_time * max(-top, min(top, speed)))
                for goal, servo, speed, top in zip(
                    held, self._servos, self._track.velocities(), most, strict=True)]

    def _set(self, goals: Sequence[int], currents: Sequence[int] | None = None) -> None:
        currents = currents or [written.current for written in self._written]
        self._written = [replace(written, goal=goal, current=current)
                         for written, goal, current in zip(
                             self._written, goals, currents, strict=True)]

    def _receive(self) -> None:
        """Read all servos; use their replies if all of them are valid."""
        missed = self._exchange.missed
        states = self._exchange.receive(self._written)
        if states is not None:
            with self._lock:
                before, self._states = self._states, states
                self._track.add(states[0].time, self._positions())
                self._following.add(before, states, bool(missed))

    # What the replies mean

    def _judge(self, now: float) -> None:
        """Go on with what the tendons do, as far as they have come."""
        if self._exchange.missed:
            if self.state is MotionState.STOPPING and now - self._since > STOP_TIMEOUT:
                raise self._unconfirmed()
            return
        still = self._track.still()
        if self.state is MotionState.STOPPING:
            if self._braked and still:
                self._path.place(self._positions(), [w.goal for w in self._written])
                self._enter(MotionState.RESTING)
                self._aim(now)
            elif now - self._since > STOP_TIMEOUT:
                raise self._unconfirmed()
        elif self.state is MotionState.TAKING_UP and self._take_up is not None:
            if self._take_up.done and still:
                self._end_take_up(self._take_up)
        else:
            self._watch_path(now, still)

    def _watch_path(self, now: float, still: bool) -> None:
        """See that the servos follow their path and arrive."""
        errors = self._path.errors(self._positions())
        scale = self._spools.pull_per_pulse
        most = DISTANCE_BEHIND + TIME_BEHIND * self._spools.speed_limit
        if max(abs(s * e) for s, e in zip(scale, errors, strict=True)) < most:
            self._near = now
        arrived = all(abs(e) <= t for e, t in zip(errors, self._path.tolerances, strict=True))
        if not self._path.done:
            self._since = now
        elif self.state is MotionState.MOVING and arrived and still:
            self._enter(MotionState.RESTING)
        late = self.state is MotionState.MOVING and now - self._since > ARRIVAL_TIMEOUT
        at = (None if self.state is not MotionState.MOVING or self._path.done
              else self._following.caught)
        if late or now - self._near > BEHIND_TIMEOUT:
            at = max(range(len(errors)), key=lambda i: abs(scale[i] * errors[i]))
        if at is not None:
            servo, state = self._servos[at], self._states[at]
            wanted = self._path.to_pulls(self._path.wanted)[at]
            raise HardwareError(
                f'{servo} is at {1e3 * self._path.to_pulls(self._positions())[at]:.2f} mm instead '
                f'of {1e3 * wanted:.2f} mm, with about {abs(servo.tension(state.current)):.1f} N '
                f'(dynamixel.tension_limits {servo.tension_limit:g} N): check what blocks the '
                'tendon')

    def _end_take_up(self, take_up: TakeUp) -> None:
        self._take_up = None
        if take_up.failed:
            self._path.place(self._positions(), self._positions())
            self._unreferenced = take_up.failed
        else:
            self._take_zero(self._positions())
        self._enter(MotionState.RESTING)

    # The end

    def fail(self, reason: str) -> None:
        """Hold the tendons where they are, and end the session."""
        with self._lock:
            moved = self.state in BUSY and not self._exchange.missed
            self.state, self.failure = MotionState.FAILED, reason
            # Where they are now, though they swing: what goes on alone strains the arm.
            goals = self._path.holding_goals(self._positions(), [s.current for s in self._states])
        if moved:
            with contextlib.suppress(HardwareError):
                self._exchange.write(GOAL_POSITION, goals)

    def release(self) -> None:
        """Let servos at rest hold without further communication."""
        with contextlib.suppress(HardwareError):
            self._exchange.write(BUS_WATCHDOG, [0] * len(self._servos))


class DynamixelTendons(SerialTendons[DynamixelBus, DynamixelSession]):
    """
    Servos on one bus, one per tendon; see TendonDriver for what the methods promise.

    ``reference`` takes the present position as zero, or takes up the slack slowly, one tendon
    after the other.
    """

    LINK = DynamixelBus
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = PARAMETERS
    COMMISSIONING = 'soft_continuum.hardware.dynamixel.commissioning'
    EMULATOR = 'soft_continuum.sim.emulators.dynamixel'

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]) -> Self:
        """
        Return the driver that the parameters of the node describe.

        clock: not used; a device continues when a node's clock is paused or set.  Raises
        ParameterError.
        """
        return cls(values['dynamixel.port'], values['dynamixel.baud'],
                   Spools.from_parameters(values), dynamixel_zeros())

    def __init__(self, port: str, baud_rate: int, spools: Spools, zeros: Path,
                 clock: Clock = STEADY) -> None:
        """Describe the devices; nothing is opened yet.  zeros: file of their zeros."""
        super().__init__(port, baud_rate, spools.tendons, spools.pull_limits,
                         spools.take_up_tension > 0.0, clock)
        self._spools, self._zero_file = spools, ZeroFile(zeros, port)

    def close(self) -> None:
        """Disconnect, and wait until the zeros are written; log if they cannot be."""
        super().close()
        while self._zero_file.writing:
            self.clock.sleep(POLL_INTERVAL)
        try:
            self._zero_file.check_written()
        except HardwareError as error:  # the session reports it, unless it ended before
            LOG.error(error)

    def start(self, link: DynamixelBus) -> DynamixelSession:
        """Take the servos over; raises HardwareError when they are not as needed."""
        spools = self._spools
        servos = find_servos(link, spools)
        if unfit := [line for servo in servos for line in problems(servo, spools.speed_limit)]:
            raise HardwareError('; '.join(unfit))
        states = read_states(link, servos)
        begin = self.clock()
        states = read_states(link, servos)
        if (took := self.clock() - begin) > MAX_READ_TIME:
            raise HardwareError(
                f'reading the servos takes {1e3 * took:.0f} ms at {link.baud_rate} baud; allowed: '
                f'{1e3 * MAX_READ_TIME:.0f} ms; set their Baud Rate (8) to 3 (1000000) or more, '
                'and Return Delay Time (9) to 0')
        zeros = find_zeros(link, servos, states, spools, self._zero_file)
        held = take_over(link, servos, spools, states)
        return DynamixelSession(link, servos, spools, held, zeros, self._zero_file)
