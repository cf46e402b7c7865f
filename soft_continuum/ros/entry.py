# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions that check the size of messages before converting them."""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

MAX_BYTES = 65536
"""Largest size of a message; converting one blocks every thread of a process for up to 0.1 s."""
LOG_PERIOD = 1.0  # s between two log lines of one kind


def subscribe(node: Node, kind: Any, topic: str, callback: Callable[[Any], object],
              qos: QoSProfile | int, max_bytes: int = MAX_BYTES,
              convert: Callable[[bytes, Any], Any] = deserialize_message) -> Any:
    """
    Return a subscription; messages that are too long or malformed are ignored.

    convert: makes what ``callback`` gets, of a serialized message and its kind.
    """
    def on_data(data: bytes) -> None:
        problem = f'{len(data)} bytes; allowed: {max_bytes}'
        if len(data) <= max_bytes:
            try:
                message = convert(data, kind)
            except Exception as error:  # whatever the conversion finds wrong
                problem = str(error)
            else:
                callback(message)
                return
        node.get_logger().warning(f'ignored a message on {topic}: {problem}',
                                  throttle_duration_sec=LOG_PERIOD)

    return node.create_subscription(kind, topic, on_data, qos, raw=True)
