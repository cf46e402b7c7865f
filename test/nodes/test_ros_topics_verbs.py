# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""doctor and calibrate on the controllers and the board of somebody else, and what may be said."""

import json

import pytest
from sensor_msgs.msg import JointState

from soft_continuum.commissioning import calibrate, doctor
from soft_continuum.hardware.drivers import chosen_families
from soft_continuum.parameters.files import write_parameters
from soft_continuum.ros.description import load_rig
from soft_continuum.ros_topics import commissioning
from support.ros2_control import Controllers, JOINTS, OtherNodes
from support.ros_valves import VALVES, Valves

TENDONS = {'tendon_driver': 'ros_topics', 'ros_tendons.joints': JOINTS,
           'ros_tendons.timeout': 1.0, 'ros_jamming.timeout': 1.0}


@pytest.fixture
def file(domain, monkeypatch, tmp_path):
    """Return the parameter file of a rig whose board runs."""
    monkeypatch.setattr(commissioning, 'LISTENING', 0.5)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    path = tmp_path / 'rig.yaml'
    values = {name: tuple(value) if isinstance(value, list) else value
              for name, value in (TENDONS | VALVES).items()}
    write_parameters(path, values, [])
    board = Valves(domain)
    yield path
    board.close()


@pytest.fixture
def controllers(domain):
    """Return the controllers of the rig."""
    made = Controllers(domain, start=0.0)
    yield made
    made.close()


def test_the_doctor_says_who_is_heard_and_finds_a_second_publisher(
        file, domain, controllers, capsys):
    def ask():
        doctor.main(['--json', '--params-file', str(file)])
        checks = json.loads(capsys.readouterr().out)['checks']
        return {check['step']: (check['status'], check['message']) for check in checks}

    found = ask()
    assert '/joint_state_broadcaster/joint_states from /controller_manager at ' in found[
        'ros_tendons.state_topic'][1]
    assert '/position_controller/commands to /controller_manager' in found[
        'ros_tendons.command_topic'][1]
    assert 'spool_right 0, spool_left 0: right_tendon 0.00 mm' in found['joints'][1]
    assert found['tendon reference'][0] == 'WARN'
    assert found['segment 1'][0] == 'WARN'  # it is evacuated
    assert not {step for step, (status, _) in found.items() if status == 'FAIL'}
    assert controllers.commands == 0
    other = OtherNodes(domain, 'somebody_else')
    other.node.create_publisher(JointState, 'joint_state_broadcaster/joint_states', 10)
    status, message = ask()['tendon driver ros_topics']
    assert status == 'FAIL'
    assert 'is published by /controller_manager and ' in message
    other.close()


def test_the_zero_and_the_signs_of_joints_are_measured_and_kept_in_a_file(
        file, controllers, tmp_path):
    common = ['--yes', '--output', str(tmp_path), '--params-file', str(file)]
    assert calibrate.main(['zero', '--take-up', '1', '0.5', *common]) == 0
    assert controllers.positions['spool_right'] == pytest.approx(0.1, abs=0.01)
    assert calibrate.main(['signs', '--seen', 'paid-out', 'pulled-in', *common]) == 0
    assert calibrate.main(['steps', '--distance', '10', '--measured', '11', '10', *common]) == 0
    zero, signs, steps = (load_rig([file, tmp_path / f'calibration_{what}.yaml'])
                          for what in ('zero', 'signs', 'steps'))
    assert zero['ros_tendons.zeros'] == pytest.approx(
        [controllers.positions[name] for name in JOINTS], abs=1e-6)
    assert signs['ros_tendons.scales'] == (-0.01, 0.01)
    assert steps['ros_tendons.scales'] == (0.011, 0.01)


def topics_of(values):
    return {parameter: family.topics(values)
            for parameter, family in chosen_families(values).items()}


def test_what_drivers_publish_and_subscribe_to_is_told_by_their_parameters(file):
    topics = topics_of(load_rig([file]))
    assert topics['tendon_driver'] == (
        {'position_controller/commands': 'std_msgs/Float64MultiArray'},
        {'joint_state_broadcaster/joint_states': 'sensor_msgs/JointState'})
    published, subscribed = topics['jamming_driver']
    assert published == dict.fromkeys(
        ('/board/pump', '/board/valve_1', '/board/valve_2', '/board/valve_3'), 'std_msgs/Bool')
    assert subscribed['/board/pressure_2'] == 'sensor_msgs/FluidPressure'
    assert subscribed['/board/valve_state_3'] == subscribed['/board/pump_state'] == 'std_msgs/Bool'
    assert len(subscribed) == 7
    simulated = topics_of(load_rig([]))
    assert simulated == {'tendon_driver': ({}, {}), 'jamming_driver': ({}, {})}
