# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Goals that must not be accepted: each says why and what is allowed, and nothing moves."""

from builtin_interfaces.msg import Duration
import numpy as np
import pytest
from ros_rig import Rig, shape_message
from sensor_msgs.msg import JointState

from soft_continuum_interfaces.msg import Shape

LIBRARY = 'c_form, upright_c_form, s_form'

BAD_GOALS = {
    'unknown shape': ([shape_message('d_form')], ["'d_form'", LIBRARY]),
    'no name and no angles': ([Shape()], [LIBRARY]),
    'unknown shape after a known one':
        ([shape_message('c_form'), shape_message('d_form')], ['shape 2', "'d_form'", LIBRARY]),
    'angle beyond its limit':
        ([shape_message((0.1, 1.2, 0.1))], ['segment 2', '1.2 rad', '-1.047 to 1.047 rad']),
    'too few angles': ([shape_message((0.1, 0.1))], ['2 bending angles', '3 segments']),
    'too many angles': ([shape_message((0.1,) * 4)], ['4 bending angles', '3 segments']),
    'angle that is not a number':
        ([shape_message((0.1, 0.1, float('nan')))], ['segment 3', 'nan', '1.047']),
    'infinite angle':
        ([shape_message((float('-inf'), 0.0, 0.0))], ['segment 1', 'inf', '1.047']),
    'degrees instead of radians':
        ([shape_message((36.0, 36.0, 36.0))], ['segment 1', '36 rad', '1.047 rad']),
    'empty sequence': ([], ['empty', LIBRARY]),
    'negative hold time':
        ([Shape(name='c_form', hold_time=Duration(sec=-1))], ['c_form', 'hold_time', '-1 s']),
    'negative hold time of nanoseconds':
        ([Shape(name='c_form', hold_time=Duration(sec=-1, nanosec=500_000_000))],
         ['hold_time', '-0.5 s', 'negative']),
}



@pytest.mark.parametrize('case', BAD_GOALS)
def test_a_bad_goal_is_rejected_with_the_reason_and_moves_nothing(arm: Rig, case: str) -> None:
    shapes, reasons = BAD_GOALS[case]
    goal = arm.goal(*shapes)
    assert not goal.accepted
    said = arm.rejected()
    for reason in reasons:
        assert reason in said
    arm.assert_rests_stiff()
    assert arm.pulls == (0.0, 0.0)


def test_a_shape_beyond_the_tension_limit_is_rejected_before_anything_moves(rig: Rig) -> None:
    rig.start_arm(tension_limit=1.0)
    assert not rig.goal('c_form').accepted
    said = rig.rejected()
    assert 'c_form' in said
    assert 'tension_limit: 1 N' in said
    rig.assert_rests_stiff()


def test_a_shape_beyond_the_travel_of_the_tendons_is_rejected(rig: Rig) -> None:
    rig.start_arm(pull_limits=(-0.01, 0.01))
    assert not rig.goal('c_form').accepted
    assert 'pull_limits: -0.01 to 0.01 m' in rig.rejected()
    rig.assert_rests_stiff()


def test_a_rejected_goal_leaves_the_running_one_alone(arm: Rig) -> None:
    running = arm.goal((0.0, 0.0, 0.3), hold=1.5)
    running.wait_for_phase('moving')
    assert not arm.goal('d_form').accepted
    assert "'d_form'" in arm.rejected()
    assert running.result()[0] == 'SUCCEEDED'


def test_why_a_goal_was_rejected_is_still_told_while_another_one_runs(arm: Rig) -> None:
    running = arm.goal((0.0, 0.0, 0.3), hold=20.0)
    running.wait_for_phase('softening')
    assert not arm.goal('d_form').accepted
    running.wait_for_phase('holding')
    arm.wait_for_more(arm.tendons)
    # What a late joiner gets is the latest status only.
    assert "'d_form'" in arm.status_value('shape_sequencer', 'rejected')
    running.cancel()
    assert running.result()[0] == 'CANCELED'


@pytest.mark.parametrize(('missing', 'named'), [
    ('tendon_actuation', 'tendon_actuation'),
    ('jamming_valves', 'jamming_valves'),
    ('kinematics', 'kinematics'),
])
def test_a_goal_is_rejected_naming_the_node_that_is_not_heard(
        rig: Rig, missing: str, named: str) -> None:
    present = [name for name in (
        'tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer') if name != missing]
    rig.start(*present)
    assert not rig.goal('c_form').accepted
    assert named in rig.rejected()


def test_a_goal_after_a_rejected_one_runs(arm: Rig) -> None:
    assert not arm.goal('d_form').accepted
    assert arm.goal((0.0, 0.0, 0.2)).result()[0] == 'SUCCEEDED'


def test_a_state_that_is_not_a_number_ends_no_node(arm: Rig) -> None:
    # As from a broken node on the same topics; the nodes must neither die nor believe it.
    joints = len(arm.joints.last.position)
    arm.publisher(JointState, 'joint_states').publish(JointState(position=[np.nan] * joints))
    states = arm.publisher(JointState, 'tendon_states')
    states.publish(JointState(name=['right_tendon', 'left_tendon'], position=[np.nan] * 2,
                              velocity=[np.nan] * 2))
    assert not arm.goal('d_form').accepted
    arm.wait_for_more(arm.joints)
    assert not np.isnan(arm.joints.last.position).any()
    assert arm.goal((0.0, 0.0, 0.2)).result()[0] == 'SUCCEEDED'
