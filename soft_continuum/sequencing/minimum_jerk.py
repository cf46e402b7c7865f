# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The minimum-jerk profile, from rest to rest (Flash and Hogan, 1985)."""

from math import sqrt
from typing import TypeVar

from soft_continuum.mechanics.arm import Array

Time = TypeVar('Time', float, Array)


def progress(t: Time) -> Time:
    """Return the completed part of the path at a part of the time, both 0 to 1."""
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


def duration(length: float, speed: float, acceleration: float) -> float:
    """Return the time (s) for a distance (m) within a speed (m/s) and an acceleration (m/s^2)."""
    # Their peaks: 15/8 and 10/sqrt(3) of the mean.
    return max(15 / 8 * length / speed, sqrt(10 / sqrt(3) * length / acceleration))
