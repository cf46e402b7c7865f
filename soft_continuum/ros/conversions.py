# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Conversions between the library's arrays and ROS messages."""

from geometry_msgs.msg import Pose, PoseArray
import numpy as np
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soft_continuum.hardware.tendon_controller import MotionRefusedError, Reason
from soft_continuum.mechanics.arm import TENDONS
from soft_continuum.mechanics.chain import Array, orientation


def seconds(stamp: object) -> float:
    """Return a builtin_interfaces Time or Duration in s."""
    return float(stamp.sec + stamp.nanosec * 1e-9)  # type: ignore[attr-defined]


def poses_to_ros(poses: Array, message: PoseArray) -> PoseArray:
    """Write (x, z, angle) rows, m and rad, into a kept PoseArray: z of a pose is the tangent."""
    while len(message.poses) < len(poses):
        message.poses.append(Pose())
    for pose, (x, z, angle) in zip(message.poses, poses, strict=True):
        pose.position.x, pose.position.z = float(x), float(z)
        q = pose.orientation
        q.x, q.y, q.z, q.w = orientation(float(angle))
    return message


def poses_from_ros(message: PoseArray) -> Array:
    """Return (x, z, angle) rows of a PoseArray whose rotations are about y, m and rad."""
    return np.array([(p.position.x, p.position.z,
                      2.0 * np.arctan2(p.orientation.y, p.orientation.w))
                     for p in message.poses])


def trajectory_to_ros(times: Array, pulls: Array) -> JointTrajectory:
    """Return times (k,) s and pulls (k, 2) m as a JointTrajectory without a stamp."""
    message = JointTrajectory(joint_names=list(TENDONS))
    for time, pull in zip(times, pulls, strict=True):
        point = JointTrajectoryPoint(positions=[float(pull[0]), float(pull[1])])
        point.time_from_start.sec = int(time)
        point.time_from_start.nanosec = min(999_999_999, int((time % 1.0) * 1e9))
        message.points.append(point)
    return message


def trajectory_from_ros(message: JointTrajectory, now: float) -> tuple[Array, Array]:
    """
    Return times (k,) s, on the clock of ``now``, and pulls (k, 2) m, right and left.

    A stamp of zero starts the trajectory now.  Raises MotionRefusedError when the joint names or
    the number of positions are not those of the two tendons.
    """
    if sorted(message.joint_names) != sorted(TENDONS):
        raise MotionRefusedError(
            Reason.INVALID,
            f'joint_names are {list(message.joint_names)}; needed: {list(TENDONS)}')
    for number, point in enumerate(message.points, start=1):
        if len(point.positions) != len(TENDONS):
            raise MotionRefusedError(
                Reason.INVALID,
                f'point {number} has {len(point.positions)} positions; needed: one for each of '
                f'{list(message.joint_names)}')
    order = [list(message.joint_names).index(name) for name in TENDONS]
    start = seconds(message.header.stamp) or now
    times = np.array([start + seconds(p.time_from_start) for p in message.points])
    pulls = np.array([[p.positions[i] for i in order] for p in message.points], dtype=float)
    return times, pulls
