# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Which tag is where: one on every disc, and fixed ones that carry the base frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Self

import numpy as np

from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sensing.pictures import Array, MODULES

FIRST_FIXED = 100
"""Number of the first fixed tag; the tag of disc N has the number N, the base disc being 0."""
MIN_FIXED = 4
MIN_HEIGHT = 0.1
"""Of the size of the board: how far each of four fixed tags is off the line of two others."""
QUIET = 1 / MODULES
"""Of a tag's size: the white margin that it needs on every side, one of its modules."""
CORNERS = np.array([(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]) / 2.0
"""Of a tag of size 1, to the right and up: in the order in which they are detected."""


@dataclass(frozen=True)
class TagLayout:
    """
    Tags of the family 36h11 in the plane of the arm, seen from -y: x to the right, z up.

    disc_size, fixed_size: edge of the black square, m.  fixed: (fixed, 2) m, centres (x, z) in
    base_link, numbered from FIRST_FIXED.  depth: m by which the tags of the discs are nearer to
    the camera than the fixed ones.  deviation, fixed_deviation, depth_deviation: m, standard, of
    where they are stuck on the discs, where the fixed ones are, and of the depth.
    disc_heights: (discs,) m.  segment_lengths: (segments,) m, between the discs.
    """

    disc_size: float
    fixed_size: float
    fixed: Array
    depth: float
    deviation: float
    fixed_deviation: float
    depth_deviation: float
    disc_heights: tuple[float, ...]
    segment_lengths: tuple[float, ...]

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the layout that parameters arm.* and tags.* describe; raises ParameterError."""
        arm = arm_from_parameters(values)
        positions: Sequence[float] = values['tags.fixed_positions']
        if len(positions) % 2 or len(positions) < 2 * MIN_FIXED:
            raise ParameterError(
                f'parameter tags.fixed_positions has {len(positions)} numbers; needed: x and z of '
                f'at least {MIN_FIXED} tags')
        fixed = np.reshape(np.array(positions, dtype=float), (-1, 2))
        if not carry_a_plane(fixed):
            raise ParameterError(
                'parameter tags.fixed_positions: the tags stand almost in a line, but for one at '
                'most; put them around the arm, such as at the corners of a rectangle')
        return cls(values['tags.disc_size'], values['tags.fixed_size'], fixed,
                   values['tags.depth'], values['tags.deviation'],
                   values['tags.fixed_deviation'], values['tags.depth_deviation'],
                   tuple(d.height for d in arm.discs), tuple(s.length for s in arm.segments))

    @property
    def heights(self) -> tuple[float, ...]:
        """From the bottom of each disc to the centre of its tag, (discs,) m."""
        return tuple(height / 2.0 for height in self.disc_heights)

    @property
    def rim(self) -> Array:
        """Outline of a disc in its frame as views draw it at bottom and top, (2, 3) m."""
        return np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]) * self.disc_size

    @property
    def fixed_numbers(self) -> tuple[int, ...]:
        """Numbers of the fixed tags."""
        return tuple(range(FIRST_FIXED, FIRST_FIXED + len(self.fixed)))

    def fixed_corners(self, number: int) -> Array:
        """Return the corners of a fixed tag, (4, 2) m, x and z in base_link."""
        corners: Array = self.fixed[number - FIRST_FIXED] + self.fixed_size * CORNERS
        return corners

    def disc_corners(self, disc: int, pose: Array) -> Array:
        """Return the corners of the tag of a disc whose bottom is at ``pose`` (x, z, angle)."""
        x, z, angle = pose
        right, up = directions(angle)
        local = self.disc_size * CORNERS
        corners: Array = (np.array([x, z]) + local[:, :1] * right
                          + (local[:, 1:] + self.heights[disc]) * up)
        return corners


def directions(angle: float) -> tuple[Array, Array]:
    """Return the directions (x, z) to the right of and along something turned by ``angle`` rad."""
    return np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])


def carry_a_plane(centres: Array) -> bool:
    """Return whether four of these points (k, 2) m have no three of them almost in a line."""
    size = float(np.ptp(centres, axis=0).max())
    return any(min(_height(*three) for three in combinations(four, 3)) > MIN_HEIGHT * size
               for four in combinations(centres, 4))


def _height(a: Array, b: Array, c: Array) -> float:
    """Return the smallest height of a triangle, m."""
    sides = np.stack([b - a, c - b, a - c])
    longest = float(np.linalg.norm(sides, axis=1).max())
    area = abs(float(sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0]))
    return area / longest if longest > 0.0 else 0.0
