# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A script in Python sees and moves the arm as the public interfaces let it."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from io import StringIO
from itertools import pairwise
from math import inf, nan
import sys
import threading
from time import monotonic, sleep
from typing import Any

import matplotlib
from matplotlib.figure import Figure
import numpy as np
import pytest
from rclpy.action import ActionClient
from rclpy.service import Service
from std_srvs.srv import Trigger

from soft_continuum.client import (
    Arm,
    ClientError,
    LostError,
    MotionEndedError,
    NoAnswerError,
    NodesMissingError,
    RefusedError,
    requests,
    SequenceError,
)
from soft_continuum.client.connection import Connection
from soft_continuum.parameters.files import load_arm, load_description
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import MotionRequest
from support.ros_rig import Rig

matplotlib.use('Agg')
DEADLINE = 60.0  # s
LEAN = (0.2, 0.1, -0.1)  # rad
STRAIGHT = (0.0, 0.0, 0.0)


def wait_until(condition):
    deadline = monotonic() + DEADLINE
    while not condition():
        assert monotonic() < deadline
        sleep(0.01)


def moves_or_has_moved(running):
    """Whether a sequence moves the arm; a late test may find it held only."""
    return running.progress and running.progress.phase in ('moving', 'stiffening', 'holding')


# State.

def test_the_state_of_a_straight_and_stiff_arm_is_complete(new_client):
    wait_until(lambda: new_client.state.tip and None not in new_client.state.pressures)
    state = new_client.state
    assert state.pulls == state.speeds == (0.0, 0.0)
    assert state.stiff == (True, True, True)
    assert all(0.0 < pressure < 60e3 for pressure in state.pressures)
    assert state.bending_angles == STRAIGHT
    assert [pose.x for pose in state.segment_poses] == [0.0, 0.0, 0.0]
    assert state.tip.z == pytest.approx(load_arm(description_file()).length)
    assert len(state.joint_angles) == 39
    assert [node.level for node in state.nodes] == ['ok'] * 4
    assert all(node.running and node.age < DEADLINE for node in state.nodes)
    assert state.node('jamming_valves').values['stiff'] == 'true true true'


def test_a_client_works_where_stderr_is_no_file_as_in_notebooks(arm, here, monkeypatch):
    monkeypatch.setattr(sys, 'stderr', StringIO())
    with Arm(arm.namespace, timeout=DEADLINE) as client:
        assert client.state.stiff == (True, True, True)


def test_an_unknown_node_is_named_with_the_known_ones(client):
    with pytest.raises(KeyError, match='jaming; the nodes are tendon_actuation, '):
        client.state.node('jaming')


def test_what_is_stale_is_not_known(rig, connect):
    nodes = rig.start('jamming_valves')
    rig.start('kinematics', ready=False)
    arm = connect()
    wait_until(lambda: arm.state.stiff == (True, True, True))
    rig.end(nodes[0])
    wait_until(lambda: arm.state.stiff == (None, None, None))
    wait_until(lambda: arm.state.pressures == (None, None, None))
    assert arm.state.pulls is arm.state.tip is arm.state.bending_angles is None


def test_the_shape_library_and_the_description_are_those_of_the_nodes(rig, connect):
    rig.start_arm(shape_names=['c_form', 'lean'], shapes__lean=list(LEAN), arm__payload=0.0125)
    arm = connect()
    c_form = tuple(load_description(description_file())['shapes.c_form'])
    assert dict(arm.shapes) == {'c_form': c_form, 'lean': LEAN}
    assert arm.description.payload == 0.0125


def test_a_plot_and_a_notebook_show_the_shape_that_the_arm_has(client):
    client.run(LEAN)

    def tip_is_that_of_the_state():
        drawn = client.plot().get_lines()[-1].get_xydata()[-1]
        tip = client.state.tip
        return np.allclose(drawn, [tip.x * 1e3, tip.z * 1e3], rtol=0.0, atol=1e-6)

    wait_until(tip_is_that_of_the_state)  # they come on two topics
    own = Figure().subplots()
    assert client.plot(own) is own
    page = client._repr_html_()
    assert '<svg' in page and '<pre>tendons    right_tendon ' in page
    assert repr(client) == "Arm('/arm_under_test')"
    assert str(client.state).startswith('tendons    right_tendon ')
    assert client.state._repr_html_().startswith('<pre>tendons    right_tendon ')


# Sequences.

def test_a_sequence_reaches_its_shapes_and_reports_its_progress(client):
    seen = []
    result = client.run('s_form', LEAN, hold=0.5, progress=seen.append)
    assert (result.outcome, result.message, result.shapes_completed) == ('SUCCESSFUL', '', 2)
    wait_until(lambda: client.state.bending_angles == pytest.approx(LEAN, abs=2e-3))
    fractions = [now.fraction for now in seen]
    assert fractions == sorted(fractions) and fractions[-1] == pytest.approx(1.0)
    assert all(one != next for one, next in pairwise(seen))  # called on change only
    assert {now.shape for now in seen} == {'s_form', 'shape 2'}
    assert {now.phase for now in seen} >= {'softening', 'moving', 'stiffening', 'holding'}


@pytest.mark.parametrize(('shapes', 'reason'), [
    (['no_form'], "unknown shape 'no_form'; known: c_form, "),
    ([(0.1, 0.2)], '3'),
    ([(nan, 0.0, 0.0)], 'nan'),
    ([(2.0, 0.0, 0.0)], 'segment 1'),
    ([], 'the sequence is empty'),
])
def test_what_the_sequencer_rejects_is_refused_with_its_reason(client, shapes, reason):
    before = client.state.pulls
    for _ in range(2):  # the second time for the same reason
        with pytest.raises(RefusedError, match='shape_sequencer: .*' + reason):
            client.run(*shapes)
    assert client.state.pulls == before


def alone(work):
    """Run a coroutine on a thread: other tests may have left a loop running on this one."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result(DEADLINE)


def test_a_sequence_can_be_awaited_while_others_work(client):
    async def work():
        running = client.start(LEAN, hold=600.0)
        waiting = asyncio.ensure_future(_awaited(running))
        for _ in range(3):  # a wait that blocks the others leaves them none
            await asyncio.sleep(0.01)
        assert not waiting.done()
        running.cancel()
        with pytest.raises(SequenceError, match='CANCELED'):
            await waiting
        return await client.start(LEAN)

    async def _awaited(running):
        return await running

    assert alone(work()).outcome == 'SUCCESSFUL'


def test_a_task_that_no_longer_awaits_leaves_the_sequence_running(client):
    async def work():
        running = client.start(LEAN, hold=600.0)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(_awaited(running), 0.01)
        return running

    async def _awaited(running):
        return await running

    running = alone(work())
    assert client.run(LEAN).outcome == 'SUCCESSFUL'
    with pytest.raises(SequenceError, match='PREEMPTED'):  # not CANCELED before
        running.result(DEADLINE)


def test_a_canceled_sequence_ends_stiff(client):
    running = client.start('c_form', hold=600.0)
    wait_until(lambda: moves_or_has_moved(running))
    running.cancel()
    with pytest.raises(SequenceError, match='CANCELED') as raised:
        running.result(DEADLINE)
    assert raised.value.result.outcome == 'CANCELED'
    assert raised.value.result.shapes_completed == 0
    assert running.done
    wait_until(lambda: client.state.stiff == (True, True, True))


def test_waiting_too_briefly_says_that_it_still_runs(client):
    running = client.start('c_form', hold=600.0)
    with pytest.raises(NoAnswerError, match='still runs after 0.01 s'):
        running.result(0.01)


def test_a_newer_sequence_ends_the_older_one(client, connect):
    older = client.start('c_form', hold=600.0)
    result = connect().run(LEAN)
    assert result.outcome == 'SUCCESSFUL'
    with pytest.raises(SequenceError, match='PREEMPTED'):
        older.result(DEADLINE)


def test_a_progress_callback_that_fails_cancels_the_sequence(client, arm):
    def fail(_):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        client.run('c_form', hold=600.0, progress=fail)
    arm.wait_for_status('shape_sequencer', 'last', 'CANCELED')


def test_leaving_cancels_what_was_started(arm, here):
    with Arm(arm.namespace, timeout=DEADLINE) as client:
        running = client.start('c_form', hold=600.0)
        wait_until(lambda: running.progress)
    assert running.done
    arm.wait_for_status('shape_sequencer', 'last', 'CANCELED')
    with pytest.raises(ClientError, match='this Arm is closed; make a new one'):
        client.stop()


def test_nothing_spins_an_action_client_that_is_taken_down(
        here: None, monkeypatch: pytest.MonkeyPatch) -> None:
    connection = Connection('asker', 'deaf', timeout=DEADLINE)
    spun: list[bool] = []
    destroy = ActionClient.destroy

    def note_and_destroy(client: ActionClient) -> None:
        spun.append(connection._thread.is_alive())
        destroy(client)

    monkeypatch.setattr(ActionClient, 'destroy', note_and_destroy)

    async def watch() -> None:  # the action client is made when it is first needed
        assert not connection.requests._action.server_is_ready()
    try:
        connection.requests.start(watch()).result()
    finally:
        connection.close()
    assert spun == [False]


def test_a_sequencer_that_dies_does_not_keep_its_client_waiting(rig, connect, monkeypatch):
    monkeypatch.setattr(requests, 'LOST_TIMEOUT', 1.0)
    rig.start('tendon_actuation', 'jamming_valves', 'kinematics')
    sequencer = rig.start('shape_sequencer')[0]
    rig.wait_for(lambda: len(rig.joints), 'joint_states')
    rig.goal_when_heard(STRAIGHT).result()
    running = connect().start('c_form', hold=600.0)
    rig.end(sequencer)
    with pytest.raises(LostError, match='nothing received of shape_sequencer for 1 s'):
        running.result(DEADLINE)


# Stop.

def test_a_stop_of_another_client_ends_the_sequence_and_lasts_until_resumed(client, connect):
    other = connect()
    running = client.start('c_form', hold=600.0)
    wait_until(lambda: moves_or_has_moved(running))
    assert 'nothing moves before' in other.stop()
    with pytest.raises(SequenceError, match='STOPPED'):
        running.result(DEADLINE)
    with pytest.raises(RefusedError, match='call tendon_actuation/resume first'):
        client.run('c_form')
    other.resume()
    wait_until(lambda: not client.state.node('tendon_actuation').values['stopped'])
    client.stiffen()
    assert client.run(STRAIGHT).outcome == 'SUCCESSFUL'


# Segments and tendons by hand.

def test_a_softened_segment_is_full_of_air_and_a_stiffened_one_evacuated(client):
    client.soften(2)
    state = client.state
    assert state.stiff == (True, False, True)
    assert state.pressures[1] > 91e3
    client.stiffen(2)
    assert client.state.stiff == (True, True, True)
    wait_until(lambda: client.state.pressures[1] < 60e3)  # it comes on another topic


@pytest.mark.parametrize('segment', [0, 4, -1])
def test_an_unknown_segment_is_refused(client, segment):
    with pytest.raises(RefusedError, match=f'no segment {segment}; the segments are 1 to 3'):
        client.soften(segment)
    assert client.state.stiff == (True, True, True)


def test_a_jog_pulls_the_tendons_while_a_segment_is_soft(new_client):
    client = new_client
    with pytest.raises(RefusedError, match='tendon_actuation: every segment is stiff'):
        client.jog(right=0.001, left=-0.0015)
    client.soften(3)
    with pytest.raises(RefusedError, match='no tendon top; .* right_tendon, left_tendon'):
        client.jog(top=0.001)
    with pytest.raises(RefusedError, match='pull_limits'):
        client.jog(right=0.1)
    assert client.state.pulls == (0.0, 0.0)
    client.jog(right=0.001, left=-0.0015)
    assert client.state.pulls == pytest.approx((0.001, -0.0015), abs=2e-5)
    client.jog(right_tendon=-0.001)
    state = client.state
    assert state.tendons == ('right_tendon', 'left_tendon')
    assert state.pulls == pytest.approx((0.0, -0.0015), abs=2e-5)


def test_a_stopped_jog_is_refused_with_the_reason(new_client, connect):
    new_client.soften(3)
    other = connect()
    caught = []

    def jog():
        try:
            new_client.jog(left=-0.05)
        except ClientError as error:
            caught.append(error)

    thread = threading.Thread(target=jog)
    thread.start()
    try:
        wait_until(lambda: other.state.pulls[1] < -0.001)
        other.stop()
    finally:
        thread.join(DEADLINE)
    assert isinstance(caught[0], RefusedError) and 'stop was called' in str(caught[0])
    assert other.state.pulls[1] > -0.05


def test_of_two_jogs_at_once_the_newer_one_replaces_the_older(new_client, connect):
    new_client.soften(3)
    other = connect()
    with ThreadPoolExecutor(1) as pool:
        older = pool.submit(new_client.jog, left=-0.05)
        other.wait_for(lambda state: state.pulls[1] < -0.001)
        other.jog(left=0.001)
        with pytest.raises(MotionEndedError, match='newer trajectory') as ended:
            older.result(DEADLINE)
    assert ended.value.reason == MotionRequest.REPLACED


def test_nothing_is_done_by_hand_while_a_sequence_runs(client):
    running = client.start('c_form', hold=600.0)
    wait_until(lambda: client.state.node('shape_sequencer').values.get('phase') == 'holding')
    for by_hand in (lambda: client.soften(1), client.stiffen, lambda: client.jog(right=0.001)):
        with pytest.raises(RefusedError, match='a sequence is running .*; cancel or stop it'):
            by_hand()
    assert not running.done


def test_reference_and_reset_are_answered(new_client):
    assert 'straight' in new_client.reference()
    assert 'straight' in new_client.reset()
    new_client.run(LEAN)
    with pytest.raises(RefusedError, match='kinematics/reset: pulls are'):
        new_client.reset()


@pytest.mark.parametrize('plan', [True, False], ids=['by a sequence', 'without a plan'])
def test_from_any_shape_there_is_a_way_home(new_client, monkeypatch, plan):
    new_client.run(LEAN)
    if not plan:
        def refused(*_):
            raise RefusedError('no plan')
        monkeypatch.setattr(new_client, 'run', refused)
    assert 'the arm is straight' in new_client.home()
    state = new_client.state
    assert state.stiff == (True, True, True)
    assert state.pulls == pytest.approx((0.0, 0.0), abs=1e-4 if plan else 1e-9)
    assert state.bending_angles == pytest.approx(STRAIGHT, abs=0.02)


def test_what_was_stopped_does_not_go_home_before_it_is_resumed(new_client):
    new_client.stop()
    with pytest.raises(RefusedError, match='motion is stopped: .*; resume it first'):
        new_client.home()
    assert new_client.state.stiff == (True, True, True)


def test_where_nothing_looks_at_the_arm_nothing_is_tared(connect, arm):
    with pytest.raises(NodesMissingError, match='neither a camera nor disc_sensors'):
        connect(timeout=0.5).tare()


# What is missing, and what is wrong.

def test_without_nodes_it_is_said_which_and_how_to_start_them(connect):
    arm = connect(timeout=0.1)
    assert arm._repr_html_().startswith('<pre>Arm(&#x27;/arm_under_test&#x27;): tendon_actuation')
    for ask in (lambda: arm.state, lambda: arm.run('c_form'), lambda: arm.shapes, arm.stop,
                lambda: arm.jog(right=0.001), lambda: arm.soften(1), arm.plot):
        with pytest.raises(NodesMissingError) as raised:
            ask()
        for word in ('tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer',
                     './run up', 'ros2 launch soft_continuum bringup.launch.py'):
            assert word in str(raised.value)


def test_an_arm_in_another_namespace_is_pointed_at(arm, connect):
    client = connect(namespace='left', timeout=0.5)
    wait_until(lambda: 'an arm was found in namespace /arm_under_test' in _why(client.stop))


def _why(call):
    with pytest.raises(NodesMissingError) as raised:
        call()
    return str(raised.value)


def test_only_the_nodes_that_are_missing_are_named(rig, connect):
    rig.start('kinematics')
    arm = connect(timeout=0.5)
    wait_until(lambda: 'kinematics' not in _why(arm.stop))
    assert arm.state.pulls is None
    assert 'tendon_actuation, jamming_valves, shape_sequencer do not run' in _why(arm.stop)


@pytest.mark.parametrize('call', [
    lambda arm: arm.run('c_form', hold=-1.0), lambda arm: arm.run('c_form', hold=nan),
    lambda arm: arm.jog(right=nan), lambda arm: arm.jog(left=inf)])
def test_a_number_that_is_not_finite_is_an_error_before_anything_is_sent(connect, call):
    with pytest.raises(ValueError, match='nan|inf|-1'):
        call(connect(timeout=0.5))


@pytest.mark.parametrize('timeout', [0.0, -1.0, nan])
def test_a_timeout_has_to_be_positive(timeout):
    with pytest.raises(ValueError, match='must be positive'):
        Arm(timeout=timeout)


def test_an_invalid_namespace_is_named(here):
    with pytest.raises(ClientError, match="'a b' is not one that ROS takes"):
        Arm('a b')


def test_a_stop_that_gets_no_answer_is_asked_for_again(
        arm: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', str(arm.domain))
    asked: list[float] = []

    def stop(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        asked.append(monotonic())
        response.success = True
        return response

    def send(*answer: Any) -> None:
        if len(asked) > 1:  # else it is lost
            Service.send_response(service, *answer)

    service = arm.observer.create_service(Trigger, '/deaf/tendon_actuation/stop', stop)
    service.send_response = send
    connection = Connection('asker', 'deaf', timeout=10.0)
    try:
        connection.requests.start(connection.requests.stop()).result()
    finally:
        connection.close()
    wait_until(lambda: len(asked) >= 2)
