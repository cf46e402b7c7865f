# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Drawing of obstacles with Matplotlib."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import scipy

from soft_continuum.colours import OBSTACLE
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.drawing import circle, IN_SPACE
from soft_continuum.planning.obstacles.mesh import Mesh
from soft_continuum.planning.obstacles.obstacle import Obstacle
from soft_continuum.planning.obstacles.shapes import Box, Capsule, Sphere

ROUND = 24  # corners of a circle
OBSTACLE_COLOUR = tuple(channel / 255 for channel in OBSTACLE)
FLAT_OPACITY, OPACITY = 0.5, 0.2


def draw_obstacles(axes: Any, obstacles: Iterable[Obstacle], reach: float | None = None) -> None:
    """
    Draw obstacles into axes in mm, in 3d or behind an arm seen along y.

    reach: m; flat axes then show obstacles within it of the arm; without it their limits stay.
    """
    if axes.name == IN_SPACE:
        if triangles := faces(obstacles):
            corners = np.vstack(triangles)
            axes.plot_trisurf(*corners.T, triangles=np.arange(len(corners)).reshape(-1, 3),
                              color=OBSTACLE_COLOUR, alpha=OPACITY)
    elif polygons := outlines(obstacles):
        from matplotlib.collections import PolyCollection
        axes.add_collection(PolyCollection(
            polygons, facecolor=OBSTACLE_COLOUR, alpha=FLAT_OPACITY, edgecolor='none', zorder=0.5),
            autolim=False)
        if reach is not None:
            axes.update_datalim(np.clip(np.vstack(polygons), -1e3 * reach, 1e3 * reach))
            axes.autoscale_view()


def outlines(obstacles: Iterable[Obstacle]) -> list[Array]:
    """Return obstacles projected along y: polygons (n, 2), x and z, mm."""
    return [_outline(part[:, ::2]) for one in obstacles for part in _convex_parts(one)]


def faces(obstacles: Iterable[Obstacle]) -> list[Array]:
    """Return the triangles of the surfaces of obstacles, (3, 3) each, mm."""
    return [points[s] for one in obstacles for points in _convex_parts(one)
            for s in ([[0, 1, 2]] if len(points) == 3
                      else scipy.spatial.ConvexHull(points).simplices)]


def _convex_parts(obstacle: Obstacle) -> list[Array]:
    """Return the points of convex parts of an obstacle, (n, 3), mm."""
    shape, place = obstacle.shape, np.array(obstacle.position)
    if isinstance(shape, Mesh):
        parts = list(np.asarray(shape.vertices)[shape.triangles])
    elif isinstance(shape, Box):
        parts = [np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5)
                           for z in (-0.5, 0.5)]) * shape.size]
    else:
        corners = circle(ROUND, endpoint=False)
        ball = np.vstack([np.cos(t) * corners + [0.0, 0.0, np.sin(t)]
                          for t in np.linspace(-np.pi / 2, np.pi / 2, ROUND // 2)])
        if isinstance(shape, Sphere):
            parts = [shape.radius * ball]
        else:
            edge = shape.radius * (ball if isinstance(shape, Capsule) else corners)
            half = np.array([0.0, 0.0, shape.length / 2])
            parts = [np.vstack([edge - half, edge + half])]
    return [1e3 * (part @ obstacle.rotation.T + place) for part in parts]


def _outline(points: Array) -> Array:
    """Return the corners of the convex hull of points in a plane, in their order."""
    if len(points) == 3:
        return points
    outline: Array = points[scipy.spatial.ConvexHull(points).vertices]
    return outline
