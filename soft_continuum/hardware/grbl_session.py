# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
One connection to a GRBL controller: what is sent to it, and what its messages mean.

Nothing here waits.  When something is not as it must be HardwareError is raised, and the
connection is over.
"""

from dataclasses import dataclass

from soft_continuum.hardware.grbl_link import (
    Acknowledgement,
    Alarm,
    Banner,
    FEED_HOLD,
    GrblLink,
    jog_line,
    Message,
    SOFT_RESET,
    Status,
    STATUS_QUERY,
)
from soft_continuum.hardware.grbl_motion import add, JogStream, MM, Motors, Steps, subtract
from soft_continuum.hardware.grbl_setup import (
    Controller,
    explain_alarm,
    explain_error,
    Homing,
    mark_reference,
    UNLOCK,
)
from soft_continuum.hardware.grbl_states import BUSY, Event, next_state, State
from soft_continuum.hardware.protocols import HardwareError, TendonReading

MOVING_QUERY_INTERVAL, RESTING_QUERY_INTERVAL = 0.025, 0.1  # s between two status queries
QUERY_TIMEOUT = 0.2  # s for the answer to a status query
MAX_UNANSWERED_QUERIES = 4  # in succession
ACKNOWLEDGEMENT_TIMEOUT = 0.6  # s for the answer to a line
STOP_TIMEOUT = 1.0  # s for a stop to be confirmed
STOP_RETRY_INTERVAL = 0.2  # s after which a stop that shows no effect is sent again
PROGRESS_TIMEOUT = 0.5  # s without a step while motion is queued
MIN_REPORTS = 4
"""Reports or attempts that a timeout needs besides: the computer itself may have been late."""
CERTAIN_REPORTS = 2
"""Reports in succession: a jog that came late can be queued while one report says Idle."""
HOMING_TIMEOUT = 60.0  # s
HOMING_SPEED = 0.005
"""m/s at which tendons are pulled from the switches to zero."""
STOP_PINS = frozenset('HRD')
ERROR_NOT_IDLE = 8
HOME = '$H'
MINUTE = 60.0  # s
REFERENCE = 'straighten the arm, make all tendons just taut and call reference'


@dataclass
class Polling:
    """Status queries: when (s) the last was sent and answered, how many are unanswered."""

    sent_at: float
    answered_at: float
    unanswered: int = 0


@dataclass
class Watch:
    """Something that must happen in time: since when (s), and reports or attempts meanwhile."""

    since: float
    count: int = 0

    def expired(self, timeout: float, now: float) -> bool:
        """Whether it took too long (s), and the computer was not itself the reason."""
        return now - self.since > timeout and self.count >= MIN_REPORTS


class GrblSession:
    """What is known of a controller at rest since it was found; for one thread at a time."""

    def __init__(self, link: GrblLink, found: Controller, motors: Motors, jogs: JogStream,
                 homing: Homing | None) -> None:
        """Take over a controller that was ``found`` on ``link``; homing: None without switches."""
        now = link.clock()
        self._link, self._motors, self._jogs, self._homing = link, motors, jogs, homing
        self.state = next_state(State.DISCONNECTED, Event.OPENED)
        self.failure = ''
        self.position = motors.to_steps(found.position)
        self._zero = motors.to_steps(found.zero or (0.0,) * len(self.position))
        self._speeds = (0.0,) * len(self.position)  # m/s
        known = found.zero is not None and not found.locked
        self._unreferenced = '' if known else 'the controller was reset'
        self._jogs.place(self.position)
        self._target: tuple[Steps, float] | None = None  # of the last move, and its arrival (s)
        self._setup_lines: list[str] = []
        self._polling = Polling(now, now)
        self._idle_reports = CERTAIN_REPORTS  # in succession, at one place
        self._stray_reports = 0  # in succession, off the planned path
        self._acknowledgement = Watch(now)
        self._progress = Watch(now)
        self._stop = Watch(now)
        self._homing_since = now
        self._hold_sent_at = 0.0  # feed hold, or soft reset while homing, s
        self._reset_sent_at = 0.0  # s, 0 when none is under way

    @property
    def busy(self) -> bool:
        """Whether the tendons move or may move."""
        return self.state in BUSY

    @property
    def settled(self) -> bool:
        """Whether no line waits to be sent or acknowledged."""
        return not self._setup_lines and not self._link.unanswered

    # Requests

    def check(self) -> None:
        """Raise HardwareError when the connection has failed."""
        if self.state is State.FAILED:
            raise HardwareError(self.failure)

    def reading(self) -> TendonReading:
        """Return the state of the last status report, which is at most some 0.1 s old."""
        self.check()
        speeds = (0.0,) * len(self._speeds)
        if self.busy:
            # Not at rest, even if no step was made between the last two reports.
            slowest = 1.0 / max(self._motors.steps_per_metre) / MOVING_QUERY_INTERVAL
            speeds = self._speeds if any(self._speeds) else (slowest,) * len(self._speeds)
        pulls = self._motors.to_pulls(subtract(self.position, self._zero))
        return TendonReading(pulls, speeds, referenced=not self._unreferenced)

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move to ``pulls`` (m) within ``duration`` (s); during a stop, after it."""
        self.check()
        if self._unreferenced:
            raise HardwareError(f'the position is not known: {self._unreferenced}; {REFERENCE}')
        now = self._link.clock()
        self._target = add(self._zero, self._motors.from_pulls(pulls)), now + duration
        if self.state is not State.STOPPING:
            self._aim(now)

    def stop(self) -> None:
        """Brake as the controller can without losing a step, then hold."""
        self.check()
        self._target = None
        if self.state is State.HOMING_REQUESTED:
            self._setup_lines = []
        self._begin_stop()
        if self.state is State.ABORTING_HOMING:  # nothing but a reset ends a homing cycle
            self._hold_sent_at = self._link.clock()
            self._link.write(SOFT_RESET)

    def reference(self) -> None:
        """Take the present position as zero pull, or home."""
        self.check()
        if self.busy:
            raise HardwareError('the tendons are moving; wait until they rest')
        if self._homing is not None:
            self._unreferenced = 'homing has not ended'
            self._fire(Event.HOME)
            self._homing_since = self._link.clock()
            self._setup_lines = [HOME]
            self._idle_reports = 0
            return
        self._zero = self.position
        self._unreferenced = ''
        self._jogs.place(self.position)
        self._mark_reference()

    def fail(self, reason: str) -> None:
        """End the connection for good."""
        self.failure = reason
        self._fire(Event.FAILURE)

    # What is sent

    def act(self, now: float) -> None:
        """Send what is due, and check that what was sent is answered in time."""
        if self._link.unanswered == HOME:  # status queries are not answered either
            self._watch_homing(now)
            return
        if self._link.unanswered and self._acknowledgement.expired(ACKNOWLEDGEMENT_TIMEOUT, now):
            raise HardwareError(
                f'the GRBL controller did not acknowledge {self._link.unanswered!r}, so the '
                'motion was ended; check the cable')
        if self.state is State.STOPPING and self._stop.expired(STOP_TIMEOUT, now):
            raise HardwareError(
                f'the GRBL controller has not confirmed a stop within {STOP_TIMEOUT:g} s: the '
                'tendons may still move; cut the power of the motors if they do')
        self._query_status(now)
        if self.state is State.STOPPING or self._link.unanswered:
            return
        if self._setup_lines:
            line = self._setup_lines.pop(0)
            self._send(line)
            if line == HOME:
                self._fire(Event.HOME_SENT)
        elif jog := self._jogs.next_jog(now):
            self._idle_reports = 0
            self._send(jog_line(self._motors.to_millimetres(jog.end), jog.feed * MM * MINUTE))

    def _send(self, line: str) -> None:
        self._acknowledgement = Watch(self._link.clock())
        self._link.send(line)

    def _query_status(self, now: float) -> None:
        polling = self._polling
        interval = MOVING_QUERY_INTERVAL if self.busy else RESTING_QUERY_INTERVAL
        if now - polling.sent_at < (QUERY_TIMEOUT if polling.unanswered else interval):
            return
        if polling.unanswered == MAX_UNANSWERED_QUERIES:
            raise HardwareError(
                f'the GRBL controller has not answered for {now - polling.answered_at:.1f} s; '
                'check cable and power')
        polling.sent_at = now
        polling.unanswered += 1
        self._link.write(STATUS_QUERY)

    def _watch_homing(self, now: float) -> None:
        if now - self._homing_since > HOMING_TIMEOUT:
            raise HardwareError(
                f'homing has not ended within {HOMING_TIMEOUT:g} s; check switches, motors and '
                'the travel settings, $130 and following')
        if self.state is not State.ABORTING_HOMING:
            return
        if self._stop.expired(STOP_TIMEOUT, now):
            raise HardwareError(
                f'the GRBL controller has not stopped homing within {STOP_TIMEOUT:g} s: the '
                'tendons may still move; cut the power of the motors if they do')
        if now - self._hold_sent_at > STOP_RETRY_INTERVAL:
            self._hold_sent_at = now
            self._stop.count += 1
            self._link.write(SOFT_RESET)

    # What is received

    def handle(self, message: Message, now: float) -> None:
        """Take one message into account; raises HardwareError when it reports a failure."""
        if isinstance(message, Alarm):
            raise HardwareError(explain_alarm(message.number))
        if isinstance(message, Banner):
            self._on_reset()
        elif isinstance(message, Acknowledgement):
            self._on_acknowledgement(message)
        elif isinstance(message, Status) and message.position is not None:
            self._on_status(message, self._motors.to_steps(message.position), now)

    def _on_reset(self) -> None:
        self._link.answered()  # no acknowledgement follows any more, or a late one without meaning
        self._setup_lines = []
        if self._reset_sent_at:  # by the driver, at rest: the position is kept
            self._reset_sent_at = 0.0
            if not self._unreferenced:
                self._mark_reference()
        else:
            self._lose_reference('the controller was reset')

    def _on_acknowledgement(self, message: Acknowledgement) -> None:
        line = self._link.answered()
        self._hold_sent_at = 0.0  # it may have started a motion that the feed hold preceded
        if message.error == ERROR_NOT_IDLE and line.startswith('$J='):
            # A jog that arrived just as the one before ended runs as a program, which takes no
            # further jogs.  End it; the motion continues from there.
            self._begin_stop()
        elif message.error and line:
            raise HardwareError(explain_error(line, message.error))
        elif line == HOME:
            self._polling.unanswered = self._idle_reports = 0
            self._fire(Event.HOME_DONE)

    def _on_status(self, status: Status, steps: Steps, now: float) -> None:
        still = steps == self.position
        elapsed = max(now - self._polling.answered_at, 1e-3)
        travel = self._motors.to_pulls(subtract(steps, self.position))
        self._speeds = tuple(distance / elapsed for distance in travel)
        self.position = steps
        self._polling.answered_at, self._polling.unanswered = now, 0
        for watch in (self._acknowledgement, self._progress, self._stop):
            watch.count += 1
        idle = status.state == 'Idle' and still and not self._link.unanswered
        self._idle_reports = self._idle_reports + 1 if idle else 0
        if not still or self._jogs.arrived(steps):
            self._progress = Watch(now)
        self._check_path(steps)
        if status.state == 'Alarm' and self._homing is not None and self._unreferenced:
            self._fire(Event.LOCKED)
            self._jogs.place(steps)
            return
        self._check_status(status)
        rested = self._idle_reports >= CERTAIN_REPORTS
        if self.state is State.STOPPING:
            self._continue_stop(status, rested, now)
        elif rested and self.state is State.HOMED and self._homing is not None:
            self._pull_to_zero(self._homing, now)
        elif rested:
            self._check_arrival(status)
        elif self.state is State.JOGGING and self._progress.expired(PROGRESS_TIMEOUT, now):
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
            self._lose_reference('the position jumped, as after a reset of the controller')

    def _check_status(self, status: Status) -> None:
        if status.state == 'Alarm':
            raise HardwareError(f'the GRBL controller is locked (Alarm); {UNLOCK}')
        if status.state not in ('Idle', 'Jog', 'Run', 'Home') and not (
                status.state == 'Hold' and self.state is State.STOPPING):
            raise HardwareError(
                f'the GRBL controller went into the state {status.state}, which the driver did '
                f'not ask for; {UNLOCK}')
        if pins := STOP_PINS.intersection(status.pins):
            # During a jog the firmware only cancels what is queued, and would take the next one.
            raise HardwareError(
                f'a stop button or pin at the GRBL board is active ({", ".join(sorted(pins))}: '
                'H hold, R reset, D door); release it')

    def _check_arrival(self, status: Status) -> None:
        if not self._jogs.arrived(self.position) and not self._unreferenced:
            raise HardwareError(
                f'the GRBL controller stopped at {self._describe(self.position)}, short of '
                f'{self._describe(self._jogs.end)}, in the state {status.state} (a button or a '
                'pin at the board?)')
        self._jogs.clear_queue()
        if not self._jogs.moving:
            self._fire(Event.RESTED)

    def _continue_stop(self, status: Status, rested: bool, now: float) -> None:
        """See a stop through: a feed hold may meet a jog, a program, or no motion at all."""
        if rested:
            if self._reset_sent_at:  # the banner was lost
                self._on_reset()
            self._fire(Event.RESTED)
            self._jogs.place(self.position)
            self._aim(now)
        elif status.state == 'Hold' and status.substate == '0':
            if now - self._reset_sent_at > STOP_RETRY_INTERVAL:
                self._reset_sent_at = now
                self._link.write(SOFT_RESET)  # at rest: this only drops what is queued
        elif status.state in ('Jog', 'Run') and now - self._hold_sent_at > STOP_RETRY_INTERVAL:
            self._hold_sent_at = now
            self._link.write(FEED_HOLD)

    def _pull_to_zero(self, homing: Homing, now: float) -> None:
        """Take the zero from where the switches are, and move there."""
        self._zero = subtract(self.position, self._motors.from_pulls(homing.pulls))
        self._unreferenced = ''
        self._fire(Event.RESTED)
        self._jogs.place(self.position)
        self._target = self._zero, now + max(-pull for pull in homing.pulls) / HOMING_SPEED
        self._aim(now)
        self._mark_reference()

    # Changes of state

    def _fire(self, event: Event) -> None:
        before, self.state = self.state, next_state(self.state, event)
        if self.state is not before:
            now = self._link.clock()
            self._stop, self._progress = Watch(now), Watch(now)

    def _aim(self, now: float) -> None:
        """Move to the target, if there is one."""
        if self._target is not None:
            self._jogs.set_target(*self._target, now)
            self._fire(Event.TARGET if self._jogs.moving else Event.RESTED)

    def _begin_stop(self) -> None:
        jogging = self.state is State.JOGGING
        self._fire(Event.STOP)
        if jogging:
            self._hold_sent_at, self._idle_reports = self._link.clock(), 0
            self._link.write(FEED_HOLD)

    def _lose_reference(self, reason: str) -> None:
        self._unreferenced = reason
        self._target = None
        self._jogs.place(self.position)
        self._fire(Event.REFERENCE_LOST)

    def _mark_reference(self) -> None:
        offset = subtract(self.position, self._zero)
        self._setup_lines = mark_reference(self._motors.to_millimetres(offset))

    def _describe(self, steps: Steps) -> str:
        return self._motors.describe(subtract(steps, self._zero))
