# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where a camera sees the discs of an arm in space: in drawn pictures of the rings of tags."""

from soft_continuum.mechanics.chain import Array
from soft_continuum.sensing.rigid import compose, inverse, mean_pose
from soft_continuum.sensing.ring_camera import RingCamera
from soft_continuum.sensing.ring_layout import RingLayout
from soft_continuum.twin.differences import Differences
from soft_continuum.twin.spatial_camera import SpatialTwinCamera

TARE_PICTURES = 6


class RingSight:
    """A camera before a spatial arm, tared on the straight arm."""

    def __init__(self, layout: RingLayout, given: Differences, straight: Array) -> None:
        """Place the camera; straight: (discs, 7), poses of the discs in the beginning."""
        self._drawn = SpatialTwinCamera(layout, given)
        self._camera = RingCamera(layout, self._drawn.lens)
        self._mounts: dict[int, Array] = {}
        seen: dict[int, list[Array]] = {}
        for _ in range(TARE_PICTURES):
            for n, (pose, _) in self.discs(straight).items():
                seen.setdefault(n, []).append(pose)
        self._mounts = {n: compose(inverse(mean_pose(poses)), straight[n])
                        for n, poses in seen.items()}

    def discs(self, truth: Array) -> dict[int, tuple[Array, Array]]:
        """Return pose (7,) and covariance (6, 6) of the discs (discs, 7) that are seen."""
        sight = self._camera.measure(self._drawn.picture(truth))
        return {n: (compose(disc.pose, self._mounts[n]) if n in self._mounts else disc.pose,
                    disc.covariance) for n, disc in sight.discs.items()}
