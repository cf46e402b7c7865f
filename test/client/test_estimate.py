# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What measurements say of the arm is seen by clients, and told on the command line."""

import json
from math import hypot, nan
import re
import threading
from types import SimpleNamespace

import pytest

from soft_continuum.client.estimate import Estimate
from soft_continuum.client.state import source_text, state_line
from soft_continuum.ui.browser.html import History, source_html
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Anomaly, KinematicsState
from support.estimated_arm import CHAIN, joint_angles, learned, tip, tip_covariance

NAMESPACE = '/arm_under_test'


@pytest.fixture
def arm(estimated_of_module):
    """Return an arm that is estimated from measurements."""
    arm = estimated_of_module
    arm.age, arm.predicted = 0.05, (0.28, 0.2, -0.3)
    arm.state = KinematicsState(
        source=KinematicsState.ESTIMATED, angle_stddevs=[0.002] * 3,
        tip_covariance=tip_covariance(3e-4, 4e-4, 0.01), parameters=[
            learned('stiffness_factor_1', 1.25, 0.05), learned('payload', 0.02, 0.03, False)],
        anomalies=[Anomaly(cause=Anomaly.NOT_STIFF, segment=2, message='look at its valve')])
    return arm


@pytest.fixture
def client(arm, connect):
    return connect()


def test_a_client_sees_how_well_the_shape_is_known_and_what_is_wrong(arm, client):
    state = client.wait_for(lambda s: s if s.estimate and s.estimate.measured
                            and s.predicted_disc_poses else None)
    estimate = state.estimate
    assert estimate.age < 2.0
    assert estimate.tip_stddev == pytest.approx(5e-4)
    assert estimate.angle_stddevs == (0.002,) * 3
    tip, alone = (CHAIN.plane_points(joint_angles(angles))[-1]
                  for angles in (arm.angles, arm.predicted))
    assert estimate.predicted_tip_error == pytest.approx(hypot(*(tip - alone)[:2]), abs=1e-6)
    factor, payload = estimate.parameters
    assert (factor.kind, factor.segment, factor.determined) == ('stiffness_factor', 1, True)
    assert (payload.kind, payload.segment, payload.determined) == ('payload', None, False)
    anomaly, = estimate.anomalies
    assert (anomaly.cause, anomaly.segment) == ('not stiff', 2)


def test_the_status_says_it_in_a_line_each(arm, call):
    status, output, _ = call('status')
    assert status == 0
    assert 'estimated from measurements; measured just now, tip +-0.5 mm, angles +-0.1' in output
    assert 'learned    stiffness factor, segment 1: 1.25 +- 0.05' in output
    assert 'payload' not in output  # of which nothing is known
    assert 'ALARM      not stiff (segment 2): look at its valve' in output
    document = json.loads(call('status', '--json')[1])
    assert document['estimate']['measured'] is True
    assert document['estimate']['parameters'][0]['name'] == 'stiffness_factor_1'
    arm.age = None  # no disc was ever seen
    assert 'shape      estimated from measured tensions; tip +-0.5 mm' in call('status')[1]


def test_without_measurements_it_is_a_prediction_and_no_more_is_said(arm, call):
    arm.state, arm.age = KinematicsState(), None
    status, output, _ = call('status')
    assert status == 0
    assert 'shape      predicted by the model; never measured' in output
    assert 'learned' not in output and 'ALARM' not in output


@pytest.mark.parametrize(('age', 'text', 'line'), [
    (2.0, 'estimated from measurements; last measured 2 s ago', 'estimated'),
    (24.0, 'predicted since it was last measured; last measured 24 s ago', 'predicted')])
def test_what_was_measured_long_ago_is_predicted_everywhere(age, text, line):
    estimate = Estimate(True, age, (0.002,) * 3)
    assert source_text(estimate) == f'{text}, angles +-0.1 deg'
    state = SimpleNamespace(
        pulls=None, stiff=(), bending_angles=(), estimate=estimate,
        node=lambda name: SimpleNamespace(message='idle'))
    assert state_line(state).split(' | ')[3] == line
    chip = re.sub('<[^>]*>', '', source_html(state, History(3, 2, 1e5)))
    assert line.upper() in chip and f'last measured {age:.0f} s ago' in chip


def test_a_sequence_has_an_aim_and_its_result_says_where_it_ended(arm, client):
    running = client.start('c_form', aim='tip')
    client.wait_for(lambda s: s.progress)
    assert arm.goals[-1].aim == RunShapeSequence.Goal.TIP
    arm.feed_back(correction=2, error=0.0031)
    now = next(now for now in running.updates() if now.correction)
    assert (now.phase, now.error, now.aim) == ('measuring', 0.0031, 'tip')
    seen = client.wait_for(lambda s: s.progress and s.progress.correction and s.progress)
    assert (seen.error, seen.aim) == (0.0031, 'tip')
    arm.feed_back(correction=3, error=float('nan'))
    assert client.wait_for(lambda s: s.progress and s.progress.correction == 3
                           and s.progress).error is None
    arm.end_goal(shapes_completed=1, source=RunShapeSequence.Result.MEASURED,
                 bending_angles=[0.1, 0.2, 0.3], angle_stddevs=[0.002] * 3,
                 tip=tip(0.1, 0.3, 0.6), tip_error=6e-4, corrections=4)
    reached = running.result(30.0).reached
    assert reached is not None and reached.measured
    assert (reached.tip_error, reached.corrections) == (6e-4, 4)
    assert (reached.tip.x, reached.tip.z, reached.tip.angle) == pytest.approx((0.1, 0.3, 0.6))
    with pytest.raises(ValueError, match="aim is 'toe'; allowed: 'angles' or 'tip'"):
        client.start('c_form', aim='toe')


RESULTS = [
    ({'source': 1, 'tip': tip(0.1, 0.3, 0.6), 'corrections': 4},
     'reached: tip 0.6 mm from its aim (measured, +-0.5 mm), angles +5.7 +11.5 +17.2 deg, '
     '4 corrections'),
    ({'angle_stddevs': [0.002] * 3, 'tip': tip(0.1, 0.3, 0.6)},
     'predicted since measurements ended: tip 0.6 mm from its aim (by the model, +-0.5 mm), '
     'angles +5.7 +11.5 +17.2 deg'),
    ({'angle_stddevs': [nan] * 3},
     'predicted since measurements ended: tip 0.6 mm from its aim (by the model), '
     'angles +5.7 +11.5 +17.2 deg'),
    ({}, 'predicted: nothing was measured; tip 0.6 mm from its aim by the model'),
    ({'tip_error': nan}, 'predicted: nothing was measured; angles +5.7 +11.5 +17.2 deg')]


@pytest.mark.parametrize(('result', 'text'), RESULTS)
def test_run_says_where_it_ended_and_how_that_is_known(arm, call, result, text):
    sent = len(arm.goals)

    def end():
        while len(arm.goals) == sent or arm._end is None or arm._end.done():
            threading.Event().wait(0.02)
        arm.end_goal(shapes_completed=1, bending_angles=[0.1, 0.2, 0.3],
                     **{'tip_error': 6e-4, **result})

    other = threading.Thread(target=end)
    other.start()
    status, output, errors = call('run', 'c_form', '--aim', 'tip')
    other.join()
    assert (status, errors) == (4 if 'measurements ended' in text else 0, '')
    assert output.splitlines()[-2:] == ['done', text]
    assert arm.goals[-1].aim == RunShapeSequence.Goal.TIP


def test_the_loop_is_opened_and_closed(arm, client):
    assert client.closed_loop is True
    client.closed_loop = False
    assert client.closed_loop is False and arm.closed_loop is False
    client.closed_loop = True
