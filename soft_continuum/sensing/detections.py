# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tags and discs detected in one image."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

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
    Measured pose of the bottom of a disc in base_link, m and rad.

    pose, covariance: position and quaternion x, y, z, w, (7,), and (6, 6) of the position and of
    a rotation vector along the axes of base_link.  residual: px, RMS of the corners of its tags.
    by_tags: (7,), the pose for tags at their nominal positions, if distinguished.
    """

    pose: Array
    covariance: Array
    residual: float
    by_tags: Array


class View(Protocol):
    """The view of a camera of base_link."""

    def pose(self, fit: Any) -> Array:
        """Return the pose (7,) in base_link of a disc, by its tags."""

    def project(self, points: Array) -> Array:
        """Project points (k, 3) m of the arm, (k, 2) px without distortion."""


@dataclass(frozen=True)
class TagDetections:
    """
    Detections in one image.

    discs: by number, base first.  numbers: of all detected tags, including foreign ones.
    deviation: px, of the corners by their residuals, for a spatial arm less the effect of tag
    offsets; nan without measurements.  problems: as text.
    corners: by number of the tag, (4, 2) px, without the distortion of the lens.  view: the
    projection; None unless the fixed tags determine it.
    """

    discs: Mapping[int, DiscPose]
    numbers: tuple[int, ...]
    stddev: float
    problems: tuple[str, ...]
    corners: Mapping[int, Array]
    view: View | None = None


class DiscCamera(ABC):
    """Measures the discs of an arm in images of one camera, by their tags."""

    def __init__(self, layout: Layout, lens: Lens, expected: Collection[int], passes: int = 1
                 ) -> None:
        """Store the tag layout, the camera calibration, and the arguments of TagDetector."""
        self.layout, self.lens = layout, lens
        self._known = frozenset(layout.fixed_numbers).union(
            *map(layout.numbers, range(len(layout.heights))))
        self._detector = TagDetector(lens, expected, passes)

    def measure(self, picture: Picture) -> TagDetections:
        """Return the detections in a grey image (height, width)."""
        if picture.shape[::-1] != self.lens.size:
            return TagDetections({}, (), np.nan, (
                f'the image has {picture.shape[1]} x {picture.shape[0]} px, the calibration '
                f'{self.lens.size[0]} x {self.lens.size[1]}; calibrate the camera at this '
                'resolution',), {})
        numbers, corners, problems = self._find(picture)
        view = self._view(picture, corners)
        if isinstance(view, str):
            return TagDetections({}, numbers, np.nan, (*problems, view), corners)
        fits: dict[int, Any] = {}
        for n in range(len(self.layout.heights)):
            fit = self._fit(n, corners, view)
            if isinstance(fit, str):
                problems.append(fit)
            elif fit is not None:
                fits[n] = fit
        if wrong_scale := self._wrong_scale(view, fits):
            return TagDetections({}, numbers, np.nan, (*problems, wrong_scale), corners, view)
        poses = {n: view.pose(fit) for n, fit in fits.items()}
        wrong, on_wrong_discs = implausible_spacing(poses, self.layout)
        discs, stddev = self._measured(view, {
            n: (poses[n], fit) for n, fit in fits.items() if n not in wrong})
        return TagDetections(
            discs, numbers, stddev, (*problems, *on_wrong_discs), corners, view)

    def _find(self, picture: Picture) -> tuple[tuple[int, ...], dict[int, Array], list[str]]:
        """Return all numbers, the corners of this layout's tags, px, and problems."""
        found = self._detector.detect(picture)
        count = Counter(n for n, _ in found)
        problems = [f'{times} tags with the number {n} are seen; remove the wrong one'
                    for n, times in sorted(count.items()) if times > 1 and n in self._known]
        corners = {n: c for n, c in found if n in self._known and count[n] == 1}
        return tuple(sorted(count)), corners, problems

    def _too_few(self, picture: Picture, corners: Mapping[int, Array], seen: int, needed: int
                 ) -> str:
        """Return the problem of an image without enough fixed tags, and a remedy."""
        why = 'are they covered, are they in the image, sharp and lit?'
        if is_black(picture):
            why = 'the image is black: is the lens covered, is there light?'
        elif not corners and self._detector.numbers(cv2.flip(picture, 1)):
            why = 'the image is mirrored: turn that off in the driver of the camera'
        return f'{seen} of {len(self.layout.fixed)} fixed tags are seen; needed: {needed}; {why}'

    @abstractmethod
    def _view(self, picture: Picture, corners: Mapping[int, Array]) -> Any:
        """Return the View from the fixed tags, or why there is none."""

    @abstractmethod
    def _fit(self, n: int, corners: Mapping[int, Array], view: Any) -> Any:
        """Return the measured disc, why it is unknown, or None when it is not seen."""

    def _wrong_scale(self, view: Any, fits: Mapping[int, Any]) -> str:
        """Return a problem of the size of disc tags in a view; empty for none."""
        return ''

    @abstractmethod
    def _measured(self, view: Any, fits: Mapping[int, tuple[Array, Any]]
                  ) -> tuple[dict[int, DiscPose], float]:
        """Return discs by their tags and fits, and the deviation, as in TagDetections."""


def implausible_spacing(poses: Mapping[int, Array], layout: Layout) -> tuple[set[int], list[str]]:
    """
    Return the discs at distances that the segment between them does not allow, and why.

    poses: (7,), of the detected discs.
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
