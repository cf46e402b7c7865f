# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
IMUs on the discs of an arm: directions of up in their frames, and how they are mounted.

A Kalman filter for a direction and the biases of the gyroscope.  The direction turns opposite to
the gyroscope's rate; the accelerometer measures it while the disc does not accelerate.  The turn
of the disc about the vertical is not observable.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import cos, exp, hypot, isnan, nan, sin, sqrt
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from soft_continuum.estimation.sensing.tare import SensorError, turn_of, Window
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.rotations import (
    cross_matrices,
    moved_by,
    rotation,
    turn_between,
    UNKNOWN,
)
from soft_continuum.parameters.parameter import ParameterError

MIN_STEP = 0.0009
"""Least s between two samples that are used: faster ones are dropped."""
MAX_GAP = 0.5
"""s without a sample after which the angle is reset; the bias is kept."""
BIAS_WALK = 5e-4
"""Drift of the bias of the gyroscope in a second, rad/s."""
QUIET_TIME = 0.3
"""s of a steady rate and a magnitude of g, after which the bias is estimated."""
QUIET_RATE = 0.02
"""rad/s, besides the noise, by which a steady rate may vary."""
QUIET_ACCELERATION = 0.1
"""m/s^2, besides the noise and the mean, by which the magnitude may differ from g."""
UNNOTICED = 0.01
"""m/s^2, standard deviation of the acceleration of a disc that appears at rest."""
MOTION_TIME = 0.5
"""s, correlation time of the acceleration of a motion."""
AVERAGING_TIME = 1.0
"""s over which the magnitude of the acceleration is averaged."""
MAX_AVERAGED = 3.0
"""Limit for the mean, over g: shocks count as this."""
MAX_MAGNITUDE_ERROR = 0.1
"""Error of the mean over g, beyond which the unit or the scale is wrong."""
MIN_IN_PLANE = 0.5
"""Of g, in the plane of the arm."""
GATE = 5.0
"""Standard deviations beyond which a sample is an outlier."""
MAX_OUTLIERS = 0.5
"""s of outliers alone, after which the angle is reset."""
DISAGREE = ('gyroscope and accelerometer disagree; are rates in rad/s, and does imu.axes fit how '
            'it is mounted?')
UP, BIAS = slice(3), slice(3, 6)
TINY = 1e-12  # rad, or m/s^2
EYE, EYE6 = np.eye(3), np.eye(6)
MOUNTED = {1: ('mounting_angles', 'one for all or for each of {} discs'),
           3: ('mounting_turns', 'a rotation vector for each of {} discs, or 0.0 for none')}
"""Parameter imu.* of the mounting, by the number of axes about which a disc turns."""
AXES = {sign + name: float(f'{sign}1') * np.eye(3)[i]
        for i, name in enumerate('xyz') for sign in '+-'}
"""Axes by name; always with a sign, since ROS reads y in a parameter file as true."""


@dataclass(frozen=True)
class ImuSettings:
    """
    Settings of IMUs; standard deviations unless noted.

    gravity: m/s^2, its value.  acceleration_stddev (m/s^2) and rate_stddev (rad/s): of one sample
    if the IMU reports none.  bias_stddev: rad/s, of the gyroscope when switched on.
    motion_acceleration: m/s^2, of a moving disc.  stddev: rad, of errors common to all samples at
    an angle: mounting, and offset of the accelerometer.
    """

    gravity: float
    acceleration_stddev: float = 0.05
    rate_stddev: float = 0.003
    bias_stddev: float = 0.05
    motion_acceleration: float = 1.0
    stddev: float = 0.01


@dataclass(frozen=True)
class ImuSample:
    """
    One measurement, in the frame of the disc: z along its axis.

    time: s, of its stamp.  acceleration: (x, y, z) m/s^2; at rest g upwards.
    rate: about x, y and z, (3,) rad/s.  The variances are of one component; 0 if unknown.
    """

    time: float
    acceleration: tuple[float, float, float]
    rate: Array
    acceleration_variance: float = 0.0
    rate_variance: float = 0.0


class UpFilter:
    """
    Estimates the unit vector up in the frame of a disc, (3,).

    up: at ``time``, s, of the last sample; nan before the first.  bias: (3,) rad/s, of the
    gyroscope.  covariance: (6, 6), of both.
    """

    def __init__(self, settings: ImuSettings, axes: NDArray[np.bool_]) -> None:
        """
        Start without a sample; raises SensorError if gravity does not determine the angle.

        axes: (3,), about which of x, y and z the disc turns.
        """
        if settings.gravity == 0.0:
            raise SensorError('arm.gravity is 0, so no tilt can be measured; if the arm lies '
                              'flat, use a camera or a tracker')
        self._settings, self._axes, self._moved = settings, axes, moved_by(axes)
        self.time = nan
        self.up, self.bias = np.full(3, nan), np.zeros(3)
        self.covariance = np.zeros((6, 6))
        self.covariance[BIAS, BIAS] = settings.bias_stddev**2 * EYE
        self._magnitude = nan  # mean of the acceleration, m/s^2
        self._rate = np.zeros(3)  # mean, rad/s
        self._quiet = 0.0  # s
        self._last_good = nan  # s, when the accelerometer was believed

    @property
    def is_quiet(self) -> bool:
        """Whether the disc shows no acceleration."""
        return self._quiet >= QUIET_TIME

    @property
    def up_covariance(self) -> Array:
        """Covariance of up, across it, (3, 3), including errors common to all samples."""
        found = self.covariance[UP, UP] + self._settings.stddev**2 * EYE
        across = EYE - np.outer(self.up, self.up)
        return np.asarray(across @ found @ across)

    def update(self, sample: ImuSample) -> bool:
        """
        Process a sample; return whether the estimate was updated to its time.

        It is not if the sample comes too soon, is older than the last, or is an outlier.  Raises
        SensorError for an unusable sample.
        """
        settings, step = self._settings, sample.time - self.time
        if 0.0 <= step < MIN_STEP or -MAX_GAP < step < 0.0:
            return False
        restart = not 0.0 <= step <= MAX_GAP or isnan(self._last_good)  # also the first
        magnitude, rate = hypot(*sample.acceleration), self._axes * sample.rate
        noise = sqrt(sample.acceleration_variance) or settings.acceleration_stddev
        rate_noise = sqrt(sample.rate_variance) or settings.rate_stddev
        self._average(rate, magnitude, noise, rate_noise, step, restart)
        if restart:
            gap = step if step > 0.0 else 0.0  # false for nan, before the first
            self.covariance[BIAS, BIAS] += BIAS_WALK**2 * gap * EYE
        else:
            self._predict(rate, rate_noise, step)
        self.time = sample.time
        self._check()
        up, size = self._seen(sample.acceleration)
        # The accelerometer: successive samples in a motion have the same error.
        motion = UNNOTICED**2 if self.is_quiet else (
            settings.motion_acceleration**2 + (magnitude - settings.gravity)**2)
        variance = noise**2 + motion * (1.0 if restart else max(1.0, MOTION_TIME / step))
        variance /= size**2
        if restart:
            self._restart(up, variance)
            return True
        away = cross_matrices(turn_between(self.up, up)) @ self.up  # along the circle to it
        weight = np.linalg.inv(self.covariance[UP, UP] + variance * EYE)
        if away @ weight @ away > GATE**2:
            if sample.time - self._last_good > MAX_OUTLIERS:
                self._restart(up, variance)
                raise SensorError(DISAGREE)
            return False
        self._last_good = sample.time
        self._correct(away, self.covariance[:, UP] @ weight, variance)
        return True

    def _average(self, rate: Array, magnitude: float, noise: float, rate_noise: float,
                 step: float, restart: bool) -> None:
        """Note for how long neither the rate nor the magnitude has changed."""
        if restart:
            self._magnitude, self._rate, self._quiet = magnitude, rate, 0.0
            return
        limited = min(magnitude, MAX_AVERAGED * self._settings.gravity)
        self._magnitude += (1.0 - exp(-step / AVERAGING_TIME)) * (limited - self._magnitude)
        steady = (hypot(*(rate - self._rate).tolist()) < QUIET_RATE + 4.0 * rate_noise
                  and abs(magnitude - self._magnitude) < QUIET_ACCELERATION + 4.0 * noise)
        self._rate = self._rate + (1.0 - exp(-step / QUIET_TIME)) * (rate - self._rate)
        self._quiet = self._quiet + step if steady else 0.0

    def _check(self) -> None:
        gravity = self._settings.gravity
        if abs(self._magnitude - gravity) > MAX_MAGNITUDE_ERROR * gravity:
            raise SensorError(
                f'an acceleration of {self._magnitude:.2f} m/s^2 in the mean, at rest it is '
                f'{gravity:.2f} (arm.gravity); is it in m/s^2, gravity included?')

    def _seen(self, acceleration: tuple[float, float, float]) -> tuple[Array, float]:
        """Return the direction of an acceleration and its magnitude, m/s^2."""
        gravity, seen = self._settings.gravity, self._moved * acceleration
        size = hypot(*seen.tolist())
        if size < MIN_IN_PLANE * gravity and not self._moved.all():
            across = 'xyz'[int(np.argmin(self._moved))]
            where = (f'lies along {across} of the disc' if hypot(*(acceleration - seen)) > size
                     else 'is balanced by motion')
            raise SensorError(
                f'{size:.1f} of {gravity:.1f} m/s^2 in the plane of the arm: gravity {where}; '
                'does imu.axes fit how it is mounted? IMUs cannot measure an arm that lies flat')
        return np.asarray(seen / max(size, TINY)), max(size, TINY)

    def _predict(self, rate: Array, noise: float, step: float) -> None:
        """Predict over a step, s, with a rate (rad/s) and its standard deviation."""
        turn = (rate - self.bias) * step
        moves = EYE6.copy()
        moves[UP, UP] = back = rotation(-turn)
        self.up = back @ self.up
        moves[UP, BIAS] = by_rate = -step * cross_matrices(self.up)  # it turns by up x rate
        self.covariance = moves @ self.covariance @ moves.T
        # At another angle the offset of the accelerometer is another angle.
        self.covariance[UP, UP] += (noise**2 * by_rate @ by_rate.T
                                    + self._settings.stddev**2 * hypot(*turn.tolist()) * EYE)
        self.covariance[BIAS, BIAS] += BIAS_WALK**2 * step * EYE

    def _restart(self, up: Array, variance: float) -> None:
        """Set the direction from the accelerometer, with its variance, rad^2."""
        self.up, self._last_good = up, self.time
        self.covariance[UP], self.covariance[:, UP] = 0.0, 0.0
        self.covariance[UP, UP] = variance * EYE

    def _correct(self, away: Array, gain: Array, variance: float) -> None:
        """Update with the accelerometer; the bias only while the disc is at rest."""
        if not self.is_quiet:
            gain[BIAS] = 0.0
        step = gain @ away
        matrix = rotation(cross_matrices(self.up) @ step[UP])
        self.up, self.bias = matrix @ self.up, self.bias + step[BIAS]
        # Joseph's form, which holds for any gain; what is known of up is turned with it.
        kept = EYE6.copy()
        kept[:, UP] -= gain
        kept[UP], gain[UP] = matrix @ kept[UP], matrix @ gain[UP]
        self.covariance = kept @ self.covariance @ kept.T + variance * gain @ gain.T


class MountedImus:
    """
    IMUs on the discs; they measure up (the vertical), not a turn about it.

    mounts: (discs, 3), rotation vectors, rad, of each IMU on its disc.
    """

    def __init__(self, settings: ImuSettings, axes: NDArray[np.bool_], mounts: Array, up: Array
                 ) -> None:
        """Begin without a sample; axes: (6,), as pose_axes.  up: in base_link, (3,)."""
        self.mounts, self._settings, self._up = mounts, settings, up
        self._turns, self._moved = axes[3:], moved_by(axes[3:])
        self._known = np.logical_and.outer(axes, axes)
        self._filters: dict[int, UpFilter] = {}
        self._windows = [Window[Array]() for _ in mounts]

    @classmethod
    def of(cls, values: Mapping[str, Any], arm: Arm) -> Self:
        """Return the IMUs of parameters imu.*; raises ParameterError."""
        axes, discs, mounts = arm.pose_axes[3:], len(arm.discs), np.zeros((len(arm.discs), 3))
        name, needed = MOUNTED[axes.sum()]
        given = values[f'imu.{name}']
        if len(given) not in (1, axes.sum() * discs) or (
                len(given) == 1 and given[0] != 0.0 and axes.all()):
            raise ParameterError(f'parameter imu.{name} has {len(given)} values; needed: '
                                 f'{needed.format(discs)}')
        mounts[:, axes] = np.reshape(given, (discs, -1)) if len(given) > 1 else given[0]
        gravity = float(np.linalg.norm(arm.gravity))
        return cls(ImuSettings(gravity, *(
            values[f'imu.{one.name}'] for one in fields(ImuSettings)[1:])),
                   arm.pose_axes, mounts,
                   -np.array(arm.gravity) / gravity if gravity else np.array([0.0, 0.0, 1.0]))

    def measure(self, n: int, sample: ImuSample, accelerations: Array, rates: Array, now: float
                ) -> tuple[Array, Array] | None:
        """
        Return pose and covariance of disc n for a DiscMeasurement; None if there is none yet.

        sample: in the frame of the disc.  accelerations, rates: (3,), their variances, 0 if
        unknown.  now: s of a monotonic clock.  Raises SensorError.
        """
        if n not in self._filters:  # raises where there is no gravity
            self._filters[n] = UpFilter(self._settings, self._turns)
        found = self._filters[n]
        if not found.update(replace(
                sample, rate_variance=float((self._turns * rates).max()),
                acceleration_variance=float((self._moved * accelerations).max()))):
            return None
        self._windows[n].add(now, found.up)
        mount = rotation(self.mounts[n])
        pose, covariance = pose_of_up(mount @ found.up, mount @ found.up_covariance @ mount.T,
                                      self._up, UNKNOWN)
        return pose, np.where(self._known, covariance, UNKNOWN * np.eye(6))

    def straight(self, n: int, now: float) -> Array | None:
        """
        Return the mounting of an IMU from the last second on the straight arm; None without one.

        Raises SensorError.
        """
        seen = self._windows[n].recent(now)
        return turn_of(seen, self._up) if seen else None

    def kept(self) -> tuple[str, tuple[float, ...]]:
        """Return the name, without imu., and value of the mounting parameter."""
        return MOUNTED[self._turns.sum()][0], tuple(self.mounts[:, self._turns].ravel().tolist())

    def biases(self) -> dict[int, str]:
        """Return the biases of the active gyroscopes about each axis, rad/s."""
        return {n: ' '.join(f'{value:.4f}' for value in one.bias[self._turns])
                for n, one in sorted(self._filters.items())}


def pose_of_up(up: Array, covariance: Array, to: Array, unseen: float) -> tuple[Array, Array]:
    """
    Return pose (7,) and covariance (6, 6) of a disc with only a measured up direction, (3,).

    covariance: (3, 3), of up.  to: up in base_link, (3,).  unseen: variance of the unmeasured
    position and turn about the vertical.
    """
    vector = turn_between(up, to)
    matrix, half = rotation(vector), max(hypot(*vector.tolist()) / 2.0, TINY)
    lever = -cross_matrices(to) @ matrix  # what moves up turns it across
    full = unseen * np.eye(6)
    full[3:, 3:] = lever @ covariance @ lever.T + unseen * np.outer(to, to)
    return np.array([0.0, 0.0, 0.0, *sin(half) / half / 2.0 * vector, cos(half)]), full


def imu_rotations(axes: Sequence[str], discs: int) -> tuple[Array, ...]:
    """
    Return by disc the rotation (3, 3) from coordinates in its IMU to those in the disc.

    axes: IMU axes along x, y and z of the disc, such as +x, -z, +y; three for all discs, or three
    for each.  Raises ParameterError for invalid axes.
    """
    if len(axes) not in (3, 3 * discs):
        raise ParameterError(f'parameter imu.axes has {len(axes)} entries; needed: the axes of '
                             f'the IMU along x, y and z of the disc, for all or each of {discs}')
    if unknown := [axis for axis in axes if axis not in AXES]:
        raise ParameterError(
            f'parameter imu.axes has {unknown[0]!r}; allowed: {", ".join(AXES)}')
    found = []
    for i in range(0, len(axes), 3):
        turn = np.array([AXES[axis] for axis in axes[i:i + 3]])
        if round(float(np.linalg.det(turn))) != 1:
            raise ParameterError(f'parameter imu.axes has {list(axes[i:i + 3])}: these are not '
                                 'the axes of a right-handed frame, in this order')
        found.append(turn)
    return tuple(found) if len(found) == discs else tuple(found * discs)
