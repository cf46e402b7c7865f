# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An obstacle: a named shape, placed in base_link."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics._checks import finite, real_array
from soft_continuum.mechanics.chain import Array
from soft_continuum.text import MAX_NAME, printable

SIZE_RANGE = (1e-4, 100.0)  # m; outside it the unit is wrong
POSITION_RANGE = 1000.0  # m from base_link
MAX_TRIANGLES = 50_000
"""Of one mesh: more do not tell an arm of this accuracy where it may go, and take long."""
UPRIGHT = (0.0, 0.0, 0.0)

Integers = NDArray[np.int64]


class ObstacleError(ValueError):
    """An obstacle is not usable; the message says what was given, what is allowed, what to do."""


def check_size(name: str, value: object) -> float:
    """Return a length of a shape, m; raises ObstacleError for what is none."""
    low, high = SIZE_RANGE
    if not finite(value) or not low <= float(value) <= high:  # type: ignore[arg-type]
        raise ObstacleError(f'{name} is {printable(repr(value), MAX_NAME)}; allowed: {low:g} to '
                            f'{high:g} m')
    return float(value)  # type: ignore[arg-type]


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


@dataclass(frozen=True, eq=False)
class Mesh:
    """
    A closed surface of triangles.

    vertices: (n, 3), m.  triangles: (m, 3) numbers of vertices.  Raises ObstacleError for one that
    has a hole: nothing then says what is inside.
    """

    kind: ClassVar = 'mesh'
    vertices: Array
    triangles: Integers

    def __post_init__(self) -> None:
        """Refuse what encloses nothing."""
        points, corners = np.asarray(self.vertices), np.asarray(self.triangles)
        if (points.ndim != 2 or points.shape[1:] != (3,) or corners.ndim != 2
                or corners.shape[1:] != (3,) or corners.dtype.kind not in 'iu'
                or len(corners) < 4):
            raise ObstacleError(f'a mesh has vertices {points.shape} and triangles '
                                f'{corners.shape}; needed: (n, 3) numbers in m, and (m, 3) '
                                'numbers of vertices, 4 triangles at least')
        if len(corners) > MAX_TRIANGLES:
            raise ObstacleError(f'a mesh has {len(corners)} triangles; allowed: {MAX_TRIANGLES}. '
                                'Simplify it, for instance with MeshLab')
        if not np.all(np.isfinite(points)):
            raise ObstacleError('a mesh has vertices that are no finite numbers (NaN or '
                                'infinite); repair it, for instance with MeshLab')
        if corners.min() < 0 or corners.max() >= len(points):
            raise ObstacleError(f'a mesh has triangles of vertices {corners.min()} to '
                                f'{corners.max()}, and {len(points)} vertices')
        check_size('the largest extent of a mesh', float(np.ptp(self.bounds, axis=0).max()))
        if holes := _open_edges(corners):
            raise ObstacleError(
                f'a mesh is open: {holes} of its edges do not join two triangles that face the '
                'same side, so nothing says what is inside; close it, for instance with MeshLab '
                '(Close Holes), or give a box around it')

    @property
    def bounds(self) -> Array:
        """As of Sphere."""
        used = np.asarray(self.vertices)[np.unique(self.triangles)]
        return np.array([used.min(axis=0), used.max(axis=0)])


Shape = Sphere | Box | Capsule | Cylinder | Mesh


@dataclass(frozen=True, eq=False)
class Obstacle:
    """
    A shape at a place in base_link.

    name: of its own among obstacles.  position: of the origin of the shape's frame, (3,), m.
    rpy: its rotation about the fixed axes x, y and z, in this order, as URDF has it, rad.
    """

    name: str
    shape: Shape
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = UPRIGHT

    def __post_init__(self) -> None:
        """Refuse what is nowhere, or has no name."""
        if not (isinstance(self.name, str) and self.name.strip() and self.name.isprintable()
                and len(self.name) <= MAX_NAME):
            raise ObstacleError(
                f'the name of an obstacle is {printable(repr(self.name), MAX_NAME)}; give a text '
                f'of up to {MAX_NAME} characters')
        if not isinstance(self.shape, Shape):
            raise ObstacleError(f'obstacle {self.name}: the shape is {type(self.shape).__name__}; '
                                'give a Sphere, Box, Capsule, Cylinder or Mesh')
        for name, most, unit in (('position', POSITION_RANGE, 'm'), ('rpy', 2 * np.pi, 'rad')):
            _check_three(f'obstacle {self.name}: {name}', getattr(self, name), most, unit)

    @property
    def rotation(self) -> Array:
        """Rotation matrix of the shape's frame in base_link, (3, 3)."""
        (cx, cy, cz), (sx, sy, sz) = np.cos(self.rpy), np.sin(self.rpy)
        return np.array([[cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
                         [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
                         [-sy, cy * sx, cy * cx]])


def _check_three(name: str, values: Sequence[float], most: float, unit: str) -> None:
    try:
        given = real_array(values, '')
    except ValueError:
        given = np.empty(0)
    if given.shape != (3,) or not np.all(np.abs(given) <= most):  # nor nan
        raise ObstacleError(f'{name} is {printable(repr(values), MAX_NAME)}; allowed: three '
                            f'numbers from {-most:g} to {most:g} {unit}')


def _both_ways(x: float, y: float, z: float) -> Array:
    return np.array([[-x, -y, -z], [x, y, z]])


def _open_edges(triangles: ArrayLike) -> int:
    """Return how many edges are not passed once in either direction, as in a closed surface."""
    corners: Any = np.asarray(triangles, dtype=np.int64)
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    there, ways = np.unique(edges, axis=0, return_counts=True)
    back = {tuple(edge) for edge in there[:, ::-1].tolist()}
    once = {tuple(edge) for edge, n in zip(there.tolist(), ways.tolist(), strict=True) if n == 1}
    return len(there) - len(once & back)
