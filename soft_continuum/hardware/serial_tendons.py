# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Lifecycle of a tendon driver on a serial line: connect, serve, watch, stop, disconnect.

One thread owns the line.  It lets the session talk to the device, cycle by cycle, and ends all
motion on any failure.  After a failure only close() and open() help.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
import contextlib
from socket import socketpair
import threading
from typing import Any, cast, ClassVar, Generic, TypeVar

from soft_continuum.hardware.clock import Clock
from soft_continuum.hardware.protocols import (
    check_limits,
    check_motion,
    HardwareError,
    TendonReading,
)
from soft_continuum.hardware.real_time import ask_for_real_time
from soft_continuum.hardware.serial_ports import close_serial, open_serial
from soft_continuum.parameters.parameter import ParameterError, spread

CLOSE_TIMEOUT = 1.0  # s that close() gives the tendons to stop
STOP_TIMEOUT = 1.0  # s for a stop to be confirmed
POLL_INTERVAL = 0.005  # s


def check_per_tendon(family: str, tendons: Sequence[str], *, signs: Sequence[float],
                     **lists: Sequence[float]) -> None:
    """Raise ParameterError for lists without one value for each tendon, and signs but 1 and -1."""
    for name, given in {'signs': signs, **lists}.items():
        spread(f'{family}.{name}', tuple(given), len(tendons),
               f'the tendons are {", ".join(tendons)}', alone=False)
    if any(abs(sign) != 1.0 for sign in signs):
        raise ParameterError(f'parameter {family}.signs is {list(signs)}; allowed: 1 or -1')


class SerialLink:
    """An open port with a device behind it, used by one thread, that others may wake or abort."""

    DEVICE: ClassVar[str]
    IS: ClassVar[str] = 'is'
    HAS: ClassVar[str] = 'has'
    """What is behind it, for messages, and its verbs."""

    def __init__(self, port: str, baud_rate: int, clock: Clock) -> None:
        """Open a port that no other program may open until it is closed."""
        self.name, self.clock = port, clock
        self.line = open_serial(port, baud_rate)
        self._woken, self._waker = socketpair()
        self._waker.setblocking(False)
        self._aborted = False

    def close(self) -> None:
        """Close the port; a second call does nothing."""
        try:
            close_serial(self.line)
        finally:
            self._waker.close()
            self._woken.close()

    def wait(self, timeout: float) -> object:
        """Wait ``timeout`` (s), or until there is something to do."""
        return self._wait_for((), timeout)

    def _wait_for(self, files: Sequence[int], timeout: float) -> list[int]:
        """
        Return which of ``files`` can be read, after ``timeout`` (s), or earlier when woken.

        Raises HardwareError after ``abort``, and OSError or ValueError when a file is not open.
        """
        self.check_open()
        woken = self._woken.fileno()
        ready = self.clock.wait([*files, woken], timeout)
        if woken in ready:
            self._woken.recv(4096)
            ready.remove(woken)
        return ready

    def wake(self) -> None:
        """Make waiting return at once; from any thread, also after ``close``."""
        with contextlib.suppress(OSError):  # closed, or going to wake up anyway
            self._waker.send(b'w')

    def abort(self) -> None:
        """Make the owner's next use raise HardwareError; from any thread."""
        self._aborted = True
        self.wake()

    def check_open(self) -> None:
        """Raise HardwareError after ``abort``."""
        if self._aborted:
            raise HardwareError(f'{self.name} was closed while it was being opened')

    def lost(self, reason: object) -> HardwareError:
        """Return the error of a lost connection."""
        return HardwareError(f'the connection to {self.DEVICE} on {self.name} is lost ({reason}); '
                             'check the cable and the power')


LinkT = TypeVar('LinkT', bound=SerialLink)


class Session(ABC, Generic[LinkT]):
    """
    One connection to a device that moves tendons, over a line.

    ``cycle`` is called by the thread that owns the line; requests come from any thread, wait for
    nothing, and raise HardwareError once the session has failed.  What begins with ``_`` is called
    while the lock is held.

    failure: why the session is over; empty while it is not.
    """

    CYCLE: ClassVar[float]
    RESTING_CYCLE: ClassVar[float]
    """From the begin of one cycle to that of the next, s, and while nothing is to be done."""

    def __init__(self, link: LinkT) -> None:
        """Take over a device that was found at rest."""
        self.link = link
        self.failure = ''
        self._lock = threading.Lock()  # of all that follows
        self._unreferenced = ''  # why the position is unknown

    @property
    @abstractmethod
    def moving(self) -> bool:
        """Whether tendons may move."""

    @property
    def busy(self) -> bool:
        """Whether tendons may move, or anything is pending."""
        return self.moving

    @property
    def interval(self) -> float:
        """From the begin of one cycle to that of the next, s."""
        return self.CYCLE if self.busy else self.RESTING_CYCLE

    @abstractmethod
    def cycle(self) -> None:
        """Receive, check and send due commands; raises HardwareError on a failure."""

    def reading(self) -> TendonReading:
        """Return the last state of the tendons."""
        with self._lock:
            self._check()
            return self._reading()

    def move(self, pulls: tuple[float, ...], duration: float) -> bool:
        """
        Move to ``pulls`` (m) within ``duration`` (s); during a stop, after it.

        Returns whether the next cycle has to begin at once.
        """
        with self._lock:
            self._check()
            if self._unreferenced:
                raise HardwareError(
                    f'the position is unknown: {self._unreferenced}; straighten the arm, make all '
                    'tendons just taut and call reference')
            return self._move(pulls, self.link.clock() + duration)

    def stop(self) -> None:
        """Brake as fast as the device can without losing its position, then hold."""
        with self._lock:
            self._check()
            self._stop()

    def reference(self) -> None:
        """Take the present position as zero pull, or begin to search for it."""
        with self._lock:
            self._check()
            if self.moving:
                raise HardwareError('the tendons are moving; wait until they rest')
            self._reference()

    @abstractmethod
    def fail(self, reason: str) -> None:
        """End all motion, and the session, for good."""

    def release(self) -> None:
        """Leave a device at rest, which holds, without further communication."""

    @abstractmethod
    def _reading(self) -> TendonReading:
        """Return the last state of the tendons."""

    @abstractmethod
    def _move(self, pulls: tuple[float, ...], arrival: float) -> bool:
        """Move, to be there at ``arrival`` (s), as move says."""

    @abstractmethod
    def _stop(self) -> None:
        """Brake, then hold."""

    @abstractmethod
    def _reference(self) -> None:
        """Take the present position as zero, or begin to search for it; the tendons rest."""

    def _shown(self, speeds: tuple[float, ...], least: tuple[float, ...]) -> tuple[float, ...]:
        """Return the speeds to report: 0 at rest, else not all 0, even if no step was made."""
        if not self.moving:
            return (0.0,) * len(speeds)
        return speeds if any(speeds) else least

    def _check(self) -> None:
        if self.failure:
            raise HardwareError(self.failure)

    def _unconfirmed(self) -> HardwareError:
        return HardwareError(
            f'{self.link.DEVICE} {self.link.HAS} not confirmed a stop within {STOP_TIMEOUT:g} s: '
            'the tendons may still move; cut the power of the motors if they do')


SessionT = TypeVar('SessionT', bound=Session[Any])


class SerialTendons(ABC, Generic[LinkT, SessionT]):
    """Tendons behind a serial line; see TendonDriver for what the methods promise."""

    LINK: ClassVar[type[SerialLink]]

    def __init__(self, port: str, baud_rate: int, tendons: tuple[str, ...],
                 pull_limits: tuple[float, float], reference_moves: bool, clock: Clock) -> None:
        """Describe the device, with limits in m; nothing is opened yet."""
        self._port, self._baud_rate = port, baud_rate
        self.tendons, self.reference_moves, self.clock = tendons, reference_moves, clock
        self._pull_limits = pull_limits
        self._lock = threading.Lock()  # of all that follows, and of requests
        self._link: LinkT | None = None
        self._session: SessionT | None = None  # None while it is being opened, too
        self._thread: threading.Thread | None = None
        self._closing = False
        self._device_is = f'{self.LINK.DEVICE} {self.LINK.IS}'
        self._closed_reason = f'{self._device_is} not connected; configure the node'

    @abstractmethod
    def start(self, link: LinkT) -> SessionT:
        """Take over the device without motion; raises HardwareError if it is unsuitable."""

    def open(self) -> None:
        """Connect and hold; raise HardwareError when device or settings are not as needed."""
        self.close()  # what a failure left
        link = cast('LinkT', self.LINK(self._port, self._baud_rate, self.clock))
        with self._lock:
            self._link = link
        try:
            session = self.start(link)
            thread = threading.Thread(target=self._serve, args=(session,), daemon=True,
                                      name=type(self).__name__)
            with self._lock:
                link.check_open()  # raises when close() was called meanwhile
                self._closing = False
                thread.start()
                self._session, self._thread = session, thread
        except BaseException:
            with self._lock:
                self._link = None
            link.close()
            raise

    def close(self) -> None:
        """Stop, hold and disconnect; an ``open`` under way ends with HardwareError."""
        with self._lock:
            link, session, thread = self._link, self._session, self._thread
            if link is None:
                return
            if session is None or thread is None:
                link.abort()
                return
            with contextlib.suppress(HardwareError):  # it has failed: all motion was ended then
                session.stop()
            self._closing = True
        link.wake()
        while thread.is_alive():
            self.clock.sleep(POLL_INTERVAL)
        with self._lock:
            if self._session is not session:  # another thread was closing it too
                return
            self._link = self._session = self._thread = None
            self._closed_reason = (
                session.failure or f'{self._device_is} disconnected; configure the node')
        link.close()

    def read(self) -> TendonReading:
        """Return the last reported state, at most some 0.1 s old while the device replies."""
        with self._lock:
            return self._connected().reading()

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move all tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""
        check_motion(self.tendons, pulls, duration)
        with self._lock:
            session = self._movable()
            check_limits(self.tendons, pulls, session.reading().pulls, self._pull_limits)
            if session.move(pulls, duration):
                session.link.wake()

    def stop(self) -> None:
        """Brake as fast as the device can without losing its position, then hold."""
        with self._lock:
            session = self._connected()
            session.stop()
            session.link.wake()

    def reference(self) -> None:
        """
        Take the present position as zero pull, or search for it: see the driver's parameters.

        Raises HardwareError while tendons move.  During a search the reading is moving; afterwards
        it is not referenced if nothing was found.
        """
        with self._lock:
            session = self._movable()
            session.reference()
            session.link.wake()

    def _connected(self) -> SessionT:
        if self._link is None:
            raise HardwareError(self._closed_reason)
        if self._session is None:
            raise HardwareError(f'{self._device_is} being connected')
        return self._session

    def _movable(self) -> SessionT:
        session = self._connected()
        if self._closing:
            raise HardwareError(f'{self._device_is} being disconnected')
        return session

    def _serve(self, session: SessionT) -> None:
        """Serve the line until it is closed or fails: what its thread does."""
        ask_for_real_time()
        close_by = 0.0
        try:
            while True:
                begin, closing = self.clock(), self._closing
                session.cycle()
                if closing:
                    close_by = close_by or begin + CLOSE_TIMEOUT
                    if not session.busy:
                        session.release()
                        return
                    if begin > close_by:
                        raise HardwareError(
                            f'{self._device_is} disconnected without a confirmed stop: tendons '
                            'may still move; cut the power of the motors if they do')
                session.link.wait(begin + session.interval - self.clock())
        except Exception as error:  # nothing else would notice that the thread ended
            session.fail(str(error) if isinstance(error, HardwareError) and str(error) else
                         f'the driver failed: {type(error).__name__}: {error}')
