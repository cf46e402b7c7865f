# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where cameras see the discs of an arm in space: in drawn pictures of the rings of tags."""

from collections.abc import Mapping, Sequence
from math import pi

import numpy as np
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics.chain import Array
from soft_continuum.sensing.rigid import compose, displacement, inverse, mean_pose
from soft_continuum.sensing.ring_camera import RingCamera
from soft_continuum.sensing.ring_layout import RingLayout
from soft_continuum.twin.differences import Differences
from soft_continuum.twin.spatial_camera import FRONT, SpatialTwinCamera

DIRECTIONS = (FRONT, FRONT + pi / 2)
"""From where cameras look, rad about z from x."""
TARE_PICTURES = 6


class RingSight:
    """Cameras around a spatial arm, each tared on the straight arm."""

    def __init__(self, layout: RingLayout, given: Differences, straight: Array, cameras: int
                 ) -> None:
        """Place cameras; straight: (discs, 7), poses of the discs in the beginning."""
        self._drawn = [SpatialTwinCamera(layout, given, way) for way in DIRECTIONS[:cameras]]
        self._cameras = [RingCamera(layout, drawn.lens) for drawn in self._drawn]
        self._mounts: list[dict[int, Array]] = [{} for _ in self._drawn]
        for k in range(cameras):
            seen: dict[int, list[Array]] = {}
            for _ in range(TARE_PICTURES):
                for n, (pose, _) in self._one(k, straight).items():
                    seen.setdefault(n, []).append(pose)
            self._mounts[k] = {n: compose(inverse(mean_pose(poses)), straight[n])
                               for n, poses in seen.items()}

    def discs(self, truth: Array) -> dict[int, tuple[Array, Array]]:
        """Return pose (7,) and covariance (6, 6) of the discs (discs, 7) that are seen."""
        sights = [self._one(k, truth) for k in range(len(self._cameras))]
        return {n: _joined([sight[n] for sight in sights if n in sight])
                for n in range(len(truth)) if any(n in sight for sight in sights)}

    def _one(self, k: int, truth: Array) -> Mapping[int, tuple[Array, Array]]:
        sight = self._cameras[k].measure(self._drawn[k].picture(truth))
        return {n: (compose(disc.pose, self._mounts[k][n]) if n in self._mounts[k] else disc.pose,
                    disc.covariance) for n, disc in sight.discs.items()}


def _joined(seen: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return what several cameras measured of a disc as one, each by its covariance."""
    first = seen[0][0]
    weights = [np.linalg.inv(covariance) for _, covariance in seen]
    together = np.linalg.inv(sum(weights))
    away = together @ sum(weight @ displacement(pose, first)
                          for (pose, _), weight in zip(seen, weights, strict=True))
    turned = Rotation.from_rotvec(away[3:]) * Rotation.from_quat(first[3:])
    return np.array([*(first[:3] + away[:3]), *turned.as_quat()]), together
