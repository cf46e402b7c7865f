# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the discs are measured to be, by whatever publishes disc_N/measured_pose."""

from dataclasses import dataclass
from math import inf, nan

import numpy as np
from rclpy.clock import Clock

from soft_continuum.client.errors import ClientError
from soft_continuum.client.observed import ObservedArm
from soft_continuum.client.tasks import until
from soft_continuum.mechanics.chain import Array
from soft_continuum.ros.conversions import MAX_VARIANCE, measured_pose_from_ros, seconds

MIN_SAMPLES = 3
MAX_SAMPLES = 10_000  # of one disc


@dataclass(frozen=True)
class MeasuredDisc:
    """
    The mean of what was measured of a disc: pose (x, z, angle) of its bottom, m and rad.

    A coordinate that no sensor measures is nan; those of several sensors are weighted by their
    variances.  deviation: (3,) of it, m and rad, inf for nan: what one measurement says of itself,
    or how much they scatter if that is more.  Much of it is in all of them alike, so a mean has
    no less.  samples: of the coordinate that was measured most often.
    """

    pose: Array
    deviation: Array
    samples: int

    @property
    def has_position(self) -> bool:
        """Whether x and z are measured, not only the angle."""
        return bool(np.isfinite(self.pose[:2]).all())


class MeasuredArm:
    """Collects the measured poses of the discs of an observed arm; on the thread of its node."""

    def __init__(self, observed: ObservedArm, clock: Clock) -> None:
        """Listen to an observed arm; clock: of the stamps."""
        self._observed, self._clock = observed, clock
        self._begin, self._frame, self._refused = inf, '', ''
        self._samples: dict[str, list[tuple[Array, Array]]] = {}
        observed.on_change(self._on_change)

    def _on_change(self, topic: str) -> None:
        if topic not in self._observed.disc_topics:
            return
        message, samples = self._observed.message(topic), self._samples.setdefault(topic, [])
        if seconds(message.header.stamp) < self._begin or len(samples) >= MAX_SAMPLES:
            return
        try:
            samples.append(measured_pose_from_ros(message, self._frame))
        except ValueError as error:
            self._refused = f'; {topic} has {error}'

    async def measure(self, duration: float) -> dict[int, MeasuredDisc]:
        """
        Return the discs that are measured in the next ``duration`` s, at least three times.

        Poses have to be in the frame of disc_poses, if that is known.  Raises ClientError when
        there is none.
        """
        model = self._observed.message('disc_poses')
        self._frame = model.header.frame_id if model is not None else ''
        self._begin, self._refused = seconds(self._clock.now().to_msg()), ''
        self._samples.clear()
        await until(lambda: False, duration)
        self._begin = inf
        means = {n: _mean(self._samples.get(topic, []))
                 for n, topic in enumerate(self._observed.disc_topics)}
        found = {n: mean for n, mean in means.items() if mean.samples >= MIN_SAMPLES}
        if not found:
            raise ClientError(
                f'no disc was measured {MIN_SAMPLES} times within {duration:g} s on '
                f'disc_N/measured_pose{self._refused}; does the node camera or disc_sensors run, '
                'and what do camera/status and disc_sensors/status say?')
        return found


def _mean(samples: list[tuple[Array, Array]]) -> MeasuredDisc:
    pose, deviation, counts = np.full(3, nan), np.full(3, inf), [0, 0, 0]
    for i in range(3):
        known = [(values[i], covariance[i, i]) for values, covariance in samples
                 if covariance[i, i] < MAX_VARIANCE]
        counts[i] = len(known)
        if counts[i] < MIN_SAMPLES:
            continue
        values, variances = np.array(known).T
        if i == 2:
            values = np.unwrap(values)
        weights = 1.0 / variances
        pose[i] = np.average(values, weights=weights)
        scatter = np.average((values - pose[i])**2, weights=weights)
        deviation[i] = np.sqrt(max(scatter, 1.0 / weights.mean()))
    return MeasuredDisc(pose, deviation, max(counts))
