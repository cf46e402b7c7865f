# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tag layout: tags on or around every disc, and fixed ones that define the base frame."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, hypot, pi, sin, tan
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray
import scipy

from soft_continuum.estimation.sensing.pictures import Picture
from soft_continuum.estimation.sensing.tare import SensorError, straight_heights, tag_offset
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Chain
from soft_continuum.mechanics.rotations import full_poses, IDENTITY, planar_pose
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.parameters.scalars import as_yaml

MODULES = 8
"""Modules (squares of one colour) along the edge of a tag's black square."""
FAMILY_SIZE = 587
"""Size of the family 36h11."""
FIRST_FIXED = 100
"""Number of the first fixed tag; those of the discs are lower, and begin with 0 at the base."""
MIN_FIXED = 3
MIN_WIDTH = 0.1
"""Least distance of fixed tags from one line, over the length of their group."""
QUIET_ZONE = 1 / MODULES
"""White margin on every side over the size of a tag: one of its modules."""
CORNERS = np.array([(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]) / 2.0
"""Corners of a tag of size 1, to the right and up, in the order of detection."""
FRONT = -pi / 2
"""Direction, rad about z from x, from which a planar arm is seen."""
MAX_MOTION = 1.0  # px by which tags at rest may move
FOCAL_DEVIATION = 0.005  # relative, of a good calibration
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
class PlacedTags:
    """
    Tags with their offsets, by number, and the camera that sees them.

    fixed: in base_link.  rings: of each disc, in its frame.  offsets: by disc, pose (7,) of the
    disc in that frame.  ring_spread: standard deviations of rings beyond the offsets of their
    tags, (6,), m and rad.  focal: focal length over the calibrated one, with the standard
    deviation focal_stddev.
    """

    fixed: Mapping[int, Tag]
    rings: tuple[Mapping[int, Tag], ...]
    offsets: Sequence[Array]
    ring_spread: Array
    focal: float = 1.0
    focal_stddev: float = FOCAL_DEVIATION


class Sighting(Protocol):
    """
    What a tare uses of an image, such as TagDetections.

    by_tags: by disc, pose (7,) in base_link of the nominal disc frame of its tag.
    """

    @property
    def corners(self) -> Corners:
        """Corners of the tags."""

    @property
    def by_tags(self) -> Mapping[int, Array]:
        """Poses of the discs without offsets."""


@dataclass(frozen=True)
class Layout(ABC):
    """
    Tags of the family 36h11: on the discs, and fixed ones that are numbered from FIRST_FIXED.

    disc_size, fixed_size: edge of the black square, m.  fixed: (fixed, 4), centre x, y, z (m) of
    each fixed tag in base_link and the direction that it faces (rad about z from x); z of
    base_link is up.  stddev, fixed_stddev: m, standard deviation of the positions of tags on the
    discs, and of the fixed ones.  disc_heights: (discs,) m.  straight_heights: (discs,) m, of the
    bottom of each disc of the straight arm above base_link.  segment_lengths: (segments,) m,
    between the discs.  axes: (6,), as pose_axes of the arm.
    """

    disc_size: float
    fixed_size: float
    fixed: Array
    stddev: float
    fixed_stddev: float
    disc_heights: tuple[float, ...]
    straight_heights: tuple[float, ...]
    segment_lengths: tuple[float, ...]
    axes: NDArray[np.bool_]
    fixed_parameter: ClassVar[str]
    """Name of the parameter with the poses of the fixed tags."""

    @property
    def heights(self) -> tuple[float, ...]:
        """From the bottom of each disc to the middle of its tags, (discs,) m."""
        return tuple(height / 2.0 for height in self.disc_heights)

    @property
    def face(self) -> float:
        """Width of a tag of a disc with its white margin on both sides, m."""
        return self.disc_size * (1.0 + 2.0 * QUIET_ZONE)

    @property
    def fixed_numbers(self) -> tuple[int, ...]:
        """Numbers of the fixed tags."""
        return tuple(range(FIRST_FIXED, FIRST_FIXED + len(self.fixed)))

    @property
    def fixed_tags(self) -> dict[int, Tag]:
        """The fixed tags in base_link, by number."""
        spread = _spread(self.fixed_stddev, self.fixed_size)
        return {n: Tag(row[:3], _upright(row[3]), self.fixed_size, spread)
                for n, row in zip(self.fixed_numbers, self.fixed, strict=True)}

    @property
    @abstractmethod
    def rim(self) -> Array:
        """Outline of a disc at bottom and top for drawings, in its frame, (k, 3) m."""

    @abstractmethod
    def ring(self, disc: int) -> dict[int, Tag]:
        """Return the tags of a disc in its frame, from the centre of its bottom, by number."""

    @abstractmethod
    def stuck_as(self, values: Mapping[str, Any]) -> Any:
        """Return the tag offsets of parameters tags.*; raises ParameterError."""

    @abstractmethod
    def tared(self, stuck: Any, seen: Sequence[Sighting]) -> tuple[list[int], Any, str]:
        """
        Return the detected discs, the tag offsets, and these as a parameter.

        stuck: previous offsets.  seen: images of the straight arm, the oldest first.  Raises
        SensorError for an arm that is not straight, or moves.
        """

    @abstractmethod
    def placed(self, stuck: Any) -> PlacedTags:
        """Return the tags with those offsets that need no camera."""

    def _placed(self, offsets: Sequence[Array], ring_spread: Array) -> PlacedTags:
        rings = tuple(map(self.ring, range(len(self.heights))))
        return PlacedTags(self.fixed_tags, rings, offsets or [np.array(IDENTITY)] * len(rings),
                          ring_spread)


def _of_arm(arm: Arm, values: Mapping[str, Any], name: str, each: Sequence[str]
            ) -> dict[str, Any]:
    """
    Return the fields that all layouts share; fixed: as in parameter ``name``.

    each: names of the numbers that it has for each tag.  Raises ParameterError.
    """
    numbers = values[name]
    if len(numbers) % len(each) or len(numbers) < len(each) * MIN_FIXED:
        raise ParameterError(f'parameter {name} has {len(numbers)} numbers; needed: '
                             f'{", ".join(each)} of at least {MIN_FIXED} tags')
    fixed = np.reshape(np.array(numbers, dtype=float), (-1, len(each)))
    if not off_a_line(fixed[:, :3]):
        raise ParameterError(f'parameter {name}: the tags are almost in a line; put them '
                             'around the arm, such as at the corners of boards behind it')
    if FIRST_FIXED + len(fixed) > FAMILY_SIZE:
        raise ParameterError(f'parameter {name} has {len(fixed)} tags; allowed: '
                             f'{FAMILY_SIZE - FIRST_FIXED} at most')
    return {'fixed': fixed, 'axes': arm.pose_axes,
            'disc_heights': tuple(d.height for d in arm.discs),
            'straight_heights': straight_heights(arm),
            'segment_lengths': tuple(s.length for s in arm.segments)} | {
        one: values[f'tags.{one}'] for one in (
            'disc_size', 'fixed_size', 'stddev', 'fixed_stddev')}


@dataclass(frozen=True)
class TagLayout(Layout):
    """
    Tags of a planar arm, seen from -y: x to the right, z up; one on every disc, of its number.

    The fixed tags are in a plane behind the arm.  depth_stddev: m, of the distance of the tags of
    the discs from it.  Tag offsets are poses (7,), by disc, of the disc in the nominal disc frame
    of its tag.
    """

    depth_stddev: float
    fixed_parameter = 'tags.fixed_positions'

    @classmethod
    def of(cls, values: Mapping[str, Any], arm: Arm) -> Self:
        """Return the layout of parameters tags.* for this arm; raises ParameterError."""
        shared = _of_arm(arm, values, cls.fixed_parameter, ('x', 'z'))
        x, z = shared['fixed'].T
        shared['fixed'] = np.column_stack(np.broadcast_arrays(x, values['tags.depth'], z, FRONT))
        return cls(depth_stddev=values['tags.depth_stddev'], **shared)

    @property
    def rim(self) -> Array:
        """Outline of a disc at bottom and top for drawings, in its frame, (2, 3) m."""
        return np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]) * self.disc_size

    def ring(self, disc: int) -> dict[int, Tag]:
        """Return the tag of a disc in its frame, from the centre of its bottom, by number."""
        spread = _spread(self.stddev, self.disc_size)
        spread[2, 2] = hypot(self.stddev, self.depth_stddev)
        return {disc: Tag(np.array([0.0, 0.0, self.heights[disc]]), _upright(FRONT),
                          self.disc_size, spread)}

    def stuck_as(self, values: Mapping[str, Any]) -> tuple[Array, ...]:
        """Return the poses of parameter tags.offsets; raises ParameterError."""
        given, discs = tuple(values['tags.offsets']), len(self.heights)
        if given == (0.0,):
            given = (0.0,) * 3 * discs
        if len(given) != 3 * discs:
            raise ParameterError(f'parameter tags.offsets has {len(given)} numbers; needed: x, z '
                                 f'and angle for each of {discs} discs, or 0.0 for none')
        return tuple(full_poses(np.reshape(given, (discs, 3))))

    def tared(self, stuck: tuple[Array, ...], seen: Sequence[Sighting]
              ) -> tuple[list[int], tuple[Array, ...], str]:
        """Return the offsets of the discs seen in more than half of the images."""
        offsets, discs = list(stuck), []
        for n, height in enumerate(self.straight_heights):
            try:
                poses = [sight.by_tags[n] for sight in seen if n in sight.by_tags]
                if 2 * len(poses) > len(seen):
                    offsets[n] = tag_offset(poses, height)
                    discs.append(n)
            except SensorError as error:
                raise SensorError(f'disc {n}: {error}') from None
        numbers = tuple(float(v) for offset in offsets for v in planar_pose(offset))
        return discs, tuple(offsets), f'offsets: {as_yaml(numbers, 6)}'

    def placed(self, stuck: tuple[Array, ...]) -> PlacedTags:
        """Return the tags at their nominal positions, and the offsets."""
        return self._placed(stuck, np.zeros(6))


@dataclass(frozen=True)
class RingLayout(Layout):
    """
    Rings of tags around a spatial arm.

    Every disc is surrounded by a prism of ``faces`` tags, edge to edge, upright: z of the disc is
    up.  Face k of disc N faces outwards at k / faces of a turn about z from x, and has the number
    faces * N + k.  stddev, ring_stddev: m, standard deviation of tags on their ring, and of rings
    on their disc.  disc_radii: (discs,) m.  Tag offsets are kept as the corners seen on the
    straight arm.
    """

    faces: int
    ring_stddev: float
    disc_radii: tuple[float, ...]
    fixed_parameter = 'tags.fixed_poses'

    @classmethod
    def of(cls, values: Mapping[str, Any], arm: Arm) -> Self:
        """Return the layout of parameters tags.* for this arm; raises ParameterError."""
        shared = _of_arm(arm, values, cls.fixed_parameter, ('x', 'y', 'z', 'direction'))
        faces, discs = values['tags.faces'], len(arm.discs)
        if faces * discs > FIRST_FIXED:
            raise ParameterError(
                f'parameter tags.faces is {faces}; {discs} discs have {FIRST_FIXED} numbers: '
                f'allowed: {FIRST_FIXED // discs} at most')
        found = cls(faces=faces, ring_stddev=values['tags.ring_stddev'],
                    disc_radii=tuple(Chain(arm).disc_radii.tolist()), **shared)
        widest = max(found.disc_radii)
        if found.radius < widest:
            raise ParameterError(
                f'parameters tags.faces and tags.disc_size: rings of {faces} tags of '
                f'{found.disc_size * 1e3:g} mm are {found.radius * 1e3:.1f} mm from the axis, but '
                f'a disc has a radius of {widest * 1e3:g} mm; tags.disc_size: at least '
                f'{np.ceil(1e4 * found.disc_size * widest / found.radius) / 10:g} mm')
        return found

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
    def ring_spread(self) -> Array:
        """Standard deviations of the offset of a ring on its disc, (6,), m and rad."""
        return self.ring_stddev * np.repeat([1.0, 1.0 / self.radius], 3)

    def ring(self, disc: int) -> dict[int, Tag]:
        """Return the tags of a disc in its frame, from the centre of its bottom, by number."""
        found, spread = {}, _spread(self.stddev, self.disc_size)
        for k in range(self.faces):
            axes = _upright(2.0 * pi * k / self.faces)
            centre = self.radius * axes[2] + [0.0, 0.0, self.heights[disc]]
            found[self.faces * disc + k] = Tag(centre, axes, self.disc_size, spread)
        return found

    def stuck_as(self, values: Mapping[str, Any]) -> Corners:
        """Return the corners of parameter tags.reference_corners; raises ParameterError."""
        if any(values['tags.offsets']):
            raise ParameterError('parameter tags.offsets is for planar arms; for a spatial arm '
                                 'keep tags.reference_corners, which a tare returns: tare again')
        return corners_from_numbers(values['tags.reference_corners'])

    def tared(self, stuck: Corners, seen: Sequence[Sighting]
              ) -> tuple[list[int], Corners, str]:
        """Return the corners of the tags seen in more than half of the images."""
        corners = corners_at_rest([sight.corners for sight in seen])
        discs = [n for n in range(len(self.heights)) if not corners.keys().isdisjoint(
            self.ring(n))]
        return discs, corners, f'reference_corners: {as_yaml(corners_as_numbers(corners), 7)}'

    def placed(self, stuck: Corners) -> PlacedTags:
        """Return the nominal tags; see straight_tags for those that were seen."""
        return self._placed((), self.ring_spread)


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


def family() -> Any:
    """Return the family as a dictionary of OpenCV."""
    import cv2
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


def white_modules(number: int) -> NDArray[np.bool_]:
    """Return which modules of a tag are white, (MODULES, MODULES), from its upper left."""
    import cv2
    drawn: Picture = cv2.aruco.generateImageMarker(family(), number, MODULES)
    return drawn > 127


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
