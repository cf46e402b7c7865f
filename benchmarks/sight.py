# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where cameras see the discs of an arm: in drawn pictures of its tags."""

from collections.abc import Sequence
from math import pi

import numpy as np

from soft_continuum.estimation.sensing.layout import FRONT, Layout
from soft_continuum.estimation.sensing.tag_camera import TagCamera
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.rotations import displaced, displacement
from soft_continuum.sim.twin.camera import TwinCamera
from soft_continuum.sim.twin.model_errors import ModelErrors

DIRECTIONS = (FRONT, FRONT - pi / 3.0)  # from where the first and the second camera look
Seen = tuple[Array, Array]
"""Pose (7,) and covariance (6, 6)."""


class Sight:
    """Cameras before an arm, tared on the straight arm."""

    def __init__(self, layout: Layout, given: ModelErrors,
                 straight: Sequence[tuple[Array, float]], cameras: int = 1) -> None:
        """Place 1 or 2; straight: poses (discs, 7) of the straight arm and times, for a tare."""
        self._cameras = []
        stuck = layout.stuck_as({'tags.offsets': (0.0,), 'tags.reference_corners': (0.0,)})
        for direction in DIRECTIONS[:cameras]:
            drawn = TwinCamera(layout, given, direction)
            camera = TagCamera(layout, drawn.lens, stuck)
            _, tared, _ = layout.tared(stuck, [
                camera.measure(drawn.picture(*then)) for then in straight])
            self._cameras.append((TagCamera(layout, drawn.lens, tared), drawn))

    def discs(self, truth: Array, time: float) -> dict[int, Seen]:
        """Return the discs that are seen; truth: (discs, 7)."""
        found: dict[int, list[Seen]] = {}
        for camera, drawn in self._cameras:
            for n, disc in camera.measure(drawn.picture(truth, time)).discs.items():
                found.setdefault(n, []).append((disc.pose, disc.covariance))
        return {n: _together(each) for n, each in found.items()}


def _together(seen: Sequence[Seen]) -> Seen:
    """Return what several cameras say of one disc, weighted by their covariances."""
    if len(seen) == 1:
        return seen[0]
    first = seen[0][0]
    weights = [np.linalg.inv(covariance) for _, covariance in seen]
    covariance = np.linalg.inv(sum(weights))
    away = covariance @ sum(weight @ displacement(pose, first)
                            for weight, (pose, _) in zip(weights, seen, strict=True))
    return displaced(first, away), covariance
