# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Poses of the discs of an arm from one image of its tags.

The fixed tags determine the pose of base_link in the frame of the camera, and the focal length if
they are at different depths.  All visible tags of a disc determine its pose, within the plane of
the arm if it has one.  An ambiguous disc, such as one with a single tag seen frontally that may
tilt, is not measured.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from soft_continuum.estimation.sensing.corners import TagDetector
from soft_continuum.estimation.sensing.layout import Layout, MIN_FIXED, off_a_line, Tag
from soft_continuum.estimation.sensing.lens import Lens
from soft_continuum.estimation.sensing.pictures import Array, is_black, Picture
from soft_continuum.estimation.sensing.placed_tags import PlacedTags
from soft_continuum.estimation.sensing.pose_fit import (
    CORNER_DEVIATION,
    FULL_WIDTH,
    PoseFit,
    TagGroup,
    width,
)
from soft_continuum.estimation.sensing.rigid import compose, levers, rotate, UNKNOWN, UP
from soft_continuum.mechanics.orientations import quaternions

MAX_RESIDUAL = 2.0  # px, RMS of each coordinate: tags beyond it are not where they were said to be
MAX_SCALE_ERROR = 0.03  # relative, of the edge of a printed tag
FAR_OFF = 0.5  # relative size error that no printer causes
MAX_MISFIT = 16.0  # of corners over what is expected of them, both squared
STEADY = 0.2  # px: with less of fixed tags, the view of a planar arm follows their noise
NOISY = 1.5  # such a misfit of fixed tags, beyond which corners are worse than expected
CLEARER = 12.0  # by which the misfit of every other pose of a disc is larger
MIN_WIDTH = 16.0  # px, 2 per module: of a tag seen more from its side corners are not exact
MIN_TILT = 0.35  # rad by which a tag that is seen alone has to look past the camera
MAX_TURN = 0.1  # rad, standard: a disc that is known worse than that is not measured
MIN_CHORD, MAX_CHORD = 0.5, 1.05  # of a segment's length, between the discs at its ends


@dataclass(frozen=True)
class DiscPose:
    """
    Measured pose of the bottom of a disc in base_link, m and rad.

    pose, covariance: position and quaternion x, y, z, w, (7,), and (6, 6) of the position and of
    a rotation vector along the axes of base_link.  by_tags: (7,), the pose without offsets.
    """

    pose: Array
    covariance: Array
    by_tags: Array


class CameraView:
    """The view of a camera of base_link."""

    def __init__(self, base: PoseFit, lens: Lens, deviation: float) -> None:
        """
        Take the pose of base_link in the frame of the camera.

        deviation: px, of each corner of a tag of a disc.
        """
        self.base, self._lens, self.deviation = base, lens, deviation

    def project(self, points: Array) -> Array:
        """Project points (k, 3) m in base_link, (k, 2) px; nan behind the camera."""
        places = points @ self.base.turn.T + self.base.shift
        depths = np.where(places[:, 2:] > 0.0, places[:, 2:], np.nan)
        pixels: Array = (places[:, :2] / depths * self.base.focal * np.diag(self._lens.matrix)[:2]
                         + self._lens.matrix[:2, 2])
        return pixels

    def pose(self, fit: PoseFit) -> Array:
        """Return the pose (7,) in base_link of a body seen by the camera."""
        back = self.base.turn.T
        return np.concatenate([back @ (fit.shift - self.base.shift),
                               quaternions((back @ fit.turn)[None])[0]])

    def covariance(self, fit: PoseFit, factor: float) -> Array:
        """
        Return the covariance (6, 6) of that pose, along the axes of base_link.

        factor: by which the squares of the corners are larger than expected.
        """
        back = np.kron(np.eye(2), self.base.turn.T)
        # What moves base_link moves what is seen of the body alike.
        by_base = fit.response.copy()
        by_base[:, :6] = by_base[:, :6] @ levers(fit.shift - self.base.shift)
        found = factor * (fit.covariance + by_base @ self.base.covariance @ by_base.T)[:6, :6]
        covariance: Array = back @ found @ back.T
        return covariance


@dataclass(frozen=True)
class TagDetections:
    """
    Detections in one image.

    discs: by number, base first.  numbers: of all detected tags, including foreign ones.
    stddev: px, of the corners by their residuals, less the effect of tag offsets; nan without
    measurements.  problems: as text.  corners: by number of the tag, (4, 2) px, without the
    distortion of the lens.  view: the projection; None unless the fixed tags determine it.
    """

    discs: Mapping[int, DiscPose]
    numbers: tuple[int, ...]
    stddev: float
    problems: tuple[str, ...]
    corners: Mapping[int, Array]
    view: CameraView | None = None


class TagCamera:
    """Measures the discs of an arm in images of one camera, by their tags."""

    def __init__(self, layout: Layout, lens: Lens, tags: PlacedTags) -> None:
        """Store the tag layout, the camera calibration, and the tags as they are placed."""
        self.layout, self.lens, self._tags = layout, lens, tags
        self._known = frozenset(tags.fixed).union(*tags.rings)
        self._tilts = bool(layout.axes.all())  # tags may be seen from their side, or not at all
        self._full_width = FULL_WIDTH if self._tilts else 0.0
        self._detector = TagDetector(lens, () if self._tilts else self._known, 1 + self._tilts)

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
        fits: dict[int, PoseFit] = {}
        for n in range(len(self.layout.heights)):
            fit = self._fit(n, corners, view)
            if isinstance(fit, str):
                problems.append(fit)
            elif fit is not None:
                fits[n] = fit
        if self._tilts and (wrong_scale := self._wrong_scale(view, fits)):
            return TagDetections({}, numbers, np.nan, (*problems, wrong_scale), corners, view)
        poses = {n: view.pose(fit) for n, fit in fits.items()}
        wrong, on_wrong_discs = implausible_spacing(poses, self.layout)
        fits = {n: fit for n, fit in fits.items() if n not in wrong}
        used = [view.base, *fits.values()]
        factor = sum(fit.misfit for fit in used) / sum(fit.freedom for fit in used)
        return TagDetections(
            {n: DiscPose(compose(poses[n], self._tags.offsets[n]),
                         self._covariance(n, poses[n], view.covariance(fit, max(1.0, factor))),
                         poses[n]) for n, fit in fits.items()},
            numbers, view.deviation * float(np.sqrt(factor)), (*problems, *on_wrong_discs),
            corners, view)

    def _find(self, picture: Picture) -> tuple[tuple[int, ...], dict[int, Array], list[str]]:
        """Return all numbers, the corners of this layout's tags, px, and problems."""
        found = self._detector.detect(picture)
        count = Counter(n for n, _ in found)
        problems = [f'{times} tags with the number {n} are seen; remove the wrong one'
                    for n, times in sorted(count.items()) if times > 1 and n in self._known]
        corners = {n: c for n, c in found if n in self._known and count[n] == 1
                   and (width(c) >= MIN_WIDTH or not self._tilts)}
        return tuple(sorted(count)), corners, problems

    def _view(self, picture: Picture, corners: Mapping[int, Array]) -> CameraView | str:
        """Return the view of base_link, or why it is unknown."""
        fixed, layout = self._tags.fixed, self.layout
        seen = [n for n in fixed if n in corners]
        if len(seen) < MIN_FIXED:
            return self._too_few(picture, corners, len(seen))
        if not off_a_line(np.array([fixed[n].centre for n in seen])):
            return 'the visible fixed tags are in a line; uncover the others'
        given = ([fixed[n] for n in seen], [corners[n] for n in seen], self.lens,
                 self._tags.focal, self._tags.focal_stddev)
        deviation = CORNER_DEVIATION if self._tilts else STEADY
        group = TagGroup(*given, deviation=deviation, full_width=self._full_width)
        fits, of_discs = group.fits(), CORNER_DEVIATION
        if not fits:
            return f'the fixed tags do not fit; are they at {layout.fixed_parameter}?'
        off = fits[0].misfit / fits[0].freedom
        if not self._tilts and off > NOISY:
            of_discs = deviation * float(np.sqrt(off))
            group = TagGroup(*given, deviation=of_discs, full_width=self._full_width)
            fits = group.fits()
        factor = group.size_factor(fits[0])
        if MAX_SCALE_ERROR < abs(factor - 1.0) < FAR_OFF:
            return (f'the fixed tags are {factor * layout.fixed_size * 1e3:.1f} mm large, '
                    f'measured by their distances, not {layout.fixed_size * 1e3:.1f} mm: '
                    f'print at 100 %, or correct {layout.fixed_parameter}')
        if _does_not_fit(fits[0], off) or abs(factor - 1.0) >= FAR_OFF:
            return (f'the fixed tags do not fit by {fits[0].residual:.1f} px; are they where '
                    f'{layout.fixed_parameter} says, and is this calibration of this camera?')
        return CameraView(fits[0], self.lens, of_discs)

    def _too_few(self, picture: Picture, corners: Mapping[int, Array], seen: int) -> str:
        """Return the problem of an image without enough fixed tags, and a remedy."""
        why = 'are they covered, are they in the image, sharp and lit?'
        if is_black(picture):
            why = 'the image is black: is the lens covered, is there light?'
        elif not corners and self._detector.numbers(cv2.flip(picture, 1)):
            why = 'the image is mirrored: turn that off in the driver of the camera'
        return (f'{seen} of {len(self.layout.fixed)} fixed tags are seen; needed: {MIN_FIXED}; '
                f'{why}')

    def _fit(self, n: int, corners: Mapping[int, Array], view: CameraView) -> PoseFit | str | None:
        """Return the pose of a disc, why it is unknown, or None when it is not seen."""
        ring = self._tags.rings[n]
        seen = [number for number in ring if number in corners]
        fits = TagGroup(
            [ring[k] for k in seen], [corners[k] for k in seen], self.lens, view.base.focal,
            base=view.base, axes=self.layout.axes, deviation=view.deviation,
            full_width=self._full_width).fits() if seen else []
        if not fits:
            return None
        best = fits[0]
        if _does_not_fit(best, best.misfit / best.freedom):
            return (f'the tags of disc {n} do not fit by {best.residual:.1f} px; is each in its '
                    'place, flat, and of the size tags.disc_size?')
        alone = len(seen) == 1 and _tilt(ring[seen[0]], best) < MIN_TILT
        unclear = any(fit.misfit - best.misfit < CLEARER for fit in fits[1:])
        if self._tilts and (alone or unclear or np.linalg.eigvalsh(
                best.covariance[3:6, 3:6])[-1] > MAX_TURN**2):
            return (f'only tag {", ".join(map(str, seen))} of disc {n} is seen, too frontally to '
                    'measure its orientation; turn the ring, or move the camera')
        return best

    def _wrong_scale(self, view: CameraView, fits: Mapping[int, PoseFit]) -> str:
        """Return a problem of the size of the rings, judged by the base; empty for none."""
        size = np.linalg.norm(fits[0].shift if 0 in fits else view.base.shift)
        factor = float(np.linalg.norm(view.base.shift) / size)
        if abs(factor - 1.0) <= MAX_SCALE_ERROR:
            return ''
        return (f'the tags of disc 0 are {factor * self.layout.disc_size * 1e3:.1f} mm large, '
                f'measured by the fixed tags, not {self.layout.disc_size * 1e3:.1f} mm: print at '
                '100 %, or correct tags.disc_size; is the ring of the base where it should be?')

    def _covariance(self, n: int, pose: Array, by_tags: Array) -> Array:
        """Return the covariance of a disc, with the offset of its ring."""
        # A ring that is turned about its middle shifts the bottom of the disc.
        lever = levers(-self.layout.heights[n] * rotate(pose[3:], UP))
        found = by_tags + lever * self._tags.ring_spread**2 @ lever.T
        measured = np.outer(self.layout.axes, self.layout.axes)
        covariance: Array = np.where(measured, found, UNKNOWN * np.eye(6))
        return covariance


def implausible_spacing(poses: Mapping[int, Array], layout: Layout) -> tuple[set[int], list[str]]:
    """
    Return the discs at distances that the segment between them does not allow, and why.

    poses: (7,), of the detected discs.
    """
    wrong: set[int] = set()
    problems = []
    lengths = layout.segment_lengths
    for n in sorted(poses.keys() & {above - 1 for above in poses}):
        along = rotate(poses[n][3:], UP)
        top = poses[n][:3] + layout.disc_heights[n] * along
        chord = float(np.linalg.norm(poses[n + 1][:3] - top))  # to the bottom of that above
        if not MIN_CHORD * lengths[n] <= chord <= MAX_CHORD * lengths[n]:
            wrong |= {n, n + 1}
            problems.append(
                f'discs {n} and {n + 1} are seen {chord * 1e3:.0f} mm apart, though segment '
                f'{n + 1} between them has {lengths[n] * 1e3:.0f} mm; are the tags on the right '
                'discs?')
    return wrong, problems


def _tilt(tag: Tag, fit: PoseFit) -> float:
    """Return the angle between a tag's normal and the line of sight, rad."""
    place = fit.turn @ tag.centre + fit.shift
    return float(np.arccos(-(fit.turn @ tag.axes[2]) @ place / np.linalg.norm(place)))


def _does_not_fit(fit: PoseFit, off: float) -> bool:
    """Return whether corners are off by more than pixels and, ``off``, than is expected."""
    return fit.residual > MAX_RESIDUAL and off > MAX_MISFIT
