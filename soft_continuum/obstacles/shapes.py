# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of obstacles that a few numbers describe, each about the origin of its own frame."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from soft_continuum.mechanics._checks import finite
from soft_continuum.mechanics.arm import Array
from soft_continuum.text import MAX_NAME, printable

SIZE_RANGE = (1e-4, 100.0)  # m; outside it the unit is wrong
IN_MM = 'If it is in millimetres, give unit: mm, or scale: 0.001 for a mesh alone'


class ObstacleError(ValueError):
    """An obstacle is not usable; the message says what was given, what is allowed, what to do."""


def check_size(name: str, value: object) -> None:
    """Raise ObstacleError for what is no length of a shape, m."""
    low, high = SIZE_RANGE
    if not finite(value) or not low <= value <= high:  # type: ignore[operator]
        in_mm = finite(value) and low <= 1e-3 * value <= high  # type: ignore[operator]
        raise ObstacleError(f'{name} is {printable(repr(value), MAX_NAME)}; allowed: {low:g} to '
                            f'{high:g} m{". " + IN_MM if in_mm else ""}')


@dataclass(frozen=True)
class Sphere:
    """A ball; radius: m."""

    kind: ClassVar = 'sphere'
    radius: float

    def __post_init__(self) -> None:
        """Refuse what is no size."""
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
        """Refuse what is no size."""
        if not isinstance(self.size, tuple) or len(self.size) != 3:
            raise ObstacleError(f'size is {printable(repr(self.size), MAX_NAME)}; give the three '
                                'lengths along x, y and z, such as [0.1, 0.2, 0.05]')
        for axis, length in zip('xyz', self.size, strict=True):
            check_size(f'size along {axis}', length)

    @property
    def bounds(self) -> Array:
        """As of Sphere."""
        x, y, z = self.size
        return _both_ways(x / 2, y / 2, z / 2)


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z and its centre; radius and length: m."""

    kind: ClassVar = 'cylinder'
    radius: float
    length: float

    def __post_init__(self) -> None:
        """Refuse what is no size."""
        check_size('radius', self.radius)
        check_size('length', self.length)

    @property
    def bounds(self) -> Array:
        """As of Sphere."""
        return _both_ways(self.radius, self.radius, self.length / 2)


@dataclass(frozen=True)
class Capsule(Cylinder):
    """A cylinder with a half ball at either end; length: of the cylinder alone, m."""

    kind: ClassVar = 'capsule'

    @property
    def bounds(self) -> Array:
        """As of Sphere."""
        return _both_ways(self.radius, self.radius, self.length / 2 + self.radius)


def _both_ways(x: float, y: float, z: float) -> Array:
    return np.array([[-x, -y, -z], [x, y, z]])
