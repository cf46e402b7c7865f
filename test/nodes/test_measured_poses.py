# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Which measured poses of the discs the kinematics node uses, over DDS."""

from itertools import count
from unittest.mock import Mock

from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
from rclpy.serialization import serialize_message

from soft_continuum.nodes.measurements import MeasuredPoses
from soft_continuum.parameters.files import load_arm
from soft_continuum.ros.names import MEASURED_POSE
from soft_continuum.ros.ros_time import stamp_of
from soft_continuum.user_files import description_file
from support.planar import measured_pose_to_ros

ARM, FRAME = load_arm(description_file()), 'base_link'
DISCS = len(ARM.discs)


def test_the_base_is_measured_with_the_other_discs_but_alone_it_is_no_measurement(rig):
    poses = MeasuredPoses(rig.observer, ARM, FRAME, lambda: None)
    publishers = [rig.publisher(PoseWithCovarianceStamped, MEASURED_POSE.format(n))
                  for n in range(DISCS)]
    seconds = count(1)
    found = []

    def publish(discs):
        second = next(seconds)
        for n in discs:
            message = measured_pose_to_ros(np.array([0.0, 0.1 * n, 0.0]), 1e-6 * np.eye(3))
            message.header.frame_id, message.header.stamp.sec = FRAME, second
            publishers[n].publish(message)

    def measured():
        publish([0])
        publish(range(DISCS))
        found.extend([one.disc for one in discs] for _, discs in poses.take())
        return any({0, 1, 2, 3} == set(discs) for discs in found)
    rig.wait_for(measured, 'a measurement of all discs')
    assert [0] not in found


def test_two_cameras_that_look_at_nearly_or_exactly_the_same_time_are_both_used(monkeypatch):
    """The second of two stamps within 1/60 s used to be left out."""
    now = [0.0]
    monkeypatch.setattr('soft_continuum.nodes.measurements.STEADY', lambda: now[0])
    node = Mock()
    poses = MeasuredPoses(node, ARM, FRAME, lambda: None)
    calls = {call.args[1]: call.args[2] for call in node.create_subscription.call_args_list}

    def see(disc, stamp):
        message = measured_pose_to_ros(np.array([0.0, 0.1, 0.0]), 1e-6 * np.eye(3))
        message.header.frame_id, message.header.stamp = FRAME, stamp_of(stamp)
        calls[MEASURED_POSE.format(disc)](serialize_message(message))

    used = []
    for picture in range(30):  # a second, in which a camera at 30 Hz and its neighbour look
        for late in (0.0, 0.005 * (picture % 2)):
            for disc in (1, 2):
                see(disc, 10.0 + picture / 30.0 + late)
        now[0] += 1.0 / 30.0
        used += poses.take()
    assert len(used) == 60
    assert all({one.disc for one in discs} == {1, 2} for _, discs in used)
    for fast in range(300):  # a tracker that is too fast is thinned out
        see(1, 20.0 + fast / 300.0)
        now[0] += 1.0 / 30.0
        used += poses.take()
    assert 60 <= len(used) - 60 <= 66
