# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""A request that is never answered ends its wait, says for what, and can be repeated."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.action import ActionClient
from std_srvs.srv import SetBool

from soft_continuum.browser.session import Session
from soft_continuum.client import operations
from soft_continuum.client import requests as client_requests
from soft_continuum.client.connection import Connection
from soft_continuum.client.errors import LostError, NoAnswerError, RefusedError
from soft_continuum.nodes.sequence_server import SequenceServer
from soft_continuum.recordings import recorder as recorder_node
from soft_continuum.teleop import steered_arm
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import RecorderState
from support.joystick import Joystick, LB, RIGHT
from support.ros_rig import DEADLINE, LATCHED, Rig

TIMEOUT = 0.5  # s, of what is lost in any case


@contextmanager
def lost_answers(node: Any, ending: str) -> Iterator[list[Any]]:
    """Lose every answer of a service of a node; the list has those that were lost."""
    service = next(one for one in node.services if one.service_name.endswith(ending))
    lost: list[Any] = []
    send, service.send_response = service.send_response, lambda *answer: lost.append(answer)
    try:
        yield lost
    finally:
        service.send_response = send


@pytest.fixture
def connection(module_domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Connection]:
    """Return a client that finds everything, and waits for no answer for long."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(module_domain))
    found = Connection('impatient', '/arm_under_test', TIMEOUT, DEADLINE)
    yield found
    found.close()


@pytest.fixture(scope='module')
def nodes(module_domain: int) -> Iterator[tuple[Rig, dict[str, Any]]]:
    """Return a quick arm, and its nodes by name."""
    rig = Rig(module_domain)
    yield rig, {node.get_name(): node for node in rig.start_arm()}
    rig.close()


def problem(future: 'Future[Any]') -> str:
    """Return how a request of a client failed, which nothing but a missing answer may do."""
    with pytest.raises(NoAnswerError) as failed:
        future.result(DEADLINE)
    return str(failed.value)


def test_a_client_is_told_which_answer_did_not_come(
        nodes: tuple[Rig, dict[str, Any]], connection: Connection) -> None:
    requests = connection.requests
    with lost_answers(nodes[1]['tendon_actuation'], '/reference'):
        assert problem(requests.start(requests.reference())) == (
            'nothing of an answer of tendon_actuation/reference within 0.5 s, though its node '
            'runs; is it active, and the machine not overloaded?')


def test_what_may_be_asked_again_is_and_the_first_answer_that_comes_counts(
        nodes: tuple[Rig, dict[str, Any]], connection: Connection,
        monkeypatch: pytest.MonkeyPatch) -> None:
    requests, (rig, by_name) = connection.requests, nodes
    requests.timeout = DEADLINE
    monkeypatch.setattr(operations, 'ATTEMPTS', 60)
    with lost_answers(by_name['tendon_actuation'], '/stop') as lost:
        stopping = requests.start(requests.stop())
        rig.wait_for(lambda: len(lost) >= 2, 'the second request')
        service = next(one for one in by_name['tendon_actuation'].services
                       if one.service_name.endswith('/stop'))
        type(service).send_response(service, *lost[0])  # the first answer was only late
        stopping.result(DEADLINE)
    assert rig.trigger('tendon_actuation/resume').success


def test_the_result_of_a_sequence_is_asked_for_again_when_it_is_lost(
        nodes: tuple[Rig, dict[str, Any]], connection: Connection,
        monkeypatch: pytest.MonkeyPatch) -> None:
    requests, lost = connection.requests, []
    send = SequenceServer._send_result_response

    def lose_first(server: Any, *answer: Any) -> None:
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
        nodes: tuple[Rig, dict[str, Any]], connection: Connection,
        monkeypatch: pytest.MonkeyPatch) -> None:
    requests = connection.requests

    async def lose(*request: Any) -> None:
        """Answer nothing."""

    monkeypatch.setattr(SequenceServer, '_execute_get_result_request', lose)
    sequence = requests.start(requests.send([[0.0, 0.0, 0.2]], 0.0)).result(DEADLINE)
    with pytest.raises(LostError, match='does not run the sequence any more, but has not'):
        sequence.result(DEADLINE)


@pytest.mark.parametrize('shape, outcome', [([0.0, 0.0, 0.15], 'SUCCESSFUL'),
                                            ([9.0, 0.0, 0.0], 'bending')])
def test_a_goal_whose_answer_is_lost_is_accepted_or_rejected_all_the_same(
        nodes: tuple[Rig, dict[str, Any]], connection: Connection,
        monkeypatch: pytest.MonkeyPatch, shape: list[float], outcome: str) -> None:
    requests, lost, send = connection.requests, [], ActionClient.send_goal_async

    def lose(*arguments: Any) -> Any:
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
        nodes: tuple[Rig, dict[str, Any]], connection: Connection,
        monkeypatch: pytest.MonkeyPatch) -> None:
    requests, (rig, _) = connection.requests, nodes
    monkeypatch.setattr(client_requests, 'PLANNING_TIMEOUT', TIMEOUT)
    late: list[Callable[[], None]] = []
    send = SequenceServer._send_answer
    monkeypatch.setattr(SequenceServer, '_send_answer', lambda server, *answer: late.append(
        lambda: send(server, *answer)))
    assert problem(requests.start(requests.send([[0.0, 0.0, 0.3]], 600.0))) == (
        'no answer of shape_sequencer within 0.5 s')
    rig.wait_for(lambda: late, 'the answer')
    ends = rig.sequencer
    nodes[1]['shape_sequencer'].executor.create_task(late[0])
    rig.wait_for(lambda: ends.last.error_code == RunShapeSequence.Result.CANCELED, 'its end')


def test_the_sequencer_needs_no_answer_of_what_the_pressure_confirms(
        nodes: tuple[Rig, dict[str, Any]]) -> None:
    rig, by_name = nodes
    with lost_answers(by_name['jamming_valves'], '/segment_3/set_stiff') as lost:
        assert rig.goal((0.0, 0.0, -0.1)).result()[0] == 'SUCCEEDED'
        assert lost


def test_the_sequencer_ends_a_goal_that_waits_for_a_switch_in_vain(
        nodes: tuple[Rig, dict[str, Any]]) -> None:
    rig, by_name = nodes
    valves = by_name['jamming_valves']
    service = next(one for one in valves.services
                   if one.service_name.endswith('/segment_3/set_stiff'))
    serve, service.callback = service.callback, lambda request, response: response
    assert rig.set_parameter('shape_sequencer', 'jamming_timeout', 1.0).successful
    with lost_answers(valves, '/segment_3/set_stiff'):
        status, result = rig.goal((0.0, 0.0, 0.1)).result()
    service.callback = serve
    assert rig.set_parameter('shape_sequencer', 'jamming_timeout', 10.0).successful
    assert (status, result.error_code) == ('ABORTED', result.TIMEOUT)
    assert result.error_string.startswith('segment 3 did not become soft within 1 s')
    assert rig.goal((0.0, 0.0, 0.1)).result()[0] == 'SUCCEEDED'


def test_the_page_is_told_which_answer_did_not_come(
        nodes: tuple[Rig, dict[str, Any]], connection: Connection) -> None:
    rig, by_name = nodes

    async def begin() -> Session:
        return Session(connection.requests)

    session = connection.requests.start(begin()).result(DEADLINE)
    with lost_answers(by_name['tendon_actuation'], '/resume'):
        session.resume()
        notice = rig.wait_for(lambda: session.notices and session.notices[-1], 'a notice')
    assert notice.title == 'Resume: failed'
    assert 'nothing of an answer of Resume within 0.5 s' in notice.text  # as its button


def test_a_recording_goes_on_without_the_parameters_that_nobody_answers(
        nodes: tuple[Rig, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
        ) -> None:
    rig, by_name = nodes
    monkeypatch.setattr(recorder_node, 'ANSWER_TIMEOUT', TIMEOUT)
    states = rig.record(RecorderState, 'recorder/state', LATCHED)
    recorder, = rig.start('recorder', ready=False, recorder__directory=str(tmp_path))
    said: list[str] = []
    monkeypatch.setattr(recorder.get_logger(), 'warning', lambda text, **_: said.append(text))
    with lost_answers(by_name['kinematics'], '/list_parameters'):
        assert rig.call(SetBool, 'recorder/record', data=True).success
        rig.wait_for(lambda: any('parameters of kinematics' in text for text in said), 'a reason')
    assert any('nothing of an answer of kinematics/list_parameters within 0.5 s' in text
               for text in said)
    rig.wait_for(lambda: states.last.recording and states.last.messages, 'messages')
    assert rig.call(SetBool, 'recorder/record', data=False).success
    rig.end(recorder)


def test_teleop_says_which_answer_did_not_come_and_moves_once_it_does(
        nodes: tuple[Rig, dict[str, Any]], monkeypatch: pytest.MonkeyPatch) -> None:
    rig, _ = nodes
    rig.soften(2)
    joystick = Joystick(rig)
    joystick.wait_for('ready to move segment 2', connected=True)
    teleop = joystick.nodes[1]
    with lost_answers(joystick.nodes[0], '/enable') as lost:
        monkeypatch.setattr(teleop._arm._requests, 'timeout', TIMEOUT)
        joystick.show(LB)
        joystick.wait_for('failed: nothing of an answer of servo/enable within 0.5 s')
        joystick.wait_for(steered_arm.PREPARING)  # by itself, as long as the button is held
        monkeypatch.setattr(teleop._arm._requests, 'timeout', DEADLINE)
    assert lost
    joystick.steer(RIGHT)
    joystick.show()
    joystick.unplug()
    for node in joystick.nodes:
        rig.end(node)
    assert rig.set_stiff(2, True).success
