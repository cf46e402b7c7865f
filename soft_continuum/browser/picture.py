# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The camera image with the modelled arm overlaid, while a browser shows it."""

from base64 import b64encode
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import CompressedImage

from soft_continuum.ros.entry import subscribe
from soft_continuum.ros.names import OVERLAY
from soft_continuum.ros.qos import SENSOR
from soft_continuum.ros.ros_time import Age

MAX_BYTES = 1_000_000
JPEG = b'\xff\xd8\xff'
STALE_AFTER = 2.0  # s


class CameraPicture:
    """Subscribes only while the image is shown, so that it is drawn only on demand."""

    def __init__(self, node: Node) -> None:
        """Start without a subscription."""
        self._node = node
        self._subscription: Any = None
        self._data, self._age = b'', Age()

    def look(self, on: bool) -> None:
        """Start or stop the subscription; on the thread that spins the node."""
        if on and self._subscription is None:
            self._subscription = subscribe(self._node, CompressedImage, OVERLAY, self._on_picture,
                                           SENSOR, MAX_BYTES)
        elif not on and self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _on_picture(self, message: CompressedImage) -> None:
        data = bytes(message.data)
        if data.startswith(JPEG):
            self._data = data
            self._age.refresh()

    @property
    def address(self) -> str:
        """The last image as a data URL; empty if none was received for two seconds."""
        if self._age.seconds > STALE_AFTER:
            return ''
        return f'data:image/jpeg;base64,{b64encode(self._data).decode("ascii")}'
