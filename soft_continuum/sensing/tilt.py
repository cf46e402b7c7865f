# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Where up is in the frame of a disc, from an IMU on it: of a hinge, the angle about it.

A Kalman filter of a direction and the biases of the gyroscope.  The direction turns against the
disc, as the gyroscope says; the accelerometer says where it is, as long as the disc does not
accelerate.  How the disc is turned about the vertical nobody sees.
"""

from dataclasses import dataclass
from math import atan2, exp, hypot, isnan, nan, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics.arm import Array
from soft_continuum.sensing.rigid import moved_by

MIN_STEP = 0.0009
"""s between two samples that are used: one that comes faster is left out."""
MAX_GAP = 0.5
"""s without a sample after which the angle starts anew; the bias is kept."""
BIAS_WALK = 5e-4
"""By how much the bias of the gyroscope drifts in a second, rad/s."""
QUIET_TIME = 0.3
"""s of a steady rate and a magnitude of g, after which the bias is estimated."""
QUIET_RATE = 0.02
"""rad/s, besides the noise, by which a steady rate may vary."""
QUIET_ACCELERATION = 0.1
"""m/s^2, besides the noise and the mean, by which the magnitude may differ from g."""
UNNOTICED = 0.01
"""m/s^2, standard, of the acceleration of a disc that seems to be quiet."""
MOTION_TIME = 0.5
"""s over which the acceleration of a motion stays about the same."""
AVERAGING_TIME = 1.0
"""s over which the magnitude of the acceleration is averaged."""
MAX_AVERAGED = 3.0
"""Of g: a blow counts as that in the mean."""
MAX_MAGNITUDE_ERROR = 0.1
"""Of g, in the mean: beyond it the unit or the scale is wrong."""
MIN_IN_PLANE = 0.5
"""Of g, in the plane of the arm."""
GATE = 5.0
"""Standard deviations; what is farther off than this is an outlier."""
MAX_OUTLIERS = 0.5
"""s of outliers alone, after which the angle starts anew."""
DISAGREE = ('gyroscope and accelerometer disagree; are rates in rad/s, and does imu.axes fit how '
            'it is mounted?')
UP, BIAS = slice(3), slice(3, 6)
TINY = 1e-12  # rad, or m/s^2
EYE, EYE6 = np.eye(3), np.eye(6)


class SensorError(ValueError):
    """What a sensor sends cannot be used; the message says why, and what to do."""


@dataclass(frozen=True)
class ImuSettings:
    """
    What is known of IMUs and of the arm.

    gravity: m/s^2.  acceleration_stddev (m/s^2) and rate_stddev (rad/s): standard, of one
    sample, where the IMU does not tell.  bias_stddev: rad/s, of the gyroscope when it is
    switched on.  motion_acceleration: m/s^2, standard, of a disc that moves.  stddev: rad,
    standard, of what an IMU is off in every sample at an angle alike: its mounting, and its
    accelerometer's offset.
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

    time: s, of its stamp.  acceleration: (x, y, z) m/s^2, of what is at rest g upwards.
    rate: about x, y and z, (3,) rad/s.  The variances are of one component; 0 where they are not
    known.
    """

    time: float
    acceleration: tuple[float, float, float]
    rate: Array
    acceleration_variance: float = 0.0
    rate_variance: float = 0.0


class UpFilter:
    """
    Estimates where up is in the frame of a disc, (3,), of length 1.

    up is that at ``time``, s, of the last sample; nan before the first.  bias: (3,) rad/s, of the
    gyroscope.  covariance: (6, 6), of both.
    """

    def __init__(self, settings: ImuSettings, axes: NDArray[np.bool_]) -> None:
        """
        Start without a sample; raises SensorError where gravity tells nothing.

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
        """Whether nothing shows that the disc accelerates."""
        return self._quiet >= QUIET_TIME

    @property
    def up_covariance(self) -> Array:
        """Of up, across it, (3, 3), what is off in every sample included."""
        found = self.covariance[UP, UP] + self._settings.stddev**2 * EYE
        across = EYE - np.outer(self.up, self.up)
        return np.asarray(across @ found @ across)

    def update(self, sample: ImuSample) -> bool:
        """
        Take one more sample; return whether what is estimated is now that of its time.

        It is not when the sample comes too soon, is older than the last, or is an outlier.  Raises
        SensorError for a sample from which nothing can be had.
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
        # The accelerometer: of a motion, samples soon after each other are off alike.
        motion = UNNOTICED**2 if self.is_quiet else (
            settings.motion_acceleration**2 + (magnitude - settings.gravity)**2)
        variance = noise**2 + motion * (1.0 if restart else max(1.0, MOTION_TIME / step))
        variance /= size**2
        if restart:
            self._restart(up, variance)
            return True
        away = skew(turn_between(self.up, up)) @ self.up  # along the circle to it
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
        """Return what an acceleration says, and by how much of it, m/s^2."""
        gravity, seen = self._settings.gravity, self._moved * acceleration
        size = hypot(*seen.tolist())
        if size < MIN_IN_PLANE * gravity and not self._moved.all():
            across = 'xyz'[int(np.argmin(self._moved))]
            where = (f'lies along {across} of the disc' if hypot(*(acceleration - seen)) > size
                     else 'is balanced by motion')
            raise SensorError(
                f'{size:.1f} of {gravity:.1f} m/s^2 in the plane of the arm: gravity {where}; '
                'does imu.axes fit how it is mounted? In an arm that lies flat IMUs tell nothing')
        return np.asarray(seen / max(size, TINY)), max(size, TINY)

    def _predict(self, rate: Array, noise: float, step: float) -> None:
        """Let a step, s, pass, with a rate (rad/s) and the deviation of that."""
        turn = (rate - self.bias) * step
        moves = EYE6.copy()
        moves[UP, UP] = back = rotation(-turn)
        self.up = back @ self.up
        moves[UP, BIAS] = by_rate = -step * skew(self.up)  # it turns by up x rate
        self.covariance = moves @ self.covariance @ moves.T
        # At another angle the offset of the accelerometer is another angle.
        self.covariance[UP, UP] += (noise**2 * by_rate @ by_rate.T
                                    + self._settings.stddev**2 * hypot(*turn.tolist()) * EYE)
        self.covariance[BIAS, BIAS] += BIAS_WALK**2 * step * EYE

    def _restart(self, up: Array, variance: float) -> None:
        """Take what the accelerometer says, with its variance, rad^2."""
        self.up, self._last_good = up, self.time
        self.covariance[UP], self.covariance[:, UP] = 0.0, 0.0
        self.covariance[UP, UP] = variance * EYE

    def _correct(self, away: Array, gain: Array, variance: float) -> None:
        """Take account of what it says; of the bias only while the disc is quiet."""
        if not self.is_quiet:
            gain[BIAS] = 0.0
        step = gain @ away
        matrix = rotation(skew(self.up) @ step[UP])
        self.up, self.bias = matrix @ self.up, self.bias + step[BIAS]
        # Joseph's form, which holds for any gain; what is known of up is turned with it.
        kept = EYE6.copy()
        kept[:, UP] -= gain
        kept[UP], gain[UP] = matrix @ kept[UP], matrix @ gain[UP]
        self.covariance = kept @ self.covariance @ kept.T + variance * gain @ gain.T


def turn_between(one: Array, other: Array) -> Array:
    """Return the rotation vector (3,), rad, of the smallest turn from a direction to another."""
    across, along = skew(one) @ other, one @ other
    sine = hypot(*across.tolist())
    if sine < TINY and along < 0.0:  # half a turn, about anything across it: y where that is
        across = skew(one)[:, 2 if abs(one[2]) < abs(one[0]) else 0]
        return np.asarray(np.pi / hypot(*across) * across)
    return np.asarray(atan2(sine, along) / max(sine, TINY) * across)


def rotation(vector: Array) -> Array:
    """Return the matrix (3, 3) of a rotation vector (3,), rad."""
    x, y, z = vector.tolist()
    angle = max(hypot(x, y, z), TINY)
    across, twice = sin(angle) / angle, 2.0 * (sin(angle / 2.0) / angle)**2
    return np.array([
        [1.0 - twice * (y*y + z*z), twice * x*y - across * z, twice * x*z + across * y],
        [twice * x*y + across * z, 1.0 - twice * (x*x + z*z), twice * y*z - across * x],
        [twice * x*z - across * y, twice * y*z + across * x, 1.0 - twice * (x*x + y*y)]])


def skew(vector: Array) -> Array:
    """Return the matrix (3, 3) of the cross product with a vector (3,)."""
    x, y, z = vector.tolist()  # np.cross takes ten times as long
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
