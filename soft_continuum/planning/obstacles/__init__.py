# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Obstacles in base_link and the distance of the arm from them; without ROS.

With obstacles, ``CollisionScene`` needs coal, from the extra ``obstacles``.
"""

from soft_continuum.planning.obstacles.collision_scene import Clearance, CollisionScene
from soft_continuum.planning.obstacles.mesh import Mesh
from soft_continuum.planning.obstacles.obstacle import Obstacle, turned_by
from soft_continuum.planning.obstacles.shapes import Box, Capsule, Cylinder, ObstacleError, Sphere

__all__ = ['Box', 'Capsule', 'Clearance', 'CollisionScene', 'Cylinder', 'Mesh', 'Obstacle',
           'ObstacleError', 'Sphere', 'turned_by']
