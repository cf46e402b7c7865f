# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Which tag is where on a spatial arm: rings of them around the discs, and fixed ones."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, pi, sin, tan
from typing import Any, Self

import numpy as np
import scipy

from soft_continuum.mechanics.spatial.arm import SpatialArm
from soft_continuum.mechanics.spatial.chain import SpatialChain
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sensing.layout import CORNERS, FIRST_FIXED, QUIET
from soft_continuum.sensing.pictures import Array, FAMILY_SIZE

MIN_FIXED = 3
MIN_WIDTH = 0.1
"""Of the length of a group of fixed tags: by how much they are off one line at least."""


@dataclass(frozen=True)
class Tag:
    """
    A tag in space.

    centre: (3,) m.  axes: (3, 3), directions to its right, up, and out of it to who sees it, one
    a row.  size: edge of the black square, m.  spread: (6, 6), a root of the covariance of where
    it is stuck, shift (m) and then rotation vector (rad) along its axes.
    """

    centre: Array
    axes: Array
    size: float
    spread: Array

    @property
    def corners(self) -> Array:
        """In the order in which they are detected, (4, 3) m."""
        corners: Array = self.centre + self.size * CORNERS @ self.axes[:2]
        return corners

    def moved(self, shift: Array, turn: Array, spread: Array) -> 'Tag':
        """Return it shifted (m) and turned (rotation vector, rad) along its axes."""
        turned = scipy.spatial.transform.Rotation.from_rotvec(turn).as_matrix().T @ self.axes
        return Tag(self.centre + shift @ self.axes, turned, self.size, spread)


@dataclass(frozen=True)
class RingLayout:
    """
    Tags of the family 36h11 around a spatial arm.

    Around every disc lies a prism of ``faces`` tags, edge to edge, upright: z of the disc is up.
    Face k of disc N looks from the axis along k / faces of a turn about z from x, and has the
    number faces * N + k.  disc_size, fixed_size: edge of the black square, m.  fixed: (fixed, 4),
    centre x, y, z (m) in base_link and the direction that it looks (rad about z from x), numbered
    from FIRST_FIXED; z of base_link is up.  deviation, ring_deviation, fixed_deviation: m,
    standard, of where tags are on their ring, rings on their disc, and fixed tags.  disc_heights,
    disc_radii: (discs,) m.  segment_lengths: (segments,) m, between the discs.
    """

    faces: int
    disc_size: float
    fixed_size: float
    fixed: Array
    deviation: float
    ring_deviation: float
    fixed_deviation: float
    disc_heights: tuple[float, ...]
    disc_radii: tuple[float, ...]
    segment_lengths: tuple[float, ...]

    @classmethod
    def of(cls, values: Mapping[str, Any], arm: SpatialArm) -> Self:
        """Return the layout of parameters tags.* for this arm; raises ParameterError."""
        numbers = values['tags.fixed_poses']
        if len(numbers) % 4 or len(numbers) < 4 * MIN_FIXED:
            raise ParameterError(
                f'parameter tags.fixed_poses has {len(numbers)} numbers; needed: x, y, z and '
                f'direction of at least {MIN_FIXED} tags')
        fixed = np.reshape(np.array(numbers, dtype=float), (-1, 4))
        if not off_a_line(fixed[:, :3]):
            raise ParameterError('parameter tags.fixed_poses: the tags stand almost in a line; '
                                 'put them around the arm, such as on two boards behind it')
        faces, discs = values['tags.faces'], len(arm.discs)
        if faces * discs > FIRST_FIXED:
            raise ParameterError(
                f'parameter tags.faces is {faces}; {discs} discs have {FIRST_FIXED} numbers: '
                f'allowed: {FIRST_FIXED // discs} at most')
        if FIRST_FIXED + len(fixed) > FAMILY_SIZE:
            raise ParameterError(f'parameter tags.fixed_poses has {len(fixed)} tags; allowed: '
                                 f'{FAMILY_SIZE - FIRST_FIXED} at most')
        found = cls(
            faces, values['tags.disc_size'], values['tags.fixed_size'], fixed,
            values['tags.deviation'], values['tags.ring_deviation'],
            values['tags.fixed_deviation'], tuple(d.height for d in arm.discs),
            tuple(SpatialChain(arm).disc_radii.tolist()), tuple(s.length for s in arm.segments))
        widest = max(found.disc_radii)
        if found.radius < widest:
            raise ParameterError(
                f'parameters tags.faces and tags.disc_size: rings of {faces} tags of '
                f'{found.disc_size * 1e3:g} mm are {found.radius * 1e3:.1f} mm from the axis, but '
                f'a disc has a radius of {widest * 1e3:g} mm; tags.disc_size: at least '
                f'{np.ceil(1e4 * found.disc_size * widest / found.radius) / 10:g} mm')
        return found

    @property
    def face(self) -> float:
        """Width of a face of a ring: a tag with its white margin on both sides, m."""
        return self.disc_size * (1.0 + 2.0 * QUIET)

    @property
    def radius(self) -> float:
        """From the axis to the faces of a ring, m."""
        return self.face / 2.0 / tan(pi / self.faces)

    @property
    def heights(self) -> tuple[float, ...]:
        """From the bottom of each disc to the middle of its ring, (discs,) m."""
        return tuple(height / 2.0 for height in self.disc_heights)

    @property
    def straight_heights(self) -> tuple[float, ...]:
        """Bottom of each disc of the straight arm above base_link, (discs,) m."""
        return (0.0, *np.cumsum(np.add(self.disc_heights[:-1], self.segment_lengths)).tolist())

    @property
    def rim(self) -> Array:
        """Outline of a disc in its frame as views draw it at bottom and top, (faces, 3) m."""
        turns = 2.0 * pi / self.faces * (np.arange(self.faces) + 0.5)
        outer = self.radius / cos(pi / self.faces)
        return np.column_stack([outer * np.cos(turns), outer * np.sin(turns), 0.0 * turns])

    @property
    def fixed_numbers(self) -> tuple[int, ...]:
        """Numbers of the fixed tags."""
        return tuple(range(FIRST_FIXED, FIRST_FIXED + len(self.fixed)))

    @property
    def fixed_tags(self) -> dict[int, Tag]:
        """The fixed tags in base_link, by number."""
        spread = _spread(self.fixed_deviation, self.fixed_size)
        return {n: Tag(row[:3], _upright(row[3]), self.fixed_size, spread)
                for n, row in zip(self.fixed_numbers, self.fixed, strict=True)}

    def ring(self, disc: int) -> dict[int, Tag]:
        """Return the tags of a disc in its frame, from the centre of its bottom, by number."""
        found, spread = {}, _spread(self.deviation, self.disc_size)
        for k in range(self.faces):
            axes = _upright(2.0 * pi * k / self.faces)
            centre = self.radius * axes[2] + [0.0, 0.0, self.heights[disc]]
            found[self.faces * disc + k] = Tag(centre, axes, self.disc_size, spread)
        return found


def off_a_line(points: Array) -> bool:
    """Return whether points (k, 3) m are not almost in a line."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(len(points) >= MIN_FIXED and spread[1] > MIN_WIDTH * spread[0] > 0.0)


def _spread(deviation: float, size: float) -> Array:
    """Return that of a tag of some size that is stuck off by a standard deviation, m."""
    return np.diag(deviation * np.repeat([1.0, 1.0 / size], 3))


def _upright(direction: float) -> Array:
    """Return the axes of an upright tag that looks along ``direction``, rad about z from x."""
    c, s = cos(direction), sin(direction)
    return np.array([[-s, c, 0.0], [0.0, 0.0, 1.0], [c, s, 0.0]])
