# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measured poses of the discs, from any publisher of disc_N/measured_pose."""

from dataclasses import dataclass
from math import inf, nan

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock

from soft_continuum.client.errors import ClientError
from soft_continuum.client.observed import ObservedArm
from soft_continuum.client.tasks import until
from soft_continuum.estimation.measuring import DiscMeasurement
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.rotations import displaced, displacement, matrices
from soft_continuum.ros.conversions import MAX_VARIANCE, measured_pose_from_ros, seconds

FIRST_TIMEOUT = 2.0  # s for the first measured pose
MIN_SAMPLES = 3
MAX_SAMPLES = 10_000  # of one disc
Sample = tuple[Array, Array]
"""A pose and its covariance."""


@dataclass(frozen=True)
class MeasuredDisc:
    """
    The mean measured pose of a disc, at its bottom, m and rad.

    pose: position and quaternion x, y, z, w, (7,).  Unmeasured parts are nan; several sensors are
    weighted by their variances.  deviation: (6,) of x, y, z and the rotation vector; inf for nan,
    0 for directions in which a planar arm cannot move: the reported one of a single measurement,
    or their scatter if larger.  Much of it is common to all measurements, so the mean does not
    reduce it.  samples: of the coordinate measured most often.
    """

    pose: Array
    stddev: Array
    samples: int

    @property
    def has_position(self) -> bool:
        """Whether the position is measured, not only the orientation."""
        return bool(np.isfinite(self.pose[:3]).all())

    def points(self, height: float) -> Array:
        """
        Return the bottom and top centre of a disc of this height (m), (2, 3), m.

        nan where not measured: without the orientation only the bottom is known.
        """
        place, along = self.pose[:3], matrices(self.pose[3:])[:, 2]
        return np.stack([place, place + height * along])


class MeasuredArm:
    """Collects the measured poses of the discs of an observed arm; on the thread of its node."""

    def __init__(self, observed: ObservedArm, clock: Clock, axes: NDArray[np.bool_]) -> None:
        """Follow an observed arm; clock: of the stamps; axes: pose_axes of the arm."""
        self._observed, self._clock, self._axes = observed, clock, axes
        self._begin, self._frame, self._refused = inf, '', ''
        self._samples: dict[str, list[Sample]] = {}
        observed.on_change(self._on_change)

    def _on_change(self, topic: str) -> None:
        if topic not in self._observed.disc_topics:
            return
        message, samples = self._observed.message(topic), self._samples.setdefault(topic, [])
        if seconds(message.header.stamp) < self._begin or len(samples) >= MAX_SAMPLES:
            return
        try:
            samples.append(measured_pose_from_ros(message, self._axes, self._frame))
        except ValueError as error:
            self._refused = f'; {topic} has {error}'

    async def measure(self, duration: float) -> dict[int, MeasuredDisc]:
        """
        Return the discs measured in ``duration`` s, at least three times.

        The time starts at the first measured pose, since publishers have to be discovered first.
        Poses must be in the frame of disc_poses, if known.  Raises ClientError when there is none.
        """
        model = self._observed.message('disc_poses')
        self._frame = model.header.frame_id if model is not None else ''
        self._begin, self._refused = seconds(self._clock.now().to_msg()), ''
        self._samples.clear()
        await until(lambda: any(self._samples.values()) or self._refused, FIRST_TIMEOUT)
        await until(lambda: False, duration)
        self._begin = inf
        means = {n: mean_of(self._samples[topic], self._axes)
                 for n, topic in enumerate(self._observed.disc_topics) if self._samples.get(topic)}
        found = {n: mean for n, mean in means.items() if mean.samples >= MIN_SAMPLES}
        if not found:
            raise ClientError(
                f'no disc was measured {MIN_SAMPLES} times within {duration:g} s on '
                f'disc_N/measured_pose{self._refused}; does the node camera or disc_sensors run? '
                'See camera/status and disc_sensors/status')
        return found


def mean_of(samples: list[Sample], axes: NDArray[np.bool_]) -> MeasuredDisc:
    """
    Return the mean of measured poses close to each other; samples: one or more.

    axes: pose_axes of their arm.
    """
    variances = np.array([np.diag(covariance) for _, covariance in samples])
    known = variances < MAX_VARIANCE
    turned = known[:, 3:][:, axes[3:]].all(axis=1)
    first, _ = samples[int(turned.argmax())]  # one with a measured orientation, if any
    away = np.array([displacement(pose, first, DiscMeasurement(0, pose, covariance).about)
                     for pose, covariance in samples])
    mean, stddev = np.where(axes, nan, 0.0), np.where(axes, inf, 0.0)
    for i in np.flatnonzero(known.sum(axis=0) >= MIN_SAMPLES):
        values, weights = away[known[:, i], i], 1.0 / variances[known[:, i], i]
        mean[i] = np.average(values, weights=weights)
        scatter = np.average((values - mean[i])**2, weights=weights)
        stddev[i] = np.sqrt(max(scatter, 1.0 / weights.mean()))
    return MeasuredDisc(displaced(first, mean), stddev, int(known.sum(axis=0).max()))
