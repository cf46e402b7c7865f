# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The four nodes on the controllers and the board of somebody else, all over topics."""

from dataclasses import dataclass
import json
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from sensor_msgs.msg import JointState

from soft_continuum.commissioning import calibrate, doctor
from soft_continuum.hardware.drivers import chosen_families
from soft_continuum.parameters.files import write_parameters
from soft_continuum.ros.description import load_rig
from soft_continuum.ros_topics import commissioning
from support.ros2_control import Controllers, JOINTS, OtherNodes, RADIUS
from support.ros_rig import Rig
from support.ros_valves import REGULATORS, Regulators, VALVES, Valves

BEND = (0.0, 0.0, 0.3)
BOARDS = {Valves: VALVES, Regulators: REGULATORS}
STATES = '/joint_state_broadcaster/joint_states'


@dataclass
class Bench:
    """The nodes, and what they drive."""

    rig: Rig
    controllers: Controllers
    board: Any

    def prepare(self):
        """Say that the arm is straight."""
        self.rig.wait_for(lambda: self.rig.trigger('tendon_actuation/reference').success,
                          'tendons at rest')
        self.rig.wait_for_shape()


@pytest.fixture
def make(rig):
    """Return a maker of an arm, stiff, straight and referenced, on topics."""
    made = []

    def start(kind, command_topic, board, **changes):
        bench = Bench(rig, Controllers(rig.domain, kind), board(rig.domain))
        made.append(bench)
        rig.start_arm(**{
            'tendon_driver': 'ros_topics', 'ros_tendons.joints': JOINTS,
            'ros_tendons.scales': [RADIUS], 'ros_tendons.state_topic': STATES,
            'ros_tendons.command_topic': command_topic, 'ros_tendons.command_type': kind,
            'tendon_speed': 0.04, 'tendon_acceleration': 1.0, 'speed_limit': 0.1,
            'stale_timeout': 8.0, 'ros_tendons.timeout': 2.0, 'ros_jamming.timeout': 1.0,
            'ros_tendons.following_error': 0.02, **BOARDS[board], **changes})
        bench.prepare()
        return bench

    yield start
    rig.end_all()
    for bench in made:
        bench.controllers.close()
        bench.board.close()


def assert_joints_agree(bench):
    """Claim that the joints are where the node reports the tendons, and that they moved."""
    bench.rig.assert_rests()
    assert bench.rig.pulls == pytest.approx(bench.controllers.pulls, abs=1e-6)
    assert abs(bench.rig.pulls[0]) > 1e-3


def test_joint_states_that_stop_end_the_goal_and_nothing_moves_before_resume(make):
    bench = make('positions', '/position_controller/commands', Valves)
    rig, controllers = bench.rig, bench.controllers
    goal = rig.goal_in_motion(BEND)
    controllers.message = lambda message: None
    goal.assert_ended('ABORTED', f'nothing new on {STATES}')
    controllers.message = lambda message: message
    rig.wait_for_status('tendon_actuation', 'stopped', 'the device failed')
    rig.wait_for(lambda: rig.statuses['tendon_actuation'].last.level == DiagnosticStatus.WARN,
                 'a reconnection')
    rests_at = controllers.pulls
    rig.assert_rests()
    assert controllers.pulls == pytest.approx(rests_at, abs=1e-9)
    rig.goal(BEND).assert_rejected('the device failed')
    assert rig.trigger('tendon_actuation/resume').success
    # The same node reports the joints where they were: their zero is still known.
    assert rig.goal_when_heard((0.0, 0.0, 0.1)).result()[0] == 'SUCCEEDED'
    assert_joints_agree(bench)
    rig.assert_never_moved_all_stiff()


def test_pressures_that_stop_end_the_goal_and_nothing_is_switched(make):
    bench = make('trajectory', '/trajectory_controller/joint_trajectory', Regulators,
                 stale_timeout=2.0, jamming_timeout=3.0)
    rig, board = bench.rig, bench.board
    goal = rig.goal_when_heard((0.0, 0.0, -0.2))
    assert goal.result()[0] == 'SUCCEEDED'
    rig.assert_stiff_since(goal)
    rig.assert_stiff_only_by_pressure()
    assert_joints_agree(bench)
    goal = rig.goal_in_motion(BEND)
    board.publishes = False
    goal.assert_ended('ABORTED', 'jamming_valves')
    rig.wait_for(lambda: rig.at_rest, 'rest')
    rig.wait_for(lambda: not any(flag.last.data for flag in rig.stiff), 'no stiffness known')
    evacuated = board.plant.read().evacuated
    board.publishes = True
    rig.wait_for(lambda: rig.statuses['jamming_valves'].last.level == DiagnosticStatus.OK,
                 'the valves back')
    assert board.plant.read().evacuated == evacuated


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
