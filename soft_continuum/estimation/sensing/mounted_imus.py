# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""IMUs on the discs of an arm: measured orientations, and their mounting."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from math import cos, hypot, sin
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from soft_continuum.estimation.sensing.rigid import moved_by, UNKNOWN
from soft_continuum.estimation.sensing.tare import turn_of, Window
from soft_continuum.estimation.sensing.tilt import (
    ImuSample,
    ImuSettings,
    rotation,
    skew,
    TINY,
    turn_between,
    UpFilter,
)
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.parameters.parameter import ParameterError

MOUNTED = {1: ('mounting_angles', 'one for all or for each of {} discs'),
           3: ('mounting_turns', 'a rotation vector for each of {} discs, or 0.0 for none')}
"""Parameter imu.* of the mounting, by the number of axes about which a disc turns."""
AXES = {sign + name: float(f'{sign}1') * np.eye(3)[i]
        for i, name in enumerate('xyz') for sign in '+-'}
"""Axes by name; always with a sign, since ROS reads y in a parameter file as true."""


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
    lever = -skew(to) @ matrix  # what moves up turns it across
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
        rotation = np.array([AXES[axis] for axis in axes[i:i + 3]])
        if round(float(np.linalg.det(rotation))) != 1:
            raise ParameterError(f'parameter imu.axes has {list(axes[i:i + 3])}: these are not '
                                 'the axes of a right-handed frame, in this order')
        found.append(rotation)
    return tuple(found) if len(found) == discs else tuple(found * discs)
