# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Goals that must not be accepted: each says why and what is allowed, and nothing moves."""

import itertools
import time

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, Quaternion
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soft_continuum.mechanics.chain import Chain
from soft_continuum.nodes import kinematics, planning, shape_sequencer
from soft_continuum.nodes.threads import load_model
from soft_continuum.planning.plans import PlanError
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import KinematicsState, Shape, TipGoal
from support.ros_rig import ALL, LATCHED, shape_message

JOINTS = Chain(load_arm(description_file())).bodies
LIBRARY = 'c_form, upright_c_form, s_form'


def tip(x, z, y=0.0, turn=(0.0, 1.0), **fields):
    """Return a goal of the tip; turn: y and w of its quaternion."""
    return TipGoal(pose=Pose(position=Point(x=x, y=y, z=z),
                             orientation=Quaternion(y=turn[0], w=turn[1])), **fields)


BAD_GOALS = {
    'unknown shape': ([shape_message('d_form')], ["'d_form'", LIBRARY]),
    'no name and no angles': ([Shape()], [LIBRARY]),
    'unknown shape after a known one':
        ([shape_message('c_form'), shape_message('d_form')], ['shape 2', "'d_form'", LIBRARY]),
    'angle beyond its limit':
        ([shape_message((0.1, 1.2, 0.1))], ['segment 2', '1.2 rad', '-1.047 to 1.047 rad']),
    'vacuums of valves': ([Shape(name='c_form', vacuums=[80e3] * 3)], ['valves']),
    'too few vacuums': ([Shape(name='c_form', vacuums=[80e3])], ['1 vacuums', '3 segments']),
    'a vacuum that is not a number':
        ([Shape(name='c_form', vacuums=[80e3, float('nan'), 80e3])], ['segment 2', 'nan']),
    'a vacuum that leaves a segment soft':
        ([Shape(name='c_form', vacuums=[80e3, 5e3, 80e3])], ['segment 2', '10000', '80000']),
    'a vacuum beyond the full one':
        ([Shape(name='c_form', vacuums=[80e3, 80e3, 9e4])], ['segment 3', '90000', '80000']),
    'a vacuum for which the description has no law':
        ([Shape(name='c_form', vacuums=[80e3, 30e3, 80e3])],
         ['segment 2', 'rigid', 'arm.stiffness_ratios']),
    'vacuums of a goal of the tip, of valves':
        ([Shape(tips=[TipGoal()], vacuums=[80e3] * 3)], ['valves']),
    'vacuums of a path of the tip':
        ([Shape(tips=[TipGoal()] * 2, vacuums=[80e3] * 3)], ['2 tips', 'path']),
    'too few angles': ([shape_message((0.1, 0.1))], ['2 bending angles', '3 segments']),
    'too many angles': ([shape_message((0.1,) * 4)], ['4 bending angles', '3 segments']),
    'angle that is not a number':
        ([shape_message((0.1, 0.1, float('nan')))], ['segment 3', 'nan', '1.047']),
    'infinite angle':
        ([shape_message((float('-inf'), 0.0, 0.0))], ['segment 1', 'inf', '1.047']),
    'degrees instead of radians':
        ([shape_message((36.0, 36.0, 36.0))], ['segment 1', '36 rad', '1.047 rad']),
    'empty sequence': ([], ['empty', LIBRARY]),
    'more shapes than are planned at once':
        ([shape_message('c_form')] * 101, ['101 shapes', 'allowed: 100']),
    'a name without an end':
        ([Shape(name='x' * 1_000_000)], ['shape 1', '1000000 characters', 'allowed: 100']),
    'a name that writes to the terminal':
        ([Shape(name='\x1b[2J\n')], ['shape 1', r'\x1b[2J', 'allowed: 100']),
    'angles without an end': ([shape_message((0.1,) * 10_000)], ['10000 bending angles']),
    'a direction out of the bending plane':
        ([Shape(bending_angles=[0.1] * 3, bending_directions=[0.0, 1.57, 0.0])],
         ['segment 2', 'direction 89.95 degrees', 'allowed: 0 and 180 degrees']),
    'a direction that is not a number':
        ([Shape(bending_angles=[0.1] * 3, bending_directions=[0.0, float('nan'), 0.0])],
         ['direction of segment 2', 'nan', 'allowed: -2 pi to 2 pi']),
    'too few directions':
        ([Shape(bending_angles=[0.1] * 3, bending_directions=[0.0])],
         ['1 bending directions', '3 segments', 'none for 0 of all']),
    'directions without angles':
        ([Shape(name='c_form', bending_directions=[0.0] * 3)],
         ['bending_directions without bending_angles', '3 each']),
    'a tip and angles':
        ([Shape(bending_angles=[0.1] * 3, tips=[tip(0.15, 0.22)])],
         ['tips and bending angles', 'give only one of the two']),
    'a tip that is not a number':
        ([Shape(tips=[tip(float('nan'), 0.22)])], ['nan', 'three finite numbers']),
    'a tip out of the bending plane':
        ([Shape(tips=[tip(0.15, 0.22, y=0.01)])],
         ['y = 0.01 m', 'planar arm', 'tolerance is 0.001 m']),
    'a tip of an unknown kind':
        ([Shape(tips=[tip(0.15, 0.22, kind=3)])], ['is 3', '0 (position)', '2 (pose)']),
    'a tip in another frame':
        ([Shape(tips=[tip(0.15, 0.22, header=Header(frame_id='camera'))])],
         ['camera', 'base_link', 'tf2']),
    'a tip without an orientation':
        ([Shape(tips=[tip(0.15, 0.22, turn=(0.0, 0.0), kind=1)])],
         ['quaternion of length 0', 'needed: 1']),
    'a tip that points out of the plane':
        ([Shape(tips=[TipGoal(kind=1, pose=Pose(
            position=Point(x=0.15, z=0.22), orientation=Quaternion(x=1.0, w=1.0)))])],
         ['quaternion of length 1.41']),
    'a negative tolerance of the tip':
        ([Shape(tips=[tip(0.15, 0.22, position_tolerance=-0.001)])],
         ['position tolerance', '-0.001 m', '1e-05 to 1 m']),
    'a tolerance of the angle that is not a number':
        ([Shape(tips=[tip(0.15, 0.22, kind=1, angle_tolerance=float('nan'))])],
         ['angle tolerance', 'nan']),
    'a path that never ends':
        ([Shape(tips=[tip(0.15, 0.22)] * 201)], ['201 tips', 'allowed: 200']),
    'a tip out of reach':
        ([Shape(tips=[tip(0.5, 0.5)])], ['tip at (500, 500) mm', 'out of reach', '392.6 mm']),
    'negative hold time':
        ([Shape(name='c_form', hold_time=Duration(sec=-1))], ['c_form', 'hold_time', '-1 s']),
    'negative hold time of nanoseconds':
        ([Shape(name='c_form', hold_time=Duration(sec=-1, nanosec=500_000_000))],
         ['hold_time', '-0.5 s', 'negative']),
}


def test_a_bad_goal_is_rejected_with_the_reason_and_moves_nothing(shared_arm):
    pulls, flags = shared_arm.pulls, [len(r) for r in shared_arm.stiff]
    for case, (shapes, reasons) in BAD_GOALS.items():
        goal = shared_arm.goal(*shapes)
        assert not goal.accepted, case
        goal.assert_rejected(*reasons)
    shared_arm.assert_rests()
    assert (shared_arm.pulls, [len(r) for r in shared_arm.stiff]) == (pulls, flags)


def test_a_shape_beyond_the_tension_limit_is_rejected_before_anything_moves(shared_arm):
    assert shared_arm.set_parameter('shape_sequencer', 'tension_limit', 1.0).successful
    shared_arm.goal((0.0, 0.0, 0.0), 'c_form').assert_rejected('c_form', 'tension_limit: 1 N')
    shared_arm.assert_rests_stiff()
    assert shared_arm.set_parameter('shape_sequencer', 'tension_limit', 60.0).successful


def test_a_shape_beyond_the_travel_of_the_tendons_is_rejected(rig):
    rig.start_arm(pull_limits=(-0.01, 0.01))
    rig.goal('c_form').assert_rejected('pull_limits: -0.01 to 0.01 m')
    rig.assert_rests_stiff()


@pytest.fixture
def endless(monkeypatch):
    """Make planning last until the plan is abandoned."""
    def plan(planner, *_):
        while not planner._abandoned():
            time.sleep(0.005)
        raise PlanError('the plan was abandoned')

    monkeypatch.setattr(planning, 'plan_shapes', plan)


@pytest.mark.usefixtures('endless')
def test_a_stop_is_obeyed_and_rejects_the_goal_while_it_is_being_planned(shared_arm):
    goal = shared_arm.goal('c_form')
    assert shared_arm.trigger('tendon_actuation/stop').success
    goal.assert_rejected('~/stop was called')
    assert shared_arm.trigger('tendon_actuation/resume').success
    shared_arm.wait_for(
        lambda: not shared_arm.status_value('tendon_actuation', 'stopped'), 'no more stop')


@pytest.mark.usefixtures('endless')
def test_of_many_goals_that_are_being_planned_each_is_answered(shared_arm):
    goals = [shared_arm.goal('c_form') for _ in range(20)]
    for goal in goals[:-1]:
        goal.assert_rejected('superseded by a newer goal')
    assert not shared_arm.goal('d_form').accepted
    assert not goals[-1].accepted


def test_a_goal_that_runs_can_be_canceled_while_its_next_shape_is_being_planned(
        shared_arm, monkeypatch):
    plan, calls, angles = planning.plan_shapes, itertools.count(), (0.0, 0.0, 0.2)

    def plan_once(planner, state, pulls, shapes, *options):
        # Those of the test before may still be planned.  The first of this one is the check.
        if tuple(shapes[0].bending_angles) == angles and next(calls) > 0:
            while not planner._abandoned():
                time.sleep(0.005)
        return plan(planner, state, pulls, shapes, *options)

    monkeypatch.setattr(planning, 'plan_shapes', plan_once)
    before, goal = shared_arm.pulls, shared_arm.goal(angles).wait_for_phase('preparing')
    goal.cancel()
    assert goal.result()[1].error_code == RunShapeSequence.Result.CANCELED
    assert shared_arm.pulls == before


def test_a_rejected_goal_leaves_the_running_one_alone_and_its_reason_stays(shared_arm):
    running = shared_arm.goal((0.0, 0.0, 0.3), hold=60.0).wait_for_phase('softening')
    rejected = shared_arm.goal('d_form')
    rejected.assert_rejected()
    running.wait_for_phase('holding')
    shared_arm.wait_for(lambda: "'d_form'" in shared_arm.status_value(
        'shape_sequencer', 'rejected'), 'the reason in the status')
    # A late joiner gets the latest state and status only.
    last = shared_arm.sequencer.last
    assert (last.running, last.goal_id) == (True, running.goal_id)
    assert last.rejected_goal_id == rejected.goal_id
    assert "'d_form'" in last.rejected
    running.cancel()
    assert running.result()[0] == 'CANCELED'
    shared_arm.wait_for(lambda: not shared_arm.sequencer.last.running, 'its end')
    assert shared_arm.sequencer.last.error_code == RunShapeSequence.Result.CANCELED


def test_a_goal_is_rejected_naming_the_nodes_that_are_missing(rig, monkeypatch):
    monkeypatch.setattr(shape_sequencer, 'FIRST_MESSAGE_TIMEOUT', 0.5)
    rig.start('shape_sequencer')
    rig.goal('c_form').assert_rejected('tendon_actuation', 'jamming_valves', 'kinematics')


def test_a_goal_waits_for_nodes_that_are_just_starting_and_for_no_stop(rig, monkeypatch):
    monkeypatch.setattr(shape_sequencer, 'FIRST_MESSAGE_TIMEOUT', 60.0)
    rig.start('shape_sequencer', 'tendon_actuation', 'jamming_valves')

    def waiting():
        return 'waiting for kinematics' in rig.statuses['shape_sequencer'].last.message

    early = rig.goal((0.0, 0.0, 0.1))
    rig.wait_for(waiting, 'the goal waits')
    assert rig.trigger('tendon_actuation/stop').success
    early.assert_rejected('~/stop was called')
    assert rig.trigger('tendon_actuation/resume').success
    rig.wait_for(lambda: not rig.status_value('tendon_actuation', 'stopped'), 'no more stop')
    later = rig.goal((0.0, 0.0, 0.1))
    rig.wait_for(waiting, 'the goal waits')
    rig.start('kinematics')
    assert later.result()[0] == 'SUCCEEDED'


def test_a_goal_waits_longer_for_a_node_that_runs_and_still_loads(rig, monkeypatch):
    monkeypatch.setattr(shape_sequencer, 'FIRST_MESSAGE_TIMEOUT', 0.0)
    monkeypatch.setattr(shape_sequencer, 'STARTING_TIMEOUT', 60.0)
    loads = []
    monkeypatch.setattr(kinematics, 'load_model', lambda *what: loads.append(what))
    rig.start(*ALL, ready=False)
    rig.wait_until_ready('tendon_actuation', 'jamming_valves', 'shape_sequencer')
    goal = rig.goal((0.0, 0.0, 0.1))
    rig.wait_for(lambda: 'waiting for kinematics' in rig.statuses['shape_sequencer'].last.message,
                 'the goal waits')
    load_model(*loads[0])
    assert goal.result()[0] == 'SUCCEEDED'


def test_a_state_that_is_not_a_number_ends_no_node(shared_arm):
    # As from a broken node on the same topics; the nodes must neither die nor believe it.
    joints = [[nan] * JOINTS for nan in (np.nan, 1.7e308)]
    with shared_arm.stranger() as stranger:
        shapes = stranger.create_publisher(KinematicsState, 'kinematics/state', LATCHED)
        tendons = stranger.create_publisher(JointState, 'tendon_states', LATCHED)
        shared_arm.wait_for(tendons.get_subscription_count, 'somebody to listen')
        for angles in joints:
            shapes.publish(KinematicsState(joint_angles=angles, held_angles=angles))
            tendons.publish(JointState(
                name=['right_tendon', 'left_tendon'], position=angles[:2], velocity=angles[:2]))
        shared_arm.wait_for(lambda: all(
            'stranger' in shared_arm.statuses[node].last.message
            for node in ('tendon_actuation', 'shape_sequencer')), 'a conflict')
        shared_arm.goal('c_form').assert_rejected('published by')
        assert not np.isnan(shared_arm.wait_for_more(shared_arm.joints)[-1].position).any()
    assert shared_arm.goal((0.0, 0.0, 0.2)).result()[0] == 'SUCCEEDED'
