# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the twin really is, published for tests and benchmarks; no node of the suite reads it."""

from geometry_msgs.msg import PoseArray
from sensor_msgs.msg import JointState

from soft_continuum.ros.conversions import poses_to_ros
from soft_continuum.ros.names import TWIN
from soft_continuum.ros.qos import STREAM
from soft_continuum.twin.publisher import DISC_POSES, Publisher
from soft_continuum.twin.rig import TwinRig

PERIOD = 0.02  # s


class GroundTruth(Publisher):
    """Publishes the joints, tendons and discs of a twin while this context manager is open."""

    def __init__(self, rig: TwinRig, namespace: str = '') -> None:
        """Make the node ``twin``; raises ClientError for a namespace that ROS does not take."""
        super().__init__(TWIN, namespace)
        self._rig = rig
        self._names = rig.plant.joint_names

    async def _begin(self) -> None:
        node = self._node
        self._joints = node.create_publisher(JointState, 'twin/joint_states', STREAM)
        self._tendons = node.create_publisher(JointState, 'twin/tendon_states', STREAM)
        self._discs = node.create_publisher(PoseArray, DISC_POSES, STREAM)
        node.create_timer(PERIOD, self._publish)

    def _publish(self) -> None:
        with self._rig.lock:
            plant = self._rig.plant
            angles, poses, tensions = plant.joint_angles, plant.poses, plant.tensions
        stamp = self._node.get_clock().now().to_msg()
        joints = JointState(name=self._names, position=angles.tolist())
        tendons = JointState(name=list(self._rig.plant.arm.tendon_names),
                             effort=tensions.tolist())
        discs = poses_to_ros(poses, PoseArray())
        joints.header.stamp = tendons.header.stamp = discs.header.stamp = stamp
        discs.header.frame_id = 'base_link'
        self._joints.publish(joints)
        self._tendons.publish(tendons)
        self._discs.publish(discs)
