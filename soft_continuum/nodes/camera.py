# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node that looks at the arm: poses of the discs from printed tags."""

from functools import partial
import threading
from time import monotonic
from typing import Any
import zlib

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image

from soft_continuum.nodes.entries import repeat, subscribe
from soft_continuum.nodes.node_parameters import NodeParameters
from soft_continuum.nodes.status import ERROR, FAILURE_PERIOD, OK, Status, WARN
from soft_continuum.nodes.threads import Newest, on_ros_thread, Worker
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.nodes import NODE_PARAMETERS
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.age import Age
from soft_continuum.ros.conversions import measured_pose_to_ros, seconds
from soft_continuum.ros.pictures import grey_picture, MAX_PICTURE_BYTES
from soft_continuum.ros.qos import SENSOR, STREAM
from soft_continuum.sensing.layout import TagLayout
from soft_continuum.sensing.lens import Lens, LensError
from soft_continuum.sensing.opencv import OpenCVError, require_opencv
from soft_continuum.sensing.sources import is_device

MAX_AGE = 1.0  # s between a picture's stamp and now
DARK = 8  # grey value of a picture that is called black, not frozen
FROZEN_AFTER = 2.0  # s of one and the same picture, of a camera
STALE_AFTER = 2.0  # s without a picture
IMAGES = 'camera/image_raw'
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
RETRY = 2.0  # s until a device that failed is opened again
CLOSE_TIMEOUT = 2.0  # s


class Camera(Node):
    """
    Measures where the discs are in the pictures of one camera.

    Subscribes to camera/image_raw (sensor_msgs/Image) and camera/camera_info
    (sensor_msgs/CameraInfo) unless it opens a device, a file or a folder itself.  Publishes
    disc_N/measured_pose (geometry_msgs/PoseWithCovarianceStamped), N from 0 at the base, ~/status
    and /diagnostics.

    Pictures are looked at on a thread of their own; of those that come faster, the newest.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters and topics; raises ParameterError."""
        super().__init__('camera', **options)
        try:
            require_opencv()
        except OpenCVError as error:
            raise ParameterError(str(error)) from None
        from soft_continuum.sensing.tag_camera import TagCamera
        self.parameters = NodeParameters(self, NODE_PARAMETERS['camera'])
        self.status = Status(self, 'camera and printed tags')
        self._layout = TagLayout.of(arm_from_parameters(self.parameters), self.parameters)
        self._make_camera = partial(TagCamera, self._layout)
        self._camera: TagCamera | None = None
        if path := self.parameters['camera.calibration']:
            try:
                self._camera = self._make_camera(Lens.read(path))
            except (OSError, ValueError) as error:
                raise ParameterError(f'parameter camera.calibration: {error}') from None
        self._source: str = self.parameters['camera.source']
        if self._source and self._camera is None:
            raise ParameterError('parameter camera.calibration is needed beside camera.source; '
                                 'soft_continuum calibrate camera writes that file')
        self._info_problem = 'no camera/camera_info yet'
        self._poses = [self.create_publisher(
            PoseWithCovarianceStamped, f'disc_{n}/measured_pose', STREAM)
            for n in range(len(self._layout.heights))]
        self._worker = Worker('pictures', self._on_failure)
        self._newest = Newest(self._worker.submit, self._look)
        self._reports = Newest(lambda f: on_ros_thread(self, f), self._report)
        self._age, self._taken = Age(), 0.0  # of the last picture; when one was looked at, s
        self._last, self._changed = 0, monotonic()  # checksum of the last picture, s
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def callback_failed(self, error: Exception) -> None:
        """Report what a callback raised."""
        self.status.alarm('callback', f'{type(error).__name__}: {error}', FAILURE_PERIOD)

    def _on_failure(self, error: Exception) -> None:
        on_ros_thread(self, self.callback_failed, error)

    def start(self) -> None:
        """Begin to look."""
        self._age.refresh()
        self.status.set(WARN, 'no picture yet')
        if self._source:
            self._thread = threading.Thread(target=self._read, name='source', daemon=True)
            self._thread.start()
            if is_device(self._source):
                repeat(self, 0.5, self._check_age)
            return
        repeat(self, 0.5, self._check_age)
        if self._camera is None:
            subscribe(self, CameraInfo, 'camera/camera_info', self._on_info, SENSOR)
        self._subscribe(SENSOR)

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

    # Where pictures come from.

    def _on_info(self, message: CameraInfo) -> None:
        try:
            lens = Lens.from_info(message)
        except LensError as error:
            self._camera, self._info_problem = None, str(error)
            return
        before = self._camera.lens if self._camera else None
        if before is None or before.size != lens.size or not (
                np.array_equal(before.matrix, lens.matrix)
                and np.array_equal(before.distortion, lens.distortion)):
            self._camera = self._make_camera(lens)

    def _on_image(self, message: Image) -> None:
        now = monotonic()
        self._age.refresh()
        if now - self._taken < 0.9 / self.parameters['camera.rate']:
            return
        self._taken = now
        delay = seconds(self.get_clock().now().to_msg()) - seconds(message.header.stamp)
        if abs(delay) > MAX_AGE:
            self.status.set(ERROR, f'the picture is stamped {delay:.1f} s ago; set the clocks of '
                            'the computers alike (negative: from the future)')
            return
        try:
            self._newest.put((message.header.stamp, grey_picture(message), True))
        except ValueError as error:
            self.status.set(ERROR, str(error))

    def _read(self) -> None:
        """Take pictures from a device, a file or a folder, on a thread of its own."""
        import cv2

        from soft_continuum.sensing.sources import pictures, SourceError
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
                end = WARN, f'{self._source} has no more pictures'
            except (SourceError, OSError, cv2.error) as error:
                end = ERROR, str(error)
            self._worker.call(lambda end=end: self._reports.put((*end, {})))  # after the last one
            if not live:
                return
            self._ending.wait(RETRY)

    # What is seen.

    def _look(self, taken: tuple[Time, Any, bool]) -> None:
        """Measure and publish; on the thread for it."""
        stamp, picture, live = taken
        camera = self._camera
        if camera is None:
            self._reports.put((ERROR, self._info_problem, {}))
            return
        if live and self._is_frozen(picture) and picture.max() > DARK:
            self._reports.put((ERROR, 'the camera has sent the same picture for '
                               f'{FROZEN_AFTER:g} s: it is frozen; restart its driver', {}))
            return
        sight = camera.measure(picture)
        for n, disc in sight.discs.items():
            message = measured_pose_to_ros(disc.pose, disc.covariance)
            message.header.stamp = stamp
            message.header.frame_id = self.parameters['frame_id']
            self._poses[n].publish(message)
        missing = [str(n) for n in range(len(self._poses)) if n not in sight.discs]
        values = {'discs': ' '.join(map(str, sight.discs)),
                  'tags': ' '.join(map(str, sorted(sight.numbers))),
                  'deviation_px': f'{sight.deviation:.3f}'}
        if sight.problems:
            self._reports.put((WARN if sight.discs else ERROR, '; '.join(sight.problems), values))
        elif missing:
            self._reports.put((WARN, f'disc {", ".join(missing)} not seen', values))
        else:
            self._reports.put((OK, 'all discs are seen', values))

    def _is_frozen(self, picture: Any) -> bool:
        checksum, now = zlib.crc32(picture), monotonic()
        if checksum != self._last:
            self._last, self._changed = checksum, now
        return now - self._changed > FROZEN_AFTER

    def _report(self, report: tuple[bytes, str, dict[str, str]]) -> None:
        level, text, values = report
        self.status.set(level, text, **values)

    def _check_age(self) -> None:
        if not self._source:
            self._choose_profile()
        if self._age.seconds > STALE_AFTER:
            source = self._source or self.resolve_topic_name(IMAGES)
            self.status.set(ERROR, f'no picture from {source} for {STALE_AFTER:g} s; is the '
                            'camera plugged in, does its driver run?')
