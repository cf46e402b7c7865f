# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The IMUs on the discs of an arm: what they say of its poses, and how they are mounted.

In the plane that is an angle; in space where up is, which says nothing of a turn about it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.either import AnyArm
from soft_continuum.mechanics.spatial.arm import SpatialArm
from soft_continuum.mechanics.spatial.orientations import matrices
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sensing.rigid import in_plane, UNKNOWN
from soft_continuum.sensing.tare import MAX_TILT, refuse_motion, tilt_of, Window
from soft_continuum.sensing.tilt import ImuSample, ImuSettings, SensorError, TiltFilter
from soft_continuum.sensing.up_direction import pose_of_up, turned_upright, UpFilter

SETTINGS = ('acceleration_deviation', 'rate_deviation', 'bias_deviation', 'motion_acceleration',
            'deviation')


class AnyImus(Protocol):
    """PlanarImus or SpatialImus."""

    parameter: str
    """Of how they are mounted, without imu."""
    mounts: Array
    """How they are, a row for each disc."""

    def measure(self, n: int, sample: ImuSample, accelerations: Array, rates: Array, now: float
                ) -> tuple[Array, Array] | None:
        """
        Return pose and covariance of disc n, as a DiscMeasurement has them; None if not now.

        sample: in the frame of the disc, with rates (3,).  accelerations, rates: (3,), their
        variances, 0 where they are not known.  now: s of a clock that nobody sets.  Raises
        SensorError.
        """

    def straight(self, n: int, now: float) -> Any:
        """
        Return how an IMU is mounted, from the last second on the straight arm; None without one.

        Raises SensorError.
        """

    def biases(self) -> dict[int, str]:
        """Return those of the gyroscopes that are there, rad/s."""


class PlanarImus:
    """Those of a planar arm; mounts: (discs,) rad."""

    parameter = 'mounting_angles'

    def __init__(self, settings: ImuSettings, mounts: Array) -> None:
        """Begin without a sample."""
        self.mounts, self._settings = mounts, settings
        self._filters: dict[int, TiltFilter] = {}
        self._windows = [Window[float]() for _ in mounts]

    def measure(self, n: int, sample: ImuSample, accelerations: Array, rates: Array, now: float
                ) -> tuple[Array, Array] | None:
        """Return a pose of which only the angle is known."""
        if n not in self._filters:  # raises where there is no gravity
            self._filters[n] = TiltFilter(self._settings)
        found = self._filters[n]
        if not found.update(replace(
                sample, rate=float(sample.rate[1]), rate_variance=float(rates[1]),
                acceleration_variance=float(max(accelerations[0], accelerations[2])))):
            return None
        self._windows[n].add(now, found.angle)
        return in_plane(np.array([0.0, 0.0, found.angle - self.mounts[n]]),
                        np.diag([UNKNOWN, UNKNOWN, found.variance]))

    def straight(self, n: int, now: float) -> float | None:
        """Return the angle."""
        angles = self._windows[n].recent(now)
        return tilt_of(angles) if angles else None

    def biases(self) -> dict[int, str]:
        """Return that about y."""
        return {n: f'{one.bias:.4f}' for n, one in sorted(self._filters.items())}


class SpatialImus:
    """Those of an arm in space; mounts: (discs, 3), rotation vectors, rad."""

    parameter = 'mounting_turns'

    def __init__(self, settings: ImuSettings, mounts: Array, up: Array) -> None:
        """Begin without a sample; up: in base_link, (3,)."""
        self.mounts, self._settings, self._up = mounts, settings, up
        self._filters: dict[int, UpFilter] = {}
        self._windows = [Window[Array]() for _ in mounts]

    def measure(self, n: int, sample: ImuSample, accelerations: Array, rates: Array, now: float
                ) -> tuple[Array, Array] | None:
        """Return a pose that is known but for its place and its turn about the vertical."""
        if n not in self._filters:
            self._filters[n] = UpFilter(self._settings)
        found = self._filters[n]
        if not found.update(replace(
                sample, rate_variance=float(rates.max()),
                acceleration_variance=float(accelerations.max()))):
            return None
        self._windows[n].add(now, found.up)
        mount = _turn(self.mounts[n])
        return pose_of_up(mount @ found.up, mount @ found.up_covariance @ mount.T, self._up,
                          UNKNOWN)

    def straight(self, n: int, now: float) -> Array | None:
        """Return the smallest turn that makes up what it is there."""
        seen = self._windows[n].recent(now)
        if not seen:
            return None
        half = len(seen) // 2
        before, after = np.mean(seen[:half], axis=0), np.mean(seen[half:], axis=0)
        refuse_motion(0.0, float(np.linalg.norm(after - before)))
        mean = np.mean(seen, axis=0)
        turn = turned_upright(mean / np.linalg.norm(mean), self._up)
        angle = 2.0 * float(np.arctan2(np.linalg.norm(turn[:3]), turn[3]))
        if angle > MAX_TILT:
            raise SensorError(f'it is turned by {angle:.2f} rad in the straight arm; set '
                              'imu.axes, and arm.mounting_angle if the base is turned')
        return np.asarray(angle * turn[:3] / max(float(np.linalg.norm(turn[:3])), 1e-12))

    def biases(self) -> dict[int, str]:
        """Return those about x, y and z."""
        return {n: ' '.join(f'{value:.4f}' for value in one.bias)
                for n, one in sorted(self._filters.items())}


def imus_of(arm: AnyArm, values: Mapping[str, Any], discs: int) -> AnyImus:
    """Return those of parameters imu.*; raises ParameterError."""
    return (_in_plane(arm, values, discs) if isinstance(arm, Arm)
            else _in_space(arm, values, discs))


def _in_plane(arm: Arm, values: Mapping[str, Any], discs: int) -> PlanarImus:
    angles = values['imu.mounting_angles']
    if len(angles) not in (1, discs):
        raise ParameterError(f'parameter imu.mounting_angles has {len(angles)} values; '
                             f'needed: one for all or for each of {discs} discs')
    return PlanarImus(_settings(arm.gravity, arm.mounting_angle, values),
                      np.array(list(angles) * (discs // len(angles))))


def _in_space(arm: SpatialArm, values: Mapping[str, Any], discs: int) -> SpatialImus:
    turns: Sequence[float] = values['imu.mounting_turns']
    if len(turns) not in (1, 3 * discs) or (len(turns) == 1 and turns[0] != 0.0):
        raise ParameterError(f'parameter imu.mounting_turns has {len(turns)} values; needed: a '
                             f'rotation vector for each of {discs} discs, or 0.0 for none')
    gravity = float(np.linalg.norm(arm.gravity))
    up = -np.array(arm.gravity) / gravity if gravity else np.array([0.0, 0.0, 1.0])
    return SpatialImus(_settings(gravity, 0.0, values),
                       np.broadcast_to(np.reshape(turns, (-1, 3)) if len(turns) > 1
                                       else np.zeros(3), (discs, 3)).copy(), up)


def _settings(gravity: float, mounting_angle: float, values: Mapping[str, Any]) -> ImuSettings:
    return ImuSettings(gravity, mounting_angle, *(values[f'imu.{name}'] for name in SETTINGS))


def _turn(vector: Array) -> Array:
    """Return the matrix of a rotation vector (3,)."""
    angle = float(np.linalg.norm(vector))
    half = np.sinc(angle / 2.0 / np.pi) / 2.0
    return np.asarray(matrices(np.array([[*(half * vector), np.cos(angle / 2.0)]]))[0])
