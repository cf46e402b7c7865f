# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What enters a node: bounded, plain, and unable to end it."""

from types import SimpleNamespace
from unittest.mock import Mock

from geometry_msgs.msg import Pose, PoseArray
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from soft_continuum.client.observed import ObservedArm, TOPICS
from soft_continuum.mechanics.arm import Arm, Disc, Segment, tendon_pair
from soft_continuum.mechanics.laws import Jam
from soft_continuum.mechanics.statics import Statics
from soft_continuum.nodes import emergency_stop
from soft_continuum.nodes import suite_node as module
from soft_continuum.nodes.conflicts import Conflicts
from soft_continuum.nodes.conflicts import TOPICS as SOLE
from soft_continuum.nodes.emergency_stop import EmergencyStop
from soft_continuum.nodes.suite_node import ERROR, NodeInfo, OK, Status, WARN
from soft_continuum.nodes.threads import Newest
from soft_continuum.ros.conversions import (
    equilibrium_from_ros,
    equilibrium_to_ros,
    tracked_pose_to_ros,
)
from soft_continuum.ros.description import load_arm
from soft_continuum.ros.entries import LATCHED, MAX_BYTES, SENSOR, serve, STREAM, subscribe
from soft_continuum.ros.names import RECORDER, TELEOP
from soft_continuum.ros.urdf import arm_urdf
from soft_continuum.text import plain
from soft_continuum_interfaces.msg import Heartbeat, JammingValvesState, RecorderState, TeleopState
from support import ros_rig
from support.descriptions import JAMMING
from support.ros_rig import assert_declined


def test_a_message_that_is_too_long_or_none_at_all_is_left_out_and_logged():
    node, received = Mock(), []
    subscribe(node, JointState, 'joint_states', received.append, SENSOR)
    on_data = node.create_subscription.call_args.args[2]
    on_data(serialize_message(JointState(position=[0.0] * MAX_BYTES)))
    on_data(b'\0\1\0\0\xff\xff\xff\xff')
    assert received == []
    assert node.get_logger().warning.call_count == 2
    node.callback_failed.assert_not_called()
    on_data(serialize_message(JointState(position=[1.0])))
    assert list(received[0].position) == [1.0]


def test_an_observer_takes_no_message_that_is_too_long():
    node = Mock()
    ObservedArm(node)
    assert node.create_subscription.call_count == len(TOPICS) + 1
    for call in node.create_subscription.call_args_list:
        assert call.kwargs == {'raw': True}  # so that its size is seen before it is converted


def test_discs_of_a_spatial_arm_are_seen_in_space_before_its_shape_is_known():
    node = Mock()
    node.get_node_names_and_namespaces.return_value = []
    arm = ObservedArm(node)

    def receive(topic, message):
        on_data, = (call.args[2] for call in node.create_subscription.call_args_list
                    if call.args[1] == topic)
        on_data(serialize_message(message))

    receive('robot_description', String(data=arm_urdf(load_arm(JAMMING))))
    receive('jamming_valves/state', JammingValvesState(stiffness=[JammingValvesState.STIFF]))
    receive('disc_1/measured_pose', tracked_pose_to_ros(
        np.array([0.0, 0.02, 0.1, 0.6, 0.0, 0.0, 0.8]), 1e-6 * np.eye(6)))
    seen = arm.snapshot().measured_discs[1]
    assert seen is not None and seen.position[1] == 0.02
    receive('disc_poses', PoseArray(poses=4 * [Pose()]))
    receive('disc_0/measured_pose', tracked_pose_to_ros(  # as of an IMU: no turn about z
        np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), np.diag([1e9, 1e9, 1e9, 1.0, 1.0, 1e9])))
    state = arm.snapshot()
    assert state.disc_errors[0] is not None and 'nan' not in str(state)


def test_a_callback_that_fails_is_reported_to_its_node_and_answered():
    node, error = Mock(), ValueError('no such arm')

    def fail(*_):
        raise error

    subscribe(node, Bool, 'x', fail, SENSOR)
    node.create_subscription.call_args.args[2](serialize_message(Bool()))
    serve(node, Trigger, 'y', fail)
    assert_declined(node.create_service.call_args.args[2](Trigger.Request(), Trigger.Response()),
                    'log')
    assert [call.args for call in node.callback_failed.call_args_list] == [(error,)] * 2


def test_of_values_that_come_faster_than_they_are_taken_only_the_newest_counts():
    posted = []
    taken = []

    def post(function):
        posted.append(function)
        return True

    newest = Newest(post, taken.append)
    for value in range(1, 1000):
        newest.put(value)
    assert len(posted) == 1
    posted.pop()()
    newest.put(1000)
    posted.pop()()
    assert taken == [999, 1000]


def test_text_of_others_is_cut_and_escaped():
    assert plain('c_form') == 'c_form'
    assert plain('\x1b[2J\n') == r'\x1b[2J\n'
    assert plain('x' * 5_000_000) == 'x' * 100 + '... (5000000 characters)'


def test_a_flood_of_other_programs_costs_one_look_at_the_graph():
    node = Mock()
    node.count_publishers.return_value = 0
    node.get_topic_names_and_types.return_value = []
    node.resolve_topic_name = '/arm/{}'.format
    node.node_info.own, node.node_info.time = NodeInfo.own({}), 0.0
    conflicts = Conflicts(node, 0)
    heard = {call.args[1]: call.args[2] for call in node.create_subscription.call_args_list}
    for n in range(100):
        heard['kinematics/heartbeat'](serialize_message(Heartbeat(process=str(n), version=str(n))))
        heard['~/heartbeat'](serialize_message(Heartbeat(process=str(n))))
    looks = node.count_publishers.call_args_list
    assert 'kinematics' in conflicts.problem
    assert [call.args for call in looks] == [(f'/arm/{topic}',) for topic in SOLE]


class Switches:
    """An emergency stop, and who publishes it."""

    def __init__(self):
        self.node, self.changes = Mock(), []
        self.node.get_publishers_info_by_topic.return_value = []
        self._stop = EmergencyStop(self.node, self.changes.append)

    def say(self, publishers, *said, old=False):
        """Let the named ones be there (! latches), and messages come; return all changes."""
        self.node.get_publishers_info_by_topic.return_value = [
            Mock(qos_profile=LATCHED if name[-1] == '!' else STREAM,
                 endpoint_gid=name.encode(), node_name=name.strip('!'))
            for name in publishers.split()]
        self._stop._check_now()
        on_data = self.node.create_subscription.call_args_list[-1 - old].args[2]
        for on in said:
            on_data(serialize_message(Bool(data=on)))
        return self.changes

    @property
    def latched(self):
        """Whether it receives what was latched before it subscribed."""
        qos = self.node.create_subscription.call_args.args[3]
        return bool(qos.durability == LATCHED.durability)


def test_while_one_subscription_replaces_another_the_old_one_can_only_stop():
    switches = Switches()
    assert switches.say('switch!', True, False, old=True) == [True]
    assert switches.latched
    switches.node.destroy_subscription.assert_not_called()
    assert switches.say('switch!', False) == [True, False]
    switches.node.destroy_subscription.assert_called_once()
    assert switches.node.create_subscription.call_count == 2


def test_what_one_has_turned_on_no_other_turns_off(monkeypatch):
    now = 0.0
    monkeypatch.setattr(emergency_stop, 'monotonic', lambda: now)
    switches = Switches()
    # What was latched reaches a node that starts late in any order.
    assert switches.say('switch! other!', False, True, False) == [True]
    assert switches.say('other!', False) == [True, False]
    # Teleop is there all the time; while it does not say that it is on, others are obeyed.
    assert switches.say('teleop!', True, False) == [True, False] * 2
    assert switches.say('other! teleop!', True, False) == [True, False] * 2 + [True]
    now = 1.0  # s since a true
    assert switches.say('other! teleop!', False) == [True, False] * 3


def test_a_false_that_was_latched_before_the_stop_does_not_come_again():
    switches = Switches()
    assert switches.say('switch other!', True) == [True]
    switches.say('other!')  # the switch has died
    assert not switches.latched
    switches.say('')
    switches.say('new!')
    assert switches.latched
    assert switches.say('new!', False) == [True, False]


def test_a_state_of_the_model_predicts_the_same_after_it_was_sent():
    segment = Segment.leaf_spring(0.1, 0.01, jam=Jam(ratio=5.0))
    statics = Statics(Arm((segment, segment), (Disc(0.01),) * 3, tendon_pair(0.02, end=2)))
    soft, stiff = [True, False], [False, True]
    bent = statics.solve(statics.chain.straight(), (0.003, -0.004), soft, vacuum=(1.0, 0.6))
    held = statics.solve(bent, (0.004, -0.006), stiff, vacuum=(0.7, 1.0))
    received = equilibrium_from_ros(equilibrium_to_ros(held), statics.chain)
    assert received is not None
    assert received.vacuum == pytest.approx((0.7, 1.0))
    after, expected = (statics.solve(start, (0.005, -0.008), stiff, vacuum=start.vacuum)
                       for start in (received, held))
    assert after.joint_angles == pytest.approx(expected.joint_angles, abs=1e-7)
    assert after.held == pytest.approx(expected.held, abs=1e-7)
    without = statics.solve(statics.chain.state(held.joint_angles), (0.005, -0.008), stiff)
    assert np.abs(without.joint_angles - expected.joint_angles).max() > 1e-4


@pytest.fixture
def logged(rig, monkeypatch):
    """Return the list of what the observer of the rig logs."""
    lines = []

    class Logger:
        def __getattr__(self, _):
            return lines.append

    monkeypatch.setattr(rig.observer, 'get_logger', Logger)
    return lines


def test_the_state_of_a_node_that_rests_is_repeated_with_the_time_of_its_change(rig):
    states = {name: rig.record(kind, f'{name}/state', ros_rig.LATCHED) for name, kind in (
        (RECORDER, RecorderState), (TELEOP, TeleopState))} | rig.states
    rig.start_arm()
    rig.start(RECORDER, TELEOP, ready=False)

    def repeated(recording):
        """Whether the last three messages are the same, stamp and all."""
        return len(recording) > 3 and all(one == recording.last for one in list(recording)[-3:])

    rig.wait_for(lambda: all(map(repeated, states.values())), 'three of each', within=20.0)


def test_what_changes_fast_is_logged_once_it_lasts(rig, logged, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(module, 'time', SimpleNamespace(monotonic=lambda: now[0]))
    status = rig.on_ros_thread(Status, rig.observer, 'arm')
    for message in ('first', 'second', 'last'):
        rig.on_ros_thread(status.set, WARN, message)
    assert logged == ['first']
    now[0] = 2.0 * module.LOG_PERIOD
    rig.wait_for(lambda: len(logged) > 1, 'the last message in the log')
    assert logged == ['first', 'last']


def test_what_is_the_same_is_logged_once(rig, logged):
    status = rig.on_ros_thread(Status, rig.observer, 'arm')
    for _ in range(3):
        rig.on_ros_thread(status.set, OK, 'idle')
    assert logged == ['idle']


@pytest.mark.parametrize(('texts', 'lines'), [
    (['has 0.0 kPa', 'has -0.0 kPa', 'has 0 kPa', 'has 12.5 kPa'], 1),
    (['silent for 0.26 s', 'silent for 3 s', 'silent for 1.2e+03 s'], 1),
    (['servo 1: has 3 N', 'servo 2: has 3 N'], 2), (['step 1 of 3', 'step 2 of 3'], 2)])
def test_a_fault_is_logged_once_while_only_what_is_measured_of_it_changes(
        rig, logged, monkeypatch, texts, lines):
    monkeypatch.setattr(module, 'LOG_PERIOD', -1.0)
    status = rig.on_ros_thread(Status, rig.observer, 'arm')
    for text in texts * 2:
        rig.on_ros_thread(status.set, ERROR, text)
    assert len(logged) == lines * (2 if lines > 1 else 1)
