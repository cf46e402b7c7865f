# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The camera node: poses of the discs from printed tags."""

from array import array
import os
from pathlib import Path
import threading
from time import monotonic
from typing import Any, TYPE_CHECKING
import zlib

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger

from soft_continuum.estimation.sensing.layout import layout_of
from soft_continuum.estimation.sensing.lens import Lens, LensError
from soft_continuum.estimation.sensing.pictures import is_black, is_device, pictures, SourceError
from soft_continuum.estimation.sensing.tare import SensorError, Window
from soft_continuum.extras import require
from soft_continuum.nodes.suite_node import ERROR, OK, SuiteNode, WARN
from soft_continuum.nodes.threads import Newest, on_ros_thread, Worker
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.conversions import (
    grey_picture,
    MAX_PICTURE_BYTES,
    poses_from_ros,
    seconds,
    tracked_pose_to_ros,
)
from soft_continuum.ros.entries import repeat, SENSOR, serve, STREAM, subscribe
from soft_continuum.ros.names import CAMERA, MEASURED_POSE
from soft_continuum.ros.ros_time import Age

if TYPE_CHECKING:  # OpenCV may not be there
    from soft_continuum.estimation.sensing.tag_camera import TagCamera, TagDetections

MAX_AGE = 1.0  # s between a picture's stamp and now
FROZEN_AFTER = 2.0  # s of one and the same picture, of a camera
STALE_AFTER = 2.0  # s without a picture
NOT_SEEN = 'no disc was detected; see ~/status'
OVERLAY_PERIOD = 0.2  # s between two pictures for people
IMAGES, INFO = '~/image_raw', '~/camera_info'
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
RETRY = 2.0  # s until a device that failed is opened again
CLOSE_TIMEOUT = 2.0  # s


class Camera(SuiteNode):
    """
    Measures poses of the discs in the images of one camera.

    Subscribes to ~/image_raw (sensor_msgs/Image) and ~/camera_info (sensor_msgs/CameraInfo) unless
    it opens a device, a file or a folder itself.  Publishes disc_N/measured_pose
    (geometry_msgs/PoseWithCovarianceStamped), N from 0 at the base, ~/status and /diagnostics. For
    people, ~/overlay/compressed (sensor_msgs/CompressedImage) is the image with the tags and the
    arm of disc_poses drawn over it.  Serves ~/tare (std_srvs/Trigger).  For several cameras, start
    one node each, with different names.

    Images are processed on a separate thread; if they arrive faster, only the newest.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters and topics; raises ParameterError, ImportError without OpenCV."""
        require('cv2')
        super().__init__(CAMERA, 'camera and printed tags', **options)
        from soft_continuum.estimation.sensing.tag_camera import overlay, TagCamera
        self._layout = layout_of(self.parameters)
        self._draw, self._make_camera = overlay, TagCamera
        self._stuck = self._layout.stuck_as(self.parameters)
        self._camera: TagCamera | None = None
        if path := self.parameters['camera.calibration']:
            try:
                self._camera = self._camera_of(Lens.read(Path(path).expanduser()))
            except (OSError, ValueError) as error:
                raise ParameterError(f'parameter camera.calibration: {error}') from None
        self._source = os.path.expanduser(self.parameters['camera.source'])
        if self._source and self._camera is None:
            raise ParameterError('parameter camera.calibration is needed beside camera.source; '
                                 'soft_continuum calibrate camera writes that file')
        self._info_problem = f'no {self.resolve_topic_name(INFO)} yet'
        self._poses = [self.create_publisher(
            PoseWithCovarianceStamped, MEASURED_POSE.format(n), STREAM)
            for n in range(len(self._layout.heights))]
        self._overlays = self.create_publisher(CompressedImage, '~/overlay/compressed', STREAM)
        self._model: Any = None  # disc_poses of the model, (2 * discs, 7)
        self._model_age = Age()
        self._shown = 0.0  # when an overlay was published, s
        self._seen = Window['TagDetections']()
        self._tared = ''
        self._worker = Worker('pictures', self.thread_failed)
        self._newest = Newest(self._worker.submit, self._look)
        self._reports = Newest(lambda f: on_ros_thread(self, f), self._report)
        self._age, self._taken = Age(), 0.0  # of the last picture; when one was looked at, s
        self._last, self._changed = 0, monotonic()  # checksum of the last picture, s
        self._ending = threading.Event()

    def start(self) -> None:
        """Start to measure."""
        self._age.refresh()
        serve(self, Trigger, '~/tare', self._on_tare)
        self.status.set(WARN, 'no image received yet')
        subscribe(self, PoseArray, 'disc_poses', self._on_model, SENSOR)
        if self._source:
            threading.Thread(target=self._read, name='source', daemon=True).start()
        else:
            if self._camera is None:
                subscribe(self, CameraInfo, INFO, self._on_info, SENSOR)
            self._subscribe(SENSOR)
        if not self._source or is_device(self._source):
            repeat(self, 0.5, self._check_age)

    def _subscribe(self, profile: QoSProfile) -> None:
        self._profile = profile
        self._subscription = subscribe(
            self, Image, IMAGES, self._on_image, profile, MAX_PICTURE_BYTES)

    def _choose_profile(self) -> None:
        """Have what gets lost sent again where the driver does that: a picture is many packets."""
        present = self.get_publishers_info_by_topic(self.resolve_topic_name(IMAGES))
        reliable = [p.qos_profile.reliability == ReliabilityPolicy.RELIABLE for p in present]
        profile = NEWEST if reliable and all(reliable) else SENSOR
        if profile is not self._profile:
            self.destroy_subscription(self._subscription)
            self._subscribe(profile)

    def quit(self) -> None:
        """End; this node moves nothing."""
        self._ending.set()
        self._worker.close(CLOSE_TIMEOUT)

    def _on_model(self, message: PoseArray) -> None:
        poses = poses_from_ros(message)
        self._model_age.refresh()
        self._model = poses if len(poses) == 2 * len(self._poses) else None

    # Where pictures come from.

    def _on_info(self, message: CameraInfo) -> None:
        before = self._camera.lens if self._camera else None
        try:
            lens = Lens.from_info(message)
            if before is None or before.size != lens.size or not (
                    np.array_equal(before.matrix, lens.matrix)
                    and np.array_equal(before.distortion, lens.distortion)):
                self._camera = self._camera_of(lens)
        except LensError as error:
            self._camera, self._info_problem = None, str(error)

    def _camera_of(self, lens: Lens) -> 'TagCamera':
        """Return what measures; with what was seen of the straight arm, if that fits."""
        try:
            return self._make_camera(self._layout, lens, self._stuck)
        except SensorError as error:
            raise LensError(f'tags.reference_corners: {error}') from None

    def _on_image(self, message: Image) -> None:
        now = monotonic()
        self._age.refresh()
        if now - self._taken < 0.9 / self.parameters['camera.rate']:
            return
        self._taken = now
        delay = seconds(self.get_clock().now().to_msg()) - seconds(message.header.stamp)
        if abs(delay) > MAX_AGE:
            self.status.set(ERROR, f'the image is stamped {delay:.1f} s ago (negative: from the '
                                   f'future); allowed: {MAX_AGE:g} s; synchronize the clocks of '
                                   'the computers, or reduce the load of this one')
            return
        try:
            self._newest.put((message.header.stamp, grey_picture(message), True))
        except ValueError as error:
            self.status.set(ERROR, str(error))

    def _read(self) -> None:
        """Take pictures from a device, a file or a folder, on a thread of its own."""
        assert self._camera is not None
        live, period = is_device(self._source), 1.0 / self.parameters['camera.rate']
        while not self._ending.is_set():
            next_time = monotonic()
            try:
                for picture in pictures(self._source, self._camera.lens.size):
                    if self._ending.is_set():
                        return
                    if monotonic() < next_time and live:
                        continue  # read all the same: a device keeps old ones otherwise
                    self._ending.wait(max(0.0, next_time - monotonic()))
                    next_time = max(monotonic(), next_time + period)
                    self._age.refresh()
                    self._newest.put((self.get_clock().now().to_msg(), picture, live))
                end = WARN, f'{self._source} has no more images'
            except SourceError as error:
                end = ERROR, str(error)
            self._worker.submit(lambda end=end: self._reports.put((*end, {})))  # after the last
            if not live:
                return
            self._ending.wait(RETRY)

    # What is seen.

    def _look(self, taken: tuple[Time, Any, bool]) -> None:
        """Measure and publish; on the separate thread."""
        stamp, picture, live = taken
        camera, sight = self._camera, None
        if camera is None:
            self._reports.put((ERROR, self._info_problem, {}))
        elif live and self._is_repeated(picture) and not is_black(picture):
            # No camera sees twice the same: it shows the arm as it was.
            if monotonic() - self._changed > FROZEN_AFTER:
                self._reports.put((ERROR, 'the camera has sent the same image for '
                                          f'{FROZEN_AFTER:g} s: it is frozen; restart its '
                                          'driver', {}))
        else:
            sight = camera.measure(picture)
            self._publish(stamp, sight)
        self._show(stamp, picture, camera, sight)

    def _publish(self, stamp: Time, sight: 'TagDetections') -> None:
        """Publish the poses of the discs, and the detections."""
        self._seen.add(monotonic(), sight)
        for n, disc in sight.discs.items():
            message = tracked_pose_to_ros(disc.pose, disc.covariance)
            message.header.stamp = stamp
            message.header.frame_id = self.parameters['frame_id']
            self._poses[n].publish(message)
        missing = [str(n) for n in range(len(self._poses)) if n not in sight.discs]
        values = {'discs': ' '.join(map(str, sight.discs)),
                  'tags': ' '.join(map(str, sorted(sight.numbers))),
                  'deviation_px': f'{sight.stddev:.3f}', 'tared': self._tared or 'no'}
        if sight.problems:
            self._reports.put((WARN if sight.discs else ERROR, '; '.join(sight.problems), values))
        elif missing:
            self._reports.put((WARN, f'disc {", ".join(missing)} not detected', values))
        else:
            self._reports.put((OK, 'all discs are detected', values))

    def _show(self, stamp: Time, picture: Any, camera: 'TagCamera | None',
              sight: 'TagDetections | None') -> None:
        """Draw for those who look; most of all when nothing could be measured."""
        now = monotonic()
        if now - self._shown < OVERLAY_PERIOD or not self._overlays.get_subscription_count():
            return
        self._shown = now
        message = CompressedImage(format='jpeg')
        message.header.stamp = stamp
        model = self._model if self._model_age.seconds < STALE_AFTER else None
        message.data = array('B', self._draw(picture, camera, sight, model))
        self._overlays.publish(message)

    def _on_tare(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Take the discs as they are seen as those of the straight arm."""
        try:
            numbers, stuck, kept = self._layout.tared(
                self._stuck, self._seen.recent(monotonic()))
            camera = self._camera
            if camera is None or not numbers:
                raise SensorError(NOT_SEEN)
            self._camera, self._stuck = self._make_camera(
                self._layout, camera.lens, stuck), stuck
        except SensorError as error:
            response.message = f'{error}; nothing was tared'
            return response
        discs = [*map(str, numbers)]
        self._tared = ' '.join(discs)
        response.success = True
        response.message = (
            f'tared: disc {", ".join(discs)}. To keep this after a restart, add to the parameter '
            f'file: {self.get_name()}: {{ros__parameters: {{tags: {{{kept}}}}}}}')
        return response

    def _is_repeated(self, picture: Any) -> bool:
        """Whether it is identical to the image before."""
        before, self._last = self._last, zlib.crc32(picture)
        if self._last != before:
            self._changed = monotonic()
        return self._last == before

    def _report(self, report: tuple[bytes, str, dict[str, str]]) -> None:
        level, text, values = report
        self.status.set(level, text, **values)

    def _check_age(self) -> None:
        if not self._source:
            self._choose_profile()
        if self._age.seconds > STALE_AFTER:
            source = self._source or self.resolve_topic_name(IMAGES)
            self.status.set(ERROR, f'no image from {source} for {STALE_AFTER:g} s; is the camera '
                                   'plugged in, does its driver run?')
