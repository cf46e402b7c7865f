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


STEADY = Clock()
"""Real time, which is never set."""
