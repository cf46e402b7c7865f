# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``doctor --network`` and ``--sensors`` say what is wrong with a running arm, and what to do."""

from copy import deepcopy
import json

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String

from soft_continuum import version
from soft_continuum.commissioning import doctor, doctor_network
from soft_continuum.commissioning.doctor_network import NodeReplies
from soft_continuum.commissioning.doctor_sensors import judged
from soft_continuum.ros.conversions import tracked_pose_to_ros
from soft_continuum.ros.description import load_arm
from soft_continuum.ros.urdf import arm_urdf
from soft_continuum_interfaces.srv import GetNodeInfo
from support.descriptions import JAMMING
from support.planar import measured_pose_to_ros
from support.ros_rig import STREAM

DIGEST = '0123456789abcdef'


def answers(host='rig', trip=0.01, offset=0.0, calls=50, answered=50, of='', arm=DIGEST, lost=0):
    """Return what a node answered; the slower half of the answers tells its time badly."""
    said = [GetNodeInfo.Response(host=host, version=of or version(), description=arm,
                           stamp=Time(sec=1))] * answered
    return NodeReplies(
        said, [trip * (1 + 9 * (i % 2)) for i in range(answered)],
        [offset + 4 * trip * (i % 2) for i in range(answered)], calls,
        [0.2 * i for i in range(51) if not 0 < i <= lost])


def steps(values=None, **found):
    """Return status and message by step."""
    complete = {name: answers('ws' if name in ('kinematics', 'shape_sequencer') else 'rig')
                for name in ('tendon_actuation', 'jamming_valves', 'kinematics',
                             'shape_sequencer')}
    return {check.step: (check.status, check.message)
            for check in doctor_network.judged(complete | found, values or {}, '/')}


def test_a_sound_network_is_described():
    found = steps()
    assert {status for status, _ in found.values()} == {'OK'}
    assert found['computer ws'][1] == 'kinematics, shape_sequencer'
    assert found['round trip to rig'][1].startswith('median 55.0 ms, worst 100.0 ms; 0 of 100')
    assert found['clock of rig'][1] == '+0.0 ms from this one, known to 5.0 ms'
    assert found['messages from rig'][1] == '0 of 102 lost'


@pytest.mark.parametrize(('answer', 'step', 'status', 'words'), [
    (answers(trip=0.1), 'round trip to rig', 'FAIL', 'motions come late'),
    (answers(trip=0.04), 'round trip to rig', 'WARN', 'use a cable'),
    (answers(answered=48), 'round trip to rig', 'WARN', '4 of 100 calls unanswered'),
    (answers(answered=0), 'unanswered', 'FAIL', 'jamming_valves, tendon_actuation: found, but no'),
    (answers(lost=20), 'messages from rig', 'WARN', '40 of 102 lost'),
    (answers(offset=-0.1), 'clock of rig', 'WARN', 'are assigned to the wrong time'),
    (answers(offset=3.0), 'clock of rig', 'FAIL', '+3000.0 ms from this one, known to 5.0 ms'),
    (answers(trip=0.09, offset=0.06), 'clock of rig', 'OK', '+60.0 ms'),
    (answers(of='0.0.1'), 'version', 'FAIL', '0.0.1 of jamming_valves, tendon_actuation'),
    (answers(arm='f' * 16), 'description', 'FAIL', 'digests differ: ')])
def test_what_is_wrong_is_said(answer, step, status, words):
    found = steps(tendon_actuation=answer, jamming_valves=answer)[step]
    assert found[0] == status, found
    assert words in found[1]


def test_each_parameter_that_differs_is_named_with_both_values():
    arm, limits = 'arm.payload', 'pull_limits'
    found = steps({'tendon_actuation': {arm: 0.0, limits: [-0.06, 0.06]},
                   'kinematics': {arm: 0.1}, 'shape_sequencer': {arm: 0.1, limits: [-0.05, 0.05]}},
                  tendon_actuation=answers(arm='f' * 16))
    assert found['description'][1].startswith(
        'arm.payload is 0.1 for kinematics on ws, shape_sequencer on ws and 0.0 for '
        'tendon_actuation on rig; motion is refused')
    assert found['other parameters'] == (
        'WARN', 'pull_limits is [-0.05, 0.05] for shape_sequencer on ws and [-0.06, 0.06] for '
        'tendon_actuation on rig; start every node with the same files')


def test_a_node_that_runs_twice_or_not_at_all_is_named():
    twice = answers()
    twice.said = [*answers('ws').said, *twice.said]
    assert steps(tendon_actuation=twice)['tendon_actuation'] == (
        'FAIL', 'runs on rig and ws; end all but one')
    alone = {check.step: check for check in doctor_network.judged({'camera': answers()}, {}, '/')}
    assert alone['missing'].message.startswith('tendon_actuation, jamming_valves, kinematics')
    nobody, = doctor_network.judged({}, {}, '/left')
    assert nobody.status == 'FAIL'
    assert 'no node answers in namespace /left' in nobody.message


NOW = 1000.0


def heard(message, rate=50.0, delay=0.02, frame='base_link', noise=lambda message: None):
    """Return messages of 2 s, and when they came."""
    found = []
    for time in np.arange(NOW, NOW + 2.0, 1.0 / rate):
        copy = deepcopy(message)
        noise(copy)
        copy.header.frame_id = frame
        copy.header.stamp.sec, copy.header.stamp.nanosec = divmod(int((time - delay) * 1e9), 10**9)
        found.append((float(time), copy))
    return found


def pose(variance=1e-6, of_angle=1e-4):
    return measured_pose_to_ros(np.array([0.0, 0.1, 0.0]), np.diag([variance, variance, of_angle]))


def imu(x=0.0, z=9.8, bias=0.01):
    message = Imu()
    message.linear_acceleration.x, message.linear_acceleration.z = x, z
    message.angular_velocity.y = bias
    return message


def turning(bias):
    """Return messages of an IMU at rest, by its noise and its bias, rad/s."""
    rng = np.random.default_rng(1)

    def noise(message):
        message.angular_velocity.y = bias + 0.003 * rng.standard_normal()

    return heard(imu(), noise=noise)


def cells(names, forces):
    return JointState(name=names, effort=forces)


def only(topic, messages, **others):
    found, = judged({topic: messages, **others}, {topic: ('camera',)}, '/')
    return found


def test_a_sound_sensor_is_described():
    found = only('disc_1/measured_pose', heard(pose()))
    assert (found.step, found.status) == ('disc 1 measured pose', 'OK')
    assert found.message == ('by camera, in base_link, 1.00 mm, 0.57 degrees, 50.0 Hz, '
                             '20 ms late')
    assert 'position not measured' in only('disc_1/measured_pose', heard(pose(1e6))).message
    found = only('load_cells', heard(cells(['a', 'b'], [1.0, 2.5])))
    assert (found.status, found.message[:15]) == ('OK', 'a 1.0 N, b 2.5 ')


@pytest.mark.parametrize(('topic', 'messages', 'status', 'words'), [
    ('disc_1/measured_pose', heard(pose(), delay=3600.0), 'FAIL', 'stamped 3600.0 s ago'),
    ('disc_1/measured_pose', heard(pose(), delay=-60.0), 'FAIL', 'stamped -60.0 s ago'),
    ('disc_1/measured_pose', heard(pose(), delay=0.5), 'WARN', '500 ms late; is a computer'),
    ('disc_1/measured_pose', heard(pose(), rate=1.0), 'WARN', 'expected: 2 Hz or more'),
    ('disc_1/measured_pose', heard(pose(-1.0)), 'FAIL', 'not positive definite'),
    ('disc_3/imu', heard(imu(z=1.0)), 'FAIL', '1.00 m/s^2, at rest it is 9.81; is it in'),
    ('disc_3/imu', heard(imu(x=float('nan'))), 'FAIL', 'not finite'),
    ('disc_3/imu', heard(imu()), 'WARN', 'frozen'),
    ('disc_3/imu', heard(imu(), rate=10.0), 'WARN', 'identical readings'),
    ('load_cells', heard(cells(['a', 'a'], [1.0, 2.0])), 'FAIL', 'needed: name and effort'),
    ('load_cells', heard(cells(['a', 'b'], [1.0])), 'FAIL', 'tensions 1; needed'),
    ('load_cells', heard(cells(['a'], [float('nan')])), 'FAIL', 'check the cables'),
    ('disc_3/imu', turning(0.01), 'OK', 'bias 0.5'),
    ('disc_3/imu', turning(0.3), 'WARN', 'large; is it in rad/s')])
def test_what_is_wrong_with_a_sensor_is_said(topic, messages, status, words):
    found = only(topic, messages)
    assert words in found.message
    assert found.status == status


def test_frames_and_tendons_that_are_not_those_of_the_arm_are_told():
    model = PoseArray()
    model.header.frame_id = 'left/base_link'
    found = only('disc_0/measured_pose', heard(pose()), disc_poses=[(NOW, model)])
    assert "poses in 'base_link'; needed: 'left/base_link'" in found.message
    found = only('load_cells', heard(cells(['up'], [1.0])),
                 tendon_states=[(NOW, cells(['right_tendon', 'left_tendon'], []))])
    assert found.message.startswith('names up; the tendons are right_tendon, left_tendon')


def test_sensors_that_send_nothing_are_a_failure_if_all_of_them_do():
    silent = {'disc_0/measured_pose': [], 'disc_1/measured_pose': []}
    assert [check.status for check in judged(silent, {}, '/')] == ['FAIL', 'WARN', 'WARN']
    one = silent | {'disc_1/measured_pose': heard(pose())}
    assert [check.status for check in judged(one, {}, '/')] == ['WARN', 'OK']


def test_the_status_of_the_camera_is_repeated_with_what_fits_badly():
    message = DiagnosticStatus(
        level=DiagnosticStatus.OK, message='all discs are detected', values=[
            KeyValue(key='tags', value='0 1 100'), KeyValue(key='deviation_px', value='1.800')])
    camera, = list(judged({'camera/status': [(NOW, message)]}, {}, '/'))[-1:]
    assert camera.status == 'WARN'
    assert 'tags 0 1 100, corners off by 1.800 px; calibrate the lens' in camera.message


def test_discs_in_space_are_seen_by_several_cameras():
    message = tracked_pose_to_ros(np.array([0.1, 0.1, 0.1, 0.0, 0.6, 0.8, 0.0]),
                                  np.diag([1e-6] * 3 + [1e-4] * 3))
    spatial = {'tendon_states': [(NOW, cells(['right_tendon', 'left_tendon'], []))],
               'robot_description': [(NOW, String(data=arm_urdf(load_arm(JAMMING))))]}
    found = only('disc_1/measured_pose', heard(message), **spatial)
    assert found.status == 'OK'
    assert found.message.startswith('by camera, in base_link, 1.00 mm, 0.57 degrees')
    second = DiagnosticStatus(level=DiagnosticStatus.OK, message='all discs are detected')
    checks = list(judged({'camera_2/status': [(NOW, second)], 'disc_1/measured_pose': heard(
        message), **spatial}, {}, '/'))
    assert [(check.step, check.status) for check in checks] == [
        ('camera_2', 'OK'), ('disc 1 measured pose', 'OK')]
    assert only('disc_1/measured_pose', heard(message)).status == 'FAIL'  # of a planar arm


def test_it_listens_to_a_running_arm(rig, here, capfd):
    arguments = ['--sensors', '--duration', '1', '--namespace', 'arm_under_test']
    assert doctor.main(arguments) == 1
    assert 'FAIL  sensors: no sensor publishes in namespace /arm_under_test' in (
        capfd.readouterr().out)
    publisher = rig.observer.create_publisher(
        PoseWithCovarianceStamped, 'disc_2/measured_pose', STREAM)

    def publish():
        message = pose()
        message.header.frame_id = 'base_link'
        message.header.stamp = rig.observer.get_clock().now().to_msg()
        publisher.publish(message)

    rig.observer.create_timer(0.05, publish)
    assert doctor.main([*arguments, '--duration', '3', '--json']) == 0
    document = json.loads(capfd.readouterr().out)
    check, = document['checks']
    assert (document['result'], check['step']) == ('OK', 'disc 2 measured pose')
    assert 'by observer, in base_link, 1.00 mm' in check['message']


def test_an_imu_that_is_remapped_is_listened_to(rig, here, capfd):
    publisher = rig.observer.create_publisher(Imu, '/imu/data_raw', STREAM)
    listener = Node('disc_sensors', context=rig.context, namespace=rig.namespace)
    listener.create_subscription(Imu, '/imu/data_raw', lambda message: None, STREAM)

    def publish():
        message = imu(z=1.0)
        message.header.stamp = rig.observer.get_clock().now().to_msg()
        publisher.publish(message)

    rig.observer.create_timer(0.02, publish)
    try:
        assert doctor.main(['--sensors', '--duration', '3', '--namespace', 'arm_under_test']) == 1
    finally:
        listener.destroy_node()
    assert 'FAIL  /imu/data_raw: 1.00 m/s^2, at rest it is 9.81' in capfd.readouterr().out
