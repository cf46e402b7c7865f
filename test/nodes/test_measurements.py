# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Which measured poses and tensions kinematics uses, and which differences it tells."""

from itertools import count
from math import nan
from unittest.mock import Mock

from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
import pytest
from rclpy.serialization import serialize_message

from soft_continuum.nodes.kinematics import MeasuredPoses, REPORT_DELAY, TensionCheck
from soft_continuum.ros.description import load_arm
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
    monkeypatch.setattr('soft_continuum.nodes.kinematics.monotonic', lambda: now[0])
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


# A difference between measured and predicted tension is told when it lasts, and only then.

NAMES = ('right_tendon', 'left_tendon')
TOLERANCES = (5.0, 5.0)


@pytest.mark.parametrize('tendon', NAMES)
@pytest.mark.parametrize(('seen', 'model', 'words'), [
    (20.0, 10.0, 'friction'), (4.0, 10.0, 'friction'), (0.5, 10.0, 'slack'), (-9.0, 10.0, 'sign'),
    (14.9, 10.0, ''), (5.1, 10.0, ''), (nan, 10.0, ''), (20.0, nan, ''), (None, 10.0, '')])
def test_what_differs_for_long_is_told_with_its_tendon(tendon, seen, model, words):
    check = TensionCheck(NAMES)
    other = NAMES[1 - NAMES.index(tendon)]
    measured = {other: 2.0} | ({} if seen is None else {tendon: seen})
    by_model = [model if name == tendon else 2.0 for name in NAMES]
    assert check.problem(100.0, measured, by_model, TOLERANCES) == ''
    assert check.problem(100.0 + 0.99 * REPORT_DELAY, measured, by_model, TOLERANCES) == ''
    problem = check.problem(100.0 + 1.01 * REPORT_DELAY, measured, by_model, TOLERANCES)
    assert words in problem
    assert bool(problem) is bool(words)
    assert (tendon in problem) is bool(words)
    assert other not in problem


def test_what_comes_and_goes_is_not_told_and_what_is_over_is_forgotten():
    check, model = TensionCheck(NAMES), [10.0, 10.0]
    for second in range(20):
        seen = dict.fromkeys(NAMES, 20.0 if second % 2 else 10.0)
        assert check.problem(float(second), seen, model, TOLERANCES) == ''
    wrong, right = dict.fromkeys(NAMES, 20.0), dict.fromkeys(NAMES, 10.0)
    check.problem(30.0, wrong, model, TOLERANCES)
    told = check.problem(33.0, wrong, model, TOLERANCES)
    assert all(name in told for name in NAMES)
    assert check.problem(33.1, dict.fromkeys(NAMES, 20.5), model, TOLERANCES) == told
    torn = check.problem(33.15, dict.fromkeys(NAMES, 0.0), model, TOLERANCES)
    assert torn.count('slack') == 2
    assert check.problem(33.2, right, model, TOLERANCES) == ''
    assert check.problem(33.3, wrong, model, TOLERANCES) == ''
