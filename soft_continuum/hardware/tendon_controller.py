# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tendon motion: accepting, following and stopping trajectories, by limits and measured tensions.

A rejected trajectory changes nothing.  A stop always wins and lasts until resume.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import auto, Enum
from math import isfinite

import numpy as np

from soft_continuum.hardware.protocols import Accuracy, HardwareError, TendonDriver, TendonReading
from soft_continuum.mechanics.arm import Array

JOIN_TOLERANCE = 2e-4
"""Largest step (m) to a trajectory that replaces the present one; the driver smooths it."""
MAX_DELAY = 0.2
"""s by which a trajectory may arrive late and still be joined."""
SPARE = 0.02  # of the limit, for the noise of a load cell
SMALLEST_PULL = 1e-6  # m: less is no pulling in
MOST_NEGATIVE = 0.1  # of the limit: a tendon pushes less than the zero of a cell is off


class Reason(Enum):
    """Why a motion was refused or ended; names as in MotionRequest.reason."""

    NO_REASON = auto()
    INVALID = auto()
    BEYOND_LIMITS = auto()
    TENSION = auto()
    ALL_STIFF = auto()
    STIFFNESS_UNKNOWN = auto()
    STIFFNESS_CHANGED = auto()
    SHAPE_UNKNOWN = auto()
    NOT_REFERENCED = auto()
    HOMING = auto()
    STOPPED = auto()
    INACTIVE = auto()
    DEVICE = auto()
    REPLACED = auto()
    HELD = auto()
    LATE = auto()
    BUSY = auto()
    CLOCK = auto()
    PROGRAM = auto()
    CONFLICT = auto()


class MotionRefusedError(ValueError):
    """A motion is not allowed; the message has the request and the allowed range."""

    def __init__(self, reason: Reason, message: str) -> None:
        """Refuse with a ``reason`` for programs and a message for people."""
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True)
class TendonLimits:
    """
    Limits of tendon motion.

    tendons: their names.  pull_limits: smallest and largest pull, m.  speed_limit: m/s.
    """

    tendons: tuple[str, ...]
    pull_limits: tuple[float, float]
    speed_limit: float


class TendonController:
    """Follows trajectories of all tendons within limits, on one driver."""

    def __init__(self, driver: TendonDriver, limits: TendonLimits,
                 tensions: Callable[[], tuple[float, ...] | None] = lambda: None) -> None:
        """
        Use an opened ``driver``; nothing moves until a trajectory is accepted.

        tensions: N, of load cells that are not the driver's; None where there are none.
        """
        self.driver, self._tensions = driver, tensions
        self.limits = limits
        self.reading = self._read()
        self.stopped = False
        self.stopped_because = ''
        self.delay = 0.0  # s by which the present motion is later than it was sent
        self.end = 0.0  # of the last trajectory, on the clock of ``now``
        self.homing = False  # searching for the switches, or pulling from them to zero
        self._busy = False  # until the driver has come to rest after a trajectory
        self._interval = 0.02
        self._times: Array = np.zeros(0)
        self._pulls: Array = np.zeros((0, len(limits.tendons)))
        self._setpoint = np.array(self.reading.pulls)
        self._setpoint_time = -np.inf

    def _read(self) -> TendonReading:
        reading, tensions = self.driver.read(), self._tensions()
        if tensions is None:
            return reading
        # The accuracy of the driver's tensions does not apply to load cells.
        return replace(reading, tensions=tensions,
                       accuracy=Accuracy(reading.accuracy.pull_tolerances))

    @property
    def following(self) -> bool:
        """Whether a trajectory is being followed."""
        return len(self._times) > 0

    @property
    def busy(self) -> bool:
        """Whether the tendons move, or may still move to their set-points."""
        return self._busy or self.reading.moving

    def accept(self, times: Array, pulls: Array, now: float, begin: float | None = None,
               continues: bool = False) -> None:
        """
        Replace the present trajectory from ``now`` on by another one, as ``plan`` returns it.

        Raises MotionRefusedError; then the present trajectory continues unchanged.
        """
        times, pulls = self.plan(times, pulls, now, begin, continues)
        if not self.following:
            self._setpoint_time = now
        self._times, self._pulls, self._busy = times, pulls, True
        self.end = float(times[-1])

    def plan(self, times: Array, pulls: Array, now: float, begin: float | None = None,
             continues: bool = False) -> tuple[Array, Array]:
        """
        Return the times (k,) s and pulls (k, tendons) m of a trajectory followed from ``now`` on.

        times: (points,) s on the clock of ``now``.  pulls: (points, tendons) m.  begin: when the
        trajectory was to start, on the same clock; a late one may catch up as far as the driver's
        own limits let it.  continues: whether it goes on along the path of the present trajectory,
        which is followed up to its first point.  Changes nothing.  Raises MotionRefusedError.
        """
        if self.stopped:
            raise MotionRefusedError(Reason.STOPPED, f'stopped ({self.stopped_because}); call '
                                     '~/resume before any motion')
        if self.homing:
            raise MotionRefusedError(
                Reason.HOMING, 'the tendons are being homed; wait until they rest')
        if not self.reading.referenced:
            why = f' ({self.reading.unreferenced})' if self.reading.unreferenced else ''
            raise MotionRefusedError(
                Reason.NOT_REFERENCED, f'the position is not referenced{why}; straighten the arm '
                'and call ~/reference')
        self._check(times, pulls, now)
        # From the set-point that was sent last through the points that are still ahead of it.
        start = max(now, self._setpoint_time) if self.following else now
        ahead = times > start
        if not ahead.any():  # it ends before the next set-point: be at its end by then
            ahead[-1], times = True, np.append(times[:-1], start + self._interval)
        times, pulls = times[ahead], pulls[ahead]
        kept = np.flatnonzero((self._times > start) & (self._times < times[0]) & continues)
        times = np.concatenate([[start], self._times[kept], times])
        pulls = np.concatenate([[self._planned(start)], self._pulls[kept], pulls])
        steps = np.abs(np.diff(pulls, axis=0)).max(axis=1)
        # Seconds since 1970 have a coarse floating-point resolution.
        allowed = self.limits.speed_limit * (np.diff(times) + 2 * np.spacing(times[-1]))
        allowed = allowed * (1 + 1e-6)
        late = 0.0 if begin is None else min(max(0.0, start - begin), MAX_DELAY)
        allowed[0] += JOIN_TOLERANCE + self.limits.speed_limit * late
        if np.any(steps > allowed):
            worst = int(np.argmax(steps - allowed))
            speed = steps[worst] / np.diff(times)[worst]
            raise MotionRefusedError(
                Reason.BEYOND_LIMITS, f'needs a tendon speed of {speed:.4g} m/s; speed_limit: '
                f'{self.limits.speed_limit:g} m/s')
        return times, pulls

    def _planned(self, time: float) -> Array:
        """Return where the present trajectory is at ``time``, or the set-point without one."""
        if not self.following:
            return self._setpoint
        return np.array([np.interp(time, self._times, pulls) for pulls in self._pulls.T])

    def _check(self, times: Array, pulls: Array, now: float) -> None:
        tendons = self.limits.tendons
        if pulls.ndim != 2 or pulls.shape != (len(times), len(tendons)) or len(times) == 0:
            raise MotionRefusedError(
                Reason.INVALID, f'positions of shape {pulls.shape} were given; needed: for each '
                f'of {len(times)} points {", ".join(tendons)}')
        if not (np.all(np.isfinite(times)) and np.all(np.isfinite(pulls))):
            raise MotionRefusedError(
                Reason.INVALID, 'positions and times must be finite numbers')
        if np.any(np.diff(times) <= 0.0):
            raise MotionRefusedError(
                Reason.INVALID, 'time_from_start must increase from point to point')
        if times[-1] <= now - MAX_DELAY:  # it may be shorter than it took to arrive
            raise MotionRefusedError(
                Reason.LATE, f'the trajectory ended {now - times[-1]:.3f} s ago; check '
                'header.stamp (zero: start now) and the clocks')
        low, high = self.limits.pull_limits
        if pulls.min() < low or pulls.max() > high:
            worst = int(np.argmax(np.maximum(low - pulls, pulls - high).max(axis=0)))
            raise MotionRefusedError(
                Reason.BEYOND_LIMITS,
                f'pulls of {tendons[worst]} reach from {pulls[:, worst].min():.4g} to '
                f'{pulls[:, worst].max():.4g} m; pull_limits: {low:g} to {high:g} m')

    def hold(self) -> None:
        """End the present trajectory: brake and hold, ready for the next one."""
        self._times = np.zeros(0)
        if self.busy:
            self.driver.stop()

    def close(self) -> None:
        """Hold and disconnect."""
        self.driver.close()

    def stop(self, reason: str) -> None:
        """Brake and hold; accept no motion before resume."""
        self.stopped, self.stopped_because = True, reason
        self._times = np.zeros(0)
        self.driver.stop()

    def resume(self) -> None:
        """Accept motion again, from where the tendons are."""
        self.stopped, self.stopped_because = False, ''
        self._setpoint = np.array(self.reading.pulls)

    def check_reference(self) -> None:
        """Raise MotionRefusedError while the tendons move, or are stopped and would home."""
        if self.following or self.reading.moving:
            raise MotionRefusedError(
                Reason.INVALID, 'the tendons are moving; wait until they rest')
        if self.driver.reference_moves and self.stopped:
            raise MotionRefusedError(
                Reason.STOPPED, f'stopped ({self.stopped_because}); call ~/resume before homing')

    def reference(self) -> None:
        """
        Take the present position as zero pull, or begin to home: the arm must be straight.

        Raises as check_reference does.
        """
        self.check_reference()
        self.driver.reference()
        self._busy = self.homing = self.driver.reference_moves
        self.update(0.0, 0.0)

    def postpone(self, now: float) -> None:
        """
        Delay the trajectory by as much as the next update exceeds one interval.

        The delay is not made up, and applies to later parts of the motion.
        """
        late = now - self._setpoint_time
        if self.following and late > self._interval:
            self._times = self._times + late
            self.delay += late
            self.end += late
            self._setpoint_time = now

    def update(self, now: float, interval: float) -> TendonReading:
        """
        Send the driver the set-point ``interval`` s from now; return its reading.

        A late call postpones the trajectory.
        """
        self._interval = interval or self._interval
        rested = not self.following
        self.postpone(now)
        if self.following:
            ahead = self._setpoint_time = now + interval
            self._setpoint = self._planned(ahead)
            try:
                self.driver.move(tuple(float(pull) for pull in self._setpoint), interval)
            except HardwareError:
                self._times = np.zeros(0)  # nothing moves automatically when the device is back
                raise
            if ahead >= self._times[-1]:
                self._times = np.zeros(0)
        self.reading = self._read()
        if rested and not self.reading.moving:
            self._busy = self.homing = False
            self._setpoint = np.array(self.reading.pulls)
        return self.reading


class TensionGuard:
    """
    Refuses and ends motions that pull a tendon beyond the limit, where tension is measured.

    A tendon beyond the limit may only be paid out.
    """

    def __init__(self, tendons: Sequence[str]) -> None:
        """tendons: their names."""
        self._tendons = tendons
        self._lowest: tuple[float, ...] = ()  # N, of each since the motion began

    def refusal(self, reading: TendonReading, pulls: Array, limit: float) -> str:
        """Return why a motion through pulls (k, tendons) m must not begin; limit: N."""
        for t, tension in enumerate(reading.tensions or ()):
            if tension > (1.0 + SPARE) * limit and (
                    pulls[:, t].max() > reading.pulls[t] + SMALLEST_PULL):
                return f'{self._beyond(t, tension, limit)}; only pay it out'
        return ''

    def begin(self, reading: TendonReading) -> None:
        """Note the tensions with which a motion begins."""
        self._lowest = reading.tensions or ()

    def problem(self, reading: TendonReading, limit: float) -> str:
        """Return why a motion must end, empty for nothing; limit: N."""
        if reading.tensions is None:
            return ''
        lowest = self._lowest or (0.0,) * len(reading.tensions)
        self._lowest = tuple(map(min, reading.tensions, lowest))
        for t, tension in enumerate(reading.tensions):
            if tension > max(limit, lowest[t]) + SPARE * limit:
                return f'{self._beyond(t, tension, limit)}; check what blocks it, and pay it out'
        return ''

    def unmeasured(self, reading: TendonReading, limit: float) -> str:
        """Return which load cell is stale or implausible, empty for none; limit: N."""
        for name, tension in zip(self._tendons, reading.tensions or (), strict=False):
            if not isfinite(tension):
                return (f'the tension of {name} is not measured: its load cell is stale or '
                        'reports no number; check it, or disable it (load_cells.enabled: false, '
                        'or another driver)')
            if tension < -MOST_NEGATIVE * limit:
                return (f'the load cell of {name} shows {tension:.1f} N, but a tendon cannot '
                        'push; check its sign, its scale and its zero')
        return ''

    def _beyond(self, tendon: int, tension: float, limit: float) -> str:
        return (f'the measured tension of {self._tendons[tendon]} is {tension:.1f} N; '
                f'tension_limit: {limit:g} N')
