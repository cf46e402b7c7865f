# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a node reports of itself: a status for people, a typed state for other nodes."""

from copy import deepcopy
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from soft_continuum.ros.qos import LATCHED

LOG_PERIOD = 1.0  # s between two log lines of the same severity

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Status:
    """Reports how a node is, to people: latched on ``~/status``, and 1 Hz on /diagnostics."""

    def __init__(self, node: Node, hardware_id: str) -> None:
        """Create the two publishers and the timer of ``node``."""
        self._message = DiagnosticStatus(
            name=node.get_fully_qualified_name().lstrip('/'), hardware_id=hardware_id)
        self._node = node
        self._logged = float('-inf')
        self._publisher = node.create_publisher(DiagnosticStatus, '~/status', LATCHED)
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._timer = node.create_timer(
            1.0, self._publish_diagnostics, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def set(self, level: bytes, message: str, **values: object) -> None:
        """
        Update the status and publish it if it changed; for the thread of ROS.

        level: OK, WARN or ERROR.  values: shown as they print.
        """
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        if (self._message.level, self._message.message, self._message.values) == (
                level, message, pairs):
            return
        now = time.monotonic()
        changed = (level, message) != (self._message.level, self._message.message)
        if changed and (level != self._message.level or now - self._logged > LOG_PERIOD):
            self._logged = now
            logger = self._node.get_logger()
            # Separate calls: rclpy ties a severity to the calling line.
            if level == ERROR:
                logger.error(message)
            elif level == WARN:
                logger.warning(message)
            else:
                logger.info(message)
        self._message.level, self._message.message = level, message
        self._message.values = pairs
        self._publisher.publish(self._message)

    def _publish_diagnostics(self) -> None:
        array = DiagnosticArray(status=[self._message])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(array)


class StatePublisher:
    """Publishes a typed state latched on ``~/state``, whenever more than its stamp changes."""

    def __init__(self, node: Node, message_type: Any) -> None:
        """Create the publisher of ``node``."""
        self._node = node
        self._publisher = node.create_publisher(message_type, '~/state', LATCHED)
        self._last: Any = None

    def publish(self, message: Any) -> None:
        """Publish ``message``, whose stamp is still zero, if it differs from the last one."""
        if message == self._last:
            return
        self._last = deepcopy(message)
        message.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)
