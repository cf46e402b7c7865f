# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What moves the tendons, what does not, and what stops them."""

import threading

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest

from soft_continuum.nodes import reported_arm, tendon_control
from soft_continuum.nodes.kinematics import Kinematics
from soft_continuum.nodes.tendon_actuation import TensionPrediction
from soft_continuum.ros.ros_time import RosTime
from soft_continuum_interfaces.msg import MotionRequest
from support.ros_rig import assert_declined, RELIABLE, trajectory

OTHERS = ('jamming_valves', 'kinematics')
NAN, INFINITE = float('nan'), float('inf')
PULL = trajectory([(0.3, (0.004, -0.005))])
TO_ACTIVE = {'unconfigured': 'configure', 'inactive': 'activate'}
SLOW_PULL = trajectory([(20.0, (0.010, -0.012))])


@pytest.fixture(scope='module')
def shared_tendons(module_rig):
    """Return an arm without sequencer, its tip segment soft."""
    soft_arm(module_rig)
    return module_rig


@pytest.fixture
def tendons(shared_tendons):
    """Return that arm, straight and as if it had just started, whatever it did before."""
    rig = shared_tendons
    while (state := rig.lifecycle_state('tendon_actuation')) != 'active':
        assert rig.transition('tendon_actuation', TO_ACTIVE[state])
    assert rig.trigger('tendon_actuation/resume').success
    rig.send(trajectory([(0.1, (0.0, 0.0))]))
    arrives(rig, (0.0, 0.0))
    rig.wait_for(lambda: not any(rig.status_value('tendon_actuation', key)
                                 for key in ('stopped', 'ended', 'refused')), 'a clean status')
    rig.clear()
    return rig


def make_soft(rig, segment):
    rig.soften(segment)
    rig.wait_for_status('kinematics', 'soft', str(segment))
    rig.wait_for_more(rig.joints, 3)
    rig.wait_for_shape()


def soft_arm(rig):
    """Start an arm without sequencer, its tip segment soft; return tendon_actuation."""
    tendon_actuation, *_ = rig.start('tendon_actuation', *OTHERS)
    make_soft(rig, 3)
    return tendon_actuation


def wait_for_pull(rig):
    rig.wait_for(lambda: rig.moving and rig.pulls[0] > 1e-4, 'motion')


def arrives(rig, pulls):
    rig.wait_for(lambda: rig.at_rest and np.allclose(rig.pulls, pulls, atol=1e-5),
                 f'tendons at {pulls}')


def pull_slowly(rig):
    """Begin a motion that takes long."""
    rig.send(SLOW_PULL)
    wait_for_pull(rig)


def pull(rig):
    """Pull the tendons, and wait until they are there."""
    rig.send(PULL)
    arrives(rig, (0.004, -0.005))


def refused(rig, message, *reasons, motion=''):
    """Claim that a trajectory is refused with all of the reasons, and that nothing moves."""
    before, said = rig.pulls, len(rig.statuses['tendon_actuation'])
    rig.send(message, motion)
    text = rig.wait_for_status('tendon_actuation', 'refused', reasons[0], after=said)
    for reason in reasons:
        assert reason in text
    rig.assert_rests()
    assert rig.pulls == before


def test_both_tendons_go_where_a_trajectory_leads_them(tendons):
    tendons.send(trajectory([
        (0.3, (0.004, -0.005)), (0.9, (0.004, -0.005)), (1.2, (0.002, -0.003))]))
    arrives(tendons, (0.002, -0.003))
    assert max(m.position[0] for m in tendons.tendons) == pytest.approx(0.004, abs=2e-4)
    assert list(tendons.tendons.last.name) == ['right_tendon', 'left_tendon']
    assert len(tendons.tendons.last.velocity) == 2
    assert len(tendons.tendons.last.effort) == 0  # nothing measures it


def test_tendons_are_told_apart_by_name_not_by_order(tendons):
    tendons.send(trajectory([(0.3, (-0.005, 0.004))], names=('left_tendon', 'right_tendon')))
    arrives(tendons, (0.004, -0.005))


def test_a_new_trajectory_takes_over_from_the_running_one(tendons):
    pull_slowly(tendons)
    tendons.send(trajectory([(1.0, (0.0, 0.0))]))
    arrives(tendons, (0.0, 0.0))
    assert max(m.position[0] for m in tendons.tendons) < 0.009


def points(*positions):
    return trajectory([(0.3 * (i + 1), p) for i, p in enumerate(positions)])


def with_more(name, given):
    message = points((0.001, -0.002))
    setattr(message.points[0], name, list(given))
    return message


def points_from(second):
    message = points((0.001, -0.002))
    message.header.stamp = Time(sec=second)
    return message


BAD_TRAJECTORIES = {
    'not a number': (points((NAN, 0.0)), ['finite']),
    'one position': (points((0.001,)), ['point 1', '1 positions', 'left_tendon']),
    'three positions':
        (points((0.001, -0.002), (0.002, -0.003, 0.0)), ['point 2', '3 positions']),
    'no positions': (points(()), ['point 1', '0 positions']),
    **{f'{name}, {given}': (with_more(name, given), ['point 1', name, 'right_tendon'])
       for name in ('velocities', 'accelerations', 'effort')
       for given in ((0.0, NAN), (0.1,), (0.0, 0.0, 0.0), (INFINITE, 0.0))},
    'unknown joints':
        (trajectory([(0.3, (0.001, -0.002))], names=('right', 'left')),
         ["'right'", 'right_tendon', 'left_tendon']),
    'one joint': (trajectory([(0.3, (0.001,))], names=('right_tendon',)), ['left_tendon']),
    'the same joint twice':
        (trajectory([(0.3, (0.001, 0.001))], names=('right_tendon', 'right_tendon')),
         ['left_tendon']),
    'no joints': (trajectory([(0.3, (0.001, 0.001))], names=()), ['left_tendon']),
    'beyond the travel': (points((0.061, -0.06)), ['0.061', 'pull_limits: -0.06 to 0.06 m']),
    'too fast': (trajectory([(0.01, (0.03, -0.03))]), ['m/s', 'speed_limit: 1 m/s']),
    'both tendons against each other': (points((0.008, 0.008)), ['tension']),
    'the past': (points_from(1), ['ago', 'header.stamp']),
    'far in the future': (points_from(2**31 - 1), ['from now', 'allowed: 60 s']),
    # Both would take too long to judge.
    'too many points': (trajectory([(0.1 * (i + 1), (0.0, -1e-6 * i)) for i in range(1001)]),
                        ['1001 points', 'allowed: 1000']),
    'too many states': (trajectory([(10.0 * (i + 1), (0.05 * (i % 2), -0.06))
                                    for i in range(100)]),
                        ['predicted states', 'allowed: 2000']),
}


def test_a_bad_trajectory_is_refused_with_the_reason_and_moves_nothing(tendons):
    state = tendons.states['tendon_actuation']
    for case, (message, reasons) in BAD_TRAJECTORIES.items():
        tendons.send(message, case)
        tendons.wait_for(lambda c=case: state.last.refused.id == c, f'refusal: {case}')
        text = state.last.refused.message
        assert all(reason in text for reason in reasons), (case, text)
    tendons.assert_rests()
    assert {tuple(m.position) for m in tendons.tendons} == {(0.0, 0.0)}
    pull(tendons)  # and the node lives on


@pytest.mark.parametrize('how', ['stop', 'hold'])
def test_a_stop_does_not_wait_for_a_trajectory_that_is_judged_and_wins(tendons, monkeypatch, how):
    rig, node = tendons, tendons.node('tendon_actuation')
    judging, go = threading.Event(), threading.Event()

    def slow(*_):
        judging.set()
        assert go.wait(30.0)

    monkeypatch.setattr('soft_continuum.nodes.tendon_actuation.TensionPrediction.check', slow)
    rig.send(PULL)
    assert judging.wait(30.0)
    before = node._control.revocations
    if how == 'stop':
        assert rig.trigger('tendon_actuation/stop').success
    else:
        rig.send(trajectory([]))
        rig.wait_for(lambda: node._control.revocations > before, 'the hold')
    go.set()
    assert how in rig.wait_for_status('tendon_actuation', 'refused')
    rig.assert_rests()
    assert rig.pulls == (0.0, 0.0)


def test_tensions_are_predicted_from_a_shape_with_the_jams_that_there_are(tendons, monkeypatch):
    rig, node = tendons, tendons.node('tendon_actuation')
    judged = []
    check, has_read = TensionPrediction.check, threading.Event()

    def noted(self, pulls, shape, *others):
        judged.append(tuple(shape.stiff))
        check(self, pulls, shape, *others)

    monkeypatch.setattr(TensionPrediction, 'check', noted)
    monkeypatch.setattr(reported_arm, 'MAX_DISAGREEMENT', 600.0)
    due = Kinematics._stiffness_due.fget
    assert due is not None
    monkeypatch.setattr(Kinematics, '_stiffness_due',
                        property(lambda self: has_read.is_set() and due(self)))
    rig.soften(2)
    rig.wait_for(lambda: node._arm.stiff == (True, False, False), 'two soft segments')
    rig.send(PULL)
    rig.wait_for_more(rig.tendons, 3)
    assert not judged
    has_read.set()
    arrives(rig, (0.004, -0.005))
    assert set(judged) == {(True, False, False)}
    rig.send(trajectory([(0.3, (0.0, 0.0))]))  # straight before the jam holds it
    arrives(rig, (0.0, 0.0))
    assert rig.set_stiff(2, True).success
    rig.wait_for_status('kinematics', 'soft', '3')


def test_a_motion_that_was_stopped_takes_no_further_parts(tendons):
    tendons.send(SLOW_PULL, 'stopped/1')
    wait_for_pull(tendons)
    for service in ('stop', 'resume'):
        assert tendons.trigger(f'tendon_actuation/{service}').success
    tendons.wait_for(lambda: tendons.at_rest, 'rest')
    refused(tendons, SLOW_PULL, 'stopped/1', 'has ended', 'stop', motion='stopped/1')
    tendons.send(SLOW_PULL, 'stopped/2')
    tendons.wait_for(lambda: tendons.moving, 'motion')


def test_a_motion_that_was_replaced_takes_no_further_parts(tendons):
    state = tendons.states['tendon_actuation']
    tendons.send(SLOW_PULL, 'replaced/1')
    tendons.wait_for(lambda: state.last.accepted.id == 'replaced/1', 'a motion')
    tendons.send(SLOW_PULL, 'somebody_else')
    tendons.wait_for(lambda: state.last.accepted.id == 'somebody_else', 'another')
    tendons.send(SLOW_PULL, 'replaced/1')
    tendons.wait_for(lambda: 'somebody_else' in state.last.refused.message, 'a refusal')
    assert state.last.accepted.id == 'somebody_else'


def test_a_control_cycle_that_comes_late_ends_the_motion(tendons, monkeypatch):
    pull_slowly(tendons)
    monkeypatch.setattr(tendon_control, 'MAX_LATENESS', 0.5)
    tendons.node('tendon_actuation').loop.call(threading.Event().wait, 1.0)
    assert 'late' in tendons.wait_for_status('tendon_actuation', 'ended')
    tendons.come_to_rest()


def test_a_jump_of_ros_time_ends_only_a_motion_that_follows_it(tendons, monkeypatch):
    now = RosTime._now
    pull_slowly(tendons)
    monkeypatch.setattr(RosTime, '_now', lambda self: now(self) - 5.0)
    tendons.wait_for_more(tendons.tendons, 10)
    assert tendons.moving
    monkeypatch.undo()
    tendons.wait_for_more(tendons.tendons, 10)  # back, as the node has seen
    stamped = trajectory([(20.0, (0.010, -0.012))])
    stamped.header.stamp = tendons.observer.get_clock().now().to_msg()
    tendons.send(stamped, 'jumped/1')
    accepted = tendons.states['tendon_actuation']
    tendons.wait_for(lambda: accepted.last.accepted.id == 'jumped/1', 'a motion')
    monkeypatch.setattr(RosTime, '_now', lambda self: now(self) + 5.0)
    tendons.wait_for(lambda: accepted.last.accepted.reason == MotionRequest.CLOCK, 'its end')
    assert 'jumped by 5.0' in accepted.last.accepted.message
    tendons.wait_for(lambda: tendons.at_rest, 'rest')


def test_a_trajectory_that_would_need_too_much_tension_is_refused(tendons):
    assert tendons.set_parameter('tendon_actuation', 'tension_limit', 0.3).successful
    refused(tendons, PULL, 'tension', 'tension_limit: 0.3 N', 'right_tendon 4.00 mm')
    assert tendons.set_parameter('tendon_actuation', 'tension_limit', 60.0).successful
    pull(tendons)


def test_a_bad_trajectory_leaves_the_running_one_alone(tendons):
    tendons.send(trajectory([(1.0, (0.004, -0.005))]))
    wait_for_pull(tendons)
    tendons.send(points((NAN, 0.0)))
    assert 'finite' in tendons.wait_for_status('tendon_actuation', 'refused')
    arrives(tendons, (0.004, -0.005))


def test_no_tendon_moves_before_all_others_were_heard_nor_while_every_segment_is_stiff(rig):
    rig.start('tendon_actuation')
    refused(rig, PULL, 'jamming_valves')
    rig.start('jamming_valves')
    rig.soften(3)
    refused(rig, PULL, 'kinematics', 'shape')
    rig.start('kinematics')
    rig.wait_for_shape()
    assert rig.set_stiff(3, True).success
    refused(rig, PULL, 'every segment is stiff', 'set_stiff')


@pytest.mark.parametrize(('disturb', 'named'), [
    (lambda rig: rig.end(rig.node('kinematics')), 'kinematics'),  # falls silent
    (lambda rig: rig.transitions('jamming_valves', 'deactivate'), 'jamming_valves')],
    ids=['kinematics', 'valves'])
def test_another_node_that_falls_silent_in_mid_motion_ends_the_motion(rig, disturb, named):
    rig.start('tendon_actuation', 'jamming_valves', stale_timeout=1.5)
    rig.start('kinematics')
    make_soft(rig, 3)
    pull_slowly(rig)
    disturb(rig)
    rig.wait_for_status('tendon_actuation', 'ended', named)
    rig.come_to_rest()
    assert 0.0 < rig.pulls[0] < 0.009
    refused(rig, PULL, named)


@pytest.mark.parametrize(('segment', 'stiff'), [(3, True), (1, False)])
def test_a_segment_that_is_switched_in_mid_motion_ends_the_motion(tendons, segment, stiff):
    pull_slowly(tendons)
    tendons.set_stiff(segment, stiff)
    tendons.wait_for_status('tendon_actuation', 'ended', 'segment')
    tendons.come_to_rest()
    assert 0.0 < tendons.pulls[0] < 0.009
    make_soft(tendons, 3)
    tendons.send(trajectory([(0.3, (0.0, 0.0))]))
    arrives(tendons, (0.0, 0.0))
    assert tendons.set_stiff(1, True).success
    tendons.wait_for_status('kinematics', 'soft', '3')


def test_a_trajectory_without_points_brakes_and_holds(tendons):
    pull_slowly(tendons)
    tendons.send(trajectory([]))
    tendons.come_to_rest()
    assert 0.0 < tendons.pulls[0] < 0.009
    pull(tendons)  # no resume is needed


def test_a_stop_brakes_and_lasts_until_resume(tendons):
    pull_slowly(tendons)
    assert tendons.trigger('tendon_actuation/stop').success
    tendons.come_to_rest()
    stopped_at = tendons.pulls
    assert 0.0 < stopped_at[0] < 0.009
    assert 'stop' in tendons.wait_for_status('tendon_actuation', 'stopped')
    assert tendons.soft_segments() == [3]
    refused(tendons, PULL, 'stopped', '~/resume')

    for service in ('stop', 'resume', 'resume'):  # each may be repeated
        assert tendons.trigger(f'tendon_actuation/{service}').success
    tendons.assert_rests()
    assert tendons.pulls == stopped_at
    pull(tendons)


@pytest.mark.parametrize('away', [('deactivate',), ('deactivate', 'cleanup')])
@pytest.mark.parametrize('before', [True, False])
def test_a_stop_before_or_while_the_node_does_not_work_counts_when_it_does(tendons, away, before):
    if before:
        assert tendons.trigger('tendon_actuation/stop').success
    tendons.transitions('tendon_actuation', *away)
    if not before:
        assert tendons.trigger('tendon_actuation/stop').success
    tendons.transitions('tendon_actuation', *('configure', 'activate')[2 - len(away):])
    tendons.wait_for_more(tendons.tendons, 3)
    refused(tendons, PULL, 'stopped', '~/resume')
    assert tendons.trigger('tendon_actuation/resume').success
    pull(tendons)


def test_reference_takes_the_present_position_as_zero(tendons):
    pull(tendons)
    tendons.wait_for_more(tendons.joints, 3)  # of the arm that is bent
    states = tendons.states['tendon_actuation']
    before = len(states)
    assert_declined(tendons.trigger('tendon_actuation/reference'), 'was bent by 0.')
    tendons.assert_rests()
    assert tendons.pulls == pytest.approx((0.004, -0.005))
    assert tendons.trigger('tendon_actuation/reference').success
    arrives(tendons, (0.0, 0.0))
    tendons.assert_rests()
    # Between both zeros nobody takes a pull for one: goals end, shapes are forgotten.
    assert [state.referenced for state in list(states)[before:]].count(False) == 1
    assert states.last.referenced
    tendons.wait_for(lambda: 'was bent by 0.' in tendons.statuses['kinematics'].last.message,
                     'an unknown shape')
    tendons.wait_for(lambda: tendons.trigger('kinematics/reset').success, 'a straight arm')


def test_reference_is_refused_while_a_tendon_moves(tendons):
    pull_slowly(tendons)
    assert_declined(tendons.trigger('tendon_actuation/reference'), 'moving')
    tendons.wait_for(lambda: tendons.pulls[0] > 0.0005, 'more motion')


@pytest.mark.parametrize('away', [('deactivate',), ('deactivate', 'cleanup')])
def test_a_node_that_is_not_active_refuses_and_says_so(tendons, away):
    tendons.transitions('tendon_actuation', *away)
    said = len(tendons.statuses['tendon_actuation'])
    tendons.send(PULL)
    assert 'not active' in tendons.wait_for_status('tendon_actuation', 'refused', after=said)
    for service in ('resume', 'reference'):
        assert_declined(tendons.trigger(f'tendon_actuation/{service}'), 'not active')
    tendons.transitions('tendon_actuation', *('configure', 'activate')[2 - len(away):])
    tendons.assert_rests()
    assert tendons.pulls == (0.0, 0.0)


def test_deactivating_in_mid_motion_holds_and_activating_moves_nothing(tendons):
    pull_slowly(tendons)
    assert tendons.transition('tendon_actuation', 'deactivate')
    assert tendons.lifecycle_state('tendon_actuation') == 'inactive'
    assert tendons.transition('tendon_actuation', 'activate')
    tendons.wait_for_more(tendons.tendons, 1)
    tendons.come_to_rest()
    assert 0.0 < tendons.pulls[0] < 0.009


def test_a_transition_that_is_not_valid_now_is_answered_and_changes_nothing(tendons):
    for name in ('configure', 'activate', 'cleanup'):
        assert not tendons.transition('tendon_actuation', name), name
        assert tendons.lifecycle_state('tendon_actuation') == 'active'
    pull(tendons)


def test_without_autostart_the_node_waits_to_be_configured(rig):
    rig.start('tendon_actuation', ready=False, autostart=False)
    assert rig.lifecycle_state('tendon_actuation') == 'unconfigured'
    assert not rig.transition('tendon_actuation', 'activate')
    rig.transitions('tendon_actuation', 'configure', 'activate')
    rig.assert_rests()
    assert rig.transition('tendon_actuation', 'active_shutdown')
    assert rig.lifecycle_state('tendon_actuation') == 'finalized'


def test_diagnostics_name_the_driver(tendons):
    rig, heard = tendons, tendons.record(DiagnosticArray, '/diagnostics', RELIABLE)

    def named():
        return {s.name: s.hardware_id for m in heard for s in m.status}

    rig.wait_for(lambda: len(named()) == 3, 'diagnostics of three nodes')
    prefix = rig.namespace.lstrip('/')
    assert named()[f'{prefix}/tendon_actuation'] == 'simulated tendon motors'
    assert named()[f'{prefix}/jamming_valves'] == 'simulated jamming valves'
