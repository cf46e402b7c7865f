# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The arm and its target shape as markers for RViz and Foxglove."""

from collections.abc import Sequence
from textwrap import fill

from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point
import numpy as np
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from soft_continuum.colours import (
    Colour,
    DISC,
    GHOST,
    GHOST_OPACITY,
    PREDICTED,
    segment_colour,
    tension_colour,
    WRONG,
)
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.planning.plans import Shape
from soft_continuum.ros.entries import LATCHED

LIFETIME = Duration(nanosec=500_000_000)
"""Lifetime of temporary markers: they disappear when no longer published."""
TEXT_HEIGHT, TEXT_WIDTH = 0.012, 60  # m, characters


def shape_markers(chain: Chain, state: Equilibrium, stiff: Sequence[bool | None],
                  tension_limit: float, frame: str, stamp: Time) -> MarkerArray:
    """
    Return a line strip for every segment and tendon and a cylinder for every disc.

    stiff: per segment, None if unknown.  tension_limit: N, end of the colour scale.
    """
    backbone, poses = state.backbone, state.poses
    markers = []
    for s in range(chain.segments):
        first = s * chain.joints_per_segment
        marker = _marker('segments', s, Marker.LINE_STRIP, segment_colour(stiff[s]), frame, stamp)
        marker.scale.x = chain.arm.segments[s].outer_diameter / 4
        marker.points = _points(backbone[first:first + chain.joints_per_segment])
        markers.append(marker)
    for k, radius in enumerate(chain.disc_radii.tolist()):
        marker = _marker('discs', k, Marker.CYLINDER, DISC, frame, stamp)
        p, q = marker.pose.position, marker.pose.orientation
        p.x, p.y, p.z = poses[2 * k:2 * k + 2, :3].mean(axis=0).tolist()
        q.x, q.y, q.z, q.w = poses[2 * k, 3:].tolist()
        marker.scale.x = marker.scale.y = 2 * radius
        marker.scale.z = chain.arm.discs[k].height
        markers.append(marker)
    for t, (tension, guides) in enumerate(zip(state.tensions, state.tendon_points, strict=True)):
        colour = tension_colour(tension, tension_limit)
        marker = _marker('tendons', t, Marker.LINE_STRIP, colour, frame, stamp)
        marker.scale.x = 0.002
        marker.points = _points(guides)
        markers.append(marker)
    return MarkerArray(markers=markers)


def target_markers(target: Equilibrium | None, frame: str, stamp: Time) -> MarkerArray:
    """Return the ghost of the target shape; without one, its removal."""
    if target is None:
        marker = _marker('target', 0, Marker.LINE_STRIP, GHOST, frame, stamp)
        marker.action = Marker.DELETE
    else:
        marker = _ghost('target', target, GHOST, frame, stamp)
    return MarkerArray(markers=[marker])


def prediction_marker(predicted: Equilibrium, frame: str, stamp: Time) -> Marker:
    """Return the ghost of the shape that the model alone predicts."""
    marker = _ghost('prediction', predicted, PREDICTED, frame, stamp)
    marker.lifetime = LIFETIME
    return marker


def alarm_marker(alarms: Sequence[str], height: float, frame: str, stamp: Time) -> Marker:
    """Return the anomalies as a text marker; height: m above the base."""
    marker = _marker('alarms', 0, Marker.TEXT_VIEW_FACING, WRONG, frame, stamp)
    marker.lifetime = LIFETIME
    marker.text = '\n'.join(fill(alarm, TEXT_WIDTH) for alarm in alarms)
    marker.scale.z = TEXT_HEIGHT
    marker.pose.position.z = height + TEXT_HEIGHT * marker.text.count('\n')  # of its middle
    return marker


def _ghost(namespace: str, state: Equilibrium, colour: Colour, frame: str, stamp: Time) -> Marker:
    marker = _marker(namespace, 0, Marker.LINE_STRIP, colour, frame, stamp)
    marker.color.a = GHOST_OPACITY
    marker.scale.x = 0.3 * state.chain.arm.segments[0].outer_diameter
    marker.points = _points(np.vstack([np.zeros(3), state.backbone]))
    return marker


def _marker(namespace: str, number: int, kind: int, colour: Colour, frame: str, stamp: Time
            ) -> Marker:
    r, g, b = (channel / 255 for channel in colour)
    marker = Marker(ns=namespace, id=number, type=kind, action=Marker.ADD,
                    color=ColorRGBA(r=r, g=g, b=b, a=1.0))
    marker.header.frame_id, marker.header.stamp = frame, stamp
    marker.pose.orientation.w = 1.0
    return marker


def _points(rows: Array) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in rows.tolist()]


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
