# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The life of a driver of tendons on a serial line: connect, serve, watch, stop, disconnect.

One thread owns the line.  It lets the session talk to the device, cycle by cycle, and ends all
motion when something is not as it must be; then only open() lets tendons move again.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
import contextlib
from socket import socketpair
import threading
from typing import ClassVar, Generic, Protocol, TypeVar

from soft_continuum.hardware.clock import Clock
from soft_continuum.hardware.protocols import (
    check_limits,
    check_motion,
    HardwareError,
    TendonReading,
)
from soft_continuum.hardware.real_time import ask_for_real_time

CLOSE_TIMEOUT = 1.0  # s that close() gives the tendons to stop
POLL_INTERVAL = 0.005  # s


class Wakeable:
    """An open line of one thread, that others may wake or abort."""

    def __init__(self, name: str, clock: Clock) -> None:
        """Begin to wait for a line with the name of a port."""
        self.name, self.clock = name, clock
        self._woken, self._waker = socketpair()
        self._waker.setblocking(False)
        self._aborted = False

    def close(self) -> None:
        """Release what waiting takes; a second call does nothing."""
        self._waker.close()
        self._woken.close()

    def wait(self, timeout: float) -> bool:
        """Wait ``timeout`` (s), or until woken; return whether something was received."""
        return bool(self._wait_for((), timeout))

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
        """Let waiting return at once; from any thread, also after ``close``."""
        with contextlib.suppress(OSError):  # closed, or going to wake up anyway
            self._waker.send(b'w')

    def abort(self) -> None:
        """Let the owner's next use raise HardwareError; from any thread."""
        self._aborted = True
        self.wake()

    def check_open(self) -> None:
        """Raise HardwareError after ``abort``."""
        if self._aborted:
            raise HardwareError(f'{self.name} was closed while it was being opened')


class Session(Protocol):
    """
    One connection to a device that moves tendons, over a line.

    ``cycle`` is called by the thread that owns the line; requests come from any thread, wait for
    nothing, and raise HardwareError once the session has failed.
    """

    @property
    def busy(self) -> bool:
        """Whether tendons may move, or something is still to be sent or answered."""

    @property
    def interval(self) -> float:
        """From the begin of one cycle to that of the next, s."""

    def cycle(self) -> None:
        """Receive, judge and send what is due; raises HardwareError when something fails."""

    def reading(self) -> TendonReading:
        """Return the last state of the tendons."""

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move to ``pulls`` (m) within ``duration`` (s); during a stop, after it."""

    def stop(self) -> None:
        """Brake, then hold."""

    def reference(self) -> None:
        """Take the present position as zero pull, or begin to search for it."""

    def fail(self, reason: str) -> None:
        """End all motion, and the session, for good."""

    def release(self) -> None:
        """Leave a device at rest, which holds, to itself."""


LinkT = TypeVar('LinkT', bound=Wakeable)
SessionT = TypeVar('SessionT', bound=Session)


class SerialTendons(ABC, Generic[LinkT, SessionT]):
    """Tendons behind a serial line; see TendonDriver for what the methods promise."""

    DEVICE: ClassVar[str]
    """Name and verb, to begin a sentence with, such as ``the servos are``."""

    def __init__(self, tendons: tuple[str, ...], pull_limits: tuple[float, float],
                 reference_moves: bool, clock: Clock) -> None:
        """Describe the device, with limits in m; nothing is opened yet."""
        self.tendons, self.reference_moves, self.clock = tendons, reference_moves, clock
        self._pull_limits = pull_limits
        self._lock = threading.Lock()  # of all that follows
        self._link: LinkT | None = None
        self._session: SessionT | None = None  # None while it is being opened, too
        self._thread: threading.Thread | None = None
        self._closing = False
        self._closed_reason = f'{self.DEVICE} not connected; configure the node'

    @abstractmethod
    def connect(self) -> LinkT:
        """Open the line; raises HardwareError."""

    @abstractmethod
    def start(self, link: LinkT) -> SessionT:
        """Take the device over, which moves nothing; raises HardwareError if it is unfit."""

    def open(self) -> None:
        """Connect and hold; raise HardwareError when device or settings are not as needed."""
        link = self.connect()
        with self._lock:
            self._link = link
        try:
            session = self.start(link)
            with self._lock:
                link.check_open()  # raises when close() was called meanwhile
                self._session, self._closing = session, False
                self._thread = threading.Thread(
                    target=self._serve, args=(link, session), name=type(self).__name__,
                    daemon=True)
                self._thread.start()
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
            self._closed_reason = f'{self.DEVICE} disconnected; configure the node'
        link.close()

    def read(self) -> TendonReading:
        """Return the state that the device reported last, which is at most 0.3 s old."""
        return self._connected()[1].reading()

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move all tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""
        check_motion(self.tendons, pulls, duration)
        link, session = self._connected()
        check_limits(self.tendons, pulls, session.reading().pulls, self._pull_limits)
        rested = not session.busy
        session.move(pulls, duration)
        if rested:
            link.wake()

    def stop(self) -> None:
        """Brake as fast as the device can without losing its position, then hold."""
        link, session = self._connected()
        session.stop()
        link.wake()

    def reference(self) -> None:
        """
        Take the present position as zero pull, or search for it: see the driver's parameters.

        Raises HardwareError while tendons move.  Until a search has ended the reading moves, or is
        not referenced if nothing was found.
        """
        link, session = self._connected()
        session.reference()
        link.wake()

    def _connected(self) -> tuple[LinkT, SessionT]:
        with self._lock:
            if self._link is None:
                raise HardwareError(self._closed_reason)
            if self._session is None:
                raise HardwareError(f'{self.DEVICE} being connected')
            return self._link, self._session

    def _serve(self, link: LinkT, session: SessionT) -> None:
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
                    if begin > close_by:  # the device ends it, unattended
                        return
                link.wait(begin + session.interval - self.clock())
        except Exception as error:  # nothing else would notice that the thread ended
            name = type(self).__name__
            session.fail(str(error) if isinstance(error, HardwareError) else
                         f'{name} failed: {type(error).__name__}: {error}')
