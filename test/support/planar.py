# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is measured of a planar arm, as a person writes it: x, z and angle."""

from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import PLANAR_AXES
from soft_continuum.mechanics.rotations import in_plane, planar_pose
from soft_continuum.ros.conversions import measured_pose_from_ros, tracked_pose_to_ros

IN_PLANE = np.ix_(PLANAR_AXES, PLANAR_AXES)
"""Of a covariance (6, 6): x, z, and the turn about y."""


def planar(message: Any, frame: str = '') -> tuple[Any, Any]:
    """Return x, z, angle (3,) and their covariance (3, 3) of a measured pose."""
    pose, covariance = measured_pose_from_ros(message, PLANAR_AXES, frame)
    return planar_pose(pose), covariance[IN_PLANE]


def measured_pose_to_ros(pose: Any, covariance: Any) -> Any:
    """Return a measured pose (x, z, angle) and its covariance (3, 3) as a message, m and rad."""
    return tracked_pose_to_ros(*in_plane(pose, covariance))
