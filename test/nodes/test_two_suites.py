# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Two suites of the same names would soften two segments at once: they notice, and do nothing."""

from trajectory_msgs.msg import JointTrajectory

from support.ros_rig import ALL, Rig, trajectory


def test_a_second_suite_of_the_same_names_is_an_error_and_refuses_all_motion(rig: Rig) -> None:
    rig.start_arm()
    running = rig.goal((0.0, 0.0, 0.3), hold=60.0)
    running.wait_for_phase('holding')
    second = rig.start(*ALL)
    rig.wait_for(lambda: all('another /arm_under_test/' in rig.statuses[node].last.message
                             for node in ALL), 'errors of all nodes')
    status, result = running.result()
    assert status == 'ABORTED'
    assert 'another' in result.error_string
    assert not rig.goal((0.0, 0.0, 0.2)).accepted
    assert 'another' in rig.set_stiff(1, False).message
    rig.publisher(JointTrajectory, 'tendon_actuation/joint_trajectory').publish(
        trajectory([(1.0, (0.001, -0.002))]))
    rig.wait_for(lambda: 'another' in rig.states['tendon_actuation'].last.refused.message,
                 'a refusal')
    assert rig.all_stiff
    rig.end(second[0])
    rig.wait_for(lambda: not any('another' in rig.statuses[node].last.message for node in ALL),
                 'an end of the errors')
    assert rig.goal_when_heard((0.0, 0.0, 0.2)).result()[0] == 'SUCCEEDED'
