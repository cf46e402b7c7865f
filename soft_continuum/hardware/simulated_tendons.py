# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated steppers: finite speed and acceleration, whole steps."""

from collections.abc import Callable
from math import copysign, sqrt

from soft_continuum.hardware.protocols import TendonReading

TIME_STEP = 0.001  # s


class SimulatedTendons:
    """Two simulated steppers that start at zero pull, referenced and at rest."""

    def __init__(self, clock: Callable[[], float], speed_limit: float,
                 acceleration_limit: float, step: float) -> None:
        """
        Take the time (s) from ``clock``.

        speed_limit: m/s.  acceleration_limit: m/s^2.  step: pull per motor step, m.
        """
        self._clock = clock
        self._speed_limit = speed_limit
        self._acceleration = acceleration_limit
        self._step = step
        self._time = clock()
        self._pulls = [0.0, 0.0]
        self._speeds = [0.0, 0.0]
        self._targets = [0.0, 0.0]
        self._arrival = self._time
        self._zero = [0.0, 0.0]

    def open(self) -> None:
        """Connect."""
        self._advance()

    def close(self) -> None:
        """Stop and hold."""
        self.stop()

    def read(self) -> TendonReading:
        """Return pulls in whole steps, and speeds."""
        self._advance()
        right, left = (
            self._step * round((p - z) / self._step)
            for p, z in zip(self._pulls, self._zero, strict=True))
        return TendonReading((right, left), (self._speeds[0], self._speeds[1]), referenced=True)

    def move(self, pulls: tuple[float, float], duration: float) -> None:
        """Set new targets, to be reached after ``duration`` s as far as the limits allow."""
        self._advance()
        self._targets = [self._step * round(p / self._step) + z
                         for p, z in zip(pulls, self._zero, strict=True)]
        self._arrival = self._time + duration

    def stop(self) -> None:
        """Brake with the acceleration limit."""
        self._advance()
        self._targets = [p + copysign(v * v / (2 * self._acceleration), v)
                         for p, v in zip(self._pulls, self._speeds, strict=True)]
        self._arrival = self._time

    def reference(self) -> None:
        """Take the present position as zero."""
        self._advance()
        self._zero = list(self._pulls)

    def _advance(self) -> None:
        """Integrate the motion up to now."""
        now = self._clock()
        while self._time < now:
            step = min(TIME_STEP, now - self._time)
            self._time += step
            for i in (0, 1):
                self._advance_motor(i, step)

    def _advance_motor(self, i: int, step: float) -> None:
        left = self._targets[i] - self._pulls[i]
        # As fast as arriving on time needs, but never too fast to brake before the target.
        wanted = min(abs(left) / max(self._arrival - self._time, step),
                     sqrt(2 * self._acceleration * abs(left)), self._speed_limit)
        change = copysign(wanted, left) - self._speeds[i]
        most = self._acceleration * step
        self._speeds[i] += max(-most, min(most, change))
        moved = self._speeds[i] * step
        if abs(left) <= abs(moved) + 1e-12 and abs(self._speeds[i]) <= 2 * most:
            self._pulls[i], self._speeds[i] = self._targets[i], 0.0
        else:
            self._pulls[i] += moved
