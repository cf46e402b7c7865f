# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the discs are measured to be, by whatever publishes disc_N/measured_pose."""

from dataclasses import dataclass
from functools import partial

from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node

from soft_continuum.client.errors import ClientError
from soft_continuum.client.tasks import until
from soft_continuum.ros.conversions import measured_pose_from_ros, seconds
from soft_continuum.ros.entry import subscribe
from soft_continuum.ros.qos import SENSOR

Array = NDArray[np.float64]
MIN_SAMPLES = 3
MAX_SAMPLES = 10_000  # of one disc


@dataclass(frozen=True)
class MeasuredDisc:
    """
    The mean of what was measured of a disc: pose (x, z, angle) of its bottom, m and rad.

    deviation: (3,) of it, m and rad: what one measurement says of itself, or how much they
    scatter if that is more.  Much of it is in all of them alike, so a mean has no less.
    """

    pose: Array
    deviation: Array
    samples: int


class MeasuredArm:
    """Collects the measured poses of the discs of one arm; for the thread that spins the node."""

    def __init__(self, node: Node, discs: int) -> None:
        """Subscribe to disc_N/measured_pose, N from 0 to discs - 1."""
        self._node, self._begin, self._frame = node, 0.0, ''
        self._samples: list[list[tuple[Array, Array]]] = [[] for _ in range(discs)]
        self._refused = ''
        for n in range(discs):
            subscribe(node, PoseWithCovarianceStamped, f'disc_{n}/measured_pose',
                      partial(self._on_pose, n), SENSOR)

    def _on_pose(self, disc: int, message: PoseWithCovarianceStamped) -> None:
        samples = self._samples[disc]
        if seconds(message.header.stamp) < self._begin or len(samples) >= MAX_SAMPLES:
            return
        try:
            samples.append(measured_pose_from_ros(message, self._frame))
        except ValueError as error:
            self._refused = f'; disc_{disc}/measured_pose has {error}'

    async def measure(self, duration: float, frame: str = '') -> dict[int, MeasuredDisc]:
        """
        Return the discs that are measured in the next ``duration`` s, at least three times.

        frame: in which poses have to be; empty for any.  Raises ClientError when there is none.
        """
        self._begin = seconds(self._node.get_clock().now().to_msg())
        self._refused, self._frame = '', frame
        for samples in self._samples:
            samples.clear()
        await until(lambda: False, duration)
        found = {n: _mean(samples) for n, samples in enumerate(self._samples)
                 if len(samples) >= MIN_SAMPLES}
        if not found:
            raise ClientError(
                f'no disc was measured {MIN_SAMPLES} times within {duration:g} s on '
                f'disc_N/measured_pose{self._refused}; does the node camera run, and what does '
                'camera/status say?')
        return found


def _mean(samples: list[tuple[Array, Array]]) -> MeasuredDisc:
    poses = np.array([pose for pose, _ in samples])
    poses[:, 2] = np.unwrap(poses[:, 2])
    own = np.sqrt(np.mean([np.diag(covariance) for _, covariance in samples], axis=0))
    return MeasuredDisc(poses.mean(axis=0), np.maximum(own, poses.std(axis=0)), len(samples))
