# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Which measured poses of the discs the kinematics node uses, over DDS."""

from collections.abc import Sequence
from itertools import count

from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
from ros_rig import Rig

from soft_continuum.nodes.measured_poses import MeasuredPoses
from soft_continuum.ros.conversions import measured_pose_to_ros
from soft_continuum.ros.names import MEASURED_POSE

DISCS, FRAME = 4, 'base_link'


def test_the_base_is_measured_with_the_other_discs_but_alone_it_is_no_measurement(
        rig: Rig) -> None:
    poses = MeasuredPoses(rig.observer, DISCS, FRAME)
    publishers = [rig.publisher(PoseWithCovarianceStamped, MEASURED_POSE.format(n))
                  for n in range(DISCS)]
    seconds = count(1)
    found: list[list[int]] = []

    def publish(discs: Sequence[int]) -> None:
        second = next(seconds)
        for n in discs:
            message = measured_pose_to_ros(np.array([0.0, 0.1 * n, 0.0]), 1e-6 * np.eye(3))
            message.header.frame_id, message.header.stamp.sec = FRAME, second
            publishers[n].publish(message)

    def measured() -> bool:
        publish([0])
        publish(range(DISCS))
        found.extend([one.disc for one in discs] for _, discs in poses.take())
        return any({0, 1, 2, 3} == set(discs) for discs in found)
    rig.wait_for(measured, 'a measurement of all discs')
    assert [0] not in found
