# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tendon steppers on a GRBL 1.1 controller: X is the right tendon, Y the left one.

One thread owns the serial port.  It sends short jogs, watches the status, and ends all motion when
something is not as it must be; then only open() or reference() lets tendons move again.
"""

from collections.abc import Callable, Mapping, Sequence
import contextlib
from math import isfinite
import threading
from time import monotonic
from typing import Any, ClassVar, Self

from soft_continuum.hardware.grbl_link import (
    Acknowledgement,
    Alarm,
    Banner,
    Coordinates,
    FEED_HOLD,
    GrblLink,
    JOG_CANCEL,
    jog_line,
    Message,
    SOFT_RESET,
    Status,
    STATUS_QUERY,
)
from soft_continuum.hardware.grbl_motion import JogStream, Pair, PIECE, Steps
from soft_continuum.hardware.grbl_setup import (
    explain_alarm,
    explain_error,
    find_controller,
    Homing,
    mark_reference,
    unfit_settings,
    UNLOCK,
)
from soft_continuum.hardware.protocols import HardwareError, TendonReading
from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.parameters.parameter import Parameter, ParameterError

QUERY_MOVING, QUERY_RESTING = 0.025, 0.1  # s between two status queries
PATIENCE, TRIES = 0.2, 4
"""s that a status query waits for its answer, and queries in succession that may have none."""
LATEST_ANSWER = 0.6
"""s that the answer to a line may take."""
CLOSING_TIME = 1.0  # s that close() gives the tendons to stop
CERTAIN = 2
"""Reports in succession: a jog that came late can be queued while one report says Idle."""
AGAIN = 0.2  # s after which a stop that shows no effect is sent again
BUTTONS = frozenset('HRD')
NOT_IDLE = 8
MM = 1e3  # per m
MINUTE = 60.0  # s
HOME = '$H'
SEEKING, ABORTED, HOMED = 'seeking', 'aborted', 'homed'
HOMING_TIME = 60.0  # s
HOMING_SPEED = 0.005
"""m/s with which tendons are pulled from the switches to zero."""
REFERENCE = 'straighten the arm, make both tendons just taut and call reference'


class GrblTendons:
    """Two steppers on a GRBL controller; see TendonDriver for what the methods promise."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter('grbl.port', '', 'serial port of the stepper controller, best the name below '
                  '/dev/serial/by-id that stays with the device'),
        Parameter('grbl.baud_rate', 115200, 'bits/s of that port', 1200, 4000000),
        Parameter('grbl.steps_per_mm', (200.0, 200.0),
                  'motor steps per mm of pull, right and left; $100 and $101 must say the same',
                  0.1, 1e5),
        Parameter('grbl.signs', (1.0, 1.0),
                  'right and left: 1 where a positive motion pulls the tendon, -1 where it lets '
                  'it out', -1.0, 1.0),
        Parameter('grbl.homed_pulls', (0.0,),
                  'right and left pull after homing, which lets both tendons out to switches, m; '
                  '0 alone: no switches, the zero is set by hand', -10.0, 0.0),
    )

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]) -> Self:
        """
        Return the driver that the parameters of the node describe.

        clock: not used; a device goes on when a node's clock is paused or set.
        """
        return cls(
            values['grbl.port'], values['grbl.baud_rate'], values['grbl.steps_per_mm'],
            values['grbl.signs'], values['speed_limit'], values['acceleration_limit'],
            values['pull_limits'], values['grbl.homed_pulls'])

    def __init__(self, port: str, baud_rate: int, steps_per_mm: Pair, signs: Pair,
                 speed_limit: float, acceleration_limit: float, pull_limits: Pair,
                 homed_pulls: Sequence[float] = (0.0,)) -> None:
        """
        Describe the device; nothing is opened yet.

        steps_per_mm, signs: of the right and the left motor.  speed_limit: m/s.
        acceleration_limit: m/s^2.  pull_limits: smallest and largest pull, m.  homed_pulls: right
        and left pull after homing, m, or 0 alone.  Raises ParameterError.
        """
        for name, pair in (('grbl.steps_per_mm', steps_per_mm), ('grbl.signs', signs)):
            if len(pair) != 2:
                raise ParameterError(f'parameter {name} is {pair}; needed: right and left')
        if any(abs(sign) != 1.0 for sign in signs):
            raise ParameterError(f'parameter grbl.signs is {signs}; allowed: 1 or -1')
        self._port, self._baud_rate = port, baud_rate
        self._steps_per_mm = steps_per_mm
        self._scale = (signs[0] * MM * steps_per_mm[0], signs[1] * MM * steps_per_mm[1])
        self._speed_limit, self._acceleration_limit = speed_limit, acceleration_limit
        self._pull_limits = pull_limits
        self._homing = Homing.from_parameter(homed_pulls, signs, pull_limits)
        self._lock = threading.Lock()  # of all that follows
        self._link: GrblLink | None = None
        self._thread: threading.Thread | None = None
        self._failure = 'the GRBL controller is not open; configure the node'

    # What the node calls

    def open(self) -> None:
        """Connect; raise HardwareError when the device or its settings are not as needed."""
        link = GrblLink(open_serial(self._port, self._baud_rate))
        try:
            found = find_controller(link)
            speed, acceleration = self._speed_limit * MM, self._acceleration_limit * MM
            if unfit := unfit_settings(found.settings, self._steps_per_mm, speed, acceleration,
                                       self._homing):
                raise HardwareError(
                    'the settings of the GRBL controller contradict the configuration: '
                    + '; '.join(unfit))
            if found.locked and not self.reference_moves:
                raise HardwareError(f'the GRBL controller is locked (Alarm); {UNLOCK}')
        except BaseException:
            link.close()
            raise
        self.firmware = found.firmware
        self._zero: Steps = (0, 0) if found.zero is None else self._in_steps(found.zero)
        known = found.zero is not None and not found.locked
        self._unreferenced = '' if known else 'the controller was reset'
        self._homing_state = ''  # SEEKING, ABORTED, HOMED, or empty when it does not home
        self._homing_since = self._aborted_at = 0.0  # s
        self._jogs = JogStream(
            (self._steps_per_mm[0] * MM, self._steps_per_mm[1] * MM), self._speed_limit,
            self._acceleration_limit, min(found.settings[120], found.settings[121]) / MM)
        self._position = self._in_steps(found.position)
        self._jogs.place(self._position)
        self._wanted: tuple[Steps, float] | None = None  # where to, and when to be there
        self._speeds = (0.0, 0.0)
        self._rested = 2  # reports in succession that say Idle at one place
        self._astray = 0  # reports in succession from where it was not sent
        self._stopping = self._closing = False
        self._held_at = self._reset_at = 0.0  # when feed hold and soft reset were sent
        self._setup_lines: list[str] = []
        self._seen_at = self._asked_at = monotonic()
        self._queries = 0  # without an answer
        self._reports = 0  # since the last line was sent
        self._failure = ''
        self._link = link
        self._thread = threading.Thread(
            target=self._run, args=(link,), name='grbl_tendons', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop, hold and disconnect."""
        if self._link is None or self._thread is None:
            return
        with self._lock:
            if not self._failure:
                self._halt(self._link)
            self._closing = True
        self._link.wake()
        self._thread.join()
        self._link.close()
        self._link = self._thread = None
        self._failure = 'the GRBL controller is closed; configure the node'

    def read(self) -> TendonReading:
        """Return the state of the last status report, which is at most some 0.1 s old."""
        with self._lock:
            self._check()
            pulls = self._in_metres(self._position)
            speeds = (0.0, 0.0)
            if self._busy():
                # Not at rest, even if no step was made between the last two reports.
                least = 1.0 / max(abs(s) for s in self._scale) / QUERY_MOVING
                speeds = self._speeds if any(self._speeds) else (least, least)
            return TendonReading(pulls, speeds, referenced=not self._unreferenced)

    def move(self, pulls: tuple[float, float], duration: float) -> None:
        """Move both tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""
        low, high = self._pull_limits
        if not all(isfinite(x) for x in (*pulls, duration)) or duration < 0.0:
            raise HardwareError(f'not a motion: pulls {pulls} m in {duration} s')
        if min(pulls) < low - 1e-9 or max(pulls) > high + 1e-9:
            raise HardwareError(
                f'pulls of {pulls} m are beyond pull_limits: {low:g} to {high:g} m')
        with self._lock:
            link = self._check()
            if self._unreferenced:
                raise HardwareError(
                    f'the position is not known: {self._unreferenced}; {REFERENCE}')
            x, y = (z + round(p * s)
                    for p, s, z in zip(pulls, self._scale, self._zero, strict=True))
            now = monotonic()
            self._wanted = (x, y), now + duration
            if not self._stopping:
                self._jogs.aim(*self._wanted, now)
        link.wake()

    def stop(self) -> None:
        """Brake as the controller can without losing a step, then hold."""
        with self._lock:
            link = self._check()
            self._halt(link)
        link.wake()

    @property
    def reference_moves(self) -> bool:
        """Whether ``reference`` homes."""
        return self._homing is not None

    def reference(self) -> None:
        """
        Take the present position as zero pull, or home; raise HardwareError while tendons move.

        Homing lets both tendons out to their switches and pulls them to zero, to be just taut on
        the straight arm.  Until then the reading moves, or is not referenced.
        """
        with self._lock:
            link = self._check()
            if self._busy():
                raise HardwareError('the tendons are moving; wait until they rest')
            if self.reference_moves:
                self._unreferenced = 'homing has not come to its end'
                self._homing_state, self._homing_since = SEEKING, monotonic()
                self._setup_lines = [HOME]
                self._rested = 0
                link.wake()
                return
            self._zero = self._position
            self._unreferenced = ''
            self._jogs.place(self._position)
            self._mark()
        link.wake()

    # What the thread does

    def _run(self, link: GrblLink) -> None:
        close_by = 0.0
        try:
            while True:
                with self._lock:
                    for message in link.receive():
                        self._handle(link, message)
                    self._act(link, monotonic())
                    busy = self._busy()
                    if self._closing:
                        close_by = close_by or monotonic() + CLOSING_TIME
                        if not busy or monotonic() > close_by:
                            return
                link.wait(PIECE / 4 if busy else QUERY_RESTING / 2)
        except HardwareError as error:
            self._fail(link, str(error))
        except Exception as error:  # nobody else would notice that the thread is gone
            self._fail(link, f'the GRBL driver failed: {type(error).__name__}: {error}')

    def _fail(self, link: GrblLink, reason: str) -> None:
        """End all motion for good; read() and move() say why."""
        with self._lock:
            self._failure = reason
            with contextlib.suppress(HardwareError):
                # The one stop that leaves nothing pending at rest, and the one that ends homing.
                link.write(SOFT_RESET if link.unanswered == HOME else JOG_CANCEL)

    def _act(self, link: GrblLink, now: float) -> None:
        """Send what is due."""
        if link.unanswered == HOME:  # no status query is answered either
            if now - self._homing_since > HOMING_TIME:
                raise HardwareError(
                    f'homing has not come to its end within {HOMING_TIME:g} s; check switches, '
                    'motors and $130, $131')
            if self._homing_state == ABORTED and now - self._aborted_at > AGAIN:
                self._aborted_at = now
                link.write(SOFT_RESET)
            return
        # Counted, not only timed: a computer that is late itself must not blame the device.
        if link.unanswered and now - link.sent_at > LATEST_ANSWER and self._reports >= TRIES:
            raise HardwareError(
                f'the GRBL controller did not acknowledge {link.unanswered!r}, so the motion was '
                'ended; check the cable')
        interval = QUERY_MOVING if self._busy() else QUERY_RESTING
        if now - self._asked_at >= (PATIENCE if self._queries else interval):
            if self._queries == TRIES:
                raise HardwareError(
                    f'the GRBL controller has not answered for {now - self._seen_at:.1f} s; '
                    'check cable and power')
            self._asked_at = now
            self._queries += 1
            link.write(STATUS_QUERY)
        if self._stopping or link.unanswered:
            return
        if self._setup_lines:
            self._reports = 0
            link.send(self._setup_lines.pop(0))
        elif jog := self._jogs.next_jog(now):
            self._rested = self._reports = 0
            x, y = (steps / scale for steps, scale in
                    zip(jog.end, self._steps_per_mm, strict=True))
            link.send(jog_line(x, y, jog.feed * MM * MINUTE))

    def _handle(self, link: GrblLink, message: Message) -> None:
        if isinstance(message, Alarm):
            raise HardwareError(explain_alarm(message.number))
        if isinstance(message, Banner):
            self._on_reset(link)
        elif isinstance(message, Acknowledgement):
            line = link.answered()
            self._held_at = 0.0  # it may have set off a motion that the feed hold came before
            if message.error == NOT_IDLE and line.startswith('$J='):
                # A jog that came just as the one before ended is run like a program, which takes
                # no further jogs.  End it; what is wanted goes on from there.
                self._begin_stop(link)
            elif message.error and line:
                raise HardwareError(explain_error(line, message.error))
            elif line == HOME:
                self._queries = self._rested = 0
                self._homing_state = HOMED if self._homing_state == SEEKING else ''
        elif isinstance(message, Status) and message.position is not None:
            self._on_status(link, message, self._in_steps(message.position), monotonic())

    def _on_reset(self, link: GrblLink) -> None:
        link.answered()  # no acknowledgement comes any more, or a late one that says nothing
        self._setup_lines = []
        if self._reset_at:  # ours, at rest: the position is kept
            self._reset_at = 0.0
            if not self._unreferenced:
                self._mark()
        else:
            self._lose_reference('the controller was reset')

    def _lose_reference(self, why: str) -> None:
        self._unreferenced = why
        self._wanted, self._homing_state = None, ''
        self._jogs.place(self._position)
        self._stopping = True

    def _on_status(self, link: GrblLink, status: Status, steps: Steps, now: float) -> None:
        same = steps == self._position
        x, y = ((b - a) / s / max(now - self._seen_at, 1e-3)
                for a, b, s in zip(self._position, steps, self._scale, strict=True))
        self._speeds = x, y
        self._position, self._seen_at = steps, now
        self._queries = 0
        self._reports += 1
        resting = status.state == 'Idle' and same and not link.unanswered
        self._rested = self._rested + 1 if resting else 0
        if self._jogs.observe(steps, max(abs(x), abs(y))) or self._unreferenced:
            self._astray = 0
        else:
            self._astray += 1
            if self._astray == CERTAIN:
                self._lose_reference('the position jumped, as after a reset of the controller')
        if status.state == 'Alarm' and self.reference_moves and self._unreferenced:
            self._stopping = False  # locked, and at rest, until it is homed
            self._jogs.place(steps)
            return
        if status.state == 'Alarm':
            raise HardwareError(f'the GRBL controller is locked (Alarm); {UNLOCK}')
        if status.state not in ('Idle', 'Jog', 'Run', 'Home') and not (
                status.state == 'Hold' and self._stopping):
            raise HardwareError(
                f'the GRBL controller went into the state {status.state}, which nobody asked it '
                f'for here; {UNLOCK}')
        if pressed := BUTTONS.intersection(status.pins):
            # In a jog the firmware only cancels what is queued; it would go on with the next one.
            raise HardwareError(
                f'a stop button or pin at the GRBL board is active ({", ".join(sorted(pressed))}: '
                'H hold, R reset, D door); release it')
        if self._stopping:
            self._go_on_stopping(link, status, now)
        elif self._homing is not None and self._homing_state == HOMED and self._rested >= CERTAIN:
            self._on_homed(self._homing, now)
        elif self._rested >= CERTAIN:
            if not self._jogs.arrived(steps) and not self._unreferenced:
                raise HardwareError(
                    'the GRBL controller stopped short of where it was sent (a button or a pin '
                    'at the board?)')
            self._jogs.rest()

    def _on_homed(self, homing: Homing, now: float) -> None:
        """Take the zero from where the switches are, and go there."""
        self._homing_state = ''
        x, y = (p - round(pull * s)
                for p, pull, s in zip(self._position, homing.pulls, self._scale, strict=True))
        self._zero, self._unreferenced = (x, y), ''
        self._jogs.place(self._position)
        self._wanted = self._zero, now + max(-pull for pull in homing.pulls) / HOMING_SPEED
        self._jogs.aim(*self._wanted, now)
        self._mark()

    def _begin_stop(self, link: GrblLink) -> None:
        if self._jogs.moving and not self._stopping:
            self._stopping = True
            self._held_at, self._rested = monotonic(), 0
            link.write(FEED_HOLD)

    def _halt(self, link: GrblLink) -> None:
        self._wanted = None
        if link.unanswered == HOME:  # nothing else stops it; the alarm that follows says the rest
            self._homing_state, self._aborted_at = ABORTED, monotonic()
            link.write(SOFT_RESET)
        elif self._homing_state:
            self._homing_state, self._setup_lines = '', []
        self._begin_stop(link)

    def _go_on_stopping(self, link: GrblLink, status: Status, now: float) -> None:
        """See a stop through: a feed hold may meet a jog, a program, or nothing that moves."""
        if self._rested >= CERTAIN:
            if self._reset_at:  # the banner was lost
                self._on_reset(link)
            self._stopping = False
            self._jogs.place(self._position)
            if self._wanted is not None:
                self._jogs.aim(*self._wanted, now)
        elif status.state == 'Hold' and status.substate == '0':
            if now - self._reset_at > AGAIN:  # at rest: this throws away what is queued, no more
                self._reset_at = now
                link.write(SOFT_RESET)
        elif status.state in ('Jog', 'Run') and now - self._held_at > AGAIN:
            self._held_at = now
            link.write(FEED_HOLD)

    # Small things

    def _check(self) -> GrblLink:
        if self._failure or self._link is None:
            raise HardwareError(self._failure)
        return self._link

    def _busy(self) -> bool:
        return self._jogs.moving or self._stopping or bool(self._homing_state)

    def _mark(self) -> None:
        x, y = ((a - b) / s for a, b, s in
                zip(self._position, self._zero, self._steps_per_mm, strict=True))
        self._setup_lines = mark_reference((x, y))

    def _in_steps(self, position: Coordinates) -> Steps:
        return (round(position[0] * self._steps_per_mm[0]),
                round(position[1] * self._steps_per_mm[1]))

    def _in_metres(self, steps: Steps) -> Pair:
        x, y = ((a - b) / s for a, b, s in zip(steps, self._zero, self._scale, strict=True))
        return x, y
