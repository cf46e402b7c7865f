# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A closed triangle mesh as the shape of an obstacle."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics.arm import Array
from soft_continuum.planning.obstacles.shapes import check_size, ObstacleError

MAX_TRIANGLES = 10_000
"""Per mesh: more do not help to plan for such an arm, and slow down each distance."""
FLAT = 1e-6  # of the cube of its largest extent: volume below which a mesh encloses nothing
REPAIR = 'close it, for instance with MeshLab (Close Holes), or give a box around it'

Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Mesh:
    """
    A closed surface of triangles.

    vertices: (n, 3), m.  triangles: (m, 3) numbers of vertices.  Raises ObstacleError for an open
    mesh, whose inside is undefined.
    """

    kind: ClassVar = 'mesh'
    vertices: Array
    triangles: Integers

    def __post_init__(self) -> None:
        """Raise ObstacleError for a mesh that encloses no volume."""
        points, corners = np.asarray(self.vertices), np.asarray(self.triangles)
        if (points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in 'iuf'
                or corners.ndim != 2 or corners.shape[1] != 3 or corners.dtype.kind not in 'iu'):
            raise ObstacleError(f'a mesh has vertices {points.shape} and triangles '
                                f'{corners.shape}; needed: (n, 3) numbers in m, and (m, 3) whole '
                                'numbers of vertices')
        if not 4 <= len(corners) <= MAX_TRIANGLES:
            raise ObstacleError(f'a mesh has {len(corners)} triangles; allowed: 4 to '
                                f'{MAX_TRIANGLES}. Simplify a larger one, for instance with '
                                'MeshLab (Quadric Edge Collapse Decimation)')
        if not np.all(np.isfinite(points)):
            raise ObstacleError('a mesh has vertices that are not finite numbers (NaN or '
                                'infinite); export it again')
        if corners.min() < 0 or corners.max() >= len(points):
            raise ObstacleError(f'a mesh has triangles of vertices {corners.min()} to '
                                f'{corners.max()}; allowed: 0 to {len(points) - 1}')
        extent = float(np.ptp(self.bounds, axis=0).max())
        check_size('the largest extent of a mesh', extent)
        if holes := _open_edges(corners.astype(np.int64), len(points)):
            raise ObstacleError(
                f'a mesh is open: {holes} of its edges do not join triangles that face the same '
                f'side, so its inside is undefined; {REPAIR}')
        if abs(self.volume) < FLAT * extent**3:
            raise ObstacleError(f'a mesh of {extent:.3g} m encloses a volume of only '
                                f'{abs(self.volume):.2g} m^3; give it a thickness, or give a box')

    def __eq__(self, other: object) -> bool:
        """Return whether it has the same triangles."""
        return (isinstance(other, Mesh) and np.array_equal(self.vertices, other.vertices)
                and np.array_equal(self.triangles, other.triangles))

    def __hash__(self) -> int:
        """Return the same number for equal ones."""
        return hash((np.asarray(self.vertices).tobytes(), len(self.triangles)))

    @property
    def bounds(self) -> Array:
        """Smallest and largest x, y and z in the frame of the shape, (2, 3), m."""
        used = np.asarray(self.vertices)[np.unique(self.triangles)]
        return np.array([used.min(axis=0), used.max(axis=0)])

    @property
    def volume(self) -> float:
        """Enclosed volume, m^3; negative if the triangles face inwards."""
        a, b, c = self._corners(self.bounds.mean(axis=0))
        return float(np.einsum('ij,ij->', a, np.cross(b, c)) / 6.0)

    def encloses(self, point: ArrayLike) -> bool:
        """
        Return whether a point (3,), m, in the frame of the shape, is inside.

        The solid angle of the triangles seen from the point is 4 pi or 0 (van Oosterom and
        Strackee, The solid angle of a plane triangle, IEEE Trans. Biomed. Eng. 30, 1983).
        """
        a, b, c = self._corners(np.asarray(point, dtype=float))
        x, y, z = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
        above = np.einsum('ij,ij->i', a, np.cross(b, c))
        below = x * y * z + _dot(a, b) * z + _dot(b, c) * x + _dot(c, a) * y
        return bool(abs(2.0 * np.arctan2(above, below).sum()) > 2.0 * np.pi)

    def _corners(self, origin: Array) -> tuple[Array, Array, Array]:
        corners = np.asarray(self.vertices, dtype=float)[self.triangles] - origin
        return corners[:, 0], corners[:, 1], corners[:, 2]


def mesh_of_triangles(corners: ArrayLike) -> Mesh:
    """
    Return separate triangles (m, 3, 3), m, of an STL file or TRIANGLE_LIST marker, as a mesh.

    Equal corners are merged, and triangles without three different ones are dropped.  Raises
    ObstacleError as Mesh does.
    """
    vertices, numbers = np.unique(np.reshape(corners, (-1, 3)), axis=0, return_inverse=True)
    triangles = numbers.reshape(-1, 3)
    a, b, c = triangles.T
    return Mesh(vertices, triangles[(a != b) & (b != c) & (c != a)])


def _open_edges(triangles: Integers, vertices: int) -> int:
    """Return the number of edges used more often in one direction than in the other."""
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    edges, numbers = np.unique(low * vertices + high, return_inverse=True)
    return int(np.count_nonzero(np.bincount(numbers, np.where(start < end, 1, -1), len(edges))))


def _dot(one: Array, other: Array) -> Array:
    found: Array = np.einsum('ij,ij->i', one, other)
    return found
