# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A clock on which devices and drivers run as fast as the computer can, in the right order."""

from contextlib import suppress
from dataclasses import dataclass, field
import os
from select import select
import threading
import tty

from soft_continuum.hardware.clock import Clock

CHECK_INTERVAL = 0.01  # s of real time between two looks for threads that have ended


@dataclass
class Waiter:
    """A thread that waits for files or until a time (s)."""

    files: list
    until: float
    woken: threading.Event = field(default_factory=threading.Event)


class VirtualClock(Clock):
    """
    Time that passes only while all threads that use it wait on it, and then at once.

    A busy computer therefore delays nothing.  The thread that makes it counts from the start, any
    other from its first wait to its end.
    """

    def __init__(self):
        self._now = 1000.0
        self._lock = threading.Lock()
        self._threads = {threading.current_thread()}
        self._waiters = {}
        self._probe = os.openpty()
        tty.setraw(self._probe[1])

    def __del__(self):
        for end in self._probe:
            os.close(end)

    def __call__(self):
        return self._now

    def wait(self, files, timeout):
        if timeout <= 0.0:
            return select(files, [], [], 0.0)[0]
        me = threading.current_thread()
        waiter = Waiter(list(files), self._now + timeout)
        with self._lock:
            self._threads.add(me)
            self._waiters[me] = waiter
            self._go_on()
        while not waiter.woken.wait(CHECK_INTERVAL):
            with self._lock:
                self._go_on()
        return select(files, [], [], 0.0)[0]

    def _go_on(self):
        """When all threads wait, wake those that have data, or else let time pass."""
        self._threads = {thread for thread in self._threads if thread.is_alive()}
        if self._threads - self._waiters.keys():
            return
        ready = self._ready()
        if not ready:
            self._let_bytes_arrive()
            ready = self._ready()
        if not ready:
            self._now = max(self._now, min(w.until for w in self._waiters.values()))
            ready = [t for t, w in self._waiters.items() if w.until <= self._now]
        for thread in ready:
            self._waiters.pop(thread).woken.set()

    def _let_bytes_arrive(self):
        """Wait until what was written before has reached the other end of its pseudo-terminal."""
        for end, other in (self._probe, self._probe[::-1]):
            os.write(end, b'.')
            os.read(other, 1)

    def _ready(self):
        """Return the threads whose files can be read, or are not open any more."""
        try:
            found = set(select(
                {file for w in self._waiters.values() for file in w.files}, [], [], 0.0)[0])
        except (OSError, ValueError):
            return [thread for thread, w in self._waiters.items() if self._fails(w.files)]
        return [thread for thread, w in self._waiters.items() if found.intersection(w.files)]

    @staticmethod
    def _fails(files):
        with suppress(OSError, ValueError):
            select(files, [], [], 0.0)
            return False
        return True
