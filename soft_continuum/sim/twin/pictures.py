# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The twin's camera on ROS topics, in a separate process: drawing takes most of a core."""

from geometry_msgs.msg import PoseArray
import numpy as np
from sensor_msgs.msg import CameraInfo, Image

from soft_continuum.ros.conversions import grey_message, poses_from_ros, seconds
from soft_continuum.ros.entries import subscribe_unguarded
from soft_continuum.ros.names import CAMERA, TWIN
from soft_continuum.ros.qos import SENSOR, STREAM
from soft_continuum.sim.twin.camera import TwinCamera
from soft_continuum.sim.twin.publisher import DISC_POSES, Publisher

FRAME = 'simulated_{}'


class Pictures(Publisher):
    """Publishes images, drawn from twin/disc_poses, and the calibration of a camera."""

    def __init__(self, camera: TwinCamera, rate: float, namespace: str = '',
                 name: str = CAMERA) -> None:
        """
        Make the node twin_NAME, which publishes NAME/image_raw and NAME/camera_info.

        rate: Hz.  Raises ClientError, as Publisher does.
        """
        super().__init__(f'{TWIN}_{name}', namespace)
        self._camera, self._rate, self._name = camera, rate, name
        self._discs: PoseArray | None = None

    async def _begin(self) -> None:
        node = self._node
        self._images = node.create_publisher(Image, f'{self._name}/image_raw', STREAM)
        self._infos = node.create_publisher(CameraInfo, f'{self._name}/camera_info', STREAM)
        subscribe_unguarded(node, PoseArray, DISC_POSES, self._on_discs, SENSOR)
        node.create_timer(1.0 / self._rate, self._publish)

    def _on_discs(self, message: PoseArray) -> None:
        self._discs = message

    def _publish(self) -> None:
        if self._discs is None:
            return
        message, self._discs = self._discs, None
        image = grey_message(self._camera.picture(
            poses_from_ros(message)[::2], seconds(message.header.stamp)))
        lens = self._camera.lens
        info = CameraInfo(width=lens.size[0], height=lens.size[1], distortion_model='plumb_bob',
                          d=lens.distortion.tolist(), k=lens.matrix.ravel())
        info.p = lens.projection.ravel()
        info.r = np.eye(3).ravel()
        for item in (image, info):
            item.header.stamp, item.header.frame_id = (
                message.header.stamp, FRAME.format(self._name))
        self._infos.publish(info)
        self._images.publish(image)
