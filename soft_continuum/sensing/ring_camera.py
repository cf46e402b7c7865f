# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Poses of the discs of a spatial arm from one image of the tags around them.

The fixed tags determine the pose of base_link in the frame of the camera, and the focal length if
they are at different depths.  All visible tags of a disc determine its pose.  An ambiguous disc,
such as one with a single tag seen frontally, is not measured.
"""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics.orientations import cross_matrices
from soft_continuum.sensing.detections import DiscCamera, DiscPose
from soft_continuum.sensing.lens import Lens
from soft_continuum.sensing.pictures import Array, Picture
from soft_continuum.sensing.pose_fit import CORNER_DEVIATION, PoseFit, TagGroup, width
from soft_continuum.sensing.ring_layout import MIN_FIXED, off_a_line, RingLayout, Tag
from soft_continuum.sensing.ring_tare import PlacedTags
from soft_continuum.sensing.tag_camera import MAX_RESIDUAL, MAX_SCALE_ERROR

FAR_OFF = 0.5  # relative size error that no printer causes
MAX_MISFIT = 16.0  # of corners over what is expected of them, both squared
CLEARER = 12.0  # by which the misfit of every other pose of a disc is larger
MIN_WIDTH = 16.0  # px, 2 per module: of a tag seen more from its side corners are not exact
MIN_TILT = 0.35  # rad by which a tag that is seen alone has to look past the camera
MAX_TURN = 0.1  # rad, standard: a disc that is known worse than that is not measured


class RingCamera(DiscCamera):
    """Measures the discs of a spatial arm in images of one camera."""

    layout: RingLayout

    def __init__(self, layout: RingLayout, lens: Lens,
                 straight: Mapping[int, Array] | None = None) -> None:
        """
        Store the tag layout and the camera calibration.

        straight: corners (4, 2) px of each tag on the straight arm, without distortion;
        raises SensorError if the arm does not appear straight.
        """
        super().__init__(layout, lens, (), passes=2)
        self._tags = (PlacedTags.seen_straight(layout, lens, straight) if straight
                      else PlacedTags.of(layout))
        self._fixed = self._tags.fixed

    def _find(self, picture: Picture) -> tuple[tuple[int, ...], dict[int, Array], list[str]]:
        """Return the corners without tags seen too obliquely."""
        numbers, found, problems = super()._find(picture)
        return numbers, {n: c for n, c in found.items() if width(c) >= MIN_WIDTH}, problems

    def _view(self, picture: Picture, corners: Mapping[int, Array]) -> 'View | str':
        """Return the view of base_link, or why it is unknown."""
        seen = [n for n in self._fixed if n in corners]
        if len(seen) < MIN_FIXED:
            return self._too_few(picture, corners, len(seen), MIN_FIXED)
        if not off_a_line(np.array([self._fixed[n].centre for n in seen])):
            return 'the visible fixed tags are in a line; uncover the others'
        group = TagGroup([self._fixed[n] for n in seen], [corners[n] for n in seen], self.lens,
                         self._tags.focal, self._tags.focal_stddev)
        fits = group.fits()
        if not fits:
            return 'the fixed tags do not fit; are they at tags.fixed_poses?'
        factor = group.size_factor(fits[0])
        if MAX_SCALE_ERROR < abs(factor - 1.0) < FAR_OFF:
            return (f'the fixed tags are {factor * self.layout.fixed_size * 1e3:.1f} mm large, '
                    f'measured by their distances, not {self.layout.fixed_size * 1e3:.1f} mm: '
                    'print at 100 %, or correct tags.fixed_poses')
        if _does_not_fit(fits[0]) or abs(factor - 1.0) >= FAR_OFF:
            return (f'the fixed tags do not fit by {fits[0].residual:.1f} px; are they where '
                    'tags.fixed_poses says, and is this calibration of this camera?')
        return View(fits[0], self.lens)

    def _fit(self, n: int, corners: Mapping[int, Array], view: 'View') -> PoseFit | str | None:
        """Return the pose of a disc, why it is unknown, or None when it is not seen."""
        ring = self._tags.rings[n]
        seen = [number for number in ring if number in corners]
        fits = TagGroup([ring[k] for k in seen], [corners[k] for k in seen], self.lens,
                        view.base.focal).fits() if seen else []
        if not fits:
            return None
        best = fits[0]
        if _does_not_fit(best):
            return (f'the tags of disc {n} do not fit by {best.residual:.1f} px; is each on its '
                    'face, flat, and of the size tags.disc_size?')
        alone = len(seen) == 1 and _tilt(ring[seen[0]], best) < MIN_TILT
        unclear = any(fit.misfit - best.misfit < CLEARER for fit in fits[1:])
        if alone or unclear or np.linalg.eigvalsh(best.covariance[3:, 3:])[-1] > MAX_TURN**2:
            return (f'only tag {", ".join(map(str, seen))} of disc {n} is seen, too frontally to '
                    'measure its orientation; turn the ring, or move the camera')
        return best

    def _wrong_scale(self, view: 'View', fits: Mapping[int, PoseFit]) -> str:
        """Return a problem of the size of the rings, judged by the base; empty for none."""
        size = np.linalg.norm(fits[0].shift if 0 in fits else view.base.shift)
        factor = float(np.linalg.norm(view.base.shift) / size)
        if abs(factor - 1.0) <= MAX_SCALE_ERROR:
            return ''
        return (f'the tags of disc 0 are {factor * self.layout.disc_size * 1e3:.1f} mm large, '
                f'measured by the fixed tags, not {self.layout.disc_size * 1e3:.1f} mm: print at '
                '100 %, or correct tags.disc_size; is the ring of the base where it should be?')

    def _measured(self, view: 'View', fits: Mapping[int, tuple[Array, PoseFit]]
                  ) -> tuple[dict[int, DiscPose], float]:
        """Return the discs, and the deviation of corners beyond that of tag offsets."""
        used = [view.base, *(fit for _, fit in fits.values())]
        factor = sum(fit.misfit for fit in used) / sum(fit.freedom for fit in used)
        return {n: DiscPose(pose, view.covariance(fit, max(1.0, factor)) + self._of_ring(n, pose),
                            fit.residual, pose) for n, (pose, fit) in fits.items()
                }, CORNER_DEVIATION * float(np.sqrt(factor))

    def _of_ring(self, n: int, pose: Array) -> Array:
        """Return the covariance of a disc due to the offset of its ring."""
        sits, turn = self._tags.ring_stddev, Rotation.from_quat(pose[3:]).as_matrix()
        lever = np.eye(6)  # a ring that is turned about its middle shifts the bottom of the disc
        lever[:3, 3:] = cross_matrices(self.layout.heights[n] * turn[:, 2])
        squares = np.repeat([sits, sits / self.layout.radius], 3)**2
        covariance: Array = lever * squares @ lever.T
        return covariance


class View:
    """The view of a camera of base_link."""

    def __init__(self, base: PoseFit, lens: Lens) -> None:
        """Take the pose of base_link in the frame of the camera."""
        self.base, self._lens = base, lens

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
                               Rotation.from_matrix(back @ fit.turn).as_quat(canonical=True)])

    def covariance(self, fit: PoseFit, factor: float) -> Array:
        """
        Return the covariance (6, 6) of that pose, along the axes of base_link.

        factor: by which the squares of the corners are larger than expected.
        """
        back = np.kron(np.eye(2), self.base.turn.T)
        by_base = np.hstack([-np.eye(6), fit.per_focal[:, None]])
        by_base[:3, 3:6] = cross_matrices(fit.shift - self.base.shift)
        found = factor * (fit.covariance + by_base @ self.base.covariance @ by_base.T)
        covariance: Array = back @ found @ back.T
        return covariance


def _tilt(tag: Tag, fit: PoseFit) -> float:
    """Return the angle between a tag's normal and the line of sight, rad."""
    place = fit.turn @ tag.centre + fit.shift
    return float(np.arccos(-(fit.turn @ tag.axes[2]) @ place / np.linalg.norm(place)))


def _does_not_fit(fit: PoseFit) -> bool:
    """Return whether corners are off by more than pixels and stated deviations explain."""
    return fit.residual > MAX_RESIDUAL and fit.misfit > MAX_MISFIT * fit.freedom
