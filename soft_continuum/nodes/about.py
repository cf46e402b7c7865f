# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Which program a node runs, on which computer, for which arm: asked for, and told to all."""

from collections.abc import Mapping
from dataclasses import dataclass
import socket
from typing import Any, Self
from uuid import uuid4

from std_msgs.msg import String

from soft_continuum import version
from soft_continuum.nodes.entries import guarded, repeat
from soft_continuum.parameters.arm import description_digest
from soft_continuum.parameters.scalars import NUMBER
from soft_continuum.ros.names import ABOUT, INSTANCE
from soft_continuum.ros.qos import STREAM
from soft_continuum.ros.text import plain
from soft_continuum_interfaces import srv

PERIOD = 0.2  # s between two signs of life
MAX_CONFLICT = 500  # characters of a conflict that another node notices


@dataclass(frozen=True)
class Instance:
    """
    What a node says of itself: five times a second on ``~/instance``, a line for each.

    process: different for every process.  description: parameters.arm.description_digest.  time:
    its ROS time, s; None where that is not said.  conflict: one that it alone can notice.
    """

    process: str
    version: str = ''
    description: str = ''
    host: str = ''
    time: float | None = None
    conflict: str = ''

    @classmethod
    def own(cls, parameters: Mapping[str, Any]) -> Self:
        """Return what a node of this process with these parameters says."""
        return cls(uuid4().hex, version(), description_digest(parameters), socket.gethostname())

    def to_ros(self, time: float) -> String:
        """Return it as a message that is sent at a ROS time, s."""
        return String(data='\n'.join((
            self.process, self.version, self.description, self.host, f'{time:.6f}',
            self.conflict)))

    @classmethod
    def from_ros(cls, message: String) -> Self:
        """Read a message; versions before 0.2 say only the process."""
        process, of_program, description, host, time, conflict = (
            message.data.split('\n', 6) + [''] * 6)[:6]
        return cls(plain(process), plain(of_program), plain(description), plain(host),
                   float(time[:30]) if NUMBER.fullmatch(time[:30]) else None,
                   plain(conflict, MAX_CONFLICT))


class About:
    """Publishes an Instance for a node, and serves ~/about (soft_continuum_interfaces/About)."""

    def __init__(self, node: Any, parameters: Mapping[str, Any]) -> None:
        """Begin; parameters: of the node."""
        self.own = Instance.own(parameters)
        self._node = node
        self._publisher = node.create_publisher(String, INSTANCE, STREAM)
        answer = guarded(node, self._answer)
        node.create_service(srv.About, ABOUT, lambda _, response: answer(response) or response)
        repeat(node, PERIOD, self._publish)

    @property
    def time(self) -> float:
        """ROS time of the node, s."""
        return float(self._node.get_clock().now().nanoseconds * 1e-9)

    def _publish(self) -> None:
        self._publisher.publish(self.own.to_ros(self.time))

    def _answer(self, response: srv.About.Response) -> srv.About.Response:
        response.host, response.version = self.own.host, self.own.version
        response.description = self.own.description
        response.stamp = self._node.get_clock().now().to_msg()
        return response
