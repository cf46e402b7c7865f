# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Following a moving target with one segment: the soft one or, without jamming, any one.

A bending is the complex number angle times e^(i direction), rad, as of a BendingMap; towards x and
-x it is real, as always for a planar arm.

The pulls come from the model, at a reference angle: the target plus a correction.  The correction
is the reference at the time of the measurement minus the measured angle, through a low-pass
filter.  So a constant target is reached without an error, and delays known from stamps cause none:
docs/how_to/follow_a_moving_target.md has the proof of stability.
"""

from cmath import isfinite
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import degrees, expm1, inf, sqrt
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.planning.bending_map import bending_map, BendingLimits, complex_bending
from soft_continuum.planning.planner import minimum_jerk, minimum_jerk_duration
from soft_continuum.planning.settings import MotionLimits

LEAD = 0.035
"""Lead time (s) of changes in a piece, since tendon_actuation reads ahead."""
AHEAD_STEPS = 2
"""Periods before a piece brakes, which allow the next one to be late."""
OFFSET_SHARE = 0.25
"""Share of speed and acceleration for the motion from the first pulls to those of the map."""
MAX_GAP = 0.5  # s between two targets from which its speed is found
MAX_MEASURING_GAP = 0.2
"""Longest time (s) that one measurement counts for, also after a gap."""
MEMORY = 5.0  # s for which it is remembered where the reference was
MAX_HELD_CHANGE = 0.17
"""Largest rotation (rad) of another segment, for which the map remains valid."""


class TargetError(ValueError):
    """A target is refused; the message has the allowed range."""


class HeldSegmentMovedError(RuntimeError):
    """Another segment no longer has the shape for which the map was made."""


@dataclass(frozen=True)
class ServoSettings:
    """
    Limits and times of a servo.

    limits: of pulls and tension.  speed, acceleration: of the fastest tendon, m/s and m/s^2.
    period: s between two pieces.  horizon: s after which the tendons rest without a further piece.
    integral_time: s, time constant of the correction.  response_time: s, delay of the arm behind
    its planned pulls.  extrapolation: s for which a target is assumed to continue its motion.
    friction_band: m of pull; smaller corrections are not sent.  target_timeout: s after which a
    target is no longer followed.  measurement_timeout: s after which a measurement is stale.
    """

    limits: BendingLimits = BendingLimits()
    speed: float = MotionLimits.speed
    acceleration: float = MotionLimits.acceleration
    period: float = 0.04
    horizon: float = 0.35
    integral_time: float = 0.5
    response_time: float = 0.06
    extrapolation: float = 0.15
    friction_band: float = 0.00005
    target_timeout: float = 0.5
    measurement_timeout: float = 0.5

    def __post_init__(self) -> None:
        """Refuse a horizon in which the tendons cannot brake."""
        if self.braking_time < self.period:
            raise ValueError(f'a horizon of {self.horizon:g} s is too short for a period of '
                             f'{self.period:g} s')

    @property
    def braking_time(self) -> float:
        """Time available for braking, s."""
        return self.horizon - LEAD - (AHEAD_STEPS + 2) * self.period


@dataclass(frozen=True, eq=False)
class Piece:
    """
    A short trajectory that ends at rest.

    start: s, on the clock of the servo.  times: (k,) s from start, the first above zero.  pulls:
    (k, tendons) m.
    """

    start: float
    times: Array
    pulls: Array


@dataclass
class _Target:
    """Bending (rad) at a time (s), and how fast it moves (rad/s)."""

    angle: complex
    time: float
    speed: complex = 0.0

    def at(self, time: float, extrapolation: float) -> complex:
        return self.angle + self.speed * min(max(0.0, time - self.time), extrapolation)


@dataclass
class _Correction:
    """Low-pass filter of what the reference was too large by; wanted, and sent: rad."""

    wanted: complex = 0.0
    sent: complex = 0.0
    time: float = -inf  # of the last measurement, s
    seen: float = -inf  # when it came, s

    def update(self, error: complex, time: float, seconds: float, seen: float) -> None:
        gap = min(max(0.0, time - self.time), MAX_MEASURING_GAP)
        self.wanted += (error - self.wanted) * -expm1(-gap / seconds)
        self.time, self.seen = time, seen


@dataclass(frozen=True)
class _Point:
    """
    Where the reference is, rad, at a time, s.

    followed: s for which a target has been followed until then.
    """

    time: float
    angle: complex
    followed: float = 0.0


@dataclass
class _Motion:
    """What was planned last, its speed (rad/s), and what was before."""

    last: _Point
    speed: complex = 0.0
    past: deque[_Point] = field(default_factory=deque)

    def go_to(self, point: _Point) -> None:
        self.speed = (point.angle - self.last.angle) / (point.time - self.last.time)
        self.last = point
        self.past.append(point)
        while self.past[0].time < point.time - MEMORY:
            self.past.popleft()

    def was(self, time: float) -> complex:
        found: complex = np.interp(time, [point.time for point in self.past],
                                   [point.angle for point in self.past]).item()
        return found


class AngleServo:
    """
    Follows a target with one segment; all times are s of one steady clock.

    It is created for the shape of the arm when enabled, and moves nothing before the first target.
    """

    def __init__(self, statics: Any, settings: ServoSettings, state: Any, segment: int,
                 jamming: bool = True) -> None:
        """
        Compute the bending range of a segment (0-based); raises StaticsError if it is empty.

        jamming: whether the other segments are stiff.
        """
        self.settings, self.segment = settings, segment
        self.map = bending_map(statics, state, segment, settings.limits, jamming)
        self.limited = ''  # by what, as the target was followed last
        self._limit = statics.chain.arm.segments[segment].bending_angle_limit
        self._state = self._made_for = state
        self._target: _Target | None = None
        self._correction = _Correction()
        self._motion: _Motion | None = None
        self._offset, self._offset_time = np.zeros(len(state.pulls)), 1.0
        self._sent: Array | None = None  # the pulls at the end of the last piece
        share = 1.0 - OFFSET_SHARE
        self._acceleration = share * settings.acceleration / self.map.slope
        self._speed = min(share * settings.speed / self.map.slope,
                          self._acceleration * settings.braking_time)
        self._ahead: list[_Point] = []  # planned, but not passed yet

    # Targets.

    def set_angle(self, angle: complex, now: float) -> None:
        """Follow a bending, rad; a TargetError leaves the present target in place."""
        if not isfinite(angle):
            raise TargetError(f'a bending angle of {angle} rad; needed: a finite number')
        if abs(angle) > self._limit:
            raise TargetError(
                f'a bending angle of {_shown(angle)} rad; allowed by bending_angle_limits: '
                f'{-self._limit:.4g} to {self._limit:.4g} rad')
        if off := angle - self.map.along(angle):
            much, axis = (off.imag, 'y') if off.imag else (off.real, 'x')
            raise TargetError(f'a bending of {much:.4g} rad towards {axis}; allowed: 0, since '
                              'this arm bends in one plane')
        before, self._target = self._target, _Target(angle, now)
        if before is None or not 0.0 < now - before.time < MAX_GAP:
            return
        speed = (angle - before.angle) / (now - before.time)
        if abs(speed) <= self._speed:  # else it jumped
            self._target.speed = (before.speed + speed) / 2.0

    def set_tip(self, x: float, z: float, now: float, y: float = 0.0) -> None:
        """Follow a point (m) with the tip, as closely as this segment can."""
        if not (isfinite(x) and isfinite(y) and isfinite(z)):
            raise TargetError(f'a tip at {x}, {y}, {z} m; needed: finite numbers')
        self.set_angle(self.map.angle_for_tip(x, z, y), now)

    def clear_target(self) -> None:
        """Clear the target: brake and hold until the next one."""
        self._target = None

    def has_target(self, now: float) -> bool:
        """Whether there is a target that is not too old."""
        return (self._target is not None
                and now - self._target.time <= self.settings.target_timeout)

    # Measurements.

    def observe(self, state: Equilibrium, time: float, measured_time: float | None,
                now: float) -> None:
        """
        Process an estimate of the arm.

        time: of this shape.  measured_time: of its newest measurement, None without: then the
        correction is held.  Raises HeldSegmentMovedError.
        """
        self._state = state
        turned = np.linalg.norm(state.bending - self._made_for.bending, axis=1)
        turned[self.segment] = 0.0
        if turned.max() > MAX_HELD_CHANGE:
            held = 'is stiff' if any(state.stiff) else 'is held by its tendons'
            raise HeldSegmentMovedError(
                f'segment {int(turned.argmax()) + 1} {held}, but turned by '
                f'{degrees(turned.max()):.1f} degrees')
        correction = self._correction
        if (measured_time is None or measured_time <= correction.time
                or now - measured_time > self.settings.measurement_timeout):
            return
        if self._motion is None:
            correction.time, correction.seen = measured_time, now
            return
        then = self._motion.was(time - self.settings.response_time)
        error = then - self._bending(state)
        correction.update(error, measured_time, self.settings.integral_time, now)

    def is_measured(self, now: float) -> bool:
        """Whether there is a measurement that is not stale."""
        return now - self._correction.seen <= self.settings.measurement_timeout

    def _bending(self, state: Equilibrium) -> complex:
        """Return how the segment bends."""
        return self.map.along(complex_bending(state.bending, self.segment))

    @property
    def correction(self) -> complex:
        """Correction added to the target, rad."""
        return self._correction.sent

    # Motion.

    def advance(self, now: float, pulls: Sequence[float] | Array) -> Piece | None:
        """
        Return the next piece of trajectory to send now; None if nothing has to move.

        pulls: (tendons,) m, present; only used before the first piece.
        """
        target = self._target if self.has_target(now) else None
        if self._motion is None:
            if target is None:
                return None
            self._motion = self._begin(now, np.asarray(pulls, dtype=float))
        motion = self._motion
        while motion.last.time < now:  # the tendons followed the last piece
            motion.go_to(self._ahead.pop(0) if self._ahead else
                         replace(motion.last, time=motion.last.time + self.settings.period))
        self._correct()
        while motion.last.time < now + LEAD:
            motion.go_to(self._next(target, motion))
        self._ahead = self._planned_ahead(target, motion)
        points = [point for point in motion.past if point.time > now]
        return self._piece(now, points + self._ahead)

    def _planned_ahead(self, target: _Target | None, motion: _Motion) -> list[_Point]:
        """Return what the tendons do if no other piece comes: go on for a little, then rest."""
        ahead = _Motion(motion.last, motion.speed)
        for _ in range(AHEAD_STEPS):
            ahead.go_to(self._next(target, ahead))
        while ahead.speed:
            ahead.go_to(self._next(None, ahead))
        return list(ahead.past)

    def _piece(self, now: float, points: list[_Point]) -> Piece | None:
        low, high = self.settings.limits.pull_limits
        rows = np.array([
            np.clip(self.map.pulls_at(point.angle) + self._offset_at(point.followed), low, high)
            for point in points])
        if self._sent is not None and not np.abs(rows - self._sent).any():
            return None
        self._sent = rows[-1]
        return Piece(now, np.array([point.time - now for point in points]), rows)

    def _begin(self, now: float, pulls: Array) -> _Motion:
        """Begin at the angle that the arm has, or, measured, at that which the pulls stand for."""
        bendings, correction = self.map, self._correction
        present = self._bending(self._state)
        angle = bendings.clipped(present)
        if self.is_measured(now):
            angle = bendings.angle_for_pulls(pulls, angle)
            correction.wanted = correction.sent = angle - present
        self._offset = pulls - bendings.pulls_at(angle)
        largest = float(np.abs(self._offset).max())
        speed, acceleration = (OFFSET_SHARE * self.settings.speed,
                               OFFSET_SHARE * self.settings.acceleration)
        self._offset_time = max(self.settings.period,
                                minimum_jerk_duration(largest, speed, acceleration))
        begin = _Point(now, angle)
        return _Motion(begin, past=deque([begin]))

    def _offset_at(self, followed: float) -> Array:
        """Return the remaining difference of the pulls from those of the map, (tendons,), m."""
        t = min(followed / self._offset_time, 1.0)
        offset: Array = self._offset * (1.0 - minimum_jerk(t))
        return offset

    def _correct(self) -> None:
        """Send the correction if it is more than friction lets through."""
        correction = self._correction
        if abs(correction.wanted - correction.sent) * self.map.slope > (
                self.settings.friction_band):
            correction.sent = correction.wanted

    def _next(self, target: _Target | None, motion: _Motion) -> _Point:
        """Return where to be one period on, on the way to the target, or braking without one."""
        last, period = motion.last, self.settings.period
        most, followed = self._acceleration * period, last.followed
        if target is None:
            speed = _limited(motion.speed, max(0.0, abs(motion.speed) - most))
        else:
            speed = self._speed_towards(target, motion)
            speed = motion.speed + _limited(speed - motion.speed, most)
            speed = _limited(speed, self._speed)
            followed += period
        return _Point(last.time + period, self.map.clipped(last.angle + speed * period),
                      followed)

    def _speed_towards(self, target: _Target, motion: _Motion) -> complex:
        """Return the speed (rad/s) that the target asks for."""
        period = self.settings.period
        time = motion.last.time + period + self.settings.response_time
        wanted = target.at(time, self.settings.extrapolation) + self._correction.sent
        reference = self.map.clipped(wanted)
        self.limited = '' if reference == wanted else self.map.end(wanted)
        moves = target.speed if reference == wanted else 0.0
        away: complex = reference - motion.last.angle
        # As fast as it can still come to rest relative to the target, in whole periods.
        step = self._acceleration * period / 2.0
        fastest = sqrt(2.0 * self._acceleration * abs(away) + step**2) - step
        speed: complex = away / period
        if abs(speed - moves) > fastest:
            speed = moves + _limited(speed - moves, fastest)
        return speed


def _limited(value: complex, most: float) -> complex:
    """Return a number of at most that size."""
    size = abs(value)
    return value if size <= most else value * (most / size)


def _shown(bending: complex) -> str:
    return f'{abs(bending) if bending.imag else bending.real:.4g}'
