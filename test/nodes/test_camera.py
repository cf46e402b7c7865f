# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The camera node on real topics, and on folders of pictures: what it publishes and refuses."""

from functools import partial
from math import pi
import time

import cv2
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
import pytest
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger

from soft_continuum.estimation.sensing.layout import FRONT
from soft_continuum.mechanics.rotations import displacement, planar_pose
from soft_continuum.nodes import camera
from soft_continuum.ros.conversions import CHANNELS, grey_message, grey_picture, pose_from_ros
from soft_continuum.ros.entries import LATCHED, SENSOR
from support.descriptions import given_in
from support.planar import planar
from support.ros_rig import STREAM
from support.views import space_views, views

BENT = views.poses(0.3, -0.2, 0.4)
TRUTH = planar_pose(BENT)
RATE = 20.0  # Hz


@pytest.fixture(scope='module')
def drawn():
    return views.camera()


@pytest.fixture(scope='module')
def picture(drawn):
    return drawn.picture(BENT)


def statuses(rig):
    return rig.record(DiagnosticStatus, 'camera/status', LATCHED)


def wait_for(rig, heard, text):
    rig.wait_for(lambda: any(text in message.message for message in heard), text)


class Driver:
    """A driver of a camera: publishes pictures and their calibration."""

    def __init__(self, rig, drawn, profile=STREAM, name='camera', **parameters):
        self.rig, self.lens = rig, drawn.lens
        self.tare = partial(rig.call, Trigger, f'{name}/tare')
        self.statuses = rig.record(DiagnosticStatus, f'{name}/status', LATCHED)
        self.poses = [rig.record(PoseWithCovarianceStamped, f'disc_{n}/measured_pose', STREAM)
                      for n in range(4)]
        rig.start('camera', ready=False, remapped=('__node', name), **parameters)
        self._images = rig.publisher(Image, f'{name}/image_raw', profile)
        self._infos = rig.publisher(CameraInfo, f'{name}/camera_info', profile)
        self._number, self._sent = 0, 0.0

    @property
    def status(self):
        return str(self.statuses.last.message) if len(self.statuses) else ''

    def send(self, picture, late=0.0, encoding='mono8'):
        """Publish a picture, unless one was published just now; return whether it was."""
        if time.monotonic() - self._sent < 1.0 / RATE:
            return False
        self._sent = time.monotonic()
        message, lens = grey_message(picture), self.lens
        message.encoding = encoding
        info = CameraInfo(width=lens.size[0], height=lens.size[1], distortion_model='plumb_bob',
                          d=lens.distortion.tolist(), k=lens.matrix.ravel())
        now = self.rig.observer.get_clock().now().nanoseconds - int(late * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
        self._infos.publish(info)
        self._images.publish(message)
        return True

    def send_until(self, condition, what, picture, **how):
        """Send a picture again and again, each with other noise, as a camera does."""
        picture = picture.copy()

        def sent():
            picture[0, :2] = divmod(self._number % 64, 8)  # which leaves a black one black
            self._number += self.send(picture, **how)
            return condition()

        self.rig.wait_for(sent, what)

    def tare_until(self, words, picture):
        """Ask for a tare after every dozen pictures, until the answer has the words."""
        asked = [self._number]

        def tared():
            if self._number < asked[0] + 12:
                return False
            asked[0] = self._number
            return words in self.tare().message

        self.send_until(tared, words, picture)


def test_every_disc_is_published_where_it_is_with_its_covariance(rig, drawn, picture):
    driver = Driver(rig, drawn, SENSOR)  # best effort; the other tests are reliable
    driver.send_until(lambda: all(len(p) > 0 for p in driver.poses), 'all discs', picture)
    for truth, recorded in zip(TRUTH, driver.poses, strict=True):
        message = recorded.last
        pose, covariance = planar(message)
        assert pose == pytest.approx(truth, abs=2e-3)
        assert pose[:2] == pytest.approx(truth[:2], abs=2e-4)
        assert 1e-4 < np.sqrt(covariance[0, 0]) < 1e-3
        assert message.header.frame_id == 'base_link'
        full = np.reshape(message.pose.covariance, (6, 6))
        assert np.diag(full)[[1, 3, 5]] == pytest.approx(1e6)  # not measured
        assert np.linalg.eigvalsh(full)[0] > 0.0


def test_a_tare_corrects_how_tags_are_stuck(rig):
    """Drawn: tags that are off by 1 mm, standard, in an arm that is straight, then bent."""
    drawn = views.camera('ideal', tag_offset=0.001)
    driver = Driver(rig, drawn)
    assert 'no disc was detected' in driver.tare().message
    driver.tare_until('parameter file: camera: {ros__parameters',
                      drawn.picture(views.poses(0.0, 0.0, 0.0)))
    bent, tared = drawn.picture(BENT), rig.observer.get_clock().now().nanoseconds
    driver.send_until(lambda: all(Time.from_msg(p.last.header.stamp).nanoseconds > tared
                                  for p in driver.poses), 'a bent arm', bent)
    for truth, recorded in zip(TRUTH, driver.poses, strict=True):
        pose, _ = planar(recorded.last)
        assert pose[:2] == pytest.approx(truth[:2], abs=3e-4)
        assert pose[2] == pytest.approx(truth[2], abs=5e-3)
    driver.tare_until('from its pose in', bent)


def test_what_is_wrong_with_the_pictures_is_said_and_nothing_is_published(
        rig, drawn, picture, monkeypatch):
    for name in ('STALE_AFTER', 'FROZEN_AFTER'):
        monkeypatch.setattr(camera, name, 0.5)
    driver = Driver(rig, drawn)
    wait_for(rig, driver.statuses, 'no image from /arm_under_test/camera/image_raw')
    for words, how in (
            ('stamped 36', {'late': 3600.2}), ('stamped -3', {'late': -3600.2}),
            ("encoding 'bayer", {'encoding': 'bayer_rggb8'})):
        driver.send_until(lambda w=words: w in driver.status, words, picture, **how)
    driver.send_until(lambda: 'black' in driver.status, 'black', np.zeros_like(picture))
    assert not any(len(p) for p in driver.poses)
    seen = rig.record(CompressedImage, 'camera/overlay/compressed', SENSOR)
    driver.send_until(lambda: len(seen) > 0, 'what it sees, black as it is',
                      np.zeros_like(picture))
    assert bytes(seen.last.data).startswith(b'\xff\xd8')
    assert cv2.imdecode(np.frombuffer(seen.last.data, np.uint8), cv2.IMREAD_GRAYSCALE).max() < 9
    driver.send_until(lambda: 'all discs' in driver.status, 'what it sees', picture)
    begin = rig.observer.get_clock().now().nanoseconds
    rig.wait_for(lambda: driver.send(picture) and 'frozen' in driver.status, 'frozen')
    measured = [pose for pose in driver.poses[1]
                if Time.from_msg(pose.header.stamp).nanoseconds >= begin]
    assert len(measured) <= 1  # the same picture again shows the arm as it was
    driver.send_until(lambda: 'all discs' in driver.status, 'it goes on', picture)
    assert all(len(p) for p in driver.poses)


def test_a_folder_of_pictures_is_measured(rig, drawn, picture, tmp_path):
    calibration, folder = tmp_path / 'camera.yaml', tmp_path / 'pictures'
    calibration.write_text(drawn.lens.text('drawn'), encoding='utf-8')
    folder.mkdir()
    for n in range(3):
        cv2.imwrite(str(folder / f'{n}.png'), picture)
    tip = rig.record(PoseWithCovarianceStamped, 'disc_3/measured_pose', STREAM)
    heard = statuses(rig)
    rig.start('camera', ready=False, **{
        'camera.source': str(folder), 'camera.calibration': str(calibration), 'camera.rate': 5.0})
    rig.wait_for(lambda: len(tip) >= 1, 'a pose')
    wait_for(rig, heard, 'no more images')


def test_a_second_camera_of_an_arm_in_space(rig):
    """It measures all six coordinates, and has topics and parameters of its own name."""
    truth = space_views.poses((0.3, 0.2), (-0.2, 0.4), (0.1, -0.5))
    drawn = space_views.camera(direction=FRONT - pi / 3)
    picture = drawn.picture(truth)
    driver = Driver(rig, drawn, name='camera_2', **given_in(space_views.PATH, 'camera'))
    tip = driver.poses[2]
    driver.send_until(lambda: len(tip), 'disc 2', picture)
    error = displacement(np.array(pose_from_ros(tip.last.pose.pose)), truth[2])
    covariance = np.reshape(tip.last.pose.covariance, (6, 6))
    assert error == pytest.approx(np.zeros(6), abs=5e-3)
    assert np.abs(error[:3]).max() < 2e-3
    assert np.diag(covariance).max() < 1e-3
    assert np.linalg.eigvalsh(covariance)[0] > 0.0
    wait_for(rig, driver.statuses, 'all discs are detected')
    driver.tare_until('is the arm straight', picture)
    driver.tare_until('camera_2: {ros__parameters: {tags: {reference_corners',
                      drawn.picture(space_views.poses(*[(0, 0)] * 3)))


def test_a_camera_that_is_not_there_is_waited_for(rig, drawn, tmp_path):
    calibration = tmp_path / 'camera.yaml'
    calibration.write_text(drawn.lens.text('drawn'), encoding='utf-8')
    heard = statuses(rig)
    rig.start('camera', ready=False, **{'camera.source': '/dev/video99',
                           'camera.calibration': str(calibration)})
    wait_for(rig, heard, 'cannot be opened')


@pytest.mark.parametrize('encoding', CHANNELS)
def test_pictures_of_every_known_encoding_are_read(encoding):
    channels, grey = CHANNELS[encoding], np.arange(12, dtype=np.uint8).reshape(3, 4)
    rows = np.zeros((3, 4 * channels + 5), dtype=np.uint8)  # padded
    rows[:, :4 * channels] = np.repeat(grey, channels, axis=1)
    message = Image(width=4, height=3, encoding=encoding, step=rows.shape[1])
    message.data = rows.tobytes()
    assert np.array_equal(grey_picture(message), grey)


@pytest.mark.parametrize('change', [
    {'width': 0}, {'height': 10}, {'step': 2}, {'encoding': 'mono16'}, {'width': 2**31}])
def test_a_picture_that_is_none_is_refused(change):
    message = grey_message(np.zeros((3, 4), dtype=np.uint8))
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(ValueError, match='image'):
        grey_picture(message)
