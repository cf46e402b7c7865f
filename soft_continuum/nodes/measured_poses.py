# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measured poses of the discs: checked, and grouped by time."""

from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped

from soft_continuum.estimation.measuring import DiscMeasurement
from soft_continuum.hardware.clock import STEADY
from soft_continuum.mechanics.arm import Arm
from soft_continuum.nodes.entries import subscribe
from soft_continuum.ros.conversions import measured_pose_from_ros, seconds
from soft_continuum.ros.names import MEASURED_POSE
from soft_continuum.ros.qos import SENSOR

SYNC_WINDOW = 0.02  # s for which a pose waits for those of the other discs
MAX_WAITING = 20
"""Number of times with pending poses; beyond it, as in a burst, the oldest are dropped."""
MAX_RATE = 60.0
"""Rate at which poses are used: each takes some milliseconds."""
MAX_AT_ONCE = 4.0
"""Burst of times, as from several cameras."""
ANOTHER = 1e-6  # s by which the same time counts as another: the disc is seen by another camera


class MeasuredPoses:
    """
    Collects disc_N/measured_pose of all discs.

    The base does not move: its pose shows whether the camera moved, but not the arm.
    """

    def __init__(self, node: Any, arm: Arm, frame: str, on_pose: Callable[[], None]) -> None:
        """
        Subscribe for ``node``; frame: required frame of poses.

        on_pose: called when poses are pending or were refused.
        """
        self._frame, self._axes, self._on_any = frame, arm.pose_axes, on_pose
        self._waiting: dict[float, tuple[float, dict[int, DiscMeasurement]]] = {}
        self._taken = -1.0  # s, the stamp that was used last
        self._allowed = MAX_AT_ONCE  # times that may be used now
        self.refused = ''
        """Why a pose was refused since this was last read."""
        for disc in range(len(arm.discs)):
            subscribe(node, PoseWithCovarianceStamped, MEASURED_POSE.format(disc),
                      partial(self._on_pose, disc), SENSOR)

    def _on_pose(self, disc: int, message: PoseWithCovarianceStamped) -> None:
        self._on_any()
        try:
            pose, covariance = measured_pose_from_ros(message, self._axes, self._frame)
        except ValueError as error:
            self.refused = f'{MEASURED_POSE.format(disc)} has {error}'
            return
        stamp = seconds(message.header.stamp)
        while disc in self._waiting.get(stamp, (0.0, {}))[1]:
            stamp += ANOTHER
        _, discs = self._waiting.setdefault(stamp, (STEADY(), {}))
        discs[disc] = DiscMeasurement(disc, pose, covariance)
        while len(self._waiting) > MAX_WAITING:
            del self._waiting[next(iter(self._waiting))]

    @property
    def waits(self) -> bool:
        """Whether poses are pending for ``take``."""
        return bool(self._waiting)

    def take(self) -> list[tuple[float, list[DiscMeasurement]]]:
        """Return the measurements that are complete: times in s, and their poses."""
        now = STEADY()
        ready = [stamp for stamp, (came, _) in self._waiting.items() if now - came >= SYNC_WINDOW]
        found = []
        for stamp in sorted(ready):
            _, discs = self._waiting.pop(stamp)
            if not any(discs):
                continue
            self._allowed = min(
                MAX_AT_ONCE, self._allowed + abs(stamp - self._taken) * MAX_RATE)
            self._taken = stamp
            if self._allowed >= 1.0:
                self._allowed -= 1.0
                found.append((stamp, list(discs.values())))
        return found
