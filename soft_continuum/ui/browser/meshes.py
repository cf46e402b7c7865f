# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Points of shapes, and vertices of 3-D tubes, lines and outlines for the scene."""

from collections.abc import Sequence

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Chain
from soft_continuum.mechanics.directions import bending_vectors

SIDES = 32  # of a tube
PIECES = 6  # of an edge of a segment
Points = tuple[tuple[float, ...], ...]
"""x, y, z of some points, m."""


def points_of(chain: Chain, angles: Sequence[float], directions: Sequence[float] = ()
              ) -> Points:
    """Return points of a shape with bending angles and directions, rad; none for 0."""
    shape = chain.uniform(bending_vectors(chain.arm, angles, directions))
    return tuple(tuple(point) for point in np.vstack([np.zeros(3), shape.backbone]).tolist())


def tube(points: Array, frames: Array, radii: Array, sides: int = SIDES) -> Array:
    """
    Return the vertices (rings * sides, 3), m, of a tube around points (rings, 3), m.

    frames: (rings, 3, 3), whose z is along the tube.  radii: (rings,), m.
    """
    around = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)
    across = np.stack([np.cos(around), np.sin(around)], axis=1)
    rings = np.einsum('rij,kj->rki', frames[:, :, :2], across)
    vertices: Array = (points[:, None] + radii[:, None, None] * rings).reshape(-1, 3)
    return vertices


def tube_faces(rings: int, sides: int = SIDES) -> Array:
    """Return the triangles (k, 3) of such a tube, seen from outside."""
    ring, side = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing='ij')
    a = (ring * sides + side).ravel()
    b = (ring * sides + (side + 1) % sides).ravel()
    return np.concatenate([np.stack([a, b, a + sides], axis=1),
                           np.stack([b, b + sides, a + sides], axis=1)])


def repeated(triangles: Array, count: int) -> Array:
    """Return the triangles of ``count`` equal tubes whose vertices are one after another."""
    vertices = int(triangles.max()) + 1
    return np.concatenate([triangles + k * vertices for k in range(count)])


def sampled(values: Array, stations: Array) -> Array:
    """Return values (k, ...) at stations (n,) from 0 to k - 1, linear in between, (n, ...)."""
    lower = np.minimum(stations.astype(int), len(values) - 2)
    part = (stations - lower).reshape(-1, *[1] * (values.ndim - 1))
    found: Array = (1.0 - part) * values[lower] + part * values[lower + 1]
    return found


def frames_along(points: Array) -> Array:
    """Return frames (k, 3, 3) whose z is along points (k, 3); each has the least rotation.

    The rotation from one direction to the next is the product of two reflections.
    """
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    frames, frame, before = np.empty((len(points), 3, 3)), np.eye(3), np.array([0.0, 0.0, 1.0])
    for k, now in enumerate(along):
        middle = before + now
        if (square := float(middle @ middle)) > 1e-12 and now.any():  # else it turns back, rests
            for mirror, length in ((before, 1.0), (middle, square)):
                frame = frame - 2.0 / length * np.outer(mirror, mirror @ frame)
            before = now
        frames[k] = frame
    return frames


def dashes(points: Array, count: int) -> Array:
    """Return a line through points (k, 3) as ``count`` dashes a span, (pieces, 2, 3)."""
    steps = np.linspace(0.0, 1.0, 2 * count)[:, None, None]
    fine = points[:-1] + steps * (points[1:] - points[:-1])
    pieces: Array = np.stack([fine[:-1:2], fine[1::2]], axis=2).reshape(-1, 2, 3)
    return pieces


def line(points: Array) -> Array:
    """Return a line through points (k, 3) as its pieces, (k - 1, 2, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1)


def rectangle(bottom: Array, up: Array, across: Array) -> Array:
    """Return the four edges (4, 2, 3) of a rectangle from ``bottom``, to both sides and ``up``."""
    corners = bottom + np.array([-across, across, across + up, -across + up])
    edges: Array = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    return edges


def curve(places: Array, directions: Array) -> Array:
    """Return a smooth line (k, 3) between places (2, 3) that leaves and arrives in directions."""
    t = np.linspace(0.0, 1.0, PIECES + 1)[:, None]
    (lower, upper), chord = places, np.linalg.norm(places[1] - places[0])
    found: Array = (
        (2 * t**3 - 3 * t**2 + 1) * lower + (t**3 - 2 * t**2 + t) * chord * directions[0]
        + (3 * t**2 - 2 * t**3) * upper + (t**3 - t**2) * chord * directions[1])
    return found
