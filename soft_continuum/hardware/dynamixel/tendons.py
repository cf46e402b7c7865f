# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tendons on spools of Dynamixel X servos, which limit their current and so the tension.

The servos are in mode 5, current-based position control.  One thread owns their bus.  Torque stays
on, also after close; nothing here writes their EEPROM, reboots them or switches torque off.
"""

from collections.abc import Callable, Mapping
import contextlib
import os
from pathlib import Path
import threading
from typing import Any, ClassVar, Self

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.dynamixel.bus import DynamixelBus
from soft_continuum.hardware.dynamixel.parameters import PARAMETERS
from soft_continuum.hardware.dynamixel.reference import ZeroFile
from soft_continuum.hardware.dynamixel.session import CYCLE, DynamixelSession, RESTING_CYCLE
from soft_continuum.hardware.dynamixel.setup import (
    find_servos,
    problems,
    Spools,
)
from soft_continuum.hardware.dynamixel.start import find_zeros, read_states, take_over
from soft_continuum.hardware.protocols import (
    check_limits,
    check_motion,
    HardwareError,
    TendonReading,
)
from soft_continuum.hardware.real_time import ask_for_real_time
from soft_continuum.parameters.parameter import Parameter
from soft_continuum.user_files import dynamixel_zeros

CLOSE_TIMEOUT = 1.0  # s that close() gives the tendons to stop
POLL_INTERVAL = 0.005  # s
MAX_READ_TIME = 0.05  # s for all servos


class DynamixelTendons:
    """Servos on one bus, one per tendon; see TendonDriver for what the methods promise."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = PARAMETERS

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
        """Describe the devices; nothing is opened yet.  zeros: file that keeps their zeros."""
        self._port, self._baud_rate, self._spools, self.clock = port, baud_rate, spools, clock
        self._zero_file = ZeroFile(zeros, port)
        self.reference_moves = spools.take_up_tension > 0.0
        self._lock = threading.Lock()  # of all that follows
        self._opening: DynamixelBus | None = None
        self._session: DynamixelSession | None = None
        self._thread: threading.Thread | None = None
        self._wake: tuple[int, int] = (-1, -1)
        self._closing = False
        self._closed_reason = 'the Dynamixel servos are not connected; configure the node'

    def open(self) -> None:
        """Connect and hold; raise HardwareError when servos or settings are not as needed."""
        bus = DynamixelBus(self._port, self._baud_rate, self.clock)
        with self._lock:
            self._opening = bus
        try:
            session = self._start(bus)
            with self._lock:
                bus.check_open()  # raises when close() was called meanwhile
                self._opening, self._session, self._closing = None, session, False
                self._wake = os.pipe()
                self._thread = threading.Thread(
                    target=self._run, args=(session,), name='dynamixel_tendons', daemon=True)
                self._thread.start()
        except BaseException:
            with self._lock:
                self._opening = None
            bus.close()
            raise

    def _start(self, bus: DynamixelBus) -> DynamixelSession:
        spools = self._spools
        servos = find_servos(bus, spools)
        if unfit := [line for servo in servos for line in problems(servo, spools.speed_limit)]:
            raise HardwareError('; '.join(unfit))
        states = read_states(bus, servos)
        begin = self.clock()
        states = read_states(bus, servos)
        if (took := self.clock() - begin) > MAX_READ_TIME:
            raise HardwareError(
                f'reading the servos takes {1e3 * took:.0f} ms at {bus.baud_rate} baud; allowed: '
                f'{1e3 * MAX_READ_TIME:.0f} ms; set their Baud Rate (8) to 3 (1000000) or more, '
                'and Return Delay Time (9) to 0')
        zeros = find_zeros(bus, servos, states, spools, self._zero_file)
        held = take_over(bus, servos, spools, states)
        return DynamixelSession(bus, servos, spools, held, zeros, self._zero_file)

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
        self._wake_up()
        while thread.is_alive():
            self.clock.sleep(POLL_INTERVAL)
        with self._lock:
            if self._session is not session:
                return
            self._session = self._thread = None
            self._closed_reason = 'the Dynamixel servos are disconnected; configure the node'
            for end in self._wake:
                os.close(end)
            self._wake = (-1, -1)
        session.bus.close()

    def read(self) -> TendonReading:
        """Return the state of the last replies; without any for 0.3 s it fails."""
        return self._connected().reading()

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move all tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""
        tendons = self._spools.tendons
        check_motion(tendons, pulls, duration)
        session = self._connected()
        check_limits(tendons, pulls, session.reading().pulls, self._spools.pull_limits)
        rested = not session.busy
        session.move(pulls, duration)
        if rested:
            self._wake_up()

    def stop(self) -> None:
        """Brake as fast as the servos can, then hold."""
        self._connected().stop()
        self._wake_up()

    def reference(self) -> None:
        """
        Take the present position as zero pull, or take up the slack of all tendons for it.

        Raises HardwareError while tendons move.  Slack is taken up slowly, one tendon after the
        other; until then the reading moves, or is not referenced if a tendon was not found taut.
        """
        self._connected().reference()
        self._wake_up()

    def _connected(self) -> DynamixelSession:
        with self._lock:
            if self._opening is not None:
                raise HardwareError('the Dynamixel servos are being connected')
            if self._session is None:
                raise HardwareError(self._closed_reason)
            return self._session

    def _wake_up(self) -> None:
        """Let the next cycle begin at once; from any thread."""
        with self._lock, contextlib.suppress(OSError):  # closed meanwhile
            os.write(self._wake[1], b'w')

    def _run(self, session: DynamixelSession) -> None:
        """Serve the bus until it is closed or fails: what its thread does."""
        ask_for_real_time()
        wake, close_by = self._wake[0], 0.0
        try:
            while True:
                begin, closing = self.clock(), self._closing
                session.cycle()
                if closing:
                    close_by = close_by or begin + CLOSE_TIMEOUT
                    if not session.busy:
                        session.release()
                        return
                    if begin > close_by:  # the watchdogs of the servos will end it
                        return
                interval = CYCLE if session.busy else RESTING_CYCLE
                if self.clock.wait([wake], begin + interval - self.clock()):
                    os.read(wake, 4096)
        except Exception as error:  # nothing else would notice that the thread ended
            reason = f'the Dynamixel driver failed: {type(error).__name__}: {error}'
            session.fail(str(error) if isinstance(error, HardwareError) else reason)
