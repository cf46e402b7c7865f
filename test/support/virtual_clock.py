# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Clocks that run as fast as the computer can: in the right order, or only when told."""

from contextlib import suppress
from select import select
import threading
from time import monotonic

from soft_continuum.hardware.clock import Clock

START_TIME = 3.0  # s of real time that a new thread may take until it waits for the first time
CHECK_INTERVAL = 0.01  # s of real time between two looks for threads that have ended


class ToldClock:
    """A clock that goes on only when told, by adding to ``now``."""

    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


class Waiter:
    """A thread that waits for files or until a time (s), on a lock that is released to wake it."""

    def __init__(self, files, until):
        self.files, self.until, self.asleep = files, until, threading.Lock()
        self.asleep.acquire()


class VirtualClock(Clock):
    """
    Time that passes only while all threads that use it wait on it, and then at once.

    A busy computer therefore delays nothing.  The thread that makes it counts from the start, any
    other that is begun later from there to its end, unless it never waits.  What was written to a
    pseudo-terminal is there when its other end is looked at: Linux sees to that.
    """

    def __init__(self):
        self._now = 1000.0
        self._lock = threading.Lock()
        self._threads = {threading.current_thread()}
        self._waiters = {}
        self._others = set(threading.enumerate()) - self._threads  # that never wait on it
        self._born = {}  # when threads were first seen that have not waited yet

    def __call__(self):
        return self._now

    def wait(self, files, timeout):
        if timeout <= 0.0:
            return select(files, [], [], 0.0)[0]
        me = threading.current_thread()
        waiter = Waiter(files, self._now + timeout)
        with self._lock:
            self._threads.add(me)
            self._waiters[me] = waiter
            self._go_on()
        while not waiter.asleep.acquire(timeout=CHECK_INTERVAL):
            with self._lock:
                self._go_on()
        return select(files, [], [], 0.0)[0] if files else []

    def _go_on(self):
        """When all threads wait, wake those that have data, or else let time pass."""
        for thread in self._threads - self._waiters.keys():
            if thread.is_alive():
                return
            self._threads.discard(thread)
        if self._some_begin():
            return
        ready = self._ready()
        if not ready:
            self._now = max(self._now, min(w.until for w in self._waiters.values()))
            ready = [t for t, w in self._waiters.items() if w.until <= self._now]
        for thread in ready:
            self._waiters.pop(thread).asleep.release()

    def _some_begin(self):
        """Whether a thread may be on its way to its first wait: a busy computer starts it late."""
        begun = set(threading.enumerate()) - self._others - self._threads
        if not begun:
            return False
        now = monotonic()
        self._born = {thread: self._born.get(thread, now) for thread in begun}
        return any(now - since < START_TIME for since in self._born.values())

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


class LateClock(VirtualClock):
    """Time on a computer so busy that one thread goes on late, by ``lateness`` s of a timeout."""

    def __init__(self, thread, lateness):
        super().__init__()
        self._thread, self._lateness = thread, lateness
        self.late = 0.0  # s, in all

    def wait(self, files, timeout):
        found = super().wait(files, timeout)
        if threading.current_thread().name == self._thread:
            late = self._lateness(timeout)
            self.late += late
            super().wait((), late)
        return found
