# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tendon steppers on a GRBL 1.1 controller: its axes X, Y, Z, A are the tendons in their order.

One thread owns the serial port.  It sends short jogs, watches the status, and ends all motion when
something is not as it must be; then only open() or reference() lets tendons move again.
"""

from collections.abc import Callable, Mapping, Sequence
import contextlib
from math import isfinite
import threading
from typing import Any, ClassVar, Self

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.grbl_link import AXES, GrblLink, JOG_CANCEL, SOFT_RESET
from soft_continuum.hardware.grbl_motion import JOG_TIME, JogStream, MM, Motors
from soft_continuum.hardware.grbl_session import GrblSession, HOME, RESTING_QUERY_INTERVAL
from soft_continuum.hardware.grbl_setup import find_controller, Homing, unfit_settings, UNLOCK
from soft_continuum.hardware.grbl_states import State
from soft_continuum.hardware.protocols import describe_pulls, HardwareError, TendonReading
from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.parameters.parameter import Parameter, ParameterError

CLOSE_TIMEOUT = 1.0  # s that close() gives the tendons to stop
POLL_INTERVAL = 0.005  # s


class GrblTendons:
    """Steppers on a GRBL controller; see TendonDriver for what the methods promise."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter('grbl.port', '', 'serial port of the stepper controller, best the name below '
                  '/dev/serial/by-id that stays with the device'),
        Parameter('grbl.baud_rate', 115200, 'bits/s of that port', 1200, 4000000),
        Parameter('grbl.steps_per_mm', (200.0, 200.0),
                  'motor steps per mm of pull of each tendon, on the axes X, Y, ...; the settings '
                  '$100, $101, ... must be the same', 0.1, 1e5),
        Parameter('grbl.signs', (1.0, 1.0),
                  'for each tendon 1 where a positive motion pulls it in, -1 where it pays it out',
                  -1.0, 1.0),
        Parameter('grbl.homed_pulls', (0.0,),
                  'pull of each tendon after homing, which pays all out to limit switches, m; '
                  '0 alone: no switches, the zero is set by hand', -10.0, 0.0),
    )

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]) -> Self:
        """
        Return the driver that the parameters of the node describe.

        clock: not used; a device continues when a node's clock is paused or set.  Raises
        ParameterError.
        """
        return cls(
            values['grbl.port'], values['grbl.baud_rate'], motors_from_parameters(values),
            values['speed_limit'], values['acceleration_limit'], values['pull_limits'],
            values['grbl.homed_pulls'])

    def __init__(self, port: str, baud_rate: int, motors: Motors, speed_limit: float,
                 acceleration_limit: float, pull_limits: tuple[float, float],
                 homed_pulls: Sequence[float] = (0.0,), clock: Clock = STEADY) -> None:
        """
        Describe the device; nothing is opened yet.

        speed_limit: m/s.  acceleration_limit: m/s^2.  pull_limits: smallest and largest pull, m.
        homed_pulls: of each tendon after homing, m, or 0 alone.  Raises ParameterError.
        """
        self._port, self._baud_rate = port, baud_rate
        self._motors = motors
        self._speed_limit, self._acceleration_limit = speed_limit, acceleration_limit
        self._pull_limits = pull_limits
        self._homing = Homing.from_parameter(
            homed_pulls, motors.signs, pull_limits, motors.tendons)
        self.clock = clock
        self._lock = threading.Lock()  # of all that follows
        self._opening: GrblLink | None = None
        self._link: GrblLink | None = None
        self._session: GrblSession | None = None
        self._thread: threading.Thread | None = None
        self._closing = False
        self._closed_reason = 'the GRBL controller is not open; configure the node'

    @property
    def state(self) -> State:
        """What the controller is doing."""
        return State.DISCONNECTED if self._session is None else self._session.state

    def open(self) -> None:
        """Connect; raise HardwareError when the device or its settings are not as needed."""
        link = GrblLink(open_serial(self._port, self._baud_rate), self.clock)
        with self._lock:
            self._opening = link
        try:
            found = find_controller(link)
            if unfit := unfit_settings(found.settings, self._motors, self._speed_limit,
                                       self._acceleration_limit, self._homing):
                raise HardwareError(
                    'the settings of the GRBL controller contradict the configuration: '
                    + '; '.join(unfit))
            if found.locked and not self.reference_moves:
                raise HardwareError(f'the GRBL controller is locked (Alarm); {UNLOCK}')
            braking = min(found.settings[120 + i] for i in range(len(self._motors.tendons))) / MM
            jogs = JogStream(
                self._motors, self._speed_limit, self._acceleration_limit, braking)
            session = GrblSession(link, found, self._motors, jogs, self._homing)
            thread = threading.Thread(
                target=self._run, args=(link, session), name='grbl_tendons', daemon=True)
            with self._lock:
                link.wait(0.0)  # raises when close() was called meanwhile
                self._opening = None
                self._link, self._session, self._thread = link, session, thread
                self._closing = False
        except BaseException:
            with self._lock:
                self._opening = None
            link.close()
            raise
        self.firmware = found.firmware
        thread.start()

    def close(self) -> None:
        """Stop, hold and disconnect; an ``open`` under way ends with HardwareError."""
        with self._lock:
            if self._opening is not None:
                self._opening.abort()
            link, session, thread = self._link, self._session, self._thread
            if link is None or session is None or thread is None:
                return
            with contextlib.suppress(HardwareError):  # it has failed: all motion was ended then
                session.stop()
            self._closing = True
        link.wake()
        while thread.is_alive():
            self.clock.sleep(POLL_INTERVAL)
        with self._lock:
            self._link = self._session = self._thread = None
            self._closed_reason = 'the GRBL controller is closed; configure the node'
        link.close()

    def read(self) -> TendonReading:
        """Return the state of the last status report, which is at most some 0.1 s old."""
        with self._lock:
            return self._connected()[1].reading()

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move all tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""
        low, high = self._pull_limits
        tendons = self._motors.tendons
        if len(pulls) != len(tendons):
            raise HardwareError(
                f'{len(pulls)} pulls were given; needed: one for each of {", ".join(tendons)}')
        if not all(isfinite(x) for x in (*pulls, duration)) or duration < 0.0:
            raise HardwareError(f'not a motion: pulls {pulls} m in {duration} s')
        if min(pulls) < low - 1e-9 or max(pulls) > high + 1e-9:
            raise HardwareError(
                f'pulls of {describe_pulls(tendons, pulls)} are beyond pull_limits: {low:g} to '
                f'{high:g} m')
        with self._lock:
            link, session = self._connected()
            session.move(pulls, duration)
        link.wake()

    def stop(self) -> None:
        """Brake as the controller can without losing a step, then hold."""
        with self._lock:
            link, session = self._connected()
            session.stop()
        link.wake()

    @property
    def reference_moves(self) -> bool:
        """Whether ``reference`` homes."""
        return self._homing is not None

    def reference(self) -> None:
        """
        Take the present position as zero pull, or home; raise HardwareError while tendons move.

        Homing pays all tendons out to their switches and pulls them to zero, to be just taut on
        the straight arm.  Until then the reading moves, or is not referenced.
        """
        with self._lock:
            link, session = self._connected()
            session.reference()
        link.wake()

    def _connected(self) -> tuple[GrblLink, GrblSession]:
        if self._opening is not None:
            raise HardwareError('the GRBL controller is being opened')
        if self._link is None or self._session is None:
            raise HardwareError(self._closed_reason)
        return self._link, self._session

    def _run(self, link: GrblLink, session: GrblSession) -> None:
        """Serve the port until it is closed or fails: what its thread does."""
        close_by = 0.0
        try:
            while True:
                with self._lock:
                    for message in link.receive():
                        session.handle(message, self.clock())
                    session.act(self.clock())
                    busy = session.busy
                    if self._closing:
                        close_by = close_by or self.clock() + CLOSE_TIMEOUT
                        if not busy or self.clock() > close_by:
                            return
                link.wait(JOG_TIME / 4 if busy else RESTING_QUERY_INTERVAL / 2)
        except HardwareError as error:
            self._fail(link, session, str(error))
        except Exception as error:  # nothing else would notice that the thread ended
            self._fail(link, session, f'the GRBL driver failed: {type(error).__name__}: {error}')

    def _fail(self, link: GrblLink, session: GrblSession, reason: str) -> None:
        """End all motion for good; read() and move() then raise HardwareError with the reason."""
        with self._lock:
            session.fail(reason)
            with contextlib.suppress(HardwareError):
                # The one stop that leaves nothing pending at rest, and the one that ends homing.
                link.write(SOFT_RESET if link.unanswered == HOME else JOG_CANCEL)


def motors_from_parameters(values: Mapping[str, Any]) -> Motors:
    """
    Return the motors that the parameters of the node describe.

    Raises ParameterError when a list has not one value for each tendon, or a sign is none.
    """
    # Here, because it loads the mechanics: doctor must run when they do not compile.
    from soft_continuum.parameters.arm import arm_from_parameters

    tendons = arm_from_parameters(values).tendon_names
    if len(tendons) > len(AXES):
        raise ParameterError(f'the arm has {len(tendons)} tendons; a GRBL controller can move at '
                             f'most {len(AXES)}')
    for name in ('grbl.steps_per_mm', 'grbl.signs'):
        if len(values[name]) != len(tendons):
            raise ParameterError(
                f'parameter {name} is {list(values[name])}; needed: one value for each of '
                f'{", ".join(tendons)}')
    if any(abs(sign) != 1.0 for sign in values['grbl.signs']):
        raise ParameterError(
            f'parameter grbl.signs is {list(values["grbl.signs"])}; allowed: 1 or -1')
    return Motors(tendons, tuple(values['grbl.steps_per_mm']), tuple(values['grbl.signs']))
