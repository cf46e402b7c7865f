# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""
Goals that end early: canceled, superseded, stopped, or because of another node.

That they do so in every phase is claimed in test/sequencing, without ROS.
"""

from collections.abc import Callable, Iterator
import threading

import pytest

from soft_continuum.ros.ros_time import RosTime
from soft_continuum.sequencing.runner import Runner
from soft_continuum_interfaces.action import RunShapeSequence
from support.ros_rig import Rig, trajectory

Result = RunShapeSequence.Result
# Slow enough to be met in the phase, however busy the machine is.
SLOW = {
    'preparing': {'simulated_jamming__initially_stiff': False,
                  'simulated_jamming__evacuation_time': 1.0},
    'softening': {'simulated_jamming__venting_time': 2.0},  # if slower, a valve counts as stuck
    'moving': {'tendon_speed': 0.001},
    'holding': {},
}
PULLED = 1e-5  # m: of some 7 mm
BEND = (0.0, 0.0, 0.4)
BEND_MORE = (0.0, 0.0, 0.6)


def wait_for_pull(rig: Rig) -> None:
    rig.wait_for(lambda: rig.pulls[0] > PULLED, 'a pull')


@pytest.fixture
def go(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Return what a goal that is ended early waits for before it is wound down."""
    event, wind_down = threading.Event(), Runner._wind_down

    def patiently(runner: Runner) -> Iterator[None]:
        while not event.is_set():
            yield
        yield from wind_down(runner)

    monkeypatch.setattr(Runner, '_wind_down', patiently)
    return event


@pytest.mark.parametrize('phase', ['preparing', 'softening', 'moving'])
def test_cancel_leaves_the_arm_at_rest_with_every_segment_stiff(rig: Rig, phase: str) -> None:
    rig.start_arm(**SLOW[phase])
    goal = rig.goal(BEND, hold=60.0).wait_for_phase(phase)
    goal.cancel()
    result = goal.assert_ended('CANCELED', 'canceled', code=Result.CANCELED)
    assert result.shapes_completed == 0
    rig.assert_rests_stiff(goal)
    if phase != 'preparing':  # found soft
        rig.assert_only_one_was_soft()


def test_cancel_in_mid_motion_stops_short_and_the_next_goal_goes_on_from_there(rig: Rig) -> None:
    rig.start_arm(**SLOW['moving'])
    goal = rig.goal(BEND)
    wait_for_pull(rig)
    goal.cancel()
    assert goal.result()[0] == 'CANCELED'
    rig.assert_rests_stiff(goal)
    assert 0.0 < rig.pulls[0] < 0.006  # on the way to some 7 mm
    assert rig.set_parameter('shape_sequencer', 'tendon_speed', 0.3).successful
    assert rig.goal(BEND).result()[0] == 'SUCCEEDED'
    rig.assert_bends(BEND)
    rig.assert_never_moved_all_stiff()


@pytest.mark.parametrize('phase', ['moving', 'holding'])
def test_a_new_goal_aborts_the_running_one_and_succeeds(rig: Rig, phase: str) -> None:
    rig.start_arm(**SLOW[phase])
    old = rig.goal(BEND, hold=60.0).wait_for_phase(phase)
    assert rig.set_parameter('shape_sequencer', 'tendon_speed', 0.3).successful
    new = rig.goal(BEND_MORE)
    old.assert_ended('ABORTED', 'superseded', code=Result.PREEMPTED)
    assert new.result()[0] == 'SUCCEEDED'
    rig.assert_bends(BEND_MORE)
    rig.assert_rests_stiff()
    rig.assert_only_one_was_soft()
    rig.assert_never_moved_all_stiff()


def test_of_the_goals_that_wait_only_the_newest_runs(rig: Rig, go: threading.Event) -> None:
    rig.start_arm()
    first = rig.goal(BEND, hold=60.0).wait_for_phase('softening')
    second = rig.goal((0.0, 0.0, -0.5), hold=60.0)
    assert second.accepted
    third = rig.goal(BEND_MORE)
    assert third.accepted
    go.set()
    result = second.assert_ended('ABORTED', 'superseded', code=Result.PREEMPTED)
    assert result.shapes_completed == 0
    assert second.feedback == []  # it never began
    assert first.result()[1].error_code == Result.PREEMPTED
    assert third.result()[0] == 'SUCCEEDED'
    rig.assert_bends(BEND_MORE)


def test_a_goal_can_be_canceled_while_it_waits_for_its_turn(
        rig: Rig, go: threading.Event) -> None:
    rig.start_arm()
    first = rig.goal(BEND, hold=60.0).wait_for_phase('softening')
    second = rig.goal(BEND_MORE)
    assert second.accepted
    second.cancel()
    second.assert_ended('CANCELED', code=Result.CANCELED)
    go.set()
    assert first.result()[1].error_code == Result.PREEMPTED
    rig.assert_rests_stiff()


@pytest.mark.parametrize('phase', ['softening', 'moving', 'holding'])
def test_a_stop_aborts_the_goal_and_leaves_the_valves_as_they_are(rig: Rig, phase: str) -> None:
    rig.start_arm(**SLOW[phase])
    goal = rig.goal(BEND, hold=60.0).wait_for_phase(phase)
    soft = [] if phase == 'holding' else [3]
    rig.wait_for(lambda: rig.soft_segments() == soft, f'soft segments: {soft}')
    assert rig.trigger('tendon_actuation/stop').success
    goal.assert_ended('ABORTED', 'stop', code=Result.STOPPED)
    rig.assert_rests()
    rig.wait_for_more(rig.pressures[0], 15)
    assert rig.soft_segments() == soft


def test_after_a_stop_nothing_moves_until_resume_and_then_from_where_the_arm_is(rig: Rig) -> None:
    rig.start_arm(**SLOW['moving'])
    goal = rig.goal(BEND)
    wait_for_pull(rig)
    assert rig.trigger('tendon_actuation/stop').success
    assert goal.result()[1].error_code == Result.STOPPED
    rig.wait_for(lambda: rig.at_rest, 'rest')
    stopped_at = rig.pulls
    assert 0.0 < stopped_at[0] < 0.006

    rig.goal('c_form').assert_rejected('resume')
    rig.assert_rests()

    assert rig.trigger('tendon_actuation/resume').success
    rig.assert_rests()  # resume itself moves nothing
    assert rig.pulls == stopped_at
    rig.wait_for(lambda: not rig.status_value('tendon_actuation', 'stopped'), 'no more stop')
    assert rig.set_parameter('shape_sequencer', 'tendon_speed', 0.3).successful
    assert rig.goal(BEND).result()[0] == 'SUCCEEDED'
    rig.assert_bends(BEND)
    rig.assert_rests_stiff()
    rig.assert_never_moved_all_stiff()


@pytest.mark.usefixtures('go')
def test_a_stop_also_ends_a_goal_that_waits(rig: Rig) -> None:
    rig.start_arm()
    first = rig.goal(BEND, hold=60.0).wait_for_phase('softening')
    second = rig.goal(BEND_MORE)
    assert second.accepted
    assert rig.trigger('tendon_actuation/stop').success
    for goal in (first, second):
        result = goal.assert_ended('ABORTED')
        assert result.error_code in (Result.STOPPED, Result.PREEMPTED)
    assert second.result()[1].error_code == Result.STOPPED
    rig.assert_rests()


def deactivate_valves(rig: Rig) -> None:
    assert rig.transition('jamming_valves', 'deactivate')


def deactivate_tendons(rig: Rig) -> None:
    assert rig.transition('tendon_actuation', 'deactivate')


def stop_and_resume(rig: Rig) -> None:
    assert rig.trigger('tendon_actuation/stop').success
    assert rig.trigger('tendon_actuation/resume').success


def deactivate_and_activate(rig: Rig) -> None:
    rig.transitions('tendon_actuation', 'deactivate', 'activate')


@pytest.mark.parametrize('away', [stop_and_resume, deactivate_and_activate])
def test_a_stop_that_is_resumed_at_once_ends_the_goal_all_the_same(
        rig: Rig, away: Callable[[Rig], None], monkeypatch: pytest.MonkeyPatch) -> None:
    rig.start_arm(**SLOW['moving'])
    with monkeypatch.context() as patch:
        patch.setattr(Runner, '_soften', lambda runner, segment: runner._switch(
            segment, False, bool))  # never soft enough
        goal = rig.goal(BEND).wait_for_phase('softening')
        away(rig)
        assert goal.result()[1].error_code == Result.STOPPED
    assert rig.pulls == (0.0, 0.0)
    goal = rig.goal_when_heard(BEND)
    wait_for_pull(rig)
    away(rig)
    assert goal.result()[1].error_code in (Result.STOPPED, Result.HARDWARE_FAULT)
    rig.come_to_rest()
    assert 0.0 < rig.pulls[0] < 0.006


def test_a_motion_that_is_replaced_by_others_ends_the_goal(rig: Rig) -> None:
    rig.start_arm(**SLOW['moving'])
    goal = rig.goal(BEND)
    wait_for_pull(rig)
    rig.send(trajectory([(1.0, rig.pulls)]), 'somebody_else/1')
    goal.assert_ended('ABORTED', 'somebody_else/1', code=Result.HARDWARE_FAULT)
    rig.assert_rests_stiff(goal)


def stiffen(rig: Rig) -> None:
    assert rig.set_stiff(3, True).success


def soften_another(rig: Rig) -> None:
    assert rig.set_stiff(1, False).success


@pytest.mark.parametrize(('disturb', 'named'), [
    (deactivate_valves, 'jamming_valves'),
    (deactivate_tendons, 'deactivated'),
    (stiffen, 'segment'),
    (soften_another, 'segment'),
])
def test_a_disturbance_in_mid_motion_ends_the_goal_with_its_name(
        rig: Rig, disturb: Callable[[Rig], None], named: str) -> None:
    patience = {'stale_timeout': 4.0} if disturb is deactivate_valves else {}
    rig.start_arm(**SLOW['moving'], jamming_timeout=1.0, settle_timeout=1.0, **patience)
    goal = rig.goal(BEND).wait_for_phase('moving')
    rig.wait_for(lambda: rig.moving, 'motion')
    disturb(rig)
    goal.assert_ended('ABORTED', named, code=Result.HARDWARE_FAULT)
    if disturb in (stiffen, soften_another):
        rig.assert_rests_stiff(goal)  # as after every end but a stop
    if disturb is not deactivate_tendons:
        rig.assert_rests()


def test_a_jump_of_the_clock_ends_the_goal_with_a_code_of_its_own(
        rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig.start_arm(**SLOW['moving'])
    goal, now = rig.goal(BEND), RosTime._now
    wait_for_pull(rig)
    monkeypatch.setattr(RosTime, '_now', lambda self: now(self) + 5.0)
    goal.assert_ended('ABORTED', 'jumped by 5.0', code=Result.CLOCK_JUMPED)
    rig.assert_rests_stiff(goal)


def test_segments_that_are_found_soft_are_stiffened_before_the_goal_is_run(rig: Rig) -> None:
    rig.start_arm(simulated_jamming__initially_stiff=False)
    goal = rig.goal(BEND)
    goal.assert_ended('SUCCEEDED')
    assert goal.phases[0][2] == 'preparing'
    rig.assert_bends(BEND)
    rig.assert_never_moved_all_stiff()


def test_a_segment_that_does_not_become_stiff_ends_the_goal_with_its_vacuum(rig: Rig) -> None:
    # A leak as strong as the pump.
    rig.start_arm(simulated_jamming__ultimate_vacuum=49e3,
                  simulated_jamming__initially_stiff=False, jamming_timeout=0.5)
    rig.goal(BEND).assert_ended(
        'ABORTED', 'segment 1', 'did not become stiff within 0.5 s', code=Result.TIMEOUT)
    rig.assert_rests()
    assert rig.pulls == (0.0, 0.0)


def test_a_segment_that_does_not_become_soft_ends_the_goal_stiff(rig: Rig) -> None:
    rig.start_arm(simulated_jamming__venting_time=4.0, jamming_timeout=0.5)
    goal = rig.goal(BEND)
    goal.assert_ended('ABORTED', 'segment 3 did not become soft within 0.5 s; its vacuum is',
                      code=Result.TIMEOUT)
    rig.assert_rests_stiff(goal)
    assert rig.pulls == (0.0, 0.0)
