# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The obstacles of a node: from its file, and as changed by the topic."""

from collections.abc import Callable, Mapping
from pathlib import Path
from time import monotonic
from typing import Any

from rclpy.node import Node
from visualization_msgs.msg import Marker, MarkerArray

from soft_continuum.mechanics.arm import Arm
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.planning.obstacles import CollisionScene, Mesh, Obstacle, ObstacleError
from soft_continuum.planning.obstacles.files import load_obstacles, MAX_OBSTACLES
from soft_continuum.planning.obstacles.mesh import MAX_TRIANGLES
from soft_continuum.ros.conversions import seconds
from soft_continuum.ros.entries import LATCHED, LOG_PERIOD, OBSTACLES, repeat, subscribe, wake
from soft_continuum.ros.obstacles import (
    is_decoration,
    Key,
    MAX_MARKER_BYTES,
    name_of,
    obstacle_from_ros,
    obstacle_to_ros,
    REFUSED,
)
from soft_continuum.text import MAX_NAME, printable

EXPIRY_PERIOD = 0.1  # s between two looks at whether a lifetime is over


class KnownObstacles:
    """
    The obstacles around an arm.

    Subscribes to obstacles (visualization_msgs/MarkerArray): ADD and MODIFY, DELETE, DELETEALL (of
    a namespace if there is one), in the order of the markers; a lifetime ends an obstacle.  A
    message with anything wrong changes nothing.  Publishes known_obstacles, latched: all that are
    known, after a DELETEALL.  All on the thread that spins the node.
    """

    def __init__(self, node: Node, arm: Arm, parameters: Mapping[str, Any],
                 on_change: Callable[[], None]) -> None:
        """
        Read the file of the parameter obstacles.file.

        on_change: called after the obstacles, or why some were refused, have changed.  Raises
        ParameterError for a file that cannot be used.
        """
        self._node, self._arm, self._on_change = node, arm, on_change
        self._frame: str = parameters['frame_id']
        self._known: dict[Key, Obstacle] = {}
        self._ends: dict[Key, float] = {}  # of those with a lifetime: when, s (steady)
        self._refused = 0
        self._refusal = ''
        try:
            if path := parameters['obstacles.file']:
                self._known = {(one.name, 0): one
                               for one in load_obstacles(Path(path).expanduser())}
            self._scene = self._around(self._known)
        except ObstacleError as error:
            raise ParameterError(f'parameter obstacles.file: {error}') from None
        self._publisher = node.create_publisher(MarkerArray, 'known_obstacles', LATCHED)
        self._publish()
        subscribe(node, MarkerArray, 'obstacles', self._on_markers, OBSTACLES, MAX_MARKER_BYTES)
        self._expiry = repeat(node, EXPIRY_PERIOD, self._expire)  # only while one has a lifetime

    @property
    def scene(self) -> CollisionScene:
        """The present scene; a new object after every change."""
        return self._scene

    @property
    def report(self) -> dict[str, str]:
        """Values for ~/status."""
        values = {'obstacles': str(len(self._known))}
        if self._refused:
            values[REFUSED] = f'{self._refused}, the last one: {self._refusal}'
        return values

    def _on_markers(self, message: MarkerArray) -> None:
        try:
            known, ends = dict(self._known), dict(self._ends)
            for marker in message.markers:
                self._apply(marker, known, ends)
            if known != self._known:
                self._set(known)
            self._ends = ends
            if ends:
                wake(self._expiry)
        except ObstacleError as error:
            self._refused += 1
            self._refusal = str(error)
            self._node.get_logger().warning(f'obstacles refused: {error}',
                                            throttle_duration_sec=LOG_PERIOD)
            self._on_change()

    def _apply(self, marker: Marker, known: dict[Key, Obstacle], ends: dict[Key, float]) -> None:
        """Do what a marker asks for; raises ObstacleError."""
        key = marker.ns, marker.id
        if marker.action == Marker.DELETEALL:
            for gone in [one for one in known if marker.ns in ('', one[0])]:
                del known[gone]
                ends.pop(gone, None)
        elif marker.action == Marker.DELETE:
            known.pop(key, None)
            ends.pop(key, None)
        elif marker.action != Marker.ADD:
            raise ObstacleError(f'{printable(name_of(key), MAX_NAME)}: action is {marker.action}; '
                                f'allowed: {Marker.ADD} (ADD), {Marker.DELETE} (DELETE), '
                                f'{Marker.DELETEALL} (DELETEALL)')
        elif not is_decoration(marker):
            try:
                obstacle = obstacle_from_ros(marker, self._frame)
            except ObstacleError as error:
                raise ObstacleError(f'{printable(name_of(key), MAX_NAME)}: {error}') from None
            known[key] = obstacle
            ends.pop(key, None)
            if (lifetime := seconds(marker.lifetime)) > 0.0:
                ends[key] = monotonic() + lifetime
            if len(known) > MAX_OBSTACLES:
                raise ObstacleError(f'{len(known)} obstacles; allowed: {MAX_OBSTACLES}. Remove '
                                    'some, or give larger shapes around several')

    def _expire(self) -> None:
        if not self._ends:
            self._expiry.cancel()
        gone = {key for key, end in self._ends.items() if end <= monotonic()}
        if gone:
            self._ends = {key: end for key, end in self._ends.items() if key not in gone}
            self._set({key: one for key, one in self._known.items() if key not in gone})

    def _set(self, known: dict[Key, Obstacle]) -> None:
        """Take other obstacles; raises ObstacleError and changes nothing where they cannot be."""
        self._scene = self._around(known)
        self._known = known
        self._publish()
        self._on_change()

    def _around(self, known: Mapping[Key, Obstacle]) -> CollisionScene:
        triangles = sum(len(one.shape.triangles) for one in known.values()
                        if isinstance(one.shape, Mesh))
        if triangles > MAX_TRIANGLES:
            raise ObstacleError(f'the meshes have {triangles} triangles in all; allowed: '
                                f'{MAX_TRIANGLES}. Simplify them, for instance with MeshLab')
        return CollisionScene(self._arm, known.values())

    def _publish(self) -> None:
        stamp = self._node.get_clock().now().to_msg()
        clear = Marker(action=Marker.DELETEALL)
        clear.header.frame_id, clear.header.stamp = self._frame, stamp
        self._publisher.publish(MarkerArray(markers=[clear, *(
            marker for key, one in self._known.items()
            for marker in obstacle_to_ros(key, one, self._frame, stamp))]))
