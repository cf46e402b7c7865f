# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The arm as markers for RViz: backbone, discs and tendons."""

from collections.abc import Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
import numpy as np
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from soft_continuum.mechanics.chain import Array, Equilibrium, LEFT, orientation, RIGHT, RigidChain

STIFF = ColorRGBA(r=0.25, g=0.25, b=0.28, a=1.0)
SOFT = ColorRGBA(r=0.95, g=0.60, b=0.15, a=1.0)
DISC = ColorRGBA(r=0.75, g=0.78, b=0.82, a=1.0)
TAUT = ColorRGBA(r=0.80, g=0.10, b=0.10, a=1.0)
SLACK = ColorRGBA(r=0.55, g=0.55, b=0.60, a=0.6)


def shape_markers(chain: RigidChain, state: Equilibrium, stiff: Sequence[bool | None],
                  frame: str, stamp: Time) -> MarkerArray:
    """Return line strips of every segment and tendon and a cylinder for every disc."""
    backbone = chain.backbone(state.joint_angles)
    points = chain.points(state.joint_angles)
    guides = chain.guide_points(state.joint_angles)
    markers = MarkerArray()

    def add(namespace: str, number: int, kind: int, color: ColorRGBA) -> Marker:
        marker = Marker(ns=namespace, id=number, type=kind, action=Marker.ADD, color=color)
        marker.header.frame_id, marker.header.stamp = frame, stamp
        marker.pose.orientation.w = 1.0
        markers.markers.append(marker)
        return marker

    for s, segment in enumerate(chain.arm.segments):
        first = s * chain.joints_per_segment
        marker = add('segments', s, Marker.LINE_STRIP, STIFF if stiff[s] else SOFT)
        marker.scale.x = segment.outer_diameter / 4
        marker.points = _points(backbone[first:first + chain.joints_per_segment, :2])
    for k, disc in enumerate(chain.arm.discs):
        marker = add('discs', k, Marker.CYLINDER, DISC)
        x, z = points[2 * k:2 * k + 2, :2].mean(axis=0)
        marker.pose.position.x, marker.pose.position.z = float(x), float(z)
        q = marker.pose.orientation
        q.x, q.y, q.z, q.w = orientation(float(points[2 * k, 2]))
        radius = chain.guides[max(0, k - 1):k + 1].max()
        marker.scale.x = marker.scale.y = float(2 * radius)
        marker.scale.z = disc.height
    for t in (RIGHT, LEFT):
        marker = add('tendons', t, Marker.LINE_STRIP, TAUT if state.tensions[t] > 0 else SLACK)
        marker.scale.x = 0.002
        marker.points = _points(guides[t])
    return markers


def _points(rows: Array) -> list[Point]:
    return [Point(x=float(x), z=float(z)) for x, z in np.asarray(rows)]
