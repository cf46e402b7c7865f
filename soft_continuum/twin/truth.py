# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the twin really is, published for tests and benchmarks; no node of the suite reads it."""

import threading
from types import TracebackType
from typing import Self

from geometry_msgs.msg import PoseArray
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState

from soft_continuum.ros.conversions import full_poses, poses_to_ros
from soft_continuum.ros.qos import STREAM
from soft_continuum.twin.rig import TwinRig

PERIOD = 0.02  # s


class Truth:
    """Publishes the joints, tendons and discs of a twin while this context manager is open."""

    def __init__(self, rig: TwinRig, namespace: str = '') -> None:
        """Make the node ``twin`` in ``namespace``."""
        self._rig = rig
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node('twin', namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._joints = self._node.create_publisher(JointState, 'twin/joint_states', STREAM)
        self._tendons = self._node.create_publisher(JointState, 'twin/tendon_states', STREAM)
        self._discs = self._node.create_publisher(PoseArray, 'twin/disc_poses', STREAM)
        self._names = [f'joint_{n}' for n in range(1, len(rig.plant.joint_angles) + 1)]
        self._node.create_timer(PERIOD, self._publish)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)

    def __enter__(self) -> Self:
        """Begin to publish."""
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 traceback: TracebackType | None) -> None:
        """End."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        self._context.shutdown()

    def _publish(self) -> None:
        with self._rig.lock:
            plant = self._rig.plant
            angles, points, tensions = plant.joint_angles, plant.points, plant.tensions
        stamp = self._node.get_clock().now().to_msg()
        joints = JointState(name=self._names, position=angles.tolist())
        tendons = JointState(name=list(self._rig.plant.arm.tendon_names),
                             effort=tensions.tolist())
        discs = poses_to_ros(full_poses(points), PoseArray())
        joints.header.stamp = tendons.header.stamp = discs.header.stamp = stamp
        discs.header.frame_id = 'base_link'
        self._joints.publish(joints)
        self._tendons.publish(tendons)
        self._discs.publish(discs)
