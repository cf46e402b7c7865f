# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Version, computer and arm of a node, on a topic and a service."""

from collections.abc import Mapping
from dataclasses import dataclass
import socket
from struct import unpack_from
from typing import Any, Self
from uuid import uuid4

from rclpy.serialization import deserialize_message

from soft_continuum import version
from soft_continuum.parameters.arm import description_digest
from soft_continuum.ros.conversions import seconds
from soft_continuum.ros.entries import guarded, repeat
from soft_continuum.ros.names import GET_NODE_INFO, HEARTBEAT
from soft_continuum.ros.qos import STREAM
from soft_continuum.ros.ros_time import stamp_of
from soft_continuum.text import plain, printable
from soft_continuum_interfaces import srv
from soft_continuum_interfaces.msg import Heartbeat

PERIOD = 0.2  # s between two signs of life
MAX_CONFLICT = 500  # characters of a conflict that another node notices


@dataclass(frozen=True)
class NodeInfo:
    """
    Information about a node, published five times a second on ``~/heartbeat``.

    description: parameters.arm.description_digest.  time: its ROS time, s.
    """

    process: str
    version: str = ''
    description: str = ''
    host: str = ''
    time: float = 0.0
    conflict: str = ''

    @classmethod
    def own(cls, parameters: Mapping[str, Any]) -> Self:
        """Return the information of a node of this process with these parameters."""
        return cls(uuid4().hex, version(), description_digest(parameters), socket.gethostname())

    def to_ros(self, time: float) -> Heartbeat:
        """Return a message sent at a ROS time, s."""
        return Heartbeat(
            stamp=stamp_of(time), process=self.process, host=self.host, version=self.version,
            description=self.description, conflict=self.conflict)

    @classmethod
    def from_ros(cls, message: Heartbeat) -> Self:
        """Read a message."""
        return cls(plain(message.process), plain(message.version), plain(message.description),
                   plain(message.host), seconds(message.stamp),
                   printable(message.conflict, MAX_CONFLICT))


class HeartbeatReader:
    """
    Reads serialized heartbeats of one topic.

    Most equal the last one but for their stamp; of those only the stamp, which comes first, is
    converted: a heartbeat is received some 80 times a second by the nodes of an arm at rest.
    """

    def __init__(self) -> None:
        """Start without a heartbeat."""
        self._content, self._info = (b'', b''), NodeInfo('')

    def __call__(self, data: bytes, _: Any = None) -> tuple[NodeInfo, float]:
        """Return the last information, and the time of this message, s."""
        encoding, content = data[:4], (data[:4], data[12:])
        if content != self._content:
            self._info = NodeInfo.from_ros(deserialize_message(data, Heartbeat))
            self._content = content
        sec, nanosec = unpack_from('<iI' if encoding[1] & 1 else '>iI', data, 4)
        return self._info, sec + nanosec * 1e-9


class NodeInfoPublisher:
    """Publishes the NodeInfo of a node as ~/heartbeat, and serves ~/get_node_info."""

    def __init__(self, node: Any, parameters: Mapping[str, Any]) -> None:
        """Begin; parameters: of the node."""
        self.own = NodeInfo.own(parameters)
        self._node = node
        self._publisher = node.create_publisher(Heartbeat, HEARTBEAT, STREAM)
        answer = guarded(node, self._answer)
        node.create_service(srv.GetNodeInfo, GET_NODE_INFO,
                            lambda _, response: answer(response) or response)
        repeat(node, PERIOD, self._publish)

    @property
    def time(self) -> float:
        """ROS time of the node, s."""
        return float(self._node.get_clock().now().nanoseconds * 1e-9)

    def _publish(self) -> None:
        self._publisher.publish(self.own.to_ros(self.time))

    def _answer(self, response: srv.GetNodeInfo.Response) -> srv.GetNodeInfo.Response:
        response.host, response.version = self.own.host, self.own.version
        response.description = self.own.description
        response.stamp = self._node.get_clock().now().to_msg()
        return response
