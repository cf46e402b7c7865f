# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The emergency stop of the suite."""

from collections.abc import Callable

from rclpy.node import Node
from std_msgs.msg import Bool

from soft_continuum.ros.qos import LATCHED, SENSOR, STREAM


class EmergencyStop:
    """
    Subscribes to emergency_stop (std_msgs/Bool): true stops the arm, false allows to resume.

    ROS 2 has no QoS that receives from every publisher and also what was latched before, so the
    topic is subscribed three times: latched, reliable and best effort.
    """

    def __init__(self, node: Node, on_change: Callable[[bool], None] = lambda on: None) -> None:
        """Call ``on_change`` whenever it goes on or off."""
        self.on = False
        self._on_change = on_change
        for profile in (LATCHED, STREAM, SENSOR):
            node.create_subscription(Bool, 'emergency_stop', self._on_message, profile)

    def _on_message(self, message: Bool) -> None:
        if message.data != self.on:
            self.on = message.data
            self._on_change(self.on)
