# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The ghost of the target shape, for visualization."""

from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Chain
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.nodes.markers import target_markers
from soft_continuum.ros.qos import LATCHED
from soft_continuum.sequencing.plans import Shape


class Ghost:
    """Publishes target_markers (visualization_msgs/MarkerArray, latched)."""

    def __init__(self, node: Node, arm: Arm, frame: str) -> None:
        """Remove any ghost of an earlier process."""
        self._node, self._arm, self._frame = node, arm, frame
        self._shape: Shape | None = None
        self._publisher = node.create_publisher(MarkerArray, 'target_markers', LATCHED)
        self._publish()

    def show(self, shape: Shape | None) -> None:
        """Show a shape, with its angles, or none."""
        if shape != self._shape:
            self._shape = shape
            self._publish()

    def _publish(self) -> None:
        shape = self._shape
        target = None if shape is None else Chain(self._arm).uniform(
            bending_vectors(self._arm, shape.bending_angles, shape.bending_directions))
        self._publisher.publish(target_markers(
            target, self._frame, self._node.get_clock().now().to_msg()))
