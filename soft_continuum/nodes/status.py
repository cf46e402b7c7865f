# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Reports of a node: a status for people, a typed state for other nodes."""

from copy import copy, deepcopy
from math import inf
import re
import time
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from soft_continuum.ros.entries import LOG_PERIOD, repeat
from soft_continuum.ros.qos import LATCHED

REPEAT_PERIOD = 1.0  # s between two states that are the same
FAILURE_PERIOD = 5.0  # s for which a mistake of the program is shown

NUMBER = re.compile(r'-?\d+\.\d+(e[-+]?\d+)?|-?\d+(?= (?:mm|ms|s|k?Pa|N|%)(?!\w))')
"""Numbers that may change in an otherwise equal status: measured values, not part numbers."""

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Status:
    """Publishes the status of a node: latched on ``~/status``, and at 1 Hz on /diagnostics."""

    def __init__(self, node: Node, hardware_id: str) -> None:
        """Create the two publishers and the timer of ``node``."""
        self._message = DiagnosticStatus(
            name=node.get_fully_qualified_name().lstrip('/'), hardware_id=hardware_id)
        self._node = node
        self._logged: tuple[bytes, str] = OK, ''  # level and kind of the last
        self._log_times: dict[bytes, float] = {}  # by level: when, s (steady)
        self._publisher = node.create_publisher(DiagnosticStatus, '~/status', LATCHED)
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._own: tuple[bytes, str, dict[str, str]] = OK, '', {}
        self._shown = self._own
        self._alarms: dict[str, tuple[str, float]] = {}  # by source: text, monotonic s of its end
        repeat(node, 1.0, self._publish_diagnostics)

    @property
    def message(self) -> str:
        """The present status text."""
        return str(self._message.message)

    def set(self, level: bytes, message: str, **values: object) -> None:
        """
        Update the status and publish it if it changed; for the thread of ROS.

        level: OK, WARN or ERROR.  values: shown as printed.
        """
        self._own = level, message, {key: str(value) for key, value in values.items()}
        self._update()

    def alarm(self, source: str, text: str, seconds: float = inf) -> None:
        """Report an ERROR of ``source`` for so long, or until its ``text`` is empty."""
        if self._alarms.get(source, ('', inf))[0] != text or text and seconds < inf:
            self._alarms[source] = text, time.monotonic() + seconds
            self._update()

    def _update(self) -> None:
        level, message, values = self._own
        alarms = [text for text, end in self._alarms.values() if text and end > time.monotonic()]
        if alarms:
            own = [message] if level != OK else []
            level, message = ERROR, '; '.join([*alarms, *own])
        self._log(level, message)
        if self._shown == (level, message, values):
            return
        self._shown = level, message, values
        self._message.level, self._message.message = level, message
        self._message.values = [
            KeyValue(key=key, value=value) for key, value in values.items()]
        self._publisher.publish(self._message)

    def _log(self, level: bytes, message: str) -> None:
        """Log what changed but for numbers; of what changes faster than LOG_PERIOD, what lasts."""
        now, kind = time.monotonic(), (level, NUMBER.sub('#', message))
        if (kind == self._logged
                or now - self._log_times.get(level, -inf) <= LOG_PERIOD):
            return
        self._logged, self._log_times[level] = kind, now
        logger = self._node.get_logger()
        # Separate calls: rclpy ties a severity to the calling line.
        if level == ERROR:
            logger.error(message)
        elif level == WARN:
            logger.warning(message)
        else:
            logger.info(message)

    def _publish_diagnostics(self) -> None:
        self._update()  # alarms come to their end
        array = DiagnosticArray(status=[self._message])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(array)


class StatePublisher:
    """
    Publishes a typed state latched on ``~/state``, whenever more than its stamp changes.

    It is repeated every second, in case a subscriber received a false one.
    """

    def __init__(self, node: Node, message_type: Any) -> None:
        """Create the publisher of ``node``."""
        self._node = node
        self._publisher = node.create_publisher(message_type, '~/state', LATCHED)
        self._last: Any = None
        self._changed = Time()
        repeat(node, REPEAT_PERIOD, self._send)

    def publish(self, message: Any) -> None:
        """Publish ``message``, whose stamp is still zero, if it has changed."""
        if message != self._last:
            self._last = deepcopy(message)
            self._changed = self._node.get_clock().now().to_msg()
            self._send()

    def _send(self) -> None:
        if self._last is not None:
            message = copy(self._last)
            message.stamp = self._changed
            self._publisher.publish(message)
