# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The emergency stop of the suite."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool

from soft_continuum.nodes.entries import repeat, subscribe
from soft_continuum.ros.qos import LATCHED, SENSOR, STREAM

TOPIC = 'emergency_stop'
PERIOD = 0.1  # s between two looks at who publishes it


class EmergencyStop:
    """
    Subscribes to emergency_stop (std_msgs/Bool): true stops the arm, false allows to resume.

    ROS 2 has no QoS that receives from every publisher and also what was latched before.  So the
    subscription is the best that all present publishers fit.  While one takes the place of
    another, both live, and the old one can only stop.
    """

    def __init__(self, node: Any, on_change: Callable[[bool], None] = lambda on: None) -> None:
        """Call ``on_change`` whenever it goes on or off."""
        self.on = False
        self._node, self._on_change = node, on_change
        self._topic = node.resolve_topic_name(TOPIC)
        self._old: Any = None
        self._begin(SENSOR)
        repeat(node, PERIOD, self._check_now)

    def _begin(self, profile: QoSProfile) -> None:
        self._profile = profile
        self._subscription = subscribe(
            self._node, Bool, TOPIC, partial(self._on_message, profile), profile)

    def _check_now(self) -> None:
        if self._old is not None:
            self._node.destroy_subscription(self._old)
            self._old = None
        present = [info.qos_profile
                   for info in self._node.get_publishers_info_by_topic(self._topic)]
        profile = SENSOR
        if present and all(p.reliability == ReliabilityPolicy.RELIABLE for p in present):
            latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in present)
            profile = LATCHED if latched else STREAM
        if profile is not self._profile:
            self._old = self._subscription
            self._begin(profile)

    def _on_message(self, profile: QoSProfile, message: Bool) -> None:
        if message.data != self.on and (message.data or profile is self._profile):
            self.on = message.data
            self._on_change(self.on)
