# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Two nodes that would act as one: whichever it is, all notice, and nothing moves."""

import pytest
from sensor_msgs.msg import JointState

from soft_continuum.ros.parameter_table import DESCRIBED
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import JammingValvesState
from support.ros_rig import ALL, QUICK, trajectory

BEND = (0.0, 0.0, 0.2)


def assert_refuses_all_motion(rig, words):
    """Claim that goals, softening and trajectories are refused for a reason that has the words."""
    rig.goal(BEND).assert_rejected(words)
    assert words in rig.set_stiff(1, False).message
    state = rig.states['tendon_actuation']
    rig.send(trajectory([(1.0, (0.001, -0.002))]))
    rig.wait_for(lambda: words in state.last.refused.message, 'a refusal')
    # By the state, which is repeated: a second jamming_valves that ended had flags of its own.
    rig.wait_for(lambda: set(rig.states['jamming_valves'].last.stiffness)
                 == {JammingValvesState.STIFF}, 'a stiff arm')


def wait_for_conflict(rig, words):
    rig.wait_for(lambda: all(words in rig.statuses[node].last.message for node in ALL),
                 'errors of all nodes')
    # Two nodes of one name share a topic: each of those in this process is asked, besides.
    rig.wait_for(lambda: all(words in node.status.message for node in rig.nodes
                             if node.get_name() in ALL),
                 'errors of all nodes of this process')


def wait_for_its_end(rig, words):
    rig.wait_for(lambda: not any(words in rig.statuses[node].last.message for node in ALL),
                 'an end of the errors')


@pytest.mark.parametrize('name', DESCRIBED)
def test_a_second_node_of_one_name_ends_the_goal_and_refuses_all_motion_whichever_it_is(
        shared_arm, name):
    rig, words = shared_arm, f'another {shared_arm.namespace}/{name} is running'
    first = [] if name in ALL else rig.start(name, ready=False)
    running = rig.goal_when_heard(BEND, hold=60.0)
    running.wait_for_phase('holding')
    second, = rig.start(name, ready=False)
    try:
        wait_for_conflict(rig, words)
        running.assert_ended('ABORTED', words)
        # Of two tendon_actuation or jamming_valves each tells its own state, by turns.
        assert_refuses_all_motion(rig, words)
    finally:
        for node in (second, *first):
            rig.end(node)
    wait_for_its_end(rig, words)


def test_a_second_process_of_one_name_is_a_conflict_and_one_that_was_started_again_is_none(
        rig, processes):
    rig.start(*(name for name in ALL if name != 'kinematics'))
    first = processes.node('kinematics', parameters=QUICK)
    rig.wait_until_ready(*ALL)
    first.kill()
    rig.start('kinematics', ready=False)
    rig.wait_for_more(rig.joints, 3)
    assert rig.goal_when_heard(BEND).result()[0] == 'SUCCEEDED'
    assert not any('another' in status.message
                   for recorded in rig.statuses.values() for status in recorded)
    second = processes.node('kinematics', parameters=QUICK)
    words = f'another {rig.namespace}/kinematics is running'
    wait_for_conflict(rig, words)
    assert_refuses_all_motion(rig, words)
    second.kill()
    wait_for_its_end(rig, 'kinematics')
    assert rig.goal_when_heard((0.0, 0.0, 0.1)).result()[0] == 'SUCCEEDED'


def publish_joints(rig, names):
    rig.publisher(JointState, 'joint_states').publish(
        JointState(name=list(names), position=[0.1] * len(names)))


def test_joints_of_a_base_on_joint_states_are_no_conflict_and_a_joint_of_the_arm_is_one(
        shared_arm):
    rig = shared_arm
    rig.clear()
    running = rig.goal_when_heard(BEND, hold=600.0).wait_for_phase('holding')
    for _ in range(10):
        publish_joints(rig, ['left_wheel', 'right_wheel'])
        rig.wait_for_more(rig.pressures[0], 2)
    assert not running.ended
    assert not any('joint_states' in status.message
                   for recorded in rig.statuses.values() for status in recorded)

    words = f'{rig.namespace}/joint_states with segment_2_joint_1 is published by '

    def noticed():
        publish_joints(rig, ['left_wheel', 'segment_2_joint_1'])
        return all(words in rig.statuses[node].last.message for node in ALL)

    rig.wait_for(noticed, 'errors of all nodes')
    running.assert_ended('ABORTED', words, f'{rig.namespace}/observer')
    wait_for_its_end(rig, words)
    assert rig.goal_when_heard(BEND).result()[0] == 'SUCCEEDED'


# Two arms on one machine.

SHAPES = {'left': (0.0, 0.4, 0.2), 'right': (0.0, -0.3, 0.5)}


def test_two_arms_run_different_shapes_at_the_same_time_and_a_stop_is_of_one_alone(make_rig):
    rigs = {name: make_rig(namespace=f'/{name}') for name in SHAPES}
    for rig in rigs.values():
        rig.start_arm(tendon_speed=0.03, simulated_jamming__evacuation_time=0.2)
    left, right = rigs.values()
    goals = {name: rig.goal(SHAPES[name], hold=600.0) for name, rig in rigs.items()}
    for goal in goals.values():
        goal.wait_for_phase('moving')
    assert left.trigger('tendon_actuation/stop').success
    assert goals['left'].result()[1].error_code == RunShapeSequence.Result.STOPPED
    left.come_to_rest()
    goals['right'].wait_for_phase('holding')
    assert left.trigger('tendon_actuation/resume').success
    assert left.goal_when_heard(SHAPES['left']).result()[0] == 'SUCCEEDED'
    assert not goals['right'].ended
    for name, rig in rigs.items():
        rig.assert_bends(SHAPES[name])
        rig.assert_only_one_was_soft()
        rig.assert_never_moved_all_stiff()
    goals['right'].cancel()
    assert goals['right'].result()[0] == 'CANCELED'
