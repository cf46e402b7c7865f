# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of two versions, or of two descriptions of the arm, are no arm: nothing moves."""

from dataclasses import replace
import socket

import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from soft_continuum import version
from soft_continuum.nodes.conflicts import HeartbeatReader
from soft_continuum.nodes.suite_node import NodeInfo
from soft_continuum.parameters.arm import ARM_PARAMETERS, description_digest
from soft_continuum.parameters.scalars import read_scalar
from soft_continuum.ros.description import load_description
from soft_continuum.ros.names import DISC_SENSORS, KINEMATICS, SERVO, TENDON_ACTUATION
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import Heartbeat
from soft_continuum_interfaces.srv import GetNodeInfo
from support.ros_rig import ALL, trajectory

HERE = socket.gethostname()
OF_FILE = description_digest(load_description(description_file()))


def test_a_digest_is_of_the_arm_alone_however_it_is_written():
    # By sha256sum, of {"arm.jamming": true, "arm.payload": 0.5, "arm.tendon_names": ["a", "b"]}.
    assert description_digest({
        'arm.tendon_names': ['a', 'b'], 'tension_limit': 7.0,
        'arm.payload': read_scalar('5e-1'), 'arm.jamming': True}) == '9c46f7a4206757ba'
    assert description_digest({'recorder.pictures': True}) == ''


def test_every_parameter_of_the_arm_counts():
    values = load_description(description_file())
    for parameter in ARM_PARAMETERS:
        value = values[parameter.name]
        first, *rest = value if isinstance(value, tuple) else [value]
        other = (not first if isinstance(first, bool) else 'second_order' if first == 'paper' else
                 'other' if isinstance(first, str) else first + 1 if isinstance(first, int) else
                 first * (1.0 - 2**-52) if first else 1e-9)
        changed = {parameter.name: (other, *rest) if isinstance(value, tuple) else other}
        assert description_digest(values | changed) != OF_FILE, parameter.name


def test_what_is_said_is_what_is_read():
    said = NodeInfo('process', '1.0', 'digest', 'host', 2.5, 'a conflict')
    assert NodeInfo.from_ros(said.to_ros(2.5)) == said


def test_of_a_heartbeat_like_the_last_one_only_the_time_is_converted():
    read, found = HeartbeatReader(), []
    for time, conflict in ((1.25, ''), (2.5, ''), (3.75, 'a conflict'), (5.0, 'a conflict')):
        said = NodeInfo('process', '1.0', 'digest', 'host', conflict=conflict)
        info, at = read(serialize_message(said.to_ros(time)))
        assert (replace(info, time=0.0), at) == (said, time)
        found.append(info)
    assert found[0] is found[1] is not found[2] is found[3]


def test_every_node_answers_what_it_is(shared_arm):
    for node in ALL:
        answer = shared_arm.call(GetNodeInfo, f'{node}/get_node_info')
        assert (answer.host, answer.version, answer.description) == (HERE, version(), OF_FILE)
        assert answer.stamp.sec


def test_a_node_with_another_description_is_a_conflict_that_refuses_all_motion(shared_arm):
    running = shared_arm.goal((0.0, 0.0, 0.3), hold=60.0).wait_for_phase('holding')
    other, = shared_arm.start(DISC_SENSORS, ready=False, arm__payload=0.1)
    theirs = shared_arm.call(GetNodeInfo, f'{DISC_SENSORS}/get_node_info').description
    words = (f'{DISC_SENSORS} on {HERE} has a description of the arm with digest {theirs}, '
             f'{{}} on {HERE} {OF_FILE}: start every node with the same description')
    running.assert_ended('ABORTED', words.format('shape_sequencer'))
    assert words.format('jamming_valves') in shared_arm.set_stiff(1, False).message
    assert not shared_arm.goal((0.0, 0.0, 0.2)).accepted
    shared_arm.send(trajectory([(1.0, (0.001, -0.002))]))
    shared_arm.wait_for(
        lambda: words.format(TENDON_ACTUATION)
        in shared_arm.states[TENDON_ACTUATION].last.refused.message, 'a refusal')
    assert shared_arm.all_stiff
    assert 'digest' in shared_arm.statuses[KINEMATICS].last.message
    shared_arm.end(other)
    shared_arm.wait_for(lambda: not any(
        'digest' in shared_arm.statuses[node].last.message for node in ALL), 'its end')
    assert shared_arm.goal_when_heard((0.0, 0.0, 0.2)).result()[0] == 'SUCCEEDED'


@pytest.mark.parametrize(('said', 'words'), [
    (NodeInfo('process', '0.0.1', OF_FILE, 'rig').to_ros(0.0),
     f'servo on rig has version 0.0.1, {{}} on {HERE} {version()}: install one version'),
    (NodeInfo('\x1b[2J' + '\n' * 60_000).to_ros(0.0),
     'servo on an unknown computer has version unknown'),
    (NodeInfo('process', version(), OF_FILE, 'rig').to_ros(2e9), 'the clock of servo on rig is '),
    ], ids=['older', 'no version', 'ahead'])
def test_a_node_of_another_version_or_time_is_a_conflict(shared_arm, said, words):
    publisher = shared_arm.publisher(Heartbeat, f'{SERVO}/heartbeat')

    def heard():
        publisher.publish(said)
        return all(words.format(node) in shared_arm.statuses[node].last.message for node in ALL)

    shared_arm.wait_for(heard, 'a conflict')
    assert all(shared_arm.statuses[node].last.message.isprintable() for node in ALL)
    assert not shared_arm.goal((0.0, 0.0, 0.2)).accepted
    shared_arm.wait_for(lambda: not any(
        'servo' in shared_arm.statuses[node].last.message for node in ALL), 'its end')


def test_a_node_whose_sign_of_life_is_of_another_type_is_of_another_version(shared_arm):
    with shared_arm.stranger() as stranger:
        publisher = stranger.create_publisher(String, f'{SERVO}/heartbeat', 1)
        words = f'/{SERVO}/heartbeat is also of type std_msgs/msg/String: that node runs another'
        shared_arm.wait_for(lambda: all(
            words in shared_arm.statuses[node].last.message for node in ALL), 'a conflict')
        assert not shared_arm.goal((0.0, 0.0, 0.2)).accepted
        stranger.destroy_publisher(publisher)
        shared_arm.wait_for(lambda: not any(
            SERVO in shared_arm.statuses[node].last.message for node in ALL), 'its end')
