# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tag layout: one tag on every disc, and fixed ones that define the base frame."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Self, TYPE_CHECKING

import numpy as np

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.orientations import full_poses
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.parameters.scalars import as_yaml
from soft_continuum.sensing.lens import Lens
from soft_continuum.sensing.pictures import Array, MODULES
from soft_continuum.sensing.rigid import planar_pose
from soft_continuum.sensing.tare import straight_heights, tag_offset
from soft_continuum.sensing.tilt import SensorError

if TYPE_CHECKING:  # OpenCV and matplotlib may not be there
    from soft_continuum.sensing.detections import DiscCamera, TagDetections
    from soft_continuum.sensing.pages import Page

FIRST_FIXED = 100
"""Number of the first fixed tag; the tag of disc N has the number N, the base disc being 0."""
MIN_FIXED = 4
MIN_HEIGHT = 0.1
"""Least distance of each of four fixed tags from the line of two others, over the board size."""
QUIET_ZONE = 1 / MODULES
"""White margin on every side over the size of a tag: one of its modules."""
CORNERS = np.array([(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]) / 2.0
"""Corners of a tag of size 1, to the right and up, in the order of detection."""


@dataclass(frozen=True)
class Layout(ABC):
    """
    Tags of the family 36h11: on the discs, and fixed ones that are numbered from FIRST_FIXED.

    disc_size, fixed_size: edge of the black square, m.  fixed: positions of the fixed tags, one
    per row.  stddev, fixed_stddev: m, standard deviation of the positions of tags on the discs,
    and of the fixed ones.  disc_heights: (discs,) m.  straight_heights: (discs,) m, of the bottom
    of each disc of the straight arm above base_link.  segment_lengths: (segments,) m, between the
    discs.
    """

    disc_size: float
    fixed_size: float
    fixed: Array
    stddev: float
    fixed_stddev: float
    disc_heights: tuple[float, ...]
    straight_heights: tuple[float, ...]
    segment_lengths: tuple[float, ...]

    @property
    def heights(self) -> tuple[float, ...]:
        """From the bottom of each disc to the middle of its tags, (discs,) m."""
        return tuple(height / 2.0 for height in self.disc_heights)

    @property
    def fixed_numbers(self) -> tuple[int, ...]:
        """Numbers of the fixed tags."""
        return tuple(range(FIRST_FIXED, FIRST_FIXED + len(self.fixed)))

    @property
    @abstractmethod
    def rim(self) -> Array:
        """Outline of a disc at bottom and top for drawings, in its frame, (k, 3) m."""

    @abstractmethod
    def numbers(self, disc: int) -> Collection[int]:
        """Return the numbers of the tags of a disc."""

    @abstractmethod
    def stuck_as(self, values: Mapping[str, Any]) -> Any:
        """Return the tag offsets of parameters tags.*; raises ParameterError."""

    @abstractmethod
    def tared(self, stuck: Any, seen: 'Sequence[TagDetections]') -> tuple[list[int], Any, str]:
        """
        Return the detected discs, the tag offsets, and these as a parameter.

        stuck: previous offsets.  seen: images of the straight arm, the oldest first.  Raises
        SensorError for an arm that is not straight, or moves.
        """

    @abstractmethod
    def camera(self, lens: Lens, stuck: Any) -> 'DiscCamera':
        """
        Return the detector of discs for images of a camera; needs OpenCV.

        Raises SensorError for impossible tag offsets.
        """

    @abstractmethod
    def pages(self) -> 'list[Page]':
        """Return the pages to print, without the board; raises ParameterError."""


def of_arm(arm: Arm, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that all layouts share, from an arm and parameters tags.*."""
    return {name: values[f'tags.{name}'] for name in (
        'disc_size', 'fixed_size', 'stddev', 'fixed_stddev')} | {
        'disc_heights': tuple(d.height for d in arm.discs),
        'straight_heights': straight_heights(arm),
        'segment_lengths': tuple(s.length for s in arm.segments)}


@dataclass(frozen=True)
class TagLayout(Layout):
    """
    Tags in the plane of the arm, seen from -y: x to the right, z up; one on every disc.

    fixed: (fixed, 2) m, centres (x, z) in base_link.  depth: m by which the tags of the discs are
    nearer to the camera than the fixed ones, with the standard deviation depth_stddev.  Tag
    offsets are poses (7,), by disc, of the disc in the nominal disc frame of its tag.
    """

    depth: float
    depth_stddev: float

    @classmethod
    def of(cls, values: Mapping[str, Any], arm: Arm) -> Self:
        """Return the layout of parameters tags.* for this arm; raises ParameterError."""
        positions: Sequence[float] = values['tags.fixed_positions']
        if len(positions) % 2 or len(positions) < 2 * MIN_FIXED:
            raise ParameterError(
                f'parameter tags.fixed_positions has {len(positions)} numbers; needed: x and z of '
                f'at least {MIN_FIXED} tags')
        fixed = np.reshape(np.array(positions, dtype=float), (-1, 2))
        if not not_collinear(fixed):
            raise ParameterError(
                'parameter tags.fixed_positions: all tags, or all but one, are almost in a line; '
                'put them around the arm, such as at the corners of a rectangle')
        return cls(fixed=fixed, depth=values['tags.depth'],
                   depth_stddev=values['tags.depth_stddev'], **of_arm(arm, values))

    @property
    def rim(self) -> Array:
        """Outline of a disc at bottom and top for drawings, in its frame, (2, 3) m."""
        return np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]) * self.disc_size

    def numbers(self, disc: int) -> Collection[int]:
        """Return the number of the tag of a disc."""
        return (disc,)

    def stuck_as(self, values: Mapping[str, Any]) -> tuple[Array, ...]:
        """Return the poses of parameter tags.offsets; raises ParameterError."""
        given, discs = tuple(values['tags.offsets']), len(self.heights)
        if given == (0.0,):
            given = (0.0,) * 3 * discs
        if len(given) != 3 * discs:
            raise ParameterError(f'parameter tags.offsets has {len(given)} numbers; needed: x, z '
                                 f'and angle for each of {discs} discs, or 0.0 for none')
        return tuple(full_poses(np.reshape(given, (discs, 3))))

    def tared(self, stuck: tuple[Array, ...], seen: 'Sequence[TagDetections]'
              ) -> tuple[list[int], tuple[Array, ...], str]:
        """Return the offsets of the discs seen in more than half of the images."""
        offsets, discs = list(stuck), []
        for n, height in enumerate(self.straight_heights):
            try:
                poses = [sight.discs[n].by_tags for sight in seen if n in sight.discs]
                if 2 * len(poses) > len(seen):
                    offsets[n] = tag_offset(poses, height)
                    discs.append(n)
            except SensorError as error:
                raise SensorError(f'disc {n}: {error}') from None
        numbers = tuple(float(v) for offset in offsets for v in planar_pose(offset))
        return discs, tuple(offsets), f'offsets: {as_yaml(numbers, 6)}'

    def camera(self, lens: Lens, stuck: tuple[Array, ...]) -> 'DiscCamera':
        """Return a TagCamera."""
        from soft_continuum.sensing.tag_camera import TagCamera
        return TagCamera(self, lens, stuck)

    def pages(self) -> 'list[Page]':
        """Return the tags, and a drawing of their positions."""
        from soft_continuum.sensing.printing import plane_pages
        return plane_pages(self)

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
    """Return the axes (x, z), right and up, of a body turned by ``angle`` rad."""
    return np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])


def not_collinear(centres: Array) -> bool:
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
