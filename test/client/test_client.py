# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A script in Python sees and moves the arm as the public interfaces let it."""

import asyncio
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from io import StringIO
from itertools import pairwise
from math import cos, hypot, inf, nan, radians, sin
import sys
from time import monotonic
from types import SimpleNamespace
from unittest.mock import Mock

import matplotlib
from matplotlib.figure import Figure
import numpy as np
import pytest
from rclpy.action import ActionClient
from rclpy.serialization import serialize_message
from rclpy.service import Service
from sensor_msgs.msg import JointState
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
    Tip,
)
from soft_continuum.client.connection import Connection
from soft_continuum.client.observed import ObservedArm
from soft_continuum.client.tasks import Tasks
from soft_continuum.hardware.clock import STEADY
from soft_continuum.ros.description import load_arm, load_description
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import MotionRequest
from support.driver_waits import until

matplotlib.use('Agg')
DEADLINE = 60.0  # s
LEAN = (0.2, 0.1, -0.1)  # rad
STRAIGHT = (0.0, 0.0, 0.0)
wait_until = partial(until, STEADY, step=0.01)


def moves_or_has_moved(running):
    """Whether a sequence moves the arm; a late test may find it held only."""
    return running.progress and running.progress.phase in ('moving', 'stiffening', 'holding')


# State.

def test_joints_of_a_base_that_carries_the_arm_are_not_taken_for_its_own():
    node = Mock()
    observed = ObservedArm(node)
    send = {call.args[1]: call.args[2]
            for call in node.create_subscription.call_args_list}['joint_states']
    send(serialize_message(JointState(name=['wheel_1', 'wheel_2'], position=[0.1, 0.1])))
    assert observed.message('joint_states') is None
    assert observed.age('kinematics') == inf
    for joint in ('segment_1_joint_1', 'segment_1_joint_1_x'):
        send(serialize_message(JointState(name=[joint], position=[0.2])))
        assert observed.message('joint_states').name == [joint]


def test_the_first_state_waits_for_the_ros_graph(arm, connect, monkeypatch):
    in_graph, since = ObservedArm.running, []

    def late(observed):
        since.append(monotonic())
        return in_graph(observed) | ({} if monotonic() - since[0] > 0.5 else {'kinematics': False})

    monkeypatch.setattr(ObservedArm, 'running', late)
    assert connect().state.node('kinematics').running


def test_a_client_knows_the_state_the_shapes_and_the_description_of_a_new_arm(
        rig, settling, connect):
    rig.start_arm(shape_names=['c_form', 'lean'], shapes__lean=list(LEAN), arm__payload=0.0125)
    arm = connect()
    wait_until(lambda: arm.state.tip and None not in arm.state.pressures)
    state = arm.state
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
    with pytest.raises(KeyError, match='jaming; the nodes are tendon_actuation, '):
        state.node('jaming')
    c_form = tuple(load_description(description_file())['shapes.c_form'])
    assert dict(arm.shapes) == {'c_form': c_form, 'lean': LEAN}
    assert arm.description.payload == 0.0125


def test_a_client_works_where_stderr_is_no_file_as_in_notebooks(arm, here, monkeypatch):
    monkeypatch.setattr(sys, 'stderr', StringIO())
    with Arm(arm.namespace, timeout=DEADLINE) as client:
        assert client.state.stiff == (True, True, True)


def test_what_is_stale_is_not_known(rig, connect):
    nodes = rig.start('jamming_valves')
    rig.start('kinematics', ready=False)
    arm = connect()
    wait_until(lambda: arm.state.stiff == (True, True, True))
    rig.end(nodes[0])
    wait_until(lambda: arm.state.stiff == (None, None, None))
    wait_until(lambda: arm.state.pressures == (None, None, None))
    assert arm.state.pulls is arm.state.tip is arm.state.bending_angles is None


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
    (['no_form'], "unknown shape 'no_form'; known: c_form, "), ([(nan, 0.0, 0.0)], 'nan'),
    ([], 'the sequence is empty')])
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


async def awaited(running):
    return await running


def test_a_sequence_can_be_awaited_while_others_work(client):
    async def work():
        running = client.start(LEAN, hold=600.0)
        waiting = asyncio.ensure_future(awaited(running))
        for _ in range(3):  # a wait that blocks the others leaves them none
            await asyncio.sleep(0.01)
        assert not waiting.done()
        running.cancel()
        with pytest.raises(SequenceError, match='CANCELED'):
            await waiting
        return await client.start(LEAN)

    assert alone(work()).outcome == 'SUCCESSFUL'


def test_a_sequence_runs_on_when_no_task_awaits_it_until_a_newer_one_ends_it(client, connect):
    async def work():
        running = client.start('c_form', hold=600.0)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(awaited(running), 0.01)
        return running

    older = alone(work())
    assert connect().run(LEAN).outcome == 'SUCCESSFUL'
    with pytest.raises(SequenceError, match='PREEMPTED'):  # not CANCELED before
        older.result(DEADLINE)


def test_a_canceled_sequence_ends_stiff(client):
    running = client.start('c_form', hold=600.0)
    with pytest.raises(NoAnswerError, match='still runs after 0.01 s'):
        running.result(0.01)
    wait_until(lambda: moves_or_has_moved(running))
    running.cancel()
    with pytest.raises(SequenceError, match='CANCELED') as raised:
        running.result(DEADLINE)
    assert raised.value.result.outcome == 'CANCELED'
    assert raised.value.result.shapes_completed == 0
    assert running.done
    wait_until(lambda: client.state.stiff == (True, True, True))


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
    with pytest.raises(ClientError, match='this Arm is closed; create a new one'):
        client.stop()


def test_nothing_spins_an_action_client_that_is_taken_down(here, monkeypatch):
    connection = Connection('asker', 'deaf', timeout=DEADLINE)
    spun = []
    destroy = ActionClient.destroy

    def note_and_destroy(client):
        spun.append(connection._thread.is_alive())
        destroy(client)

    monkeypatch.setattr(ActionClient, 'destroy', note_and_destroy)

    async def watch():  # the action client is made when it is first needed
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
    with pytest.raises(LostError, match='nothing received from shape_sequencer for 1 s'):
        running.result(DEADLINE)


# Stop.

def test_what_is_done_by_hand_waits_for_the_sequence_which_a_stop_of_another_client_ends(
        client, connect):
    other = connect()
    running = client.start('c_form', hold=600.0)
    wait_until(lambda: moves_or_has_moved(running))
    for by_hand in (lambda: client.soften(1), client.stiffen, lambda: client.jog(right=0.001)):
        with pytest.raises(RefusedError, match='a sequence is running .*; cancel or stop it'):
            by_hand()
    assert not running.done
    assert 'nothing moves before' in other.stop()
    with pytest.raises(SequenceError, match='STOPPED'):
        running.result(DEADLINE)
    for work, reason in ((lambda: client.run('c_form'), 'call tendon_actuation/resume first'),
                         (client.home, 'motion is stopped: .*; resume it first')):
        with pytest.raises(RefusedError, match=reason):
            work()
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


def test_an_unknown_segment_is_refused(client):
    for segment in (0, 4, -1):
        with pytest.raises(RefusedError, match=f'no segment {segment}; the segments are 1 to 3'):
            client.soften(segment)
    assert client.state.stiff == (True, True, True)


def test_a_jog_pulls_the_tendons_while_a_segment_is_soft(straight_client):
    client = straight_client
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


def test_a_jog_is_replaced_by_a_newer_one_and_ended_by_a_stop_of_another_client(
        straight_client, connect, monkeypatch):
    monkeypatch.setattr(requests, 'JOG_SPEED', 0.002)
    straight_client.soften(3)
    other = connect()
    for end, kind, reason in (
            (lambda: other.jog(left=0.001), MotionEndedError, 'replaced by another trajectory'),
            (other.stop, RefusedError, 'stop was called')):
        begin = other.state.pulls[1]
        with ThreadPoolExecutor(1) as pool:
            older = pool.submit(straight_client.jog, left=-0.03)
            other.wait_for(lambda state, begin=begin: state.pulls[1] < begin - 0.001)
            end()
            with pytest.raises(kind, match=reason) as ended:
                older.result(DEADLINE)
        assert other.state.pulls[1] > begin - 0.03
        assert kind is RefusedError or ended.value.reason == MotionRequest.REPLACED


def test_reference_and_reset_are_answered(client):
    client.run(LEAN)
    with pytest.raises(RefusedError, match='kinematics/reset: pulls are'):
        client.reset()
    assert 'straight' in client.reference(sure=True)
    wait_until(lambda: client.state.pulls == (0.0, 0.0))
    assert 'straight' in client.reset(sure=True)


@pytest.mark.parametrize('plan', [True, False], ids=['by a sequence', 'without a plan'])
def test_from_any_shape_there_is_a_way_home(straight_client, monkeypatch, plan):
    client = straight_client
    client.run(LEAN)
    if not plan:
        def refused(*_):
            raise RefusedError('no plan')
        monkeypatch.setattr(client, 'run', refused)
    assert 'the arm is straight' in client.home()
    state = client.state
    assert state.stiff == (True, True, True)
    assert state.pulls == pytest.approx((0.0, 0.0), abs=1e-4 if plan else 1e-9)
    assert state.bending_angles == pytest.approx(STRAIGHT, abs=0.02)


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


def test_a_number_that_is_not_finite_is_an_error_before_anything_is_sent(connect):
    arm = connect(timeout=0.5)
    for call in (lambda: arm.run('c_form', hold=-1.0), lambda: arm.run('c_form', hold=nan),
                 lambda: arm.jog(right=nan), lambda: arm.jog(left=inf)):
        with pytest.raises(ValueError, match='nan|inf|-1'):
            call()


def test_what_no_arm_can_have_is_named(here):
    for timeout in (0.0, -1.0, nan):
        with pytest.raises(ValueError, match='must be positive'):
            Arm(timeout=timeout)
    with pytest.raises(ClientError, match="'a b' is not valid in ROS"):
        Arm('a b')


def test_a_stop_that_gets_no_answer_is_asked_for_again(arm, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(arm.domain))
    asked = []

    def stop(_, response):
        asked.append(monotonic())
        response.success = True
        return response

    def send(*answer):
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


TOLERANCE = 1e-3  # m


def test_reach_brings_the_tip_to_a_place_and_a_plan_tells_before(arm, client):
    plan = client.plan(Tip((0.12, 0.26)))
    assert plan.found and plan.message == ''
    assert plan.softenings == len(plan.steps) >= 1
    end = plan.steps[-1].tip[-1]
    assert hypot(end.x - 0.12, end.z - 0.26) <= TOLERANCE and end.is_planar
    assert 0.0 < plan.tension < 60.0 and plan.duration > 0.0
    seen = []
    result = client.reach(0.12, 0.26, progress=seen.append)
    assert result.reached.tip_error <= TOLERANCE and result.reached.replans == 0
    assert result.reached.bending_angles == pytest.approx(plan.steps[-1].bending_angles, abs=0.01)
    assert {progress.shape for progress in seen} == {'tip at (120, 260) mm'}
    assert {progress.aim for progress in seen} == {'tip'}


def test_what_the_tip_cannot_do_is_refused(client):
    with pytest.raises(RefusedError, match='y = 0.01 m; a planar arm'):
        client.reach(0.12, 0.01, 0.26)
    with pytest.raises(RefusedError, match='out of reach'):
        client.run(Tip((0.5, 0.5)), 'c_form')
    with pytest.raises(ValueError, match='path'):
        client.follow([])
    plan = client.plan(Tip((0.5, 0.5)))
    assert not plan.found and 'out of reach' in plan.message
    for wrong in ({'position': (0.1,)}, {'position': (0.1, float('nan'))},
                  {'position': (0.1, 0.2), 'direction': (0.0, 0.0, 0.0)},
                  {'position': (0.1, 0.2), 'angle': 0.1, 'direction': (0.0, 0.0, 1.0)}):
        with pytest.raises(ValueError, match='position|direction'):
            Tip(**wrong)


@pytest.mark.parametrize('angle', [0.0, 0.7, -1.2, radians(180.0)])
def test_a_direction_turns_z_by_its_angle(angle):
    x, y, z, w = Tip((0.1, 0.2), angle=angle).quaternion
    # Where a rotation by the quaternion brings the z axis.
    assert (2.0 * (x * z + w * y), 1.0 - 2.0 * (x * x + y * y)) == pytest.approx(
        (sin(angle), cos(angle)), abs=1e-12)


def test_the_command_line_reaches_and_follows(arm, call, tmp_path):
    status, output, errors = call('reach', '-100', '280', '--unit', 'mm')
    assert (status, errors) == (0, '')
    assert 'tip at (-100, 280) mm, segment' in output and output.splitlines()[-2] == 'done'
    path = tmp_path / 'path.csv'
    path.write_text('x [mm],z [mm]\n-100,280\n-90,288\n')
    status, output, errors = call('follow', str(path), '--unit', 'mm', '--tolerance', '4')
    assert (status, errors) == (0, '')
    assert 'path through 2 points' in output
    status, _, errors = call('reach', '500', '500', '--unit', 'mm')
    assert (status, errors.count('\n')) == (1, 1) and 'out of reach' in errors


class Fake:
    """An arm whose sequencer refuses to straighten it; does: what was asked of it by hand."""

    def __init__(self, obstacles=(), error=None, stopped=''):
        self.obstacles = SimpleNamespace(known=[SimpleNamespace(name=name) for name in obstacles])
        self.description = SimpleNamespace(segments=(1, 2, 3))
        self.error, self.stopped, self.does = error, stopped, []
        self.state = SimpleNamespace(
            stopped='', progress=None, stiff=(True, True, True), bending_angles=(0.5, 0.0, 0.0),
            tendons=('right', 'left'), pulls=(0.01, 0.0), node=lambda name: SimpleNamespace(
                level='ok'), nodes=[SimpleNamespace(name='shape_sequencer', running=True)])

    def run(self, *shapes):
        raise RefusedError('shape_sequencer: no plan')

    def wait_for(self, condition, timeout):
        return condition(self.state)

    def soften(self, segment):
        self.does.append(f'soften {segment}')

    def stiffen(self):
        self.does.append('stiffen')

    def jog(self, **moves):
        self.does.append('jog')
        self.state.stopped = self.stopped
        if self.error is not None:
            raise self.error
        self.state.pulls = tuple(pull + moves[name] for name, pull in zip(
            self.state.tendons, self.state.pulls, strict=True))


def test_without_a_plan_it_goes_home_and_ends_stiff():
    arm = Fake()
    assert 'straightened without a plan, because shape_sequencer: no plan' in Arm.home(arm)
    assert arm.does == ['soften 3', 'jog', 'soften 2', 'soften 1', 'stiffen']


def test_it_moves_nothing_without_a_plan_where_there_are_obstacles():
    arm = Fake(obstacles=['lamp', 'post'])
    with pytest.raises(RefusedError, match=r'no plan; without a plan .* \(lamp, post\)'):
        Arm.home(arm)
    assert arm.does == []


@pytest.mark.parametrize(('error', 'stopped', 'end'), [
    (KeyboardInterrupt(), '', 'stiffen'), (RefusedError('too much tension'), '', 'stiffen'),
    (RefusedError('stopped'), 'by hand', 'jog')])
def test_what_interrupts_it_leaves_no_segment_soft_but_a_stop_does(error, stopped, end):
    arm = Fake(error=error, stopped=stopped)
    with pytest.raises(type(error)):
        Arm.home(arm)
    assert arm.does[-1] == end


STOP = 'tendon_actuation/stop'


def step(call):
    """Let a call see whether its answer has come; return that."""
    try:
        return call.send(None)
    except StopIteration as end:
        return end.value


def test_a_call_that_fails_withdraws_no_request_of_another_one():
    node, futures = Mock(), []
    node.get_node_names_and_namespaces.return_value = []

    def call_async(_):
        futures.append(Mock())
        futures[-1].done.return_value = False
        return futures[-1]
    node.create_client.return_value.call_async = call_async
    tasks = Tasks(node, 0.0, 1.0)
    first, second = tasks.call(Trigger, STOP), tasks.call(Trigger, STOP, within=100.0)
    step(second)
    with pytest.raises(ClientError):
        step(first)
    node.destroy_client.assert_not_called()
    futures[0].done.return_value = True
    assert step(second) is futures[0].result()
    with pytest.raises(ClientError):
        step(tasks.call(Trigger, STOP))
    node.destroy_client.assert_called_once()


class Interrupted(Future):
    """The answer to a goal; Ctrl-C comes when it is first waited for."""

    came = False

    def result(self, timeout=None):
        if not self.came:
            self.came = True
            raise KeyboardInterrupt
        return super().result(timeout)


class Sequence:
    """One that was accepted; calls: what was asked of it."""

    def __init__(self):
        self.calls, self.done = [], False

    def cancel(self):
        self.calls.append('cancel')

    def result(self, timeout):
        self.calls.append('result')


def arm_of(answer):
    arm = Arm.__new__(Arm)
    arm._sequences = []
    arm._requests = SimpleNamespace(start=lambda work: answer, send=lambda *goal: None)
    return arm


def test_a_goal_that_is_accepted_after_ctrl_c_is_canceled():
    answer, sequence = Interrupted(), Sequence()
    answer.set_result(sequence)
    with pytest.raises(KeyboardInterrupt):
        arm_of(answer).start('c_form')
    assert sequence.calls == ['cancel', 'result']


def test_a_goal_that_is_refused_after_ctrl_c_leaves_nothing_to_do():
    answer = Interrupted()
    answer.set_exception(RefusedError('out of reach'))
    with pytest.raises(KeyboardInterrupt):
        arm_of(answer).start('c_form')
