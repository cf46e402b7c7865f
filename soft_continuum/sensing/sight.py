# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What one picture shows: tags, and from them the discs."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from soft_continuum.sensing.corners import TagDetector
from soft_continuum.sensing.layout import Layout
from soft_continuum.sensing.lens import Lens
from soft_continuum.sensing.pictures import Array, is_black, Picture
from soft_continuum.sensing.rigid import rotate

MIN_CHORD, MAX_CHORD = 0.5, 1.05  # of a segment's length, between the discs at its ends


@dataclass(frozen=True)
class DiscPose:
    """
    Where a disc was seen: pose of its bottom in base_link, m and rad.

    pose, covariance: position and quaternion x, y, z, w, (7,), and (6, 6) of the position and of
    a rotation vector along the axes of base_link.  residual: px, RMS of the corners of its tags.
    by_tags: (7,), its pose if its tags were stuck as they are meant to be, as far as that is
    kept apart.
    """

    pose: Array
    covariance: Array
    residual: float
    by_tags: Array


class View(Protocol):
    """How a camera sees base_link."""

    def seen_at(self, points: Array) -> Array:
        """Return where points (k, 3) m of the arm are, (k, 2) px without distortion."""


@dataclass(frozen=True)
class Sight:
    """
    What one picture shows.

    discs: by number, base first.  numbers: of all tags that were seen, others too.  deviation: px,
    of the corners by their residuals, of a spatial arm less what tags that are stuck off do to
    them; nan where nothing was measured.  problems: for people.
    corners: by number of the tag, (4, 2) px, without the distortion of the lens.  view: where
    other points are seen; None while the fixed tags do not tell.
    """

    discs: Mapping[int, DiscPose]
    numbers: tuple[int, ...]
    deviation: float
    problems: tuple[str, ...]
    corners: Mapping[int, Array]
    view: View | None = None


class TagFinder:
    """Finds the tags of one layout in the pictures of one camera."""

    def __init__(self, lens: Lens, known: Collection[int], expected: Collection[int],
                 passes: int = 1) -> None:
        """Take the numbers of the layout, and the rest as TagDetector."""
        self._lens, self._known = lens, frozenset(known)
        self._detector = TagDetector(lens, expected, passes)

    def wrong_size(self, picture: Picture) -> str:
        """Return what is wrong with the size of a picture, empty for nothing."""
        if picture.shape[::-1] == self._lens.size:
            return ''
        return (f'the picture has {picture.shape[1]} x {picture.shape[0]} px, the '
                f'calibration {self._lens.size[0]} x {self._lens.size[1]}; calibrate '
                'the camera at the resolution that is used')

    def find(self, picture: Picture) -> tuple[tuple[int, ...], dict[int, Array], list[str]]:
        """Return all numbers, the corners of the tags of this layout, px, and what is wrong."""
        found = self._detector.detect(picture)
        count = Counter(n for n, _ in found)
        problems = [f'{times} tags with the number {n} are seen; take the wrong one away'
                    for n, times in sorted(count.items()) if times > 1 and n in self._known]
        corners = {n: c for n, c in found if n in self._known and count[n] == 1}
        return tuple(sorted(count)), corners, problems

    def why_so_few(self, picture: Picture, corners: Mapping[int, Array]) -> str:
        """Return a remedy for a picture without enough tags."""
        if is_black(picture):
            return '; the picture is black: is the lens covered, is there light?'
        if not corners and self._detector.numbers(cv2.flip(picture, 1)):
            return '; the picture is mirrored: turn that off in the driver of the camera'
        return '; is something before them, are they in the picture, sharp and lit?'


class DiscCamera(Protocol):
    """Measures the discs in the pictures of one camera."""

    @property
    def layout(self) -> Layout:
        """Where the tags are."""

    @property
    def lens(self) -> Lens:
        """Calibration of the camera."""

    def measure(self, picture: Picture) -> Sight:
        """Return what a grey picture (height, width) shows."""


def exchanged(poses: Mapping[int, Array], layout: Layout) -> tuple[set[int], list[str]]:
    """
    Return the discs that are nearer or farther than the segment between them lets, and why.

    poses: (7,), of the discs that are seen.
    """
    wrong: set[int] = set()
    problems = []
    lengths = layout.segment_lengths
    for n in sorted(poses.keys() & {above - 1 for above in poses}):
        along = rotate(poses[n][3:], np.array([0.0, 0.0, 1.0]))
        top = poses[n][:3] + layout.disc_heights[n] * along
        chord = float(np.linalg.norm(poses[n + 1][:3] - top))  # to the bottom of that above
        if not MIN_CHORD * lengths[n] <= chord <= MAX_CHORD * lengths[n]:
            wrong |= {n, n + 1}
            problems.append(
                f'discs {n} and {n + 1} are seen {chord * 1e3:.0f} mm apart, though segment '
                f'{n + 1} between them has {lengths[n] * 1e3:.0f} mm; are the tags on the right '
                'discs?')
    return wrong, problems
