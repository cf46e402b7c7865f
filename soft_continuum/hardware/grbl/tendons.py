# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Steppers on GRBL 1.1 controllers: the axes X, Y, Z, A are the tendons in their order.

In a session nothing waits.  On any failure HardwareError is raised and the connection ends.

    RESTING -TARGET-> JOGGING -RESTED-> RESTING          JOGGING -STOP-> STOPPING -RESTED-> RESTING
    RESTING -HOME-> HOMING_REQUESTED -HOME_SENT-> SEEKING -HOME_DONE-> HOMED -RESTED-> RESTING
    SEEKING -STOP-> ABORTING_HOMING -HOME_DONE-> RESTING

From HOMED the tendons are pulled to zero by a jog: RESTED is followed by TARGET.
Several controllers are one driver, for arms with more tendons than one has axes.
"""

from collections.abc import Callable, Mapping, Sequence
import contextlib
from dataclasses import dataclass
from enum import auto, Enum
import threading
from typing import Any, ClassVar, TypeVar

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.grbl import PARAMETERS
from soft_continuum.hardware.grbl.link import (
    Acknowledgement,
    Alarm,
    Banner,
    FEED_HOLD,
    GrblLink,
    JOG_CANCEL,
    jog_line,
    Message,
    SOFT_RESET,
    STATUS_QUERY,
    StatusReport,
)
from soft_continuum.hardware.grbl.motion import add, JOG_TIME, JogStream, Motors, Steps, subtract
from soft_continuum.hardware.grbl.setup import (
    bears_mark,
    Controller,
    explain_alarm,
    explain_error,
    find_controller,
    invalid_settings,
    is_mark,
    mark_reference,
    MARKED,
    MODES,
    OFFSETS,
    UNLOCK,
)
from soft_continuum.hardware.protocols import (
    Accuracy,
    check_motion,
    describe_pulls,
    HardwareError,
    TendonDriver,
    TendonReading,
)
from soft_continuum.hardware.serial_tendons import (
    POLL_INTERVAL,
    SerialTendons,
    Session,
    STOP_TIMEOUT,
)
from soft_continuum.parameters.parameter import Parameter

MOVING_QUERY_INTERVAL, RESTING_QUERY_INTERVAL = 0.025, 0.1  # s between two status queries
QUERY_TIMEOUT = 0.2  # s for the answer to a status query
MAX_UNANSWERED_QUERIES = 4  # in succession
ACKNOWLEDGEMENT_TIMEOUT = 0.6  # s for the answer to a line
STOP_RETRY_INTERVAL = 0.2  # s after which a stop that shows no effect is sent again
PROGRESS_TIMEOUT = 0.5  # s without a step while motion is queued
MIN_REPORTS = 4
"""Reports or attempts that a timeout also needs, since this computer may have been late."""
CERTAIN_REPORTS = 2
"""Required successive reports: a late jog can be queued while one report shows Idle."""
HOMING_TIMEOUT = 60.0  # s
HOMING_SPEED = 0.005
"""m/s at which tendons are pulled from the switches to zero."""
STOP_PINS = frozenset('HRD')
ERROR_NOT_IDLE = 8
HOME = '$H'
MINUTE = 60.0  # s
SAME_SPEED = 0.02  # relative, of boards that move together

T = TypeVar('T')


class GrblState(Enum):
    """State of a controller, as known to its driver."""

    RESTING = auto()
    JOGGING = auto()
    """Jogs are queued or still to be sent."""
    STOPPING = auto()
    """A feed hold was sent, or the reference was lost, and rest is not certain yet."""
    HOMING_REQUESTED = auto()
    """The homing cycle is the next line to be sent."""
    SEEKING = auto()
    """The homing cycle runs: the switches are searched for, and nothing else is answered."""
    ABORTING_HOMING = auto()
    """A soft reset was sent to end the homing cycle; an alarm must follow."""
    HOMED = auto()
    """The switches were found, and rest is not certain yet."""
    FAILED = auto()
    """All motion was ended, and nothing leads out of this but a new connection."""


class Event(Enum):
    """
    Events that change the state.

    TARGET: there is motion to be sent.  RESTED: all motion has ended.  HOME_DONE: the homing cycle
    was acknowledged.  LOCKED: the controller is locked until it is homed.
    """

    TARGET, RESTED, STOP, HOME, HOME_SENT, HOME_DONE, LOCKED, REFERENCE_LOST, FAILURE = range(9)


BUSY = frozenset(GrblState) - {GrblState.RESTING, GrblState.FAILED}
"""States in which the tendons move or may move."""

_TRANSITIONS = {
    Event.TARGET: {GrblState.RESTING: GrblState.JOGGING},
    Event.RESTED: dict.fromkeys(
        (GrblState.JOGGING, GrblState.STOPPING, GrblState.HOMED), GrblState.RESTING),
    Event.STOP: {GrblState.JOGGING: GrblState.STOPPING,
                 GrblState.SEEKING: GrblState.ABORTING_HOMING,
                 GrblState.HOMING_REQUESTED: GrblState.RESTING,
                 GrblState.HOMED: GrblState.RESTING},
    Event.HOME: {GrblState.RESTING: GrblState.HOMING_REQUESTED},
    Event.HOME_SENT: {GrblState.HOMING_REQUESTED: GrblState.SEEKING},
    Event.HOME_DONE: {GrblState.SEEKING: GrblState.HOMED,
                      GrblState.ABORTING_HOMING: GrblState.RESTING},
    Event.LOCKED: {GrblState.STOPPING: GrblState.RESTING},
    Event.REFERENCE_LOST: dict.fromkeys(set(GrblState) - {GrblState.FAILED}, GrblState.STOPPING),
    Event.FAILURE: dict.fromkeys(GrblState, GrblState.FAILED),
}


def next_state(state: GrblState, event: Event) -> GrblState:
    """Return the state after an event; events without a transition change nothing."""
    return _TRANSITIONS[event].get(state, state)


@dataclass
class ProgressTimer:
    """A pending event: its start (s), and the reports or attempts since."""

    since: float
    count: int = 0

    def expired(self, timeout: float, now: float) -> bool:
        """Whether it took too long (s), unless this computer was late."""
        return now - self.since > timeout and self.count >= MIN_REPORTS


class GrblSession(Session[GrblLink]):
    """The session of a controller that was found at rest."""

    CYCLE, RESTING_CYCLE = JOG_TIME / 4, RESTING_QUERY_INTERVAL / 2

    def __init__(self, link: GrblLink, found: Controller, motors: Motors) -> None:
        """Take over a controller that was ``found`` on ``link``."""
        super().__init__(link)
        now, self._motors = link.clock(), motors
        braking = min(found.settings[120 + i] / scale
                      for i, scale in enumerate(motors.steps_per_metre))
        self._jogs = JogStream(motors, braking)
        self.state = GrblState.RESTING
        self.position = motors.to_steps(found.position)
        self._zero = motors.to_steps(found.zero or (0.0,) * len(self.position))
        self._speeds = (0.0,) * len(self.position)  # m/s
        known = found.zero is not None and not found.locked
        self._unreferenced = '' if known else 'no zero since the controller was started or reset'
        self._marked = known  # whether the controller has the mark of the reference, or must have
        self._mark_found = False  # in the answer to OFFSETS
        self._jogs.place(self.position)
        self._target: tuple[Steps, float] | None = None  # of the last move, and its arrival (s)
        self._setup_lines = [MODES] if known else []
        self._queried_at = self._reported_at = now  # s, the last time
        self._unanswered_queries = 0
        self._idle_reports = CERTAIN_REPORTS  # in succession, at one place
        self._stray_reports = 0  # in succession, off the planned path
        self._acknowledgement = ProgressTimer(now)
        self._state_watch = ProgressTimer(now)  # since it began or, in JOGGING, the last progress
        self._hold_sent_at = 0.0  # feed hold, or soft reset while homing, s
        self._reset_sent_at = 0.0  # s, 0 when none is under way

    @property
    def fastest(self) -> float:
        """Speed of the fastest motion that is planned, m/s."""
        return self._jogs.speed_limit

    @property
    def moving(self) -> bool:
        """Whether the tendons move or may move."""
        return self.state in BUSY

    # Requests

    def _reading(self) -> TendonReading:
        """Return the state of the last status report, which is at most some 0.1 s old."""
        slowest = 1.0 / max(self._motors.steps_per_metre) / MOVING_QUERY_INTERVAL
        pulls = self._motors.to_pulls(subtract(self.position, self._zero))
        return TendonReading(pulls, self._shown(self._speeds, (slowest,) * len(pulls)),
                             referenced=not self._unreferenced, unreferenced=self._unreferenced,
                             accuracy=self._motors.accuracy)

    def _move(self, pulls: tuple[float, ...], arrival: float) -> bool:
        self._target = add(self._zero, self._motors.from_pulls(pulls)), arrival
        if self.state is not GrblState.STOPPING:
            self._aim(self.link.clock())
        return True  # jogs are short

    def _stop(self) -> None:
        """Brake as the controller can without losing a step, then hold."""
        self._target = None
        if self.state is GrblState.HOMING_REQUESTED:
            self._setup_lines = []
        self._begin_stop()
        if self.state is GrblState.ABORTING_HOMING:  # nothing but a reset ends a homing cycle
            self._hold_sent_at = self.link.clock()
            self.link.write(SOFT_RESET)

    def _reference(self) -> None:
        if self._motors.homes:
            self._unreferenced = 'homing has not ended'
            self._fire(Event.HOME)
            self._setup_lines = [HOME]
            self._idle_reports = 0
            return
        self._zero = self.position
        self._unreferenced = ''
        self._jogs.place(self.position)
        self._mark_reference()

    def fail(self, reason: str) -> None:
        """End all motion, and the connection, for good."""
        with self._lock:
            self.failure = reason
            self._fire(Event.FAILURE)
            with contextlib.suppress(HardwareError):
                # The one stop that leaves nothing pending at rest, and the one that ends homing.
                self.link.write(SOFT_RESET if self.link.unanswered == HOME else JOG_CANCEL)

    # What is sent

    def cycle(self) -> None:
        """Process messages, and send due commands."""
        with self._lock:
            for message in self.link.receive():
                self.handle(message, self.link.clock())
            self.act(self.link.clock())

    def act(self, now: float) -> None:
        """Send due commands, and check that earlier ones are answered in time."""
        stopping = self.state in (GrblState.STOPPING, GrblState.ABORTING_HOMING)
        if stopping and self._state_watch.expired(STOP_TIMEOUT, now):
            raise self._unconfirmed()
        if self.link.unanswered == HOME:  # status queries are not answered either
            self._watch_homing(now)
            return
        if self.link.unanswered and self._acknowledgement.expired(ACKNOWLEDGEMENT_TIMEOUT, now):
            raise HardwareError(
                f'the GRBL controller did not acknowledge {self.link.unanswered!r}, so the '
                'motion was ended; check the cable')
        self._query_status(now)
        if self.state is GrblState.STOPPING or self.link.unanswered:
            return
        if self._setup_lines:
            line = self._setup_lines.pop(0)
            self._send(line)
            if line == HOME:
                self._fire(Event.HOME_SENT)
        elif jog := self._jogs.next_jog(now):
            self._idle_reports = 0
            self._send(jog_line(subtract(jog.end, jog.start), jog.feed * MINUTE))

    def _send(self, line: str) -> None:
        self._acknowledgement = ProgressTimer(self.link.clock())
        self.link.send(line)

    def _query_status(self, now: float) -> None:
        interval = MOVING_QUERY_INTERVAL if self.busy else RESTING_QUERY_INTERVAL
        if now - self._queried_at < (QUERY_TIMEOUT if self._unanswered_queries else interval):
            return
        if self._unanswered_queries == MAX_UNANSWERED_QUERIES:
            raise HardwareError(
                f'the GRBL controller has not answered for {now - self._reported_at:.1f} s; '
                'check cable and power')
        self._queried_at = now
        self._unanswered_queries += 1
        self.link.write(STATUS_QUERY)

    def _watch_homing(self, now: float) -> None:
        if self.state is GrblState.SEEKING and now - self._state_watch.since > HOMING_TIMEOUT:
            raise HardwareError(
                f'homing has not ended within {HOMING_TIMEOUT:g} s; check switches, motors and '
                'the travel settings, $130 and following')
        stop_sent = now - self._hold_sent_at
        if self.state is GrblState.ABORTING_HOMING and stop_sent > STOP_RETRY_INTERVAL:
            self._hold_sent_at = now
            self._state_watch.count += 1
            self.link.write(SOFT_RESET)

    # What is received

    def handle(self, message: Message, now: float) -> None:
        """Process one message; raises HardwareError when it reports a failure."""
        if isinstance(message, Alarm):
            raise HardwareError(explain_alarm(message.number))
        if isinstance(message, Banner):
            self._on_reset()
        elif isinstance(message, Acknowledgement):
            self._on_acknowledgement(message)
        elif is_mark(message):
            self._mark_found = True
        elif isinstance(message, StatusReport) and message.position is not None:
            self._on_status(message, self._motors.to_steps(message.position), now)

    def _on_reset(self) -> None:
        # No acknowledgement follows any more, or a late one without meaning.
        doubted = OFFSETS in (self.link.answered(), *self._setup_lines)
        self._setup_lines = []
        if self._reset_sent_at and not doubted:  # by the driver, at rest: the position is kept
            self._reset_sent_at = 0.0
            if not self._unreferenced:
                self._mark_reference()
        else:
            self._lose_reference('the controller was reset')

    def _on_acknowledgement(self, message: Acknowledgement) -> None:
        line = self.link.answered()
        self._hold_sent_at = 0.0  # it may have started a motion that the feed hold preceded
        if message.error == ERROR_NOT_IDLE and line.startswith('$J='):
            # A jog that arrived just as the one before ended runs as a program, which takes no
            # further jogs.  End it; the motion continues from there.
            self._begin_stop()
        elif message.error and line:
            raise HardwareError(explain_error(line, message.error))
        elif line == HOME:
            self._unanswered_queries = self._idle_reports = 0
            self._fire(Event.HOME_DONE)
        elif line == OFFSETS:
            self._end_doubt()
        elif line == MARKED:
            self._marked = True

    def _on_status(self, status: StatusReport, steps: Steps, now: float) -> None:
        still = steps == self.position
        elapsed = max(now - self._reported_at, 1e-3)
        travel = self._motors.to_pulls(subtract(steps, self.position))
        self._speeds = tuple(distance / elapsed for distance in travel)
        self.position = steps
        self._reported_at, self._unanswered_queries = now, 0
        self._acknowledgement.count += 1
        self._state_watch.count += 1
        idle = status.state == 'Idle' and still and not self.link.unanswered
        self._idle_reports = self._idle_reports + 1 if idle else 0
        if self.state is GrblState.JOGGING and (not still or self._jogs.arrived(steps)):
            self._state_watch = ProgressTimer(now)
        self._check_path(steps)
        if self._marked and not self._unreferenced and not bears_mark(status, self._zero):
            self._doubt()
        if status.state == 'Alarm' and self._motors.homes and self._unreferenced:
            self._fire(Event.LOCKED)
            self._jogs.place(steps)
            return
        self._check_status(status)
        rested = self._idle_reports >= CERTAIN_REPORTS
        if self.state is GrblState.STOPPING:
            self._continue_stop(status, rested, now)
        elif rested and self.state is GrblState.HOMED:
            self._pull_to_zero(now)
        elif rested:
            self._check_arrival(status)
        elif self.state is GrblState.JOGGING and self._state_watch.expired(PROGRESS_TIMEOUT, now):
            raise HardwareError(
                f'the GRBL controller reports {status.state}, but has made no step for '
                f'{PROGRESS_TIMEOUT:g} s at {self._describe(steps)}; reset the board')

    def _check_path(self, steps: Steps) -> None:
        """Lose the reference when the position jumped."""
        fastest = max(abs(speed) for speed in self._speeds)
        if self._jogs.observe(steps, fastest) or self._unreferenced:
            self._stray_reports = 0
            return
        self._stray_reports += 1
        if self._stray_reports == CERTAIN_REPORTS:
            self._lose_reference('the position left the planned path, as after a reset of the '
                                 'controller or a damaged command')

    def _doubt(self) -> None:
        """Rest, and request the mark again: the line that indicates a reset may be damaged."""
        self._marked = self._mark_found = False
        self._begin_stop()
        self._setup_lines = [OFFSETS]

    def _end_doubt(self) -> None:
        if self._mark_found:
            self._mark_reference()  # another program may have changed the offset
        else:
            self._lose_reference('the controller was reset')

    def _check_status(self, status: StatusReport) -> None:
        if status.state == 'Alarm':
            raise HardwareError(f'the GRBL controller is locked (Alarm); {UNLOCK}')
        if status.state not in ('Idle', 'Jog', 'Run', 'Home') and not (
                status.state == 'Hold' and self.state is GrblState.STOPPING):
            raise HardwareError(
                f'the GRBL controller entered the state {status.state}, which the driver did not '
                f'request; {UNLOCK}')
        if pins := STOP_PINS.intersection(status.pins):
            # During a jog the firmware only cancels what is queued, and would take the next one.
            raise HardwareError(
                f'a stop button or pin at the GRBL board is active ({", ".join(sorted(pins))}: '
                'H hold, R reset, D door); release it')

    def _check_arrival(self, status: StatusReport) -> None:
        if not self._jogs.arrived(self.position) and not self._unreferenced:
            raise HardwareError(
                f'the GRBL controller stopped at {self._describe(self.position)}, short of '
                f'{self._describe(self._jogs.end)}, in the state {status.state} (a button or a '
                'pin at the board?)')
        self._jogs.clear_queue()
        if not self._jogs.moving:
            self._fire(Event.RESTED)

    def _continue_stop(self, status: StatusReport, rested: bool, now: float) -> None:
        """See a stop through: a feed hold may meet a jog, a program, or no motion at all."""
        if rested:
            if self._reset_sent_at:  # the banner was lost
                self._on_reset()
            self._fire(Event.RESTED)
            self._jogs.place(self.position)
            self._aim(now)
        elif status.state == 'Hold' and status.substate == '0':
            if now - self._reset_sent_at > STOP_RETRY_INTERVAL:
                self._reset_sent_at, self._marked = now, False
                self.link.write(SOFT_RESET)  # at rest: this only drops what is queued
        elif status.state in ('Jog', 'Run') and now - self._hold_sent_at > STOP_RETRY_INTERVAL:
            self._hold_sent_at = now
            self.link.write(FEED_HOLD)

    def _pull_to_zero(self, now: float) -> None:
        """Take the zero from where the switches are, and move there."""
        pulls = self._motors.homed_pulls
        self._zero = subtract(self.position, self._motors.from_pulls(pulls))
        self._unreferenced = ''
        self._fire(Event.RESTED)
        self._jogs.place(self.position)
        self._target = self._zero, now - min(pulls) / HOMING_SPEED
        self._aim(now)
        self._mark_reference()

    # Changes of state

    def _fire(self, event: Event) -> None:
        before, self.state = self.state, next_state(self.state, event)
        if self.state is not before:
            self._state_watch = ProgressTimer(self.link.clock())

    def _aim(self, now: float) -> None:
        """Move to the target, if there is one."""
        if self._target is not None:
            self._jogs.set_target(*self._target, now)
            self._fire(Event.TARGET if self._jogs.moving else Event.RESTED)

    def _begin_stop(self) -> None:
        jogging = self.state is GrblState.JOGGING
        self._fire(Event.STOP)
        if jogging:
            self._hold_sent_at, self._idle_reports = self.link.clock(), 0
            self.link.write(FEED_HOLD)

    def _lose_reference(self, reason: str) -> None:
        self._unreferenced = reason
        self._target = None
        self._jogs.place(self.position)
        self._fire(Event.REFERENCE_LOST)

    def _mark_reference(self) -> None:
        self._setup_lines = mark_reference(subtract(self.position, self._zero))
        self._marked = False

    def _describe(self, steps: Steps) -> str:
        pulls = self._motors.to_pulls(subtract(steps, self._zero))
        return describe_pulls(self._motors.tendons, pulls)


class GrblTendons(SerialTendons[GrblLink, GrblSession]):
    """
    Steppers on a GRBL controller; see TendonDriver for what the methods promise.

    ``reference`` takes the present position as zero, or homes: it pays all tendons out to their
    switches and pulls them to zero, to be just taut on the straight arm.
    """

    LINK = GrblLink
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = PARAMETERS
    COMMISSIONING = 'soft_continuum.hardware.grbl.commissioning'
    EMULATOR = 'soft_continuum.sim.emulators.grbl'

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]
                        ) -> TendonDriver:
        """
        Return the driver that the parameters of the node describe.

        clock: not used; a device continues when a node's clock is paused or set.  Raises
        ParameterError.
        """
        boards = [cls(port, values['grbl.baud_rate'], motors)
                  for port, motors in Motors.of_boards(values)]
        return boards[0] if len(boards) == 1 else GrblBoards(boards)

    def __init__(self, port: str, baud_rate: int, motors: Motors, clock: Clock = STEADY) -> None:
        """Describe the device; nothing is opened yet."""
        super().__init__(
            port, baud_rate, motors.tendons, motors.pull_limits, motors.homes, clock)
        self._motors = motors

    def start(self, link: GrblLink) -> GrblSession:
        """Take the controller over; raises HardwareError when its settings are not as needed."""
        found = find_controller(link)
        if unfit := invalid_settings(found.settings, self._motors):
            raise HardwareError('the settings of the GRBL controller contradict the '
                                'configuration: ' + '; '.join(unfit))
        if found.locked and not self.reference_moves:
            raise HardwareError(f'the GRBL controller is locked (Alarm); {UNLOCK}')
        return GrblSession(link, found, self._motors)

    @property
    def fastest(self) -> float:
        """Speed of the fastest motion that the controller can brake in time, m/s."""
        with self._lock:
            return self._connected().fastest


class GrblBoards:
    """
    Boards that each move some of the tendons, in their order; see TendonDriver.

    When one fails the others are stopped.  Only the clock of this computer synchronizes them: in
    motion, one may be some 20 ms behind another.
    """

    def __init__(self, boards: Sequence[GrblTendons], clock: Clock = STEADY) -> None:
        """Describe the devices; nothing is opened yet."""
        self._boards, self.clock = tuple(boards), clock
        self.reference_moves = boards[0].reference_moves
        self._lock = threading.Lock()
        self._closed = True

    def open(self) -> None:
        """Connect all of them, or none; raise HardwareError."""
        with self._lock:
            self._closed = False
        failed = self._at_once(lambda board: board.open())
        with self._lock:
            closed = self._closed
        if not (failed or closed):
            failed = self._uneven()
        if failed or closed:
            self.close()
            raise failed[0] if failed else HardwareError('closed while it was being opened')

    def _uneven(self) -> list[HardwareError]:
        """Return what to raise for boards of which some are slower: tendons would not arrive."""
        speeds = self._each(lambda board: board.fastest)
        if max(speeds) <= (1.0 + SAME_SPEED) * min(speeds):
            return []
        each = '; '.join(f'{1e3 * speed:.1f} mm/s for {", ".join(board.tendons)}'
                         for speed, board in zip(speeds, self._boards, strict=True))
        return [HardwareError(
            'the GRBL controllers accelerate differently, so some tendons would arrive later than '
            f'others: {each}; set $120 and following of all to the same acceleration')]

    def close(self) -> None:
        """Stop, hold and disconnect; an ``open`` under way ends with HardwareError."""
        with self._lock:
            self._closed = True
        self._at_once(lambda board: board.close())

    def read(self) -> TendonReading:
        """Return the last state of all of them."""
        readings = self._each(lambda board: board.read())
        return TendonReading(
            tuple(pull for reading in readings for pull in reading.pulls),
            tuple(speed for reading in readings for speed in reading.speeds),
            all(reading.referenced for reading in readings),
            unreferenced='; '.join(dict.fromkeys(filter(None, (
                reading.unreferenced for reading in readings)))),
            accuracy=Accuracy(tuple(tolerance for reading in readings
                                    for tolerance in reading.accuracy.pull_tolerances)))

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move all tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""
        tendons = [name for board in self._boards for name in board.tendons]
        check_motion(tendons, pulls, duration)
        wanted = dict(zip(tendons, pulls, strict=True))

        def move(board: GrblTendons) -> None:
            board.move(tuple(wanted[name] for name in board.tendons), duration)

        for board in self._boards:  # one that refuses must not have others stopped, or not homed
            if not board.read().referenced:
                try:
                    move(board)
                except HardwareError as error:
                    raise self._named(board, error) from None
        self._each(move)

    def stop(self) -> None:
        """Brake all of them, even if some fail, then hold."""
        failed: list[HardwareError] = []
        for board in self._boards:
            try:
                board.stop()
            except HardwareError as error:
                failed.append(self._named(board, error))
        if failed:
            raise failed[0]

    def reference(self) -> None:
        """Take the present position as zero pull, or home."""
        if self.read().moving:  # of which the first to refuse would have the others stopped
            raise HardwareError('the tendons are moving; wait until they rest')
        self._each(lambda board: board.reference())

    def _at_once(self, act: Callable[[GrblTendons], None]) -> list[HardwareError]:
        """Act on all boards at the same time, and wait for them; return what they raised."""
        failed: dict[GrblTendons, HardwareError] = {}

        def run(board: GrblTendons) -> None:
            try:
                act(board)
            except HardwareError as error:
                failed[board] = self._named(board, error)
            except Exception as error:  # it must not pass for done because its thread ended
                failed[board] = self._named(board, f'{type(error).__name__}: {error}')

        threads = [threading.Thread(target=run, args=(board,), daemon=True)
                   for board in self._boards]
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads):
            self.clock.sleep(POLL_INTERVAL)
        return [failed[board] for board in self._boards if board in failed]

    def _each(self, act: Callable[[GrblTendons], T]) -> list[T]:
        """Act on every board; when one fails stop all and raise HardwareError."""
        done = []
        for board in self._boards:
            try:
                done.append(act(board))
            except HardwareError as error:
                with contextlib.suppress(HardwareError):
                    self.stop()
                raise self._named(board, error) from None
        return done

    def _named(self, board: GrblTendons, error: object) -> HardwareError:
        return HardwareError(f'{error} (the controller of {", ".join(board.tendons)})')
