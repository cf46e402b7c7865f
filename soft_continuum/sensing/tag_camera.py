# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Poses of the discs of a planar arm from one image of its tags.

Corners are undistorted; those of the fixed tags give the homography from the plane of the arm to
the image.  The pose of a disc is the least-squares fit to the corners of its tag.  Depth and tilt,
which a single tag measures poorly, are not used.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from soft_continuum.mechanics.orientations import full_poses
from soft_continuum.sensing.detections import DiscCamera, DiscPose
from soft_continuum.sensing.layout import directions, MIN_FIXED, not_collinear, TagLayout
from soft_continuum.sensing.lens import Lens
from soft_continuum.sensing.pictures import Array, Picture
from soft_continuum.sensing.rigid import compose, IDENTITY, in_plane

SHARED_DEVIATION = 0.05  # px that all corners of a tag are off alike: residuals do not show it
FOCAL_DEVIATION = 0.005  # relative, of a good calibration
MAX_RESIDUAL = 2.0  # px, RMS: tags beyond it are not where they were said to be
MAX_SCALE_ERROR = 0.03  # relative, of the edge of a printed tag
ITERATIONS = 5


class TagCamera(DiscCamera):
    """Measures the discs of a planar arm in images of one camera."""

    layout: TagLayout

    def __init__(self, layout: TagLayout, lens: Lens, offsets: Sequence[Array] = ()) -> None:
        """
        Store the tag layout and the camera calibration.

        offsets: by disc, its pose (7,) in the nominal disc frame of its tag; none for tags at
        their nominal positions.
        """
        discs = range(len(layout.heights))
        super().__init__(layout, lens, {*layout.fixed_numbers, *discs})
        self._offsets = offsets or [np.array(IDENTITY) for _ in discs]

    def _view(self, picture: Picture, corners: Mapping[int, Array]) -> 'Plane | str':
        """Return the plane from the fixed tags, or why there is none."""
        seen = {n: c for n, c in corners.items() if n in self.layout.fixed_numbers}
        if len(seen) < MIN_FIXED:
            return self._too_few(picture, corners, len(seen), MIN_FIXED)
        if not not_collinear(np.array([self.layout.fixed_corners(n).mean(axis=0) for n in seen])):
            return 'all visible fixed tags but one are in a line; uncover the others'
        plane = Plane(self.layout, self.lens, seen)
        return plane.problem() or plane

    def _fit(self, n: int, corners: Mapping[int, Array], view: 'Plane') -> '_Fit | str | None':
        """Return the fit of a disc in the plane, why it fails, or None if it is not seen."""
        if n not in corners:
            return None
        fit = view.fit(n, corners[n])
        return fit if fit.residual <= MAX_RESIDUAL else (
            f'the tag of disc {n} does not fit by {fit.residual:.1f} px; is it flat, and of the '
            'size tags.disc_size?')

    def _measured(self, view: 'Plane', fits: Mapping[int, tuple[Array, '_Fit']]
                  ) -> tuple[dict[int, DiscPose], float]:
        """Return the discs, and the deviation of all corners."""
        squares = view.squares + sum(8.0 * fit.residual**2 for _, fit in fits.values())
        stddev = float(np.sqrt(squares / (view.freedom + 5 * len(fits))))
        variance = stddev**2 + SHARED_DEVIATION**2
        return {n: DiscPose(compose(pose, self._offsets[n]), in_plane(
            fit.pose, variance * fit.covariance + self._fixed_covariance(n, fit))[1],
            fit.residual, pose) for n, (pose, fit) in fits.items()}, stddev

    def _fixed_covariance(self, disc: int, fit: '_Fit') -> Array:
        """Return the covariance of errors common to all images: tags, and the lens."""
        stuck = self.layout.stddev
        of_tag = np.diag([stuck, stuck, stuck / self.layout.disc_size])**2
        lever = np.eye(3)  # a tag that is turned shifts the bottom of the disc
        lever[:2, 2] = -self.layout.heights[disc] * directions(fit.pose[2])[0]
        covariance: Array = lever @ of_tag @ lever.T
        covariance += self.layout.fixed_stddev**2 * fit.placement
        across = np.outer(fit.outwards, fit.outwards)
        covariance[:2, :2] += across * (
            (FOCAL_DEVIATION * self.layout.depth)**2 + self.layout.depth_stddev**2)
        return covariance


@dataclass(frozen=True)
class _Fit:
    """
    A disc's pose, its covariance for corners that are off by 1 px, and its residual, px.

    placement: (3, 3), covariance for fixed tags that are off by 1 m.  outwards: (2,), apparent
    outward shift of the disc over its shift towards the camera.
    """

    pose: Array
    covariance: Array
    residual: float
    placement: Array
    outwards: Array


class Plane:
    """The homography from the plane of the fixed tags to the picture."""

    def __init__(self, layout: TagLayout, lens: Lens, seen: Mapping[int, Array]) -> None:
        self._layout = layout
        self._points = np.vstack([layout.fixed_corners(n) for n in seen])
        self._pixels = np.vstack([*seen.values()])
        matrix, _ = cv2.findHomography(self._points, self._pixels, 0)
        self._matrix = matrix / matrix[2, 2]
        self._foot, self._distance, self._foot_covariance = _viewpoint(
            self._points, self._pixels, lens)
        errors = self.project_at(self._points) - self._pixels
        self.squares = float((errors**2).sum())
        self.freedom = max(1, errors.size - 8)
        jacobian = self._jacobian(self._points).reshape(-1, 8)
        self._covariance = np.linalg.inv(jacobian.T @ jacobian)
        shifts = np.zeros((len(jacobian), 2 * len(seen)))  # of the pixels with that of each tag
        for i, step in enumerate(1e-6 * np.eye(2)):
            moved = (self.project_at(self._points + step)
                     - self.project_at(self._points - step)) / 2e-6
            for k in range(len(seen)):
                shifts[8 * k:8 * k + 8, 2 * k + i] = moved[4 * k:4 * k + 4].ravel()
        of_tags = self._covariance @ jacobian.T @ shifts
        self._placement = of_tags @ of_tags.T

    def project_at(self, points: Array, depth: float = 0.0) -> Array:
        """Project points (k, 2) m, nearer to the camera by ``depth``, (k, 2) px."""
        return _mapped(self._matrix, self._behind(points, depth))

    def project(self, points: Array) -> Array:
        """Project points (k, 3) m of the arm, in base_link, (k, 2) px."""
        return self.project_at(points[:, [0, 2]], self._layout.depth)

    def pose(self, fit: _Fit) -> Array:
        """Return the pose (7,) of a disc."""
        pose: Array = full_poses(fit.pose[None])[0]
        return pose

    def _behind(self, points: Array, depth: float) -> Array:
        """Return the points of the plane hidden by these, (k, 2) m."""
        return points + (points - self._foot) * depth / (self._distance - depth)

    def _jacobian(self, points: Array, depth: float = 0.0) -> Array:
        """Return the Jacobian of the projections by the homography, (k, 2, 8)."""
        jacobian, hidden = np.empty((len(points), 2, 8)), self._behind(points, depth)
        for i in range(8):
            size = 1e-6 * max(1.0, abs(self._matrix.flat[i]))
            there, back = self._matrix.copy(), self._matrix.copy()
            there.flat[i] += size
            back.flat[i] -= size
            jacobian[:, :, i] = (_mapped(there, hidden) - _mapped(back, hidden)) / (2.0 * size)
        return jacobian

    def problem(self) -> str:
        """Return a problem of the fixed tags; empty for none."""
        count = len(self._pixels) // 4
        inverse = np.linalg.inv(cv2.findHomography(
            self._points.reshape(count, 4, 2).mean(axis=1), np.array([
                _centre_of(c) for c in self._pixels.reshape(count, 4, 2)]), 0)[0])
        edges = _mapped(inverse, self._pixels).reshape(count, 4, 2)
        size = float(np.median(np.linalg.norm(edges - np.roll(edges, 1, axis=1), axis=2)))
        scale = size / self._layout.fixed_size
        if abs(scale - 1.0) > MAX_SCALE_ERROR:
            return (f'the fixed tags are {size * 1e3:.1f} mm large, measured by their distances, '
                    f'not {self._layout.fixed_size * 1e3:.1f} mm: print at 100 %, or correct '
                    'tags.fixed_positions')
        residual = np.sqrt(self.squares / self._pixels.size)
        if residual > MAX_RESIDUAL:
            return (f'the fixed tags do not fit by {residual:.1f} px; are they where '
                    'tags.fixed_positions says, in one plane, and is this calibration of this '
                    'camera?')
        return ''

    def fit(self, disc: int, pixels: Array) -> _Fit:
        """Return the pose at which the tag of a disc is seen at ``pixels`` (4, 2)."""
        layout, depth = self._layout, self._layout.depth
        flat = _mapped(np.linalg.inv(self._matrix), pixels)
        flat -= (flat - self._foot) * depth / self._distance
        up = flat[:2].mean(axis=0) - flat[2:].mean(axis=0)
        angle = float(np.arctan2(up[0], up[1]))
        pose = np.array([0.0, 0.0, angle])
        pose[:2] = flat.mean(axis=0) - layout.disc_corners(disc, pose).mean(axis=0)
        jacobian = np.empty((8, 3))
        for _ in range(ITERATIONS):
            errors = (pixels - self.project_at(layout.disc_corners(disc, pose), depth)).ravel()
            for i, size in enumerate((1e-6, 1e-6, 1e-5)):
                step = np.zeros(3)
                step[i] = size
                jacobian[:, i] = (
                    self.project_at(layout.disc_corners(disc, pose + step), depth)
                    - self.project_at(layout.disc_corners(disc, pose - step), depth)
                ).ravel() / (2.0 * size)
            change = np.linalg.lstsq(jacobian, errors, rcond=None)[0]
            pose = pose + change
            if np.abs(change).max() < 1e-9:
                break
        own = np.linalg.inv(jacobian.T @ jacobian)
        gain = own @ jacobian.T @ self._jacobian(
            layout.disc_corners(disc, pose), depth).reshape(8, 8)
        residual = pixels - self.project_at(layout.disc_corners(disc, pose), depth)
        covariance = own + gain @ self._covariance @ gain.T
        covariance[:2, :2] += (depth / self._distance)**2 * self._foot_covariance
        return _Fit(pose, covariance,
                    float(np.sqrt((residual**2).sum() / 8.0)),
                    gain @ self._placement @ gain.T, (pose[:2] - self._foot) / self._distance)


def _viewpoint(points: Array, pixels: Array, lens: Lens) -> tuple[Array, float, Array]:
    """
    Return the camera position: foot (x, z) on the plane of the fixed tags, and distance, m.

    Also return the covariance (2, 2) of the foot for corners that are off by 1 px.
    """
    solid = np.column_stack([points, np.zeros(len(points))])
    _, turn, shift = cv2.solvePnP(solid, pixels, lens.matrix, None, flags=cv2.SOLVEPNP_IPPE)
    turn, shift = cv2.solvePnPRefineLM(solid, pixels, lens.matrix, None, turn, shift)
    pose = np.concatenate([turn.ravel(), shift.ravel()])
    jacobian = cv2.projectPoints(solid, turn, shift, lens.matrix, None)[1][:, :6]
    of_pose = np.column_stack([
        (_camera(pose + step) - _camera(pose - step)) / 2e-6 for step in 1e-6 * np.eye(6)])[:2]
    covariance = of_pose @ np.linalg.inv(jacobian.T @ jacobian) @ of_pose.T
    camera = _camera(pose)
    return camera[:2], abs(float(camera[2])), covariance


def _camera(pose: Array) -> Array:
    """Return the camera position for a rotation vector and a shift, (6,), of the plane."""
    camera: Array = -cv2.Rodrigues(pose[:3])[0].T @ pose[3:]
    return camera


def _centre_of(corners: Array) -> Array:
    """Return the intersection of a tag's diagonals (4, 2): its centre in any perspective."""
    a, b, c, d = corners
    sides = np.column_stack([c - a, b - d])
    centre: Array = a + (c - a) * np.linalg.solve(sides, b - a)[0]
    return centre


def _mapped(matrix: Array, points: Array) -> Array:
    """Return points (k, 2) mapped by a homography."""
    w = points @ matrix[:, :2].T + matrix[:, 2]
    mapped: Array = w[:, :2] / w[:, 2:]
    return mapped
