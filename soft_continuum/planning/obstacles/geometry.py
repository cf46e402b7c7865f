# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Shapes in coal (https://github.com/coal-library/coal), and distances between them.

Coal is loaded with the first shape: loading takes a moment, and only obstacles need it.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import inf
from typing import Any

import numpy as np

from soft_continuum.extras import needed
from soft_continuum.mechanics.arm import Array
from soft_continuum.planning.obstacles.mesh import Mesh
from soft_continuum.planning.obstacles.obstacle import Obstacle, Shape
from soft_continuum.planning.obstacles.shapes import Box, Capsule, Cylinder, ObstacleError, Sphere

TOLERANCE = 2e-6
"""m subtracted from distances, since coal is accurate to 1e-6."""
MAX_KEPT = 16  # meshes
CONVEX = 1e-5  # of its volume by which the hull of a convex mesh is larger, for its digits


@dataclass(frozen=True)
class PlacedShape:
    """
    A geometry of coal at its pose.

    hull: convex hull for a fast first check; None if the geometry is convex.
    """

    geometry: Any
    hull: Any
    pose: Any


def placed(obstacle: Obstacle) -> PlacedShape:
    """Return an obstacle as a geometry of coal; raises ObstacleError without coal."""
    with needed(ObstacleError):
        import coal
    geometry, hull = _geometry(coal, obstacle.shape)
    return PlacedShape(geometry, hull, coal.Transform3s(
        obstacle.rotation, np.array(obstacle.position, dtype=float)))


def distance(centre: Array, axis: Array, length: float, radius: float, other: PlacedShape,
             most: float = inf) -> float:
    """
    Return the distance of a cylinder from an obstacle, m; negative where they overlap.

    centre: (3,), m.  axis: unit vector (3,).  A distance above ``most`` may be underestimated,
    but not below ``most``.
    """
    import coal
    cylinder = coal.Cylinder(radius, length)
    pose = coal.Transform3s(_frame(axis), centre)
    request = coal.DistanceRequest()
    found = inf
    for geometry in (other.hull, other.geometry):
        if geometry is not None:
            found = coal.distance(cylinder, pose, geometry, other.pose, request,
                                  coal.DistanceResult()) - TOLERANCE
            if found >= most:
                break
    return found


def _geometry(coal: Any, shape: Shape) -> tuple[Any, Any]:
    """Return a shape, and its hull if it is not convex."""
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius), None
    if isinstance(shape, Box):
        return coal.Box(*shape.size), None
    if isinstance(shape, Capsule):  # before Cylinder, of which it is one
        return coal.Capsule(shape.radius, shape.length), None
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length), None
    return _of_mesh(shape)


@lru_cache(maxsize=MAX_KEPT)
def _of_mesh(mesh: Mesh) -> tuple[Any, Any]:
    """Return the same for a mesh, cached: creating it may take a second."""
    import coal
    hull, is_convex = _hull(coal, mesh)
    if is_convex:
        return hull, None
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(mesh.triangles), len(mesh.vertices))
    model.addVertices(np.asarray(mesh.vertices, dtype=float))
    model.addTriangles(np.asarray(mesh.triangles, dtype=np.uint64))
    model.endModel()
    return model, hull


def _hull(coal: Any, mesh: Mesh) -> tuple[Any, bool]:
    """Return the convex hull of a mesh, and whether the mesh is convex."""
    from scipy.spatial import ConvexHull
    points = np.asarray(mesh.vertices, dtype=float)[np.unique(mesh.triangles)]
    hull = ConvexHull(points)
    corners = coal.StdVec_Vec3s()
    for corner in points[hull.vertices]:
        corners.append(corner)
    return (coal.ConvexBase.convexHull(corners, True, 'Qt'),
            hull.volume - abs(mesh.volume) < CONVEX * hull.volume)


def _frame(axis: Array) -> Array:
    """Return any rotation (3, 3) whose z is a unit vector (3,)."""
    x, y, z = axis.tolist()
    if z < 0.0:  # a cylinder has no direction
        x, y, z = -x, -y, -z
    a = 1.0 / (1.0 + z)  # the turn about the axis across z and the vector
    return np.array([[1.0 - a * x * x, -a * x * y, x],
                     [-a * x * y, 1.0 - a * y * y, y],
                     [-x, -y, z]])
