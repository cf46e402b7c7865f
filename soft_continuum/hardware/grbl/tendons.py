# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tendon steppers on a GRBL 1.1 controller: its axes X, Y, Z, A are the tendons in their order.

One thread owns the serial port.  It sends short jogs, watches the status, and ends all motion when
something is not as it must be; then only open() or reference() lets tendons move again.
"""

from collections.abc import Callable, Mapping
import contextlib
import threading
from typing import Any, ClassVar

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.grbl.boards import GrblBoards
from soft_continuum.hardware.grbl.link import GrblLink
from soft_continuum.hardware.grbl.motion import JOG_TIME, Motors
from soft_continuum.hardware.grbl.parameters import PARAMETERS
from soft_continuum.hardware.grbl.session import GrblSession, RESTING_QUERY_INTERVAL
from soft_continuum.hardware.grbl.setup import find_controller, invalid_settings, UNLOCK
from soft_continuum.hardware.protocols import (
    check_limits,
    check_motion,
    HardwareError,
    TendonDriver,
    TendonReading,
)
from soft_continuum.hardware.real_time import ask_for_real_time
from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.parameters.parameter import Parameter

CLOSE_TIMEOUT = 1.0  # s that close() gives the tendons to stop
POLL_INTERVAL = 0.005  # s


class GrblTendons:
    """Steppers on a GRBL controller; see TendonDriver for what the methods promise."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = PARAMETERS

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
        self._port, self._baud_rate, self._motors, self.clock = port, baud_rate, motors, clock
        self.tendons = motors.tendons
        self.reference_moves = motors.homes
        self._lock = threading.Lock()  # of all that follows
        self._opening: GrblLink | None = None
        self._session: GrblSession | None = None
        self._thread: threading.Thread | None = None
        self._closing = False
        self._closed_reason = 'the GRBL controller is not open; configure the node'

    def open(self) -> None:
        """Connect; raise HardwareError when the device or its settings are not as needed."""
        link = GrblLink(open_serial(self._port, self._baud_rate), self.clock)
        with self._lock:
            self._opening = link
        try:
            found = find_controller(link)
            if unfit := invalid_settings(found.settings, self._motors):
                raise HardwareError(
                    'the settings of the GRBL controller contradict the configuration: '
                    + '; '.join(unfit))
            if found.locked and not self.reference_moves:
                raise HardwareError(f'the GRBL controller is locked (Alarm); {UNLOCK}')
            session = GrblSession(link, found, self._motors)
            with self._lock:
                link.wait(0.0)  # raises when close() was called meanwhile
                self._opening, self._session, self._closing = None, session, False
                self._thread = threading.Thread(
                    target=self._run, args=(session,), name='grbl_tendons', daemon=True)
                self._thread.start()
        except BaseException:
            with self._lock:
                self._opening = None
            link.close()
            raise

    def close(self) -> None:
        """Stop, hold and disconnect; an ``open`` under way ends with HardwareError."""
        with self._lock:
            if self._opening is not None:
                self._opening.abort()
            session, thread = self._session, self._thread
            if session is None or thread is None:
                return
            with contextlib.suppress(HardwareError):  # it has failed: all motion was ended then
                session.stop()
            self._closing = True
        session.link.wake()
        while thread.is_alive():
            self.clock.sleep(POLL_INTERVAL)
        with self._lock:
            if self._session is not session:  # another thread was closing it too
                return
            self._session = self._thread = None
            self._closed_reason = 'the GRBL controller is closed; configure the node'
        session.link.close()

    @property
    def fastest(self) -> float:
        """Speed of the fastest motion that the controller can brake in time, m/s."""
        with self._lock:
            return self._connected().fastest

    def read(self) -> TendonReading:
        """Return the state of the last status report, which is at most some 0.1 s old."""
        with self._lock:
            return self._connected().reading()

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move all tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""
        tendons = self._motors.tendons
        check_motion(tendons, pulls, duration)
        with self._lock:
            session = self._connected()
            check_limits(tendons, pulls, session.reading().pulls, self._motors.pull_limits)
            session.move(pulls, duration)
        session.link.wake()

    def stop(self) -> None:
        """Brake as the controller can without losing a step, then hold."""
        with self._lock:
            session = self._connected()
            session.stop()
        session.link.wake()

    def reference(self) -> None:
        """
        Take the present position as zero pull, or home; raise HardwareError while tendons move.

        Homing pays all tendons out to their switches and pulls them to zero, to be just taut on
        the straight arm.  Until then the reading moves, or is not referenced.
        """
        with self._lock:
            session = self._connected()
            session.reference()
        session.link.wake()

    def _connected(self) -> GrblSession:
        if self._opening is not None:
            raise HardwareError('the GRBL controller is being opened')
        if self._session is None:
            raise HardwareError(self._closed_reason)
        return self._session

    def _run(self, session: GrblSession) -> None:
        """Serve the port until it is closed or fails: what its thread does."""
        ask_for_real_time()
        link = session.link
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
        except Exception as error:  # nothing else would notice that the thread ended
            reason = f'the GRBL driver failed: {type(error).__name__}: {error}'
            with self._lock:  # read() and move() then raise HardwareError with the reason
                session.fail(str(error) if isinstance(error, HardwareError) else reason)
