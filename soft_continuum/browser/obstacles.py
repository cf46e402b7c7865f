# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles as they are drawn beside the arm."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import viser

from soft_continuum.colours import OBSTACLE, OBSTACLE_OPACITY
from soft_continuum.obstacles import Box, Capsule, Cylinder, Mesh, Obstacle, Sphere
from soft_continuum.ros.obstacles import Key

FOLDER = '/arm/obstacles'


class DrawnObstacles:
    """What is drawn of obstacles in the frame of the base."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Draw nothing yet."""
        self._scene = scene
        self._drawn: Mapping[Key, Obstacle] = {}
        self._handles: list[Any] = []

    def show(self, obstacles: Mapping[Key, Obstacle]) -> None:
        """Draw these and no others."""
        if obstacles is self._drawn:
            return
        self._drawn = obstacles
        for handle in self._handles:
            handle.remove()
        self._handles = [handle for number, obstacle in enumerate(obstacles.values())
                         for handle in self._add(f'{FOLDER}/{number}', obstacle)]

    def _add(self, name: str, obstacle: Obstacle) -> list[Any]:
        scene, shape = self._scene, obstacle.shape
        x, y, z, w = obstacle.orientation
        place = np.array(obstacle.position)
        look: dict[str, Any] = {'opacity': OBSTACLE_OPACITY, 'wxyz': (w, x, y, z),
                                'position': place, 'cast_shadow': False}
        if isinstance(shape, Sphere):
            return [scene.add_icosphere(name, shape.radius, OBSTACLE, **look)]
        if isinstance(shape, Box):
            return [scene.add_box(name, OBSTACLE, shape.size, **look)]
        if isinstance(shape, Mesh):
            return [scene.add_mesh_simple(
                name, np.asarray(shape.vertices, dtype=np.float32), np.asarray(shape.triangles),
                color=OBSTACLE, flat_shading=True, side='double', **look)]
        assert isinstance(shape, Cylinder)
        drawn: list[Any] = [scene.add_cylinder(name, shape.radius, shape.length, OBSTACLE, **look)]
        if isinstance(shape, Capsule):
            along = obstacle.rotation[:, 2] * shape.length / 2
            drawn += [scene.add_icosphere(f'{name}_{end}', shape.radius, OBSTACLE,
                                          **{**look, 'position': place + sign * along})
                      for end, sign in (('below', -1.0), ('above', 1.0))]
        return drawn
