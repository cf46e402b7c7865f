# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where cameras see the discs of an arm in space: in drawn pictures of the rings of tags."""

from collections.abc import Sequence
from math import pi

import numpy as np
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics.arm import Array
from soft_continuum.sensing.layout import corners_at_rest, FRONT, RingLayout
from soft_continuum.sensing.rigid import displacement
from soft_continuum.twin.camera import TwinCamera
from soft_continuum.twin.model_errors import ModelErrors

TARE_PICTURES = 6
DIRECTIONS = (FRONT, FRONT - pi / 3.0)  # from where the first and the second camera look
Seen = tuple[Array, Array]
"""Pose (7,) and covariance (6, 6)."""


class RingSight:
    """Cameras before a spatial arm, tared on the straight arm."""

    def __init__(self, layout: RingLayout, given: ModelErrors, straight: Array,
                 cameras: int = 1) -> None:
        """Place 1 or 2; straight: (discs, 7), poses of the discs in the beginning."""
        self._drawn = [TwinCamera(layout, given, direction)
                       for direction in DIRECTIONS[:cameras]]
        self._cameras = [layout.camera(drawn.lens) for drawn in self._drawn]
        for k, (camera, drawn) in enumerate(zip(self._cameras, self._drawn, strict=True)):
            corners = [camera.measure(drawn.picture(straight)).corners
                       for _ in range(TARE_PICTURES)]
            self._cameras[k] = layout.camera(drawn.lens, corners_at_rest(corners))

    def discs(self, truth: Array) -> dict[int, Seen]:
        """Return the discs that are seen; truth: (discs, 7)."""
        found: dict[int, list[Seen]] = {}
        for k in range(len(self._cameras)):
            for n, seen in self._seen_by(k, truth).items():
                found.setdefault(n, []).append(seen)
        return {n: _together(each) for n, each in found.items()}

    def _seen_by(self, k: int, truth: Array) -> dict[int, Seen]:
        sight = self._cameras[k].measure(self._drawn[k].picture(truth))
        return {n: (disc.pose, disc.covariance) for n, disc in sight.discs.items()}


def _together(seen: Sequence[Seen]) -> Seen:
    """Return what several cameras say of one disc, weighted by their covariances."""
    if len(seen) == 1:
        return seen[0]
    first = seen[0][0]
    weights = [np.linalg.inv(covariance) for _, covariance in seen]
    covariance = np.linalg.inv(sum(weights))
    away = covariance @ sum(weight @ displacement(pose, first)
                            for weight, (pose, _) in zip(weights, seen, strict=True))
    turned = Rotation.from_rotvec(away[3:]) * Rotation.from_quat(first[3:])
    return np.concatenate([first[:3] + away[:3], turned.as_quat()]), covariance
