# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The clock of drivers and emulators, which tests and demonstrations can run faster."""

from collections.abc import Sequence
from select import select
from time import monotonic


class Clock:
    """Steady time in s, and all waiting on it."""

    def __init__(self, factor: float = 1.0) -> None:
        """Let ``factor`` s pass in each s of real time."""
        self._factor = factor

    def __call__(self) -> float:
        """Return the time, s."""
        return monotonic() * self._factor

    def wait(self, files: Sequence[int], timeout: float) -> list[int]:
        """
        Return which of ``files`` (descriptors) can be read, after ``timeout`` s at the latest.

        Raises OSError or ValueError when one of them is not open.
        """
        return select(files, [], [], max(0.0, timeout) / self._factor)[0]

    def sleep(self, seconds: float) -> None:
        """Wait."""
        self.wait((), seconds)


class Looks:
    """
    Time for detecting stale peers; it stands still while this program does not look.

    At most GAP counts between two looks: a program that was delayed cannot know that nothing was
    received.
    """

    GAP = 0.1  # s

    def __init__(self, clock: Clock) -> None:
        """Begin with a look at time 0."""
        self._clock, self._last, self._time = clock, clock(), 0.0

    def look(self) -> None:
        """Add the time since the last look, at most GAP."""
        last, self._last = self._last, self._clock()
        self._time += min(self._last - last, self.GAP)

    def __call__(self) -> float:
        """Return the time of the last look, s."""
        return self._time


STEADY = Clock()
"""Real time, which is never set."""
