# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The twin's camera on ROS topics, in a process of its own: to draw takes most of a core."""

from geometry_msgs.msg import PoseArray
import numpy as np
from sensor_msgs.msg import CameraInfo, Image

from soft_continuum.client.connection import Connection
from soft_continuum.ros.conversions import poses_from_ros
from soft_continuum.ros.entry import subscribe
from soft_continuum.ros.pictures import grey_message
from soft_continuum.ros.qos import SENSOR, STREAM
from soft_continuum.twin.camera import Array, TwinCamera

FRAME = 'simulated_camera'


class Pictures:
    """Publishes camera/image_raw and camera/camera_info, drawn from twin/disc_poses."""

    def __init__(self, connection: Connection, camera: TwinCamera, rate: float) -> None:
        """Use a connection; rate: Hz."""
        self._connection, self._camera, self._rate = connection, camera, rate
        self._discs: PoseArray | None = None

    def start(self) -> None:
        """Begin to publish."""
        self._connection.requests.start(self._begin()).result()

    async def _begin(self) -> None:
        node = self._connection.node
        self._images = node.create_publisher(Image, 'camera/image_raw', STREAM)
        self._infos = node.create_publisher(CameraInfo, 'camera/camera_info', STREAM)
        subscribe(node, PoseArray, 'twin/disc_poses', self._on_discs, SENSOR)
        node.create_timer(1.0 / self._rate, self._publish)

    def _on_discs(self, message: PoseArray) -> None:
        self._discs = message

    def _publish(self) -> None:
        if self._discs is None:
            return
        message, self._discs = self._discs, None
        image = grey_message(self._camera.picture(planar(poses_from_ros(message)[::2])))
        lens = self._camera.lens
        info = CameraInfo(width=lens.size[0], height=lens.size[1], distortion_model='plumb_bob',
                          d=lens.distortion.tolist(), k=lens.matrix.ravel())
        info.p = np.hstack([lens.matrix, np.zeros((3, 1))]).ravel()
        info.r = np.eye(3).ravel()
        for item in (image, info):
            item.header.stamp, item.header.frame_id = message.header.stamp, FRAME
        self._infos.publish(info)
        self._images.publish(image)


def planar(poses: Array) -> Array:
    """Return poses (k, 7) in the plane of the arm as x, z and angle about y, (k, 3)."""
    angles = 2.0 * np.arctan2(poses[:, 4], poses[:, 6])
    return np.column_stack([poses[:, 0], poses[:, 2], angles])
