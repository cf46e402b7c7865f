# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A device behind a serial port: a pseudo-terminal that can be unplugged, and a thread."""

from collections.abc import Callable
from contextlib import suppress
from math import inf
import os
from pathlib import Path
import termios
import threading
import tty
from typing import Self, TypeVar

from soft_continuum.hardware.clock import Clock
from soft_continuum.hardware.real_time import ask_for_real_time

POLL_INTERVAL = 0.005  # s
TIME_STEP, RESTING_STEP = 0.002, 0.02  # s, while something happens, and while nothing does
T = TypeVar('T')


class EmulatedDevice:
    """
    A device that a thread serves inside a ``with`` statement; times are s on ``clock``.

    The port appears under a new ``name`` whenever it is plugged in, as a real one might.  No other
    thread changes the device while ``lock`` is held.
    """

    MAX_LATENESS = inf
    """s that are made up for, where the computer is too slow for the device."""

    def __init__(self, link: str | Path | None, clock: Clock) -> None:
        """Stay unplugged; link: path of a symbolic link to the port, which stays the same."""
        self.link = Path(link) if link else None
        self.clock = clock
        self.name = ''
        self.lock = threading.RLock()
        self._master = self._slave = -1  # negative while unplugged
        self._outgoing: list[tuple[float, Callable[[], object]]] = []  # when, what sends it
        self._closing = False
        self._time = clock()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        """Plug in and start to reply; raises OSError if another file exists at the link."""
        self.plug()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Unplug and end."""
        self._closing = True
        while self._thread.is_alive():
            self.clock.sleep(POLL_INTERVAL)
        self.unplug()

    @property
    def port(self) -> str:
        """The path of the port: of its link, if it has one."""
        return str(self.link or self.name)

    def plug(self) -> None:
        """Connect the cable; nothing is reset."""
        with self.lock:
            if self._master >= 0:
                return
            # An open slave side keeps the line alive while no program has opened the port.
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self.name = os.ttyname(self._slave)
            if self.link is not None:
                self._remove_link()
                try:
                    self.link.symlink_to(self.name)
                except FileExistsError:
                    raise FileExistsError(
                        f'{self.link} exists and is not a symbolic link; give another '
                        'path') from None

    def unplug(self) -> None:
        """Unplug the cable: the port disappears; motors, pump and valves keep their state."""
        with self.lock:
            if self._master < 0:
                return
            os.close(self._master)
            os.close(self._slave)
            self._master = self._slave = -1
            self._remove_link()

    def send(self, data: bytes) -> None:
        """Put bytes on the line; bytes that nothing reads are lost, as on a wire."""
        with self.lock:
            if self._master >= 0:
                with suppress(OSError):
                    os.write(self._master, data)

    def _remove_link(self) -> None:
        if self.link is not None and self.link.is_symlink():
            self.link.unlink()

    def read(self, value: Callable[[], T]) -> T:
        """Return a consistent value, or make a change, while the device stands still."""
        with self.lock:
            self._advance()
            return value()

    def _later(self, due: float, send: Callable[[], object]) -> None:
        """Call ``send`` when it is due (s)."""
        self._outgoing.append((due, send))
        self._outgoing.sort(key=lambda each: each[0])

    def _serve(self) -> None:
        ask_for_real_time()  # a board waits for no other program
        while not self._closing:
            with suppress(OSError, ValueError, termios.error):  # unplugged meanwhile
                self._turn()

    def _turn(self) -> None:
        """Wait until something comes, is due, or time has to pass; do what follows."""
        with self.lock:
            master, due = self._master, self._outgoing[0][0] if self._outgoing else inf
            pause = min(self._pause(), due - self.clock())
        ready = self.clock.wait([master] if master >= 0 else [], pause)
        with self.lock:
            self._advance()
            while self._outgoing and self._outgoing[0][0] <= self.clock():
                self._outgoing.pop(0)[1]()
            same = self._master == master
            self._take(os.read(master, 4096) if ready and same else b'')

    def _pause(self) -> float:
        """Return how long the device can wait for bytes before time has to pass, s."""
        return RESTING_STEP if self._resting() else TIME_STEP

    def _advance(self) -> None:
        """Let the time of the device catch up with the clock."""
        now = self.clock()
        elapsed, self._time = min(now - self._time, self.MAX_LATENESS), now
        while elapsed > 0.0:
            step = min(elapsed, self._pause())
            self._step(step)
            elapsed -= step

    def _resting(self) -> bool:
        """Whether nothing but bytes changes the device soon."""
        return True

    def _step(self, time: float) -> None:
        """Let a short time pass, s."""

    def _take(self, data: bytes) -> None:
        """Receive bytes, or see that none have come."""
        raise NotImplementedError
