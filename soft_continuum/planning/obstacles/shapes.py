# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Primitive shapes of obstacles, each centred at the origin of its own frame."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from soft_continuum.mechanics._checks import finite
from soft_continuum.mechanics.arm import Array
from soft_continuum.text import MAX_NAME, printable

SIZE_RANGE = (1e-4, 100.0)  # m; outside it the unit is wrong
IN_MM = 'If it is in millimetres, give unit: mm, or scale: 0.001 for a mesh alone'


class ObstacleError(ValueError):
    """An obstacle is invalid; the message has the given and allowed values and a remedy."""


def check_size(name: str, value: object) -> None:
    """Raise ObstacleError for an invalid length of a shape, m."""
    low, high = SIZE_RANGE
    if not finite(value) or not low <= value <= high:  # type: ignore[operator]
        in_mm = finite(value) and low <= 1e-3 * value <= high  # type: ignore[operator]
        raise ObstacleError(f'{name} is {printable(repr(value), MAX_NAME)}; allowed: {low:g} to '
                            f'{high:g} m{". " + IN_MM if in_mm else ""}')


@dataclass(frozen=True)
class Sphere:
    """A sphere; radius: m."""

    kind: ClassVar = 'sphere'
    radius: float

    def __post_init__(self) -> None:
        """Raise ObstacleError for invalid sizes."""
        check_size('radius', self.radius)

    @property
    def bounds(self) -> Array:
        """Smallest and largest x, y and z in the frame of the shape, (2, 3), m."""
        return _both_ways(self.radius, self.radius, self.radius)


@dataclass(frozen=True)
class Box:
    """A box about its centre; size: its lengths along x, y and z, m."""

    kind: ClassVar = 'box'
    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        """Raise ObstacleError for invalid sizes."""
        if not isinstance(self.size, tuple) or len(self.size) != 3:
            raise ObstacleError(f'size is {printable(repr(self.size), MAX_NAME)}; give the three '
                                'lengths along x, y and z, such as [0.1, 0.2, 0.05]')
        for axis, length in zip('xyz', self.size, strict=True):
            check_size(f'size along {axis}', length)

    @property
    def bounds(self) -> Array:
        """As for Sphere."""
        x, y, z = self.size
        return _both_ways(x / 2, y / 2, z / 2)


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z; radius and length: m."""

    kind: ClassVar = 'cylinder'
    radius: float
    length: float

    def __post_init__(self) -> None:
        """Raise ObstacleError for invalid sizes."""
        check_size('radius', self.radius)
        check_size('length', self.length)

    @property
    def bounds(self) -> Array:
        """As for Sphere."""
        return _both_ways(self.radius, self.radius, self.length / 2)


@dataclass(frozen=True)
class Capsule(Cylinder):
    """A cylinder with a hemisphere at either end; length: of the cylinder alone, m."""

    kind: ClassVar = 'capsule'

    @property
    def bounds(self) -> Array:
        """As for Sphere."""
        return _both_ways(self.radius, self.radius, self.length / 2 + self.radius)


def _both_ways(x: float, y: float, z: float) -> Array:
    return np.array([[-x, -y, -z], [x, y, z]])
