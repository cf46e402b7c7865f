# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A request that is never answered ends its wait, says for what, and can be repeated."""

from contextlib import contextmanager

import pytest
import rclpy
from rclpy.action import ActionClient
from std_srvs.srv import SetBool

from soft_continuum.client import requests as client_requests
from soft_continuum.client.connection import Connection
from soft_continuum.client.errors import LostError, NoAnswerError, RefusedError
from soft_continuum.lab.recordings import recorder as recorder_node
from soft_continuum.nodes.shape_sequencer import SequenceServer
from soft_continuum.ui.browser.session import PageSession
from soft_continuum.ui.teleop import steered_arm
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import RecorderState
from support.joystick import Joystick, LB, RIGHT
from support.ros_rig import DEADLINE, LATCHED

TIMEOUT = 0.5  # s, of what is lost in any case


def service_of(node, ending):
    """Return a service of a node by the end of its name."""
    return next(one for one in node.services if one.service_name.endswith(ending))


@contextmanager
def lost_answers(node, ending):
    """Lose every answer of a service of a node; the list has those that were lost."""
    service, lost = service_of(node, ending), []
    send, service.send_response = service.send_response, lambda *answer: lost.append(answer)
    try:
        yield lost
    finally:
        service.send_response = send


@pytest.fixture
def connection(module_domain, monkeypatch):
    """Return a client that finds everything, and waits for no answer for long."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(module_domain))
    found = Connection('impatient', '/arm_under_test', TIMEOUT, DEADLINE)
    yield found
    found.close()


def problem(future):
    """Return how a request of a client failed, which nothing but a missing answer may do."""
    with pytest.raises(NoAnswerError) as failed:
        future.result(DEADLINE)
    return str(failed.value)


def test_a_client_is_told_which_answer_did_not_come(shared_arm, connection):
    requests = connection.requests
    with lost_answers(shared_arm.node('tendon_actuation'), '/reference'):
        assert problem(requests.start(requests.reference())) == (
            'an answer from tendon_actuation/reference is missing after 0.5 s, although its node '
            'runs; is it active, and the computer not overloaded?')


def test_what_may_be_asked_again_is_and_the_first_answer_that_comes_counts(
        shared_arm, connection, monkeypatch):
    requests = connection.requests
    requests.timeout = DEADLINE
    monkeypatch.setattr(client_requests, 'ATTEMPTS', 60)
    with lost_answers(shared_arm.node('tendon_actuation'), '/stop') as lost:
        stopping = requests.start(requests.stop())
        shared_arm.wait_for(lambda: len(lost) >= 2, 'the second request')
        service = service_of(shared_arm.node('tendon_actuation'), '/stop')
        type(service).send_response(service, *lost[0])  # the first answer was only late
        stopping.result(DEADLINE)
    assert shared_arm.trigger('tendon_actuation/resume').success


def test_the_result_of_a_sequence_is_asked_for_again_when_it_is_lost(
        shared_arm, connection, monkeypatch):
    requests, lost = connection.requests, []
    send = SequenceServer._send_result_response

    def lose_first(server, *answer):
        if lost:
            send(server, *answer)
        else:
            lost.append(answer)

    monkeypatch.setattr(SequenceServer, '_send_result_response', lose_first)
    monkeypatch.setattr(client_requests, 'ATTEMPTS', 1000)
    sequence = requests.start(requests.send([[0.0, 0.0, 0.1]], 0.0)).result(DEADLINE)
    assert sequence.result(DEADLINE).outcome == 'SUCCESSFUL'
    assert lost


def test_a_sequence_of_which_the_result_never_comes_ends_with_the_reason(
        shared_arm, connection, monkeypatch):
    requests = connection.requests

    async def lose(*request):
        """Answer nothing."""

    monkeypatch.setattr(SequenceServer, '_execute_get_result_request', lose)
    sequence = requests.start(requests.send([[0.0, 0.0, 0.2]], 0.0)).result(DEADLINE)
    with pytest.raises(LostError, match='no longer runs the sequence, but has not'):
        sequence.result(DEADLINE)


@pytest.mark.parametrize('shape, outcome', [([0.0, 0.0, 0.15], 'SUCCESSFUL'),
                                            ([9.0, 0.0, 0.0], 'bending')])
def test_a_goal_whose_answer_is_lost_is_accepted_or_rejected_all_the_same(
        shared_arm, connection, monkeypatch, shape, outcome):
    requests, lost, send = connection.requests, [], ActionClient.send_goal_async

    def lose(*arguments):
        lost.append(send(*arguments))
        return rclpy.Future()

    monkeypatch.setattr(ActionClient, 'send_goal_async', lose)
    answered = requests.start(requests.send([shape], 0.0))
    if outcome == 'SUCCESSFUL':
        assert answered.result(DEADLINE).result(DEADLINE).outcome == outcome
    else:
        with pytest.raises(RefusedError, match=outcome):
            answered.result(DEADLINE)
    assert lost


def test_a_goal_that_is_not_answered_is_given_up_and_canceled_if_it_is_later(
        shared_arm, connection, monkeypatch):
    requests = connection.requests
    monkeypatch.setattr(client_requests, 'PLANNING_TIMEOUT', TIMEOUT)
    late = []
    send = SequenceServer._send_answer
    monkeypatch.setattr(SequenceServer, '_send_answer', lambda server, *answer: late.append(
        lambda: send(server, *answer)))
    assert problem(requests.start(requests.send([[0.0, 0.0, 0.3]], 600.0))) == (
        'no answer from shape_sequencer within 0.5 s')
    shared_arm.wait_for(lambda: late, 'the answer')
    shared_arm.node('shape_sequencer').executor.create_task(late[0])
    ends, canceled = shared_arm.sequencer, RunShapeSequence.Result.CANCELED
    shared_arm.wait_for(lambda: ends.last.error_code == canceled, 'its end')


def test_the_sequencer_needs_no_answer_of_what_the_pressure_confirms(shared_arm):
    with lost_answers(shared_arm.node('jamming_valves'), '/segment_3/set_stiff') as lost:
        assert shared_arm.goal((0.0, 0.0, -0.1)).result()[0] == 'SUCCEEDED'
        assert lost


def test_the_sequencer_ends_a_goal_that_waits_for_a_switch_in_vain(shared_arm):
    valves = shared_arm.node('jamming_valves')
    service = service_of(valves, '/segment_3/set_stiff')
    serve, service.callback = service.callback, lambda request, response: response
    assert shared_arm.set_parameter('shape_sequencer', 'jamming_timeout', 1.0).successful
    with lost_answers(valves, '/segment_3/set_stiff'):
        status, result = shared_arm.goal((0.0, 0.0, 0.1)).result()
    service.callback = serve
    assert shared_arm.set_parameter('shape_sequencer', 'jamming_timeout', 10.0).successful
    assert (status, result.error_code) == ('ABORTED', result.TIMEOUT)
    assert result.error_string.startswith('segment 3 did not become soft within 1 s')
    assert shared_arm.goal((0.0, 0.0, 0.1)).result()[0] == 'SUCCEEDED'


def test_the_page_is_told_which_answer_did_not_come(shared_arm, connection):

    async def begin():
        return PageSession(connection.requests)

    session = connection.requests.start(begin()).result(DEADLINE)
    with lost_answers(shared_arm.node('tendon_actuation'), '/resume'):
        session.resume()
        notice = shared_arm.wait_for(lambda: session.notices and session.notices[-1], 'a notice')
    assert notice.title == 'Resume: failed'
    assert 'an answer from Resume is missing after 0.5 s' in notice.text  # as its button


def test_a_recording_goes_on_without_the_parameters_that_nobody_answers(
        shared_arm, tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_node, 'ANSWER_TIMEOUT', TIMEOUT)
    states = shared_arm.record(RecorderState, 'recorder/state', LATCHED)
    recorder, = shared_arm.start('recorder', ready=False, recorder__directory=str(tmp_path))
    said = []
    monkeypatch.setattr(recorder.get_logger(), 'warning', lambda text, **_: said.append(text))
    with lost_answers(shared_arm.node('kinematics'), '/list_parameters'):
        assert shared_arm.call(SetBool, 'recorder/record', data=True).success
        shared_arm.wait_for(
            lambda: any('parameters of kinematics' in text for text in said), 'a reason')
    assert any('an answer from kinematics/list_parameters is missing after 0.5 s' in text
               for text in said)
    shared_arm.wait_for(lambda: states.last.recording and states.last.messages, 'messages')
    assert shared_arm.call(SetBool, 'recorder/record', data=False).success
    shared_arm.end(recorder)


def test_teleop_says_which_answer_did_not_come_and_moves_once_it_does(shared_arm, monkeypatch):
    shared_arm.soften(2)
    joystick = Joystick(shared_arm)
    joystick.wait_for('ready to move segment 2', connected=True)
    teleop = joystick.nodes[1]
    with lost_answers(joystick.nodes[0], '/enable') as lost:
        monkeypatch.setattr(teleop._arm._requests, 'timeout', TIMEOUT)
        joystick.show(LB)
        joystick.wait_for('failed: an answer from servo/enable is missing after 0.5 s')
        joystick.wait_for(steered_arm.PREPARING)  # by itself, as long as the button is held
        monkeypatch.setattr(teleop._arm._requests, 'timeout', DEADLINE)
    assert lost
    joystick.steer(RIGHT)
    joystick.close()
    assert shared_arm.set_stiff(2, True).success
