# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``doctor --sensors`` listens to the sensors of an arm and says what is wrong with each."""

from copy import deepcopy
import json

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String

from soft_continuum.commissioning import doctor
from soft_continuum.commissioning.doctor_sensors import judged
from soft_continuum.ros.conversions import tracked_pose_to_ros
from soft_continuum.ros.description import load_arm
from soft_continuum.ros.urdf import arm_urdf
from support.descriptions import JAMMING
from support.planar import measured_pose_to_ros
from support.ros_rig import STREAM

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
