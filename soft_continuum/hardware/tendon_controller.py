# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tendon motion: which trajectories are accepted, how they are followed, and what stops them.

A trajectory that is not accepted changes nothing.  A stop always wins and lasts until resume.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from soft_continuum.hardware.protocols import HardwareError, TendonDriver, TendonReading
from soft_continuum.mechanics.chain import Array

JOIN_TOLERANCE = 2e-4
"""m between a set-point and a trajectory that replaces the present one; the driver smooths it."""
LATE = 0.2
"""s by which a trajectory may arrive late and still be joined."""
TENDONS = ('right_tendon', 'left_tendon')


class MotionRefusedError(ValueError):
    """A motion is not allowed; the message says what was asked for and what is allowed."""


@dataclass(frozen=True)
class TendonLimits:
    """Travel (m), speed (m/s) of the tendons."""

    pull_limits: tuple[float, float]
    speed_limit: float


class TendonController:
    """Follows trajectories of both tendons within limits, on one driver."""

    def __init__(self, driver: TendonDriver, limits: TendonLimits) -> None:
        """Use an opened ``driver``; nothing moves until a trajectory is accepted."""
        self._driver = driver
        self.limits = limits
        self.reading = driver.read()
        self.stopped = False
        self.stopped_because = ''
        self.homing = False  # or on the way from the switches to zero pull
        self._busy = False  # until the driver has come to rest after a trajectory
        self._interval = 0.02
        self._times: Array = np.zeros(0)
        self._pulls: Array = np.zeros((0, 2))
        self._setpoint = np.array(self.reading.pulls)
        self._setpoint_time = -np.inf

    @property
    def following(self) -> bool:
        """Whether a trajectory is being followed."""
        return len(self._times) > 0

    @property
    def busy(self) -> bool:
        """Whether the tendons move, or may still move to what they were sent."""
        return self._busy or self.reading.moving

    def accept(self, times: Array, pulls: Array, now: float,
               predict: Callable[[Array], None], begin: float | None = None) -> None:
        """
        Replace the present trajectory from ``now`` on.

        times: (points,) s on the clock of ``now``; pulls: (points, 2) m, right and left.
        begin: when the trajectory was to start, on the same clock; a late one may catch up as far
        as the driver's own limits let it.  ``predict`` raises MotionRefusedError for pulls (k, 2)
        that the arm must not be given.  Raises MotionRefusedError; then the present trajectory
        goes on unchanged.
        """
        if self.stopped:
            raise MotionRefusedError(
                f'stopped ({self.stopped_because}); call ~/resume before any motion')
        if self.homing:
            raise MotionRefusedError('the tendons are being homed; wait until they rest')
        if not self.reading.referenced:
            raise MotionRefusedError(
                'the position is not referenced; straighten the arm and call ~/reference')
        self._check(times, pulls, now)
        # The set-point that was sent last, then the points that are still ahead of it.
        start = max(now, self._setpoint_time) if self.following else now
        ahead = times > start
        if not ahead.any():  # it ends before the set-point after this one: go there by then
            ahead[-1], times = True, np.append(times[:-1], start + self._interval)
        times = np.concatenate([[start], times[ahead]])
        pulls = np.concatenate([[self._planned(start)], pulls[ahead]])
        steps = np.abs(np.diff(pulls, axis=0)).max(axis=1)
        # The resolution of seconds since 1970 counts as none.
        allowed = self.limits.speed_limit * (np.diff(times) + 2 * np.spacing(times[-1]))
        allowed = allowed * (1 + 1e-6)
        late = 0.0 if begin is None else min(max(0.0, start - begin), LATE)
        allowed[0] += JOIN_TOLERANCE + self.limits.speed_limit * late
        if np.any(steps > allowed):
            worst = int(np.argmax(steps - allowed))
            speed = steps[worst] / np.diff(times)[worst]
            raise MotionRefusedError(
                f'needs a tendon speed of {speed:.4g} m/s; '
                f'speed_limit: {self.limits.speed_limit:g} m/s')
        predict(pulls)
        self._times, self._pulls = times, pulls
        self._busy = True

    def _planned(self, time: float) -> Array:
        """Return where the present trajectory is at ``time``, or the set-point without one."""
        if not self.following:
            return self._setpoint
        return np.array([np.interp(time, self._times, self._pulls[:, i]) for i in (0, 1)])

    def _check(self, times: Array, pulls: Array, now: float) -> None:
        if not (np.all(np.isfinite(times)) and np.all(np.isfinite(pulls))):
            raise MotionRefusedError('positions and times must be finite numbers')
        if np.any(np.diff(times) <= 0.0):
            raise MotionRefusedError('time_from_start must increase from point to point')
        if times[-1] <= now - LATE:  # else it was as short as its way here was long
            raise MotionRefusedError(
                f'the trajectory ended {now - times[-1]:.3f} s ago; check header.stamp '
                '(zero: start now) and the clocks')
        low, high = self.limits.pull_limits
        if pulls.min() < low or pulls.max() > high:
            raise MotionRefusedError(
                f'pulls reach from {pulls.min():.4g} to {pulls.max():.4g} m; '
                f'pull_limits: {low:g} to {high:g} m')

    def hold(self) -> None:
        """End the present trajectory: brake and hold, ready for the next one."""
        self._times = np.zeros(0)
        if self.busy:
            self._driver.stop()

    def stop(self, reason: str) -> None:
        """Brake and hold; accept no motion before resume."""
        self.stopped, self.stopped_because = True, reason
        self._times = np.zeros(0)
        self._driver.stop()

    def resume(self) -> None:
        """Accept motion again, from where the tendons are."""
        self.stopped, self.stopped_because = False, ''
        self._setpoint = np.array(self.reading.pulls)

    def reference(self) -> None:
        """
        Take the present position as zero pull, or begin to home: the arm must be straight.

        Raises MotionRefusedError while the tendons move, or are stopped and would move.
        """
        if self.following or self.reading.moving:
            raise MotionRefusedError('the tendons are moving; wait until they rest')
        if self._driver.reference_moves and self.stopped:
            raise MotionRefusedError(
                f'stopped ({self.stopped_because}); call ~/resume before homing')
        self._driver.reference()
        self._busy = self.homing = self._driver.reference_moves
        self.update(0.0, 0.0)

    def update(self, now: float, interval: float) -> TendonReading:
        """Send the driver where it must be ``interval`` s from now; return where it is."""
        self._interval = interval or self._interval
        rested = not self.following
        if self.following:
            ahead = self._setpoint_time = now + interval
            self._setpoint = self._planned(ahead)
            try:
                self._driver.move((float(self._setpoint[0]), float(self._setpoint[1])), interval)
            except HardwareError:
                self._times = np.zeros(0)  # nothing goes on by itself when the device is back
                raise
            if ahead >= self._times[-1]:
                self._times = np.zeros(0)
        self.reading = self._driver.read()
        if rested and not self.reading.moving:
            self._busy = self.homing = False
            self._setpoint = np.array(self.reading.pulls)
        return self.reading
