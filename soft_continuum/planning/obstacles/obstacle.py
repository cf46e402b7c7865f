# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An obstacle: a named shape, placed in base_link."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soft_continuum.mechanics._checks import real_array
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.rotations import matrices
from soft_continuum.planning.obstacles.mesh import Mesh
from soft_continuum.planning.obstacles.shapes import Box, Capsule, Cylinder, ObstacleError, Sphere
from soft_continuum.text import MAX_NAME, printable

POSITION_RANGE = 1000.0  # m from base_link
UNIT = 1e-3  # deviation of a quaternion's length from 1
UPRIGHT = (0.0, 0.0, 0.0, 1.0)

Shape = Sphere | Box | Capsule | Cylinder | Mesh


@dataclass(frozen=True)
class Obstacle:
    """
    A shape at a pose in base_link.

    name: unique.  position: of the origin of the shape's frame, (3,), m.
    orientation: of that frame, unit quaternion x, y, z, w, such as from turned_by.
    """

    name: str
    shape: Shape
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = UPRIGHT

    def __post_init__(self) -> None:
        """Raise ObstacleError for an invalid name, shape or pose."""
        if not (isinstance(self.name, str) and self.name.strip() and self.name.isprintable()
                and len(self.name) <= MAX_NAME):
            raise ObstacleError(
                f'the name of an obstacle is {printable(repr(self.name), MAX_NAME)}; give a text '
                f'of up to {MAX_NAME} characters')
        if not isinstance(self.shape, Shape):
            raise ObstacleError(f'obstacle {self.name}: the shape is {type(self.shape).__name__}; '
                                'give a Sphere, Box, Capsule, Cylinder or Mesh')
        check_numbers(f'obstacle {self.name}: position', self.position, 3, POSITION_RANGE, 'm')
        check_numbers(f'obstacle {self.name}: orientation', self.orientation, 4, 1.0 + UNIT)
        if abs(np.linalg.norm(self.orientation) - 1.0) > UNIT:
            raise ObstacleError(f'obstacle {self.name}: orientation is {self.orientation}; '
                                'allowed: a unit quaternion x, y, z, w, such as [0, 0, 0, 1]')

    @property
    def size(self) -> tuple[float, float, float]:
        """Its lengths along x, y and z of its own frame, m."""
        x, y, z = np.ptp(self.shape.bounds, axis=0).tolist()
        return x, y, z

    @property
    def rotation(self) -> Array:
        """Rotation matrix of the shape's frame in base_link, (3, 3)."""
        turn = np.array(self.orientation, dtype=float)
        found: Array = matrices(turn / np.linalg.norm(turn))
        return found


def turned_by(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion of roll, pitch and yaw about fixed x, y, z, rad."""
    (a, b, c), (p, q, r) = np.cos([roll / 2, pitch / 2, yaw / 2]), np.sin(
        [roll / 2, pitch / 2, yaw / 2])
    return (float(p * b * c - a * q * r), float(a * q * c + p * b * r),
            float(a * b * r - p * q * c), float(a * b * c + p * q * r))


def check_numbers(name: str, values: Sequence[float], count: int, most: float, unit: str = ''
                  ) -> None:
    """Raise ObstacleError unless given ``count`` numbers of at most ``most``."""
    try:
        given = real_array(values, '')
    except ValueError:
        given = np.empty(0)
    if given.shape != (count,) or not np.all(np.abs(given) <= most):  # nor nan
        raise ObstacleError(f'{name} is {printable(repr(values), MAX_NAME)}; allowed: {count} '
                            f'numbers from {-most:g} to {most:g} {unit}'.rstrip())
