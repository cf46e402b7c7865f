# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node disc_sensors on real topics: trackers and IMUs, and what is refused of them."""

from math import cos, pi, sin
import re
from time import monotonic

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Pose, PoseArray, PoseStamped, PoseWithCovarianceStamped
import numpy as np
import pytest
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger
import yaml

from soft_continuum.estimation.sensing.tare import WINDOW
from soft_continuum.nodes.disc_sensors import _Feed, MAX_COUNT
from soft_continuum.ros.conversions import measured_pose_from_ros, tracked_pose_to_ros
from soft_continuum.ros.description import load_arm
from soft_continuum.ros.entries import LATCHED
from support.descriptions import given_in, JAMMING, PLANAR
from support.planar import planar
from support.ros_rig import pairs, spoil, STREAM

GRAVITY = 9.80665


class Sensors:
    """The node, and sensors before it whose messages a test may spoil."""

    def __init__(self, rig, **parameters):
        self.rig = rig
        self.statuses = rig.record(DiagnosticStatus, 'disc_sensors/status', LATCHED)
        self.poses = [rig.record(PoseWithCovarianceStamped, f'disc_{n}/measured_pose', STREAM)
                      for n in range(4)]
        rig.start('disc_sensors', ready=False, **parameters)
        self.spoil = lambda message: None
        rig.wait_for(lambda: self.statuses.last, 'a status')

    def publish(self, topic, message, frame='base_link', late=0.0):
        now = self.rig.observer.get_clock().now().nanoseconds - int(late * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
        message.header.frame_id = frame
        self.spoil(message)
        self.rig.publisher(type(message), topic).publish(message)

    def pose(self, n=1, x=0.02, z=0.1, angle=0.3, **how):
        message = PoseStamped()
        _set(message.pose, x, z, angle)
        self.publish(f'disc_{n}/pose', message, **how)

    def array(self, count=4):
        message = PoseArray(poses=[Pose() for _ in range(count)])
        for n, pose in enumerate(message.poses):
            _set(pose, 0.01 * n, 0.1 * n, 0.1 * n)
        self.publish('tracker/disc_poses', message)

    def imu(self, n=3, tilt=0.2, **how):
        """Tilt, rad, is from upright about y: that of the arm and of its base."""
        message = Imu()
        a = message.linear_acceleration
        a.x, a.z = -GRAVITY * sin(tilt), GRAVITY * cos(tilt)
        self.publish(f'disc_{n}/imu', message, **how)

    def until(self, send, condition, what):
        def sent():
            send()
            return condition()

        return self.rig.wait_for(sent, what)

    def until_status(self, send, words):
        """Return the status with the words: it may be another one soon."""
        return self.until(send, lambda: next(
            (s for s in [self.statuses.last] if words in s.message), None), words)

    def tare(self):
        return self.rig.call(Trigger, 'disc_sensors/tare')


def _set(pose, x, z, angle):
    pose.position.x, pose.position.z = x, z
    pose.orientation.y, pose.orientation.w = sin(angle / 2), cos(angle / 2)


def measured(recording):
    return planar(recording.last, 'base_link')


ARMS = {
    'in the plane': (PLANAR, (0.02, 0.0, 0.1, 0.0, sin(0.15), 0.0, cos(0.15))),
    'far out of any plane': (JAMMING, (0.02, -0.15, 0.1, sin(pi / 4), 0.0, 0.0, cos(pi / 4)))}
"""Descriptions, and a pose of a disc."""


@pytest.mark.parametrize('arm', ARMS)
def test_poses_of_a_tracker_and_tilts_of_an_imu_come_out_with_their_covariances(rig, arm):
    path, row = ARMS[arm]
    axes, sensors = load_arm(path).pose_axes, Sensors(rig, **given_in(path, 'disc_sensors'))
    assert 'no measurements yet' in sensors.statuses.last.message

    def send():
        message = PoseStamped()
        message.pose = tracked_pose_to_ros(np.array(row), np.eye(6)).pose.pose
        sensors.publish('disc_1/pose', message)
        sensors.imu()

    def measured_of(disc):
        """Return a pose (7,) and the variances (6,) of a disc."""
        message = sensors.poses[disc].last
        return (measured_pose_from_ros(message, axes, 'base_link')[0],
                np.reshape(message.pose.covariance, (6, 6)).diagonal())

    sensors.until(send, lambda: len(sensors.poses[1]) and len(sensors.poses[3]) > 20, 'both')
    pose, variances = measured_of(1)
    assert pose == pytest.approx(row)
    assert np.sqrt(variances) == pytest.approx(np.repeat([0.0005, 0.005], 3))
    pose, variances = measured_of(3)
    assert pose[3:] == pytest.approx([0.0, sin(0.1), 0.0, cos(0.1)], abs=1e-3)
    tilts = axes & [False, False, False, True, True, False]
    assert variances[~tilts] == pytest.approx(1e6)  # not measured: place and heading
    # Gaps of a busy machine make it larger.
    stddevs = np.sqrt([np.reshape(message.pose.covariance, (6, 6)).diagonal()[tilts]
                          for message in sensors.poses[3]])
    assert stddevs.min() > 0.01 and stddevs.min(axis=0).max() < 0.15
    sensors.until_status(send, 'measured: disc_1/pose, disc_3/imu')


def test_a_tracker_of_all_discs_in_its_own_frame_is_turned_into_the_base(rig):
    """The base stands 1 m along x of the tracker, upside down about y."""
    sensors = Sensors(rig, tracker__frame_id='world',
                      tracker__base_pose=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0])

    def send():
        message = PoseArray(poses=[Pose() for _ in range(4)])
        for n, pose in enumerate(message.poses):
            _set(pose, 1.0 - 0.01 * n, -0.1 * n, pi + 0.2)
        sensors.publish('tracker/disc_poses', message, 'world')

    sensors.until(send, lambda: all(map(len, sensors.poses)), 'all discs')
    for n, recording in enumerate(sensors.poses):
        assert measured(recording)[0] == pytest.approx([0.01 * n, 0.1 * n, 0.2])


def test_what_is_wrong_is_said_and_nothing_is_published(rig):
    sensors = Sensors(rig)
    covariance = 'linear_acceleration_covariance__0'
    for send, change, words in (
            (lambda: sensors.pose(frame='world'), {}, "disc_1/pose: poses in 'world'; needed"),
            (lambda: sensors.pose(late=3600.2), {}, 'stamped 36'),
            (lambda: sensors.imu(late=-3600.2), {}, 'disc_3/imu: stamped -3'),
            (sensors.pose, {'header__stamp__sec': 0, 'header__stamp__nanosec': 0}, 'no stamp'),
            (sensors.pose, {'pose__orientation__w': 0.0, 'pose__orientation__y': 0.0}, 'length 0'),
            (lambda: sensors.array(3), {}, '3 poses; the arm has 4 discs'),
            (sensors.imu, {covariance: -1.0}, 'marks linear_acceleration as not measured'),
            (sensors.imu, {covariance: -4.0}, '_covariance is not valid'),
            (sensors.imu, {covariance: float('nan')}, '_covariance is not valid'),
            (sensors.imu, {'angular_velocity__y': float('nan')}, 'not finite'),
            (sensors.imu, {f'linear_acceleration__{axis}': GRAVITY * (axis == 'y')
                           for axis in 'xyz'}, 'IMUs cannot measure an arm that lies flat')):
        sensors.spoil = spoil(**change)
        assert sensors.until_status(send, words).level == DiagnosticStatus.ERROR
    assert not any(map(len, sensors.poses))
    assert 'no measurements' in sensors.tare().message
    sensors.spoil = lambda message: None
    sensors.until(sensors.imu, lambda: len(sensors.poses[3]), 'it goes on')


def test_two_sources_of_one_disc_are_told(rig):
    sensors = Sensors(rig)

    def both():
        sensors.pose()
        sensors.array()

    sensors.until_status(both, 'use one of the two')


def test_of_a_flood_only_so_much_is_taken():
    taken = []
    feed = _Feed('disc_0/imu', 0.02)
    for n in range(2 * MAX_COUNT):
        feed.take(taken.append, n)
    assert taken == list(range(MAX_COUNT))
    assert 'more than 2000 messages per second' in feed.problem


def test_a_tare_takes_the_present_as_straight_and_says_how_to_keep_it(rig):
    sensors = Sensors(rig, arm__mounting_angle=pi)

    def send():
        sensors.pose(x=0.03, z=0.08, angle=0.1)
        sensors.imu(tilt=pi + 0.15)

    moving = iter(np.linspace(0.0, 100.0, 10**5))
    sensors.until(lambda: sensors.pose(x=next(moving) % 0.1),
                  lambda: 'it moves' in sensors.tare().message, 'a refusal')
    rested = monotonic() + WINDOW  # else the last of the motion counts, as far as that is allowed
    sensors.until(send, lambda: monotonic() > rested, 'rest')
    answer = sensors.until(send, lambda: next((
        a for a in [sensors.tare()] if 'pose of disc 1; tilt of disc 3' in a.message), None),
        'a tare')
    assert answer.success
    assert 'tared: ' in answer.message
    found = re.search(r'disc_sensors: (\{.*\})$', answer.message)
    assert found
    kept = yaml.safe_load(found[1])['ros__parameters']
    assert len(kept['tracker']['offsets']) == 28
    assert kept['imu']['mounting_angles'] == pytest.approx([0.0, 0.0, 0.0, 0.15], abs=0.01)
    before = len(sensors.poses[1]), len(sensors.poses[3])
    sensors.until(send, lambda: len(sensors.poses[1]) > before[0] + 1
                  and len(sensors.poses[3]) > before[1] + 1, 'more')
    assert measured(sensors.poses[1])[0] == pytest.approx([0.0, 0.1, 0.0], abs=1e-4)
    assert measured(sensors.poses[3])[0][2] == pytest.approx(0.0, abs=1e-2)
    rig.wait_for(lambda: pairs(sensors.statuses.last).get('tared')
                 == 'pose of disc 1; tilt of disc 3', 'a status that says so')
