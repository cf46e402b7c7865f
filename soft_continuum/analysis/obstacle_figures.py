# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles in pictures of the arm."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import scipy

from soft_continuum.colours import OBSTACLE
from soft_continuum.mechanics.chain import Array
from soft_continuum.obstacles import Box, Capsule, Mesh, Obstacle, Sphere

ROUND = 24  # corners of a circle
COLOUR = tuple(channel / 255 for channel in OBSTACLE)
FLAT_OPACITY, OPACITY = 0.5, 0.2


def patches(obstacles: Iterable[Obstacle], planar: bool) -> list[Array]:
    """
    Return what draw_patches draws of obstacles, polygons in mm.

    Of a planar arm outlines as seen along y, (n, 2), x and z; else faces, (n, 3).
    """
    parts = [part for one in obstacles for part in _convex_parts(one)]
    if planar:
        return [_outline(part[:, ::2]) for part in parts]
    return [face for part in parts for face in _faces(part)]


def draw_patches(axes: Any, polygons: list[Array], planar: bool) -> None:
    """Draw them, into axes in mm; of a planar arm behind it, and the limits of the axes stay."""
    if planar:
        from matplotlib.collections import PolyCollection
        axes.add_collection(PolyCollection(
            polygons, facecolor=COLOUR, alpha=FLAT_OPACITY, edgecolor='none', zorder=0.5),
            autolim=False)
    elif polygons:
        corners = np.vstack(polygons)
        axes.plot_trisurf(*corners.T, triangles=np.arange(len(corners)).reshape(-1, 3),
                          color=COLOUR, alpha=OPACITY)


def draw_around(axes: Any, obstacles: Iterable[Obstacle], reach: float) -> None:
    """Draw obstacles around a planar arm into axes in mm, which then show those within m of it."""
    if polygons := patches(obstacles, planar=True):
        draw_patches(axes, polygons, planar=True)
        axes.update_datalim(np.clip(np.vstack(polygons), -1e3 * reach, 1e3 * reach))
        axes.autoscale_view()


def _convex_parts(obstacle: Obstacle) -> list[Array]:
    """Return convex parts of an obstacle as points of them, (n, 3), mm."""
    shape, place = obstacle.shape, np.array(obstacle.position)
    if isinstance(shape, Mesh):
        parts = list(np.asarray(shape.vertices)[shape.triangles])
    elif isinstance(shape, Box):
        parts = [np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5)
                           for z in (-0.5, 0.5)]) * shape.size]
    else:
        around = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
        circle = np.column_stack([np.cos(around), np.sin(around), np.zeros(ROUND)])
        up = np.array([0.0, 0.0, 1.0])
        ball = np.vstack([np.cos(t) * circle + np.sin(t) * up
                          for t in np.linspace(-np.pi / 2, np.pi / 2, ROUND // 2)])
        if isinstance(shape, Sphere):
            parts = [shape.radius * ball]
        else:
            edge = shape.radius * (ball if isinstance(shape, Capsule) else circle)
            parts = [np.vstack([edge + side * shape.length / 2 * up for side in (-1.0, 1.0)])]
    return [1e3 * (part @ obstacle.rotation.T + place) for part in parts]


def _outline(points: Array) -> Array:
    """Return the corners of the convex hull of points in a plane, in their order."""
    if len(points) == 3:
        return points
    outline: Array = points[scipy.spatial.ConvexHull(points).vertices]
    return outline


def _faces(points: Array) -> list[Array]:
    """Return the triangles of the convex hull of points in space."""
    return [points] if len(points) == 3 else [
        points[s] for s in scipy.spatial.ConvexHull(points).simplices]
