# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Conversion between ROS time, which may jump or stand still, and the steady clock of control.

Also the age of messages, by the steady clock.
"""

from math import inf
from time import monotonic
from typing import Self

from builtin_interfaces.msg import Duration, Time
from rclpy.clock import Clock

FRESH = 3.0  # s: an older measurement is not the shape's any more


def duration_to_ros(seconds: float) -> Duration:
    """Return s, not negative, as a message."""
    return Duration(sec=int(seconds), nanosec=min(999_999_999, int(seconds % 1.0 * 1e9)))


def stamp_of(seconds: float) -> Time:
    """Return a time of ROS in s, not negative, as a message."""
    whole, nanosec = divmod(round(max(0.0, seconds) * 1e9), 1_000_000_000)
    return Time(sec=whole, nanosec=nanosec)


class RosTime:
    """Stamps of messages as times of the steady clock, and back; the two need not run alike."""

    def __init__(self, clock: Clock) -> None:
        """Use the clock of a node."""
        self._clock = clock
        self._offset = self._now()

    def _now(self) -> float:
        """Return ROS time over steady time, s."""
        return float(self._clock.now().nanoseconds * 1e-9 - monotonic())

    def steady(self, stamp: Time) -> float | None:
        """Return the steady time (s) of a stamp as it is now; None for a stamp of zero."""
        ros = stamp.sec + stamp.nanosec * 1e-9
        return ros - self._now() if ros else None

    def stamp(self, steady: float) -> Time:
        """Return the stamp of a steady time (s) as it is now."""
        return stamp_of(steady + self._now())

    def jump(self) -> float:
        """Return the jump of ROS time against the steady clock since the last call, s."""
        before, self._offset = self._offset, self._now()
        return self._offset - before


class Age:
    """Time since a message was last received, by the steady clock."""

    def __init__(self) -> None:
        """Start as never received."""
        self._received = -inf

    @classmethod
    def now(cls) -> Self:
        """Return the age of a message that was received now."""
        age = cls()
        age.refresh()
        return age

    def refresh(self) -> None:
        """Note that it was received now."""
        self._received = monotonic()

    def clear(self) -> None:
        """Count as never received, until it is received again."""
        self._received = -inf

    @property
    def seconds(self) -> float:
        """Seconds since it was received; infinite before the first time."""
        return monotonic() - self._received
