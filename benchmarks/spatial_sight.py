# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Where a camera would see the discs of a spatial arm, with its errors but without its pictures.

It looks along +y.  Errors that stay are those of the preset: how tags are stuck on discs and where
the fixed ones are, which turn base_link, and the focal length, which makes depth wrong.  Those of
a picture grow with picture_noise, five times as much in depth and about axes across the view; how
large they are is an assumption.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics.chain import Array
from soft_continuum.sensing.rigid import compose, inverse, mean_pose
from soft_continuum.twin.differences import Differences

TAG_SIZE, BOARD_SIZE = 0.02, 0.3  # m
ACROSS, ABOUT_VIEW = 2e-5, 5e-4  # m and rad for each grey value of picture_noise
ALONG_VIEW = 5.0  # times ACROSS; about the axes across the view, times ABOUT_VIEW
TARE_PICTURES = 6


class SpatialSight:
    """A camera before a spatial arm."""

    def __init__(self, given: Differences, straight: Array, tared: bool) -> None:
        """
        Draw the errors that stay.

        straight: (discs, 7), poses of the bottom of each disc in the beginning.  tared: whether
        those are taken as the straight arm's.
        """
        self._random = np.random.default_rng([given.seed, 3])
        moved = given.tag_offset, given.tag_offset / TAG_SIZE
        self._mounts = [self._draw(*moved) for _ in straight]
        fixed = given.fixed_offset / 2.0, given.fixed_offset / BOARD_SIZE
        self._base = self._draw(*fixed)
        self._depth = 1.0 + self._random.normal(0.0, given.calibration_error)
        across, about = given.picture_noise * ACROSS, given.picture_noise * ABOUT_VIEW
        self._noise = np.array([across, ALONG_VIEW * across, across,
                                ALONG_VIEW * about, about, ALONG_VIEW * about])
        stays = self._noise**2 / TARE_PICTURES if tared else np.repeat(moved, 3)**2
        self._same = np.diag(self._noise**2 + stays)
        self._fixed = np.repeat(fixed, 3)**2
        self._focal = given.calibration_error
        self._tares: list[Array] | None = None
        if tared:
            seen = [self._poses(straight) for _ in range(TARE_PICTURES)]
            self._tares = [compose(inverse(mean_pose(each)), there)
                           for each, there in zip(zip(*seen, strict=True), straight, strict=True)]

    def discs(self, truth: Array) -> list[tuple[Array, Array]]:
        """Return pose (7,) and covariance (6, 6), as lab.Pose has them, of discs (discs, 7)."""
        poses = self._poses(truth)
        if self._tares is not None:
            poses = [compose(pose, tare) for pose, tare in zip(poses, self._tares, strict=True)]
        return [(pose, self._covariance(pose)) for pose in poses]

    def _poses(self, truth: Array) -> list[Array]:
        """Return what a picture shows of discs (discs, 7)."""
        found = []
        for pose, mount in zip(truth, self._mounts, strict=True):
            seen = compose(self._base, compose(pose, mount))
            seen[1] *= self._depth
            wrong = self._random.normal(0.0, self._noise)
            turned = Rotation.from_rotvec(wrong[3:]) * Rotation.from_quat(seen[3:])
            found.append(np.array([*(seen[:3] + wrong[:3]), *turned.as_quat()]))
        return found

    def _covariance(self, pose: Array) -> Array:
        by_base = np.eye(6)
        by_base[:3, 3:] = -np.cross(np.eye(3), pose[:3])
        found: Array = self._same + by_base * self._fixed @ by_base.T
        found[1, 1] += (self._focal * pose[1])**2
        return found

    def _draw(self, shift: float, turn: float) -> Array:
        """Return a small random pose: m and rad, standard deviations."""
        wrong = Rotation.from_rotvec(self._random.normal(0.0, turn, 3))
        return np.array([*self._random.normal(0.0, shift, 3), *wrong.as_quat()])


def bending_of(discs: Array) -> Array:
    """Return the bending of segments about x and y of the disc below, (segments, 2) rad."""
    turns = Rotation.from_quat(discs[:, 3:])
    axes = (turns[:-1].inv() * turns[1:]).apply([0.0, 0.0, 1.0])
    across = np.linalg.norm(axes[:, :2], axis=1)
    factor = np.arctan2(across, axes[:, 2]) / np.maximum(across, 1e-300)
    bending: Array = np.column_stack([-axes[:, 1], axes[:, 0]]) * factor[:, None]
    return bending
