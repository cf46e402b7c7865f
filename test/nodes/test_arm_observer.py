# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the sequencer takes for the state of the arm, and when that is a fault."""

from unittest.mock import Mock

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import FluidPressure, JointState

from soft_continuum.mechanics.chain import Chain
from soft_continuum.nodes.reported_arm import ArmObserver, REPORTED
from soft_continuum.nodes.suite_node import NodeInfo
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import JammingValvesState, KinematicsState, TendonActuationState

ARM = load_arm(description_file())
SEGMENTS, TENDONS = len(ARM.segments), list(ARM.tendon_names)
JOINTS = Chain(ARM).bodies
TIMEOUT = 0.5  # s
STIFF, SOFT = JammingValvesState.STIFF, JammingValvesState.NOT_STIFF
UNKNOWN = JammingValvesState.UNKNOWN


def shape(angles):
    """Return a shape of a stiff arm, as kinematics reports it."""
    return KinematicsState(joint_angles=angles, held_angles=angles, stiff=[True] * SEGMENTS,
                           vacuum=[1.0] * SEGMENTS)


class Bench:
    """An observer, the messages that it gets, and the clock."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr('soft_continuum.ros.ros_time.monotonic', lambda: self.now)
        node = Mock()
        node.count_publishers.return_value = 0
        node.get_clock.return_value.now.return_value.nanoseconds = 0
        self.observer = ArmObserver(
            node, ARM, {'stale_timeout': TIMEOUT, 'ambient_pressure': 101325.0,
                        'full_vacuum': 80e3,
                        'arm.jamming': True}, Mock())
        self._callbacks = {
            call.args[1]: call.args[2] for call in node.create_subscription.call_args_list}
        self.jamming(STIFF)
        self.tendons()
        self.stream()

    def send(self, topic, message):
        self._callbacks[topic](serialize_message(message))

    def stream(self, seconds=0.0):
        """Let time pass, in which all streams go on."""
        self.now += seconds
        self.send('tendon_states', JointState(
            name=TENDONS[::-1], position=[-0.002, 0.001], velocity=[0.0, 0.0]))
        self.send('kinematics/state', shape([0.01] * JOINTS))
        self.send('segment_1/pressure', FluidPressure(fluid_pressure=11325.0))

    def jamming(self, stiffness, fault='', segment_fault=''):
        self.send('jamming_valves/state', JammingValvesState(
            connected=not fault, fault=fault, stiffness=[stiffness] * SEGMENTS,
            segment_faults=[segment_fault, *[''] * (SEGMENTS - 1)]))

    def tendons(self, **values):
        self.send('tendon_actuation/state', TendonActuationState(
            **{'connected': True, 'referenced': True, **values}))


@pytest.fixture
def bench(monkeypatch):
    """Return an observer of a sound, stiff arm."""
    return Bench(monkeypatch)


def test_a_sound_arm_may_be_moved_and_its_tendons_are_known_by_name(bench):
    assert bench.observer.interlock == ''
    assert bench.observer.pulls == (0.001, -0.002)
    observation = bench.observer.observation(None, '')
    assert observation.stiff == (True,) * SEGMENTS
    assert observation.vacuum[0] == pytest.approx(90e3)
    assert not observation.moving


def test_tendons_rest_as_near_to_a_pull_as_their_device_can(bench):
    def rests(*pulls):
        return bench.observer.observation(None, '').rests_at(np.array(pulls), 2e-5)

    near, far = (0.001, -0.00191), (0.00103, -0.002)  # of 1 mm and -2 mm
    assert not rests(*near)
    bench.tendons(tendons=TENDONS, pull_tolerances=[1e-5, 1e-4])
    assert rests(*near)
    assert not rests(*far)
    for wrong in ([1e-4], [float('nan'), 1e-4], [-1e-4, 1e-4], [1.0, 1.0]):
        bench.tendons(tendons=TENDONS, pull_tolerances=wrong)
        assert rests(*near)
        assert not rests(*far)
    bench.tendons(tendons=TENDONS[::-1], pull_tolerances=[1e-2, 1e-2])
    assert not rests(*far)
    bench.tendons(tendons=TENDONS, pull_tolerances=[1e-5, 1e-4], moving=True)
    assert not rests(*near)
    bench.tendons()  # a device that does not tell
    assert not rests(*near)
    assert rests(0.001, -0.002)


@pytest.mark.parametrize('topic', ['tendon_states', 'kinematics/state', 'segment_1/pressure'])
def test_a_stream_that_ends_is_a_fault_after_the_timeout(bench, topic):
    bench._callbacks[topic] = Mock()
    bench.stream(0.9 * TIMEOUT)
    assert bench.observer.fault == ''
    bench.stream(0.2 * TIMEOUT)
    assert bench.observer.fault.startswith('nothing received for 0.5 s from ')
    assert topic.split('/')[-1] in bench.observer.fault


@pytest.mark.parametrize(('topic', 'reported'), [
    ('kinematics/state', 'shape'), ('tendon_states', 'position'),
    ('segment_1/pressure', 'pressure')])
def test_a_node_that_runs_and_reports_nothing_is_told_from_one_that_is_gone(
        bench, topic, reported):
    source = next(name for name, what in REPORTED.items() if what == reported)
    name = source.split()[0]

    def beat():
        bench.send(f'{name}/heartbeat', NodeInfo('another').to_ros(0.0))

    bench.observer.conflicts.node_info = Mock(own=NodeInfo('own'), time=0.0)
    beat()
    bench._callbacks[topic] = Mock()
    bench.stream(1.2 * TIMEOUT)
    assert bench.observer.fault == f'nothing received for 0.5 s from {source}'
    beat()
    assert bench.observer.fault == (
        f'{name} runs, but has reported no {reported} for 0.5 s; its status has the reason')


@pytest.mark.parametrize(('later', 'named'), [(0.0, 'tendon_actuation'), (0.4, 'kinematics')])
def test_a_node_that_runs_is_not_blamed_for_what_one_that_is_gone_takes_from_it(
        bench, later, named):
    bench.observer.conflicts.node_info = Mock(own=NodeInfo('own'), time=0.0)
    bench._callbacks['kinematics/state'] = Mock()
    bench.stream(later * TIMEOUT)
    bench._callbacks['tendon_states'] = Mock()
    bench.stream((1.2 - later) * TIMEOUT)
    bench.send('kinematics/heartbeat', NodeInfo('another').to_ros(0.0))
    assert bench.observer.fault.startswith(f'nothing received for 0.5 s from {named}')


@pytest.mark.parametrize('missing', ['tendon_actuation', 'kinematics', 'jamming_valves'])
def test_one_node_that_is_missing_is_named_alone(monkeypatch, missing):
    said = {'tendon_actuation': ('tendon_actuation/state', 'tendon_states'),
            'kinematics': ('kinematics/state',),
            'jamming_valves': ('jamming_valves/state', 'segment_1/pressure')}
    monkeypatch.setattr(Bench, 'send', lambda bench, topic, message: topic in said[missing] or (
        bench._callbacks[topic](serialize_message(message))))
    fault = Bench(monkeypatch).observer.fault
    assert fault.startswith('nothing received yet from ')
    assert [node for node in said if node in fault] == [missing]


def test_kinematics_may_compute_for_longer_while_no_tendon_moves(bench):
    def fault():
        return bench.observer.observation(None, '').fault

    bench._callbacks['kinematics/state'] = Mock()
    bench.stream(3.0 * TIMEOUT)
    assert fault() == ''
    assert 'kinematics' in bench.observer.fault  # no goal begins so
    bench.tendons(moving=True)
    assert fault().startswith('nothing received for 0.5 s from kinematics')
    bench.tendons()
    bench.stream(1.2 * TIMEOUT)
    assert fault().startswith('nothing received for 2 s from kinematics')


@pytest.mark.parametrize('fault', ['device', 'segment', 'tendons'])
def test_a_fault_counts_once_it_has_lasted(bench, fault):
    def report():
        if fault == 'tendons':
            bench.tendons(connected=False, fault='no answer')
        else:
            bench.jamming(UNKNOWN if fault == 'device' else STIFF, **{
                'fault' if fault == 'device' else 'segment_fault': 'no answer'})

    report()
    bench.stream(0.9 * TIMEOUT)
    report()  # the same fault, reported again, lasts on
    assert bench.observer.fault == ''
    assert bench.observer.all_stiff  # as was last known
    bench.stream(0.2 * TIMEOUT)
    assert bench.observer.fault.endswith('no answer')


def test_a_fault_that_ended_in_time_does_not_count(bench):
    bench.jamming(UNKNOWN, fault='no answer')
    bench.stream(0.9 * TIMEOUT)
    bench.jamming(STIFF)
    bench.stream(0.9 * TIMEOUT)
    bench.jamming(UNKNOWN, fault='no answer')
    assert bench.observer.fault == ''
    assert bench.observer.all_stiff
    bench.jamming(SOFT)  # which counts at once
    assert not bench.observer.all_stiff


@pytest.mark.parametrize('values, reason', [
    ({'stopped': TendonActuationState.STOPPED_BY_SERVICE, 'stop_message': 'the button'},
     'the button'),
    ({'referenced': False}, 'not referenced'),
])
def test_no_sequence_begins_on_an_arm_that_is_stopped_or_not_referenced(bench, values, reason):
    bench.tendons(**values)
    assert reason in bench.observer.interlock
    bench.tendons()
    bench.stream()
    assert bench.observer.interlock == ''


def test_pulls_and_shape_of_before_a_lost_position_do_not_count_after_it(bench):
    bench.tendons(referenced=False)
    assert 'not referenced' in bench.observer.fault
    assert bench.observer.shape is None
    bench.tendons()  # referenced at once: what was known is of another zero
    assert 'tendon_states' in bench.observer.fault
    bench.stream()
    assert bench.observer.fault == ''
    assert bench.observer.shape is not None


@pytest.mark.parametrize(('topic', 'message'), [
    *(('kinematics/state', shape(angles)) for angles in (
        [np.nan] * JOINTS, [1.7e308] * JOINTS, [0.0] * (JOINTS - 1))),
    *(('tendon_states', JointState(name=names, position=position)) for names, position in (
        (TENDONS, [np.nan, 0.0]), (TENDONS, [0.0]), (TENDONS, [1.7e308, 0.0]),
        (['a', 'b'], [0.0, 0.0])))])
def test_what_is_of_no_arm_is_ignored(bench, topic, message):
    before = bench.observer.shape
    bench.send(topic, message)
    assert bench.observer.shape is before
    assert bench.observer.pulls == (0.001, -0.002)


def test_kinematics_with_another_description_of_the_jamming_ends_motion(bench):
    """arm.jamming: false for kinematics alone makes every segment soft for it."""
    def report(stiff):
        bench.send('jamming_valves/state', JammingValvesState(stiffness=[STIFF, SOFT, STIFF]))
        for n in range(1, SEGMENTS + 1):
            bench.send(f'segment_{n}/pressure', FluidPressure(fluid_pressure=2e4))
        message = shape([0.0] * JOINTS)
        message.stiff = stiff
        bench.send('kinematics/state', message)
        found = bench.observer.motion_interlock()
        return '' if found is None else found.message

    assert report([True, False, True]) == ''
    assert report([True, True, True]) == ''  # it may be a little late
    bench.now += 2.0
    assert 'arm.jamming' in report([False] * SEGMENTS)
    assert report([True, False, True]) == ''
