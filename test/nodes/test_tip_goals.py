# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Goals of the tip, plans of them, and obstacles that come into their way, over DDS."""

from math import hypot, inf

from geometry_msgs.msg import Point, Pose
import pytest
from visualization_msgs.msg import Marker, MarkerArray

from soft_continuum.nodes import planning
from soft_continuum.planning.plans import PlanError
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Shape, TipGoal
from soft_continuum_interfaces.srv import PlanShapes
from support.ros_rig import LATCHED

PLACE = (0.15, 0.22)  # x, z, m
TOLERANCE = 1e-3  # m


def at(x, z, **fields):
    """Return a shape with the tip at a place."""
    return Shape(tips=[TipGoal(pose=Pose(position=Point(x=x, z=z)), **fields)])


def plan(rig, *shapes, **more):
    """Return the answer of plan_shapes."""
    return rig.call(PlanShapes, 'shape_sequencer/plan_shapes', shapes=list(shapes), **more)


def ball(rig, name, x, z, diameter):
    """Put a ball there, and wait until the sequencer knows it."""
    marker = Marker(ns=name, type=Marker.SPHERE, action=Marker.ADD)
    marker.header.frame_id = 'base_link'
    marker.pose.position.x, marker.pose.position.z = x, z
    marker.scale.x = marker.scale.y = marker.scale.z = diameter
    rig.publisher(MarkerArray, 'obstacles').publish(MarkerArray(markers=[marker]))
    rig.wait_for(lambda: any(m.ns == name for m in known(rig)), 'the ball to be known')


def clear(rig):
    """Take all obstacles away."""
    rig.publisher(MarkerArray, 'obstacles').publish(
        MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
    rig.wait_for(lambda: not known(rig), 'no obstacles')


def known(rig):
    """Return the obstacles that are known."""
    last = rig.obstacles.last
    return [m for m in last.markers if m.action == Marker.ADD] if last else []


@pytest.fixture(scope='module')
def watched(shared_arm):
    """Return the shared arm with its obstacles recorded."""
    shared_arm.obstacles = shared_arm.record(MarkerArray, 'known_obstacles', LATCHED)
    return shared_arm


@pytest.fixture
def arm(watched):
    """Return the arm straight, and afterwards without obstacles."""
    assert watched.goal((0.0, 0.0, 0.0)).result()[0] == 'SUCCEEDED'
    yield watched
    clear(watched)


def test_a_plan_says_what_would_be_done_and_moves_nothing(arm):
    ball(arm, 'lamp', -0.2, 0.3, 0.04)
    pulls = arm.pulls
    answer = plan(arm, at(*PLACE), Shape(name='c_form'))
    assert answer.success, answer.message
    steps = answer.steps
    assert {step.shape_index for step in steps} == {0, 1}
    assert all(1 <= step.segment <= 3 and step.duration > 0.0 for step in steps)
    assert all(0.0 < step.largest_tension < 60.0 for step in steps)
    assert all(0.005 < step.smallest_clearance < inf for step in steps)
    assert {step.nearest_obstacle for step in steps} == {'lamp'}
    end = [step for step in steps if step.shape_index == 0][-1].tip_path[-1].position
    assert hypot(end.x - PLACE[0], end.z - PLACE[1]) <= TOLERANCE
    assert answer.tip_errors[0] <= TOLERANCE and answer.tip_errors[1] == 0.0
    assert list(steps[-1].bending_angles) == pytest.approx([0.6283185] * 3, abs=0.02)
    arm.assert_rests(3)
    assert arm.pulls == pulls and arm.all_stiff


def test_a_sequence_of_a_tip_and_angles_that_was_planned_and_shown_is_run_as_it_was_shown(
        arm, monkeypatch):
    ball(arm, 'lamp', -0.2, 0.3, 0.04)
    shapes = at(*PLACE), Shape(name='c_form')
    # Few states find another plan than the goal would, so that it can be told from it.
    answer = plan(arm, *shapes, states=200)
    assert answer.success, answer.message

    def forbidden(*_):
        raise AssertionError('it was planned once more')
    monkeypatch.setattr(planning, 'plan_shapes', forbidden)
    for shape in shapes:
        shape.hold_time.nanosec = 1000  # which is no part of the plan
    goal = arm.goal(*shapes)
    result = goal.assert_ended('SUCCEEDED')
    arm.assert_rests_stiff(goal)
    assert [segment for _, segment, phase in goal.phases if phase == 'softening'] == [
        step.segment for step in answer.steps]
    assert list(result.bending_angles) == pytest.approx(
        list(answer.steps[-1].bending_angles), abs=2e-3)
    # Feedback comes by a topic, the result by a service: neither waits for the other.
    arm.wait_for(lambda: goal.feedback[-1][1].progress == 1.0, 'the last feedback')
    fractions = [feedback.progress for _, feedback in goal.feedback]
    assert fractions == sorted(fractions)


def test_what_was_planned_is_planned_again_when_something_has_changed(arm, monkeypatch):
    def stop():
        stops = arm.states['tendon_actuation'].last.stops
        arm.trigger('tendon_actuation/stop')
        arm.trigger('tendon_actuation/resume')
        arm.wait_for(lambda: arm.states['tendon_actuation'].last.stops > stops, 'a stop')

    def again(*_):
        raise PlanError('planned again')

    for change in (
            lambda: arm.set_parameter('shape_sequencer', 'reach.seed', 1), stop,
            lambda: arm.goal((0.1, 0.0, 0.0)).assert_ended('SUCCEEDED'),
            lambda: ball(arm, 'lamp', -0.2, 0.3, 0.04)):
        assert plan(arm, at(*PLACE), states=2000).success
        change()
        with monkeypatch.context() as patch:
            patch.setattr(planning, 'plan_shapes', again)
            arm.goal(at(*PLACE)).assert_rejected('planned again')
    arm.set_parameter('shape_sequencer', 'reach.seed', 0)


def test_a_plan_that_there_is_not_says_why(arm):
    ball(arm, 'lamp', *PLACE, 0.1)
    answer = plan(arm, at(*PLACE), states=500)
    assert not answer.success
    assert 'tip at (150, 220) mm' in answer.message and 'lamp' in answer.message
    refused = plan(arm, time_limit=float('nan'))
    assert (refused.success, refused.message) == (
        False, 'the sequence is empty; give at least one shape: c_form, upright_c_form, s_form')
    refused = plan(arm, at(*PLACE), time_limit=-1.0)
    assert 'time_limit is -1 s; allowed: 0' in refused.message
    arm.soften(2)
    assert 'a segment is soft' in plan(arm, at(*PLACE)).message
    arm.set_stiff(2, True)


def test_a_plan_is_not_made_while_a_sequence_runs(arm):
    goal = arm.goal((0.1, 0.0, 0.0), hold=600.0).wait_for_phase('holding')
    assert 'a sequence runs' in plan(arm, at(*PLACE)).message
    goal.cancel()
    goal.result()


def test_angles_are_refused_when_an_obstacle_is_in_their_way(arm):
    ball(arm, 'lamp', 0.17, 0.2, 0.1)
    arm.goal('c_form').assert_rejected('c_form', 'lamp is in the way')


@pytest.mark.parametrize('on_change', ['replan', 'abort'])
def test_an_obstacle_that_comes_into_the_way_stops_the_motion(arm, on_change):
    for name, value in (('obstacles.on_change', on_change), ('tendon_speed', 0.02)):
        assert arm.set_parameter('shape_sequencer', name, value).successful
    goal = arm.goal(at(*PLACE)).wait_for_phase('moving')
    # Where the tip comes by when segment 2 is bent first, as it is without an obstacle.
    ball(arm, 'hand', 0.128, 0.312, 0.04)
    status, result = goal.result()
    assert arm.set_parameter('shape_sequencer', 'tendon_speed', 0.1).successful
    if on_change == 'abort':
        assert (status, result.error_code) == ('ABORTED', RunShapeSequence.Result.OBSTRUCTED)
        assert 'hand is' in result.error_string and 'margin: 5.0 mm' in result.error_string
        assert result.replans == 0
    else:
        assert (status, result.replans) == ('SUCCEEDED', 1), result.error_string
        assert result.tip_error <= TOLERANCE
    arm.assert_rests_stiff(goal)
    arm.assert_only_one_was_soft()
