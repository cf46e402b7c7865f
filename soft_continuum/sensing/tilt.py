# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The angle of a disc in the plane of the arm, from an IMU on it.

A Kalman filter with two states, the angle and the bias of the gyroscope.  The gyroscope says how
the angle changes; the accelerometer says where down is, as long as the disc does not accelerate.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import atan2, cos, exp, hypot, isnan, nan, pi, sin, sqrt
from typing import Any, Generic, TypeVar

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


Up = TypeVar('Up')
"""What a filter estimates: an angle, or a direction."""


class SensorError(ValueError):
    """What a sensor sends cannot be used; the message says why, and what to do."""


@dataclass(frozen=True)
class ImuSettings:
    """
    What is known of IMUs and of the arm.

    gravity: m/s^2.  mounting_angle: rad, of base_link from upright about +y.
    acceleration_deviation (m/s^2) and rate_deviation (rad/s): standard, of one sample, where the
    IMU does not tell.  bias_deviation: rad/s, of the gyroscope when it is switched on.
    motion_acceleration: m/s^2, standard, of a disc that moves.  deviation: rad, standard, of what
    an IMU is off in every sample at an angle alike: its mounting, and its accelerometer's offset.
    """

    gravity: float
    mounting_angle: float
    acceleration_deviation: float = 0.05
    rate_deviation: float = 0.003
    bias_deviation: float = 0.05
    motion_acceleration: float = 1.0
    deviation: float = 0.01


@dataclass(frozen=True)
class ImuSample:
    """
    One measurement, in the frame of the disc: z along its axis, y the axis of bending.

    time: s, of its stamp.  acceleration: (x, y, z) m/s^2, of what is at rest g upwards.
    rate: about y, rad/s; of an arm in space about x, y and z, (3,).  The variances are of one
    component; 0 where they are not known.
    """

    time: float
    acceleration: tuple[float, float, float]
    rate: Any
    acceleration_variance: float = 0.0
    rate_variance: float = 0.0


class ImuFilter(ABC, Generic[Up]):
    """
    What the filters in the plane and in space have in common: when to believe an accelerometer.

    ``time`` is that of the last sample, s; nan before the first.
    """

    def __init__(self, settings: ImuSettings) -> None:
        """Start without a sample; raises SensorError where gravity tells nothing."""
        if settings.gravity == 0.0:
            raise SensorError('arm.gravity is 0, so no tilt can be measured; if the arm lies '
                              'flat, use a camera or a tracker')
        self._settings = settings
        self.time = nan
        self._magnitude = nan  # mean of the acceleration, m/s^2
        self._rate: Any = nan  # mean, rad/s
        self._quiet = 0.0  # s
        self._last_good = nan  # s, when the accelerometer was believed

    @property
    def is_quiet(self) -> bool:
        """Whether nothing shows that the disc accelerates."""
        return self._quiet >= QUIET_TIME

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
        magnitude = hypot(*sample.acceleration)
        noise = sqrt(sample.acceleration_variance) or settings.acceleration_deviation
        rate_noise = sqrt(sample.rate_variance) or settings.rate_deviation
        self._average(sample, magnitude, noise, rate_noise, step, restart)
        self._predict(sample.rate, rate_noise, step, restart)
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
            self._last_good = self.time
            return True
        if self._distance(up, variance) > GATE**2:
            if sample.time - self._last_good > MAX_OUTLIERS:
                self._restart(up, variance)
                self._last_good = self.time
                raise SensorError(DISAGREE)
            return False
        self._last_good = sample.time
        self._correct(up, variance)
        return True

    def _average(self, sample: ImuSample, magnitude: float, noise: float, rate_noise: float,
                 step: float, restart: bool) -> None:
        """Note for how long neither the rate nor the magnitude has changed."""
        if restart:
            self._magnitude, self._rate, self._quiet = magnitude, sample.rate, 0.0
            return
        limited = min(magnitude, MAX_AVERAGED * self._settings.gravity)
        self._magnitude += (1.0 - exp(-step / AVERAGING_TIME)) * (limited - self._magnitude)
        steady = (self._size(sample.rate - self._rate) < QUIET_RATE + 4.0 * rate_noise
                  and abs(magnitude - self._magnitude) < QUIET_ACCELERATION + 4.0 * noise)
        self._rate += (1.0 - exp(-step / QUIET_TIME)) * (sample.rate - self._rate)
        self._quiet = self._quiet + step if steady else 0.0

    def _check(self) -> None:
        gravity = self._settings.gravity
        if abs(self._magnitude - gravity) > MAX_MAGNITUDE_ERROR * gravity:
            raise SensorError(
                f'an acceleration of {self._magnitude:.2f} m/s^2 in the mean, at rest it is '
                f'{gravity:.2f} (arm.gravity); is it in m/s^2, gravity included?')

    @abstractmethod
    def _size(self, rate: Any) -> float:
        """Return the size of a rate, rad/s."""

    @abstractmethod
    def _predict(self, rate: Any, noise: float, step: float, restart: bool) -> None:
        """Let a step, s, pass, with a rate (rad/s) and the deviation of that."""

    @abstractmethod
    def _seen(self, acceleration: tuple[float, float, float]) -> tuple[Up, float]:
        """Return what an acceleration says, and by how much of it, m/s^2."""

    @abstractmethod
    def _restart(self, up: Up, variance: float) -> None:
        """Take what the accelerometer says, with its variance, rad^2."""

    @abstractmethod
    def _distance(self, up: Up, variance: float) -> float:
        """Return the squared distance of that from what is expected, over its variance."""

    @abstractmethod
    def _correct(self, up: Up, variance: float) -> None:
        """Take account of it; of the bias only while the disc is quiet."""


class TiltFilter(ImuFilter[float]):
    """
    Estimates the angle of a disc in the plane of the arm, rad, 0 in the straight arm.

    angle is that at ``time``; bias (rad/s) and bias_variance are those of the gyroscope.
    """

    def __init__(self, settings: ImuSettings) -> None:
        """Start without a sample; raises SensorError where gravity tells nothing."""
        super().__init__(settings)
        self.angle, self._variance = nan, nan
        self.bias, self.bias_variance = 0.0, settings.bias_deviation**2
        self._covariance = 0.0  # of angle and bias

    @property
    def variance(self) -> float:
        """Of the angle, rad^2, what is off in every sample included."""
        return self._variance + self._settings.deviation**2

    def _size(self, rate: float) -> float:
        return abs(rate)

    def _seen(self, acceleration: tuple[float, float, float]) -> tuple[float, float]:
        x, y, z = acceleration
        gravity, in_plane = self._settings.gravity, hypot(x, z)
        if in_plane < MIN_IN_PLANE * gravity:
            where = ('lies along y of the disc' if abs(y) > in_plane else 'is balanced by motion')
            raise SensorError(
                f'{in_plane:.1f} of {gravity:.1f} m/s^2 in the plane of the arm: gravity {where}; '
                'does imu.axes fit how it is mounted? In an arm that lies flat IMUs tell nothing')
        return atan2(-x, z) - self._settings.mounting_angle, in_plane

    def _predict(self, rate: float, noise: float, step: float, restart: bool) -> None:
        if restart:
            gap = step if step > 0.0 else 0.0  # false for nan, before the first
            self.bias_variance += BIAS_WALK**2 * gap
            return
        turn = (rate - self.bias) * step
        self.angle = _wrapped(self.angle + turn)
        # At another angle the offset of the accelerometer is another angle.
        self._variance += self._settings.deviation**2 * abs(turn)
        self._variance += ((noise * step)**2 - 2.0 * step * self._covariance
                          + step**2 * self.bias_variance)
        self._covariance -= step * self.bias_variance
        self.bias_variance += BIAS_WALK**2 * step

    def _restart(self, up: float, variance: float) -> None:
        self.angle, self._variance, self._covariance = _wrapped(up), variance, 0.0

    def _distance(self, up: float, variance: float) -> float:
        return _wrapped(up - self.angle)**2 / (self._variance + variance)

    def _correct(self, up: float, variance: float) -> None:
        error = _wrapped(up - self.angle)
        total = self._variance + variance
        gain = self._variance / total
        of_bias = self._covariance / total if self.is_quiet else 0.0
        # Joseph's form, which holds for any gain.
        kept = 1.0 - gain
        crossed = kept * (self._covariance - of_bias * self._variance) + gain * of_bias * variance
        self.bias_variance += of_bias**2 * total - 2.0 * of_bias * self._covariance
        self._variance = kept**2 * self._variance + gain**2 * variance
        self._covariance = crossed
        self.angle = _wrapped(self.angle + gain * error)
        self.bias += of_bias * error


def at_rest(settings: ImuSettings, angle: float) -> tuple[float, float, float]:
    """Return the acceleration (x, y, z) m/s^2 that a disc at rest measures at an angle, rad."""
    tilt = angle + settings.mounting_angle
    return -settings.gravity * sin(tilt), 0.0, settings.gravity * cos(tilt)


def _wrapped(angle: float) -> float:
    return (angle + pi) % (2.0 * pi) - pi
