# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tag layout of a spatial arm: rings of tags around the discs, and fixed ones."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import cos, pi, sin, tan
from typing import Any, Self, TYPE_CHECKING

import numpy as np
import scipy

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Chain
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.parameters.scalars import as_yaml
from soft_continuum.sensing.layout import (
    CORNERS,
    FIRST_FIXED,
    Layout,
    of_arm,
    QUIET_ZONE,
    TagLayout,
)
from soft_continuum.sensing.lens import Lens
from soft_continuum.sensing.pictures import Array, FAMILY_SIZE
from soft_continuum.sensing.tilt import SensorError

if TYPE_CHECKING:  # OpenCV and matplotlib may not be there
    from soft_continuum.sensing.detections import DiscCamera, TagDetections
    from soft_continuum.sensing.pages import Page

MIN_FIXED = 3
MIN_WIDTH = 0.1
"""Least distance of fixed tags from one line, over the length of their group."""
MAX_MOTION = 1.0  # px by which tags at rest may move
NUMBERS = 9  # of a tag that was seen: its own, and u and v of its corners

Corners = Mapping[int, Array]
"""Corners of each visible tag, by number, (4, 2) px without distortion."""


@dataclass(frozen=True)
class Tag:
    """
    A tag in space.

    centre: (3,) m.  axes: (3, 3), its right, up and outward directions, one per row.  size: edge
    of the black square, m.  spread: (6, 6), a root of the covariance of its offset, shift (m) and
    then rotation vector (rad) along its axes.
    """

    centre: Array
    axes: Array
    size: float
    spread: Array

    @property
    def corners(self) -> Array:
        """Corners in the order of detection, (4, 3) m."""
        corners: Array = self.centre + self.size * CORNERS @ self.axes[:2]
        return corners

    def moved(self, shift: Array, turn: Array, spread: Array) -> 'Tag':
        """Return the tag shifted (m) and turned (rotation vector, rad) along its axes."""
        turned = scipy.spatial.transform.Rotation.from_rotvec(turn).as_matrix().T @ self.axes
        return Tag(self.centre + shift @ self.axes, turned, self.size, spread)


@dataclass(frozen=True)
class RingLayout(Layout):
    """
    Rings of tags around a spatial arm.

    Every disc is surrounded by a prism of ``faces`` tags, edge to edge, upright: z of the disc is
    up.  Face k of disc N faces outwards at k / faces of a turn about z from x, and has the number
    faces * N + k.  fixed: (fixed, 4), centre x, y, z (m) in base_link and the direction that it
    faces (rad about z from x); z of base_link is up.  stddev, ring_stddev: m, standard deviation
    of tags on their ring, and of rings on their disc.  disc_radii: (discs,) m.
    Tag offsets are kept as the corners seen on the straight arm.
    """

    faces: int
    ring_stddev: float
    disc_radii: tuple[float, ...]

    @classmethod
    def of(cls, values: Mapping[str, Any], arm: Arm) -> Self:
        """Return the layout of parameters tags.* for this arm; raises ParameterError."""
        numbers = values['tags.fixed_poses']
        if len(numbers) % 4 or len(numbers) < 4 * MIN_FIXED:
            raise ParameterError(
                f'parameter tags.fixed_poses has {len(numbers)} numbers; needed: x, y, z and '
                f'direction of at least {MIN_FIXED} tags')
        fixed = np.reshape(np.array(numbers, dtype=float), (-1, 4))
        if not off_a_line(fixed[:, :3]):
            raise ParameterError('parameter tags.fixed_poses: the tags are almost in a line; '
                                 'put them around the arm, such as on two boards behind it')
        faces, discs = values['tags.faces'], len(arm.discs)
        if faces * discs > FIRST_FIXED:
            raise ParameterError(
                f'parameter tags.faces is {faces}; {discs} discs have {FIRST_FIXED} numbers: '
                f'allowed: {FIRST_FIXED // discs} at most')
        if FIRST_FIXED + len(fixed) > FAMILY_SIZE:
            raise ParameterError(f'parameter tags.fixed_poses has {len(fixed)} tags; allowed: '
                                 f'{FAMILY_SIZE - FIRST_FIXED} at most')
        found = cls(fixed=fixed, faces=faces, ring_stddev=values['tags.ring_stddev'],
                    disc_radii=tuple(Chain(arm).disc_radii.tolist()), **of_arm(arm, values))
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
        return self.disc_size * (1.0 + 2.0 * QUIET_ZONE)

    @property
    def radius(self) -> float:
        """From the axis to the faces of a ring, m."""
        return self.face / 2.0 / tan(pi / self.faces)

    @property
    def rim(self) -> Array:
        """Outline of a disc at bottom and top for drawings, in its frame, (faces, 3) m."""
        turns = 2.0 * pi / self.faces * (np.arange(self.faces) + 0.5)
        outer = self.radius / cos(pi / self.faces)
        return np.column_stack([outer * np.cos(turns), outer * np.sin(turns), 0.0 * turns])

    @property
    def fixed_tags(self) -> dict[int, Tag]:
        """The fixed tags in base_link, by number."""
        spread = _spread(self.fixed_stddev, self.fixed_size)
        return {n: Tag(row[:3], _upright(row[3]), self.fixed_size, spread)
                for n, row in zip(self.fixed_numbers, self.fixed, strict=True)}

    def ring(self, disc: int) -> dict[int, Tag]:
        """Return the tags of a disc in its frame, from the centre of its bottom, by number."""
        found, spread = {}, _spread(self.stddev, self.disc_size)
        for k, number in enumerate(self.numbers(disc)):
            axes = _upright(2.0 * pi * k / self.faces)
            centre = self.radius * axes[2] + [0.0, 0.0, self.heights[disc]]
            found[number] = Tag(centre, axes, self.disc_size, spread)
        return found

    def numbers(self, disc: int) -> Collection[int]:
        """Return the tags of the ring of a disc."""
        return range(self.faces * disc, self.faces * (disc + 1))

    def stuck_as(self, values: Mapping[str, Any]) -> Corners:
        """Return the corners of parameter tags.reference_corners; raises ParameterError."""
        if any(values['tags.offsets']):
            raise ParameterError('parameter tags.offsets is for planar arms; for a spatial arm '
                                 'keep tags.reference_corners, which a tare returns: tare again')
        return corners_from_numbers(values['tags.reference_corners'])

    def tared(self, stuck: Corners, seen: 'Sequence[TagDetections]'
              ) -> tuple[list[int], Corners, str]:
        """Return the corners of the tags seen in more than half of the images."""
        corners = corners_at_rest([sight.corners for sight in seen])
        discs = [n for n in range(len(self.heights)) if not corners.keys().isdisjoint(
            self.numbers(n))]
        return discs, corners, f'reference_corners: {as_yaml(corners_as_numbers(corners), 7)}'

    def camera(self, lens: Lens, stuck: Corners) -> 'DiscCamera':
        """Return a RingCamera."""
        from soft_continuum.sensing.ring_camera import RingCamera
        return RingCamera(self, lens, stuck)

    def pages(self) -> 'list[Page]':
        """Return strips of tags to fold, and a drawing of the layout."""
        from soft_continuum.sensing.printing import ring_pages
        return ring_pages(self)


def layout_of(values: Mapping[str, Any]) -> Layout:
    """
    Return the tags that parameters arm.* and tags.* describe; raises ParameterError.

    Discs that stay in a plane need one tag, facing the camera; others need one on every side.
    """
    arm = arm_from_parameters(values)
    return (RingLayout if arm.pose_axes.all() else TagLayout).of(values, arm)


def off_a_line(points: Array) -> bool:
    """Return whether points (k, 3) m are not almost in a line."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(len(points) >= MIN_FIXED and spread[1] > MIN_WIDTH * spread[0] > 0.0)


def _spread(stddev: float, size: float) -> Array:
    """Return Tag.spread for a tag size and the standard deviation of its offset, m."""
    return np.diag(stddev * np.repeat([1.0, 1.0 / size], 3))


def _upright(direction: float) -> Array:
    """Return the axes of an upright tag that faces ``direction``, rad about z from x."""
    c, s = cos(direction), sin(direction)
    return np.array([[-s, c, 0.0], [0.0, 0.0, 1.0], [c, s, 0.0]])


# Corners of the tags around the straight arm, as stored in a parameter.

def corners_at_rest(seen: Sequence[Corners]) -> dict[int, Array]:
    """
    Return the mean corners of the tags seen in more than half of the images.

    Raises SensorError when they move.
    """
    found: dict[int, list[Array]] = {}
    for corners in seen:
        for n, places in corners.items():
            found.setdefault(n, []).append(places)
    often = {n: np.array(each) for n, each in found.items() if 2 * len(each) > len(seen)}
    for n, places in often.items():
        half = len(places) // 2
        motion = np.linalg.norm(places[half:].mean(axis=(0, 1)) - places[:half].mean(axis=(0, 1)))
        if motion > MAX_MOTION:
            raise SensorError(f'tag {n} moves, by {motion:.1f} px within half a second; wait '
                              'until the arm rests')
    return {n: places.mean(axis=0) for n, places in often.items()}


def corners_as_numbers(corners: Corners) -> tuple[float, ...]:
    """Return corners as the value of parameter tags.reference_corners."""
    return tuple(float(value) for n, places in sorted(corners.items())
                 for value in (n, *places.ravel()))


def corners_from_numbers(numbers: Sequence[float]) -> dict[int, Array]:
    """Return the corners in parameter tags.reference_corners; raises ParameterError."""
    if tuple(numbers) == (0.0,):
        return {}
    if len(numbers) % NUMBERS:
        raise ParameterError(f'parameter tags.reference_corners has {len(numbers)} numbers; '
                             'needed: the number and four corners (u, v) of each tag, as ~/tare '
                             'prints them, or 0.0 for none')
    return {int(row[0]): row[1:].reshape(4, 2) for row in np.reshape(numbers, (-1, NUMBERS))}
