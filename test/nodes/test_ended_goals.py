# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Goals that end early, one after the other on one arm: canceled, superseded, stopped, disturbed.

That they do so in every phase, and for every reason, is claimed in test/sequencing, without ROS.
"""

import threading

import pytest
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from soft_continuum.nodes.shape_sequencer import ShapeSequencer
from soft_continuum.ros.ros_time import RosTime
from soft_continuum.sequencing.runner import Runner
from soft_continuum_interfaces.action import RunShapeSequence
from support.ros_rig import LATCHED, RELIABLE, STREAM, trajectory

Result = RunShapeSequence.Result
SLOW, FAST = 0.0005, 0.3  # m/s: slow enough to be met in motion, however busy the machine is
PULLED, SHORT = 1e-4, 0.006  # m: of some 7 mm
BEND = (0.0, 0.0, 0.4)
BEND_MORE = (0.0, 0.0, 0.6)


def set_speed(rig, speed):
    assert rig.set_parameter('shape_sequencer', 'tendon_speed', speed).successful


@pytest.fixture
def arm(shared_arm):
    """Return the arm of all these tests: stiff, straight and slow."""
    assert shared_arm.trigger('tendon_actuation/resume').success
    set_speed(shared_arm, FAST)
    shared_arm.goal_when_heard((0.0, 0.0, 0.0)).assert_ended('SUCCEEDED')
    set_speed(shared_arm, SLOW)
    shared_arm.assert_rests_stiff()
    shared_arm.clear()
    return shared_arm


@pytest.fixture
def go(monkeypatch):
    """Return what a goal that is ended early waits for before it is wound down."""
    event, wind_down = threading.Event(), Runner._wind_down

    def patiently(runner):
        while not event.is_set():
            yield
        yield from wind_down(runner)

    monkeypatch.setattr(Runner, '_wind_down', patiently)
    return event


def in_motion(rig):
    """Return a goal that has begun to pull."""
    goal = rig.goal_when_heard(BEND, hold=60.0)
    rig.wait_for(lambda: rig.pulls[0] > PULLED, 'a pull')
    return goal


def assert_reaches(rig, goal, bend=BEND):
    """Claim that a goal succeeds, and that every promise about stiffness was kept."""
    goal.assert_ended('SUCCEEDED')
    rig.assert_bends(bend)
    rig.assert_rests_stiff()
    rig.assert_only_one_was_soft()
    rig.assert_never_moved_all_stiff()


def test_cancel_in_mid_motion_stops_short_and_the_next_goal_goes_on_from_there(arm):
    goal = in_motion(arm)
    goal.cancel()
    result = goal.assert_ended('CANCELED', 'canceled', code=Result.CANCELED)
    assert result.shapes_completed == 0
    arm.assert_rests_stiff(goal)
    assert 0.0 < arm.pulls[0] < SHORT
    set_speed(arm, FAST)
    assert_reaches(arm, arm.goal(BEND))


def test_a_new_goal_aborts_the_running_one_and_succeeds(arm):
    old = in_motion(arm)
    set_speed(arm, FAST)
    new = arm.goal(BEND_MORE)
    old.assert_ended('ABORTED', 'superseded', code=Result.PREEMPTED)
    assert_reaches(arm, new, BEND_MORE)


def test_of_the_goals_that_wait_only_the_newest_runs(arm, go):
    set_speed(arm, FAST)
    first = arm.goal(BEND, hold=60.0).wait_for_phase('softening')
    second = arm.goal((0.0, 0.0, -0.5), hold=60.0)
    assert second.accepted
    third = arm.goal(BEND_MORE)
    assert third.accepted
    go.set()
    result = second.assert_ended('ABORTED', 'superseded', code=Result.PREEMPTED)
    assert result.shapes_completed == 0
    assert second.feedback == []  # it never began
    first.assert_ended('ABORTED', code=Result.PREEMPTED)
    third.assert_ended('SUCCEEDED')
    arm.assert_bends(BEND_MORE)


def test_a_goal_can_be_canceled_while_it_waits_for_its_turn(arm, go):
    first = arm.goal(BEND, hold=60.0).wait_for_phase('softening')
    second = arm.goal(BEND_MORE)
    second.cancel()
    second.assert_ended('CANCELED', code=Result.CANCELED)
    go.set()
    first.assert_ended('ABORTED', code=Result.PREEMPTED)
    arm.assert_rests_stiff()


@pytest.mark.usefixtures('go')
def test_a_stop_also_ends_a_goal_that_waits(arm):
    first = arm.goal(BEND, hold=60.0).wait_for_phase('softening')
    second = arm.goal(BEND_MORE)
    assert second.accepted
    assert arm.trigger('tendon_actuation/stop').success
    assert first.assert_ended('ABORTED').error_code in (Result.STOPPED, Result.PREEMPTED)
    second.assert_ended('ABORTED', code=Result.STOPPED)
    arm.assert_rests()


def test_a_stop_leaves_the_valves_and_nothing_moves_until_resume_and_then_from_where_the_arm_is(
        arm):
    goal = in_motion(arm)
    assert arm.trigger('tendon_actuation/stop').success
    goal.assert_ended('ABORTED', 'stop', code=Result.STOPPED)
    arm.wait_for(lambda: arm.at_rest, 'rest')
    stopped_at = arm.pulls
    assert 0.0 < stopped_at[0] < SHORT

    arm.goal('c_form').assert_rejected('resume')
    arm.assert_rests()
    arm.wait_for_more(arm.pressures[0], 15)
    assert arm.soft_segments() == [3]

    assert arm.trigger('tendon_actuation/resume').success
    arm.assert_rests()  # resume itself moves nothing
    assert arm.pulls == stopped_at
    arm.wait_for(lambda: not arm.status_value('tendon_actuation', 'stopped'), 'no more stop')
    set_speed(arm, FAST)
    assert_reaches(arm, arm.goal(BEND))


def stop_and_resume(rig):
    assert rig.trigger('tendon_actuation/stop').success
    assert rig.trigger('tendon_actuation/resume').success


def deactivate_and_activate(rig):
    rig.transitions('tendon_actuation', 'deactivate', 'activate')


@pytest.mark.parametrize('away', [stop_and_resume, deactivate_and_activate])
def test_a_stop_that_is_resumed_at_once_ends_the_goal_all_the_same(arm, away, monkeypatch):
    before = arm.pulls
    with monkeypatch.context() as patch:
        request = Runner._request
        patch.setattr(Runner, '_request', lambda runner, segment, ask, _, what: request(
            runner, segment, ask, bool, what))  # never soft enough
        goal = arm.goal(BEND).wait_for_phase('softening')
        away(arm)
        goal.assert_ended('ABORTED', code=Result.STOPPED)
    assert arm.pulls == before
    goal = in_motion(arm)
    away(arm)
    assert goal.result()[1].error_code in (Result.STOPPED, Result.HARDWARE_FAULT)
    arm.come_to_rest()
    assert 0.0 < arm.pulls[0] < SHORT


def test_tendons_that_are_deactivated_in_mid_motion_end_the_goal(arm):
    goal = in_motion(arm)
    arm.transitions('tendon_actuation', 'deactivate')
    goal.result()
    arm.transitions('tendon_actuation', 'activate')
    reason = goal.assert_ended('ABORTED', code=Result.HARDWARE_FAULT).error_string
    assert 'deactivated' in reason or 'not active' in reason  # the next part may be refused first


def test_a_motion_that_is_replaced_by_others_ends_the_goal(arm):
    goal = in_motion(arm)
    arm.send(trajectory([(1.0, arm.pulls)]), 'somebody_else/1')
    goal.assert_ended('ABORTED', 'somebody_else/1', code=Result.HARDWARE_FAULT)
    arm.assert_rests_stiff(goal)


def test_a_callback_that_fails_in_mid_motion_ends_the_goal_and_nothing_else(arm, monkeypatch):
    def fail(*_):
        raise ZeroDivisionError('half a shape')

    goal = in_motion(arm)
    monkeypatch.setattr(ShapeSequencer, '_go_on', fail)
    goal.assert_ended('ABORTED', 'ZeroDivisionError: half a shape')
    arm.wait_for(lambda: any('half a shape' in s.message
                             for s in arm.statuses['shape_sequencer']), 'the error')
    arm.come_to_rest()
    monkeypatch.undo()
    set_speed(arm, FAST)
    arm.goal(BEND).assert_ended('SUCCEEDED')


def test_a_jump_of_the_clock_ends_the_goal_with_a_code_of_its_own(arm, monkeypatch):
    goal, now = in_motion(arm), RosTime._now
    monkeypatch.setattr(RosTime, '_now', lambda self: now(self) + 5.0)
    goal.assert_ended('ABORTED', 'jumped by 5.0', code=Result.CLOCK_JUMPED)
    arm.assert_rests_stiff(goal)
    monkeypatch.undo()
    arm.assert_rests()


@pytest.mark.parametrize('profile', [LATCHED, RELIABLE, STREAM],
                         ids=['latched', 'reliable', 'best effort'])
def test_an_emergency_stop_ends_the_motion_until_it_is_off_and_resumed(arm, profile):
    button = arm.observer.create_publisher(Bool, 'emergency_stop', profile)
    arm.wait_for(lambda: button.get_subscription_count() >= 2, 'all nodes to listen')
    goal = in_motion(arm)
    button.publish(Bool(data=True))
    goal.assert_ended('ABORTED', 'emergency_stop', code=Result.STOPPED)
    arm.come_to_rest()
    assert arm.soft_segments() == [3]
    arm.goal(BEND).assert_rejected('emergency_stop')
    arm.wait_for(lambda: 'emergency_stop' in arm.call(
        SetBool, 'jamming_valves/set_all_stiff', data=True).message, 'valves that refuse')
    arm.wait_for_status('tendon_actuation', 'stopped', 'emergency_stop')
    assert not arm.trigger('tendon_actuation/resume').success
    button.publish(Bool(data=False))
    arm.wait_for(lambda: arm.trigger('tendon_actuation/resume').success, 'a resume')
    arm.assert_rests()
    assert arm.soft_segments() == [3]
    arm.wait_for(lambda: arm.call(
        SetBool, 'jamming_valves/set_all_stiff', data=True).success, 'valves that obey')
    arm.on_ros_thread(arm.observer.destroy_publisher, button)
