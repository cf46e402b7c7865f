# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Simulated pictures of a planar arm and its tags, by casting a ray through every pixel.

It needs no graphics hardware: rays go out from the camera to the plane of the tags.
"""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from soft_continuum.sensing.layout import CORNERS, QUIET_ZONE, TagLayout
from soft_continuum.sensing.pictures import Array, white_modules
from soft_continuum.sensing.rigid import planar_pose
from soft_continuum.twin.model_errors import ModelErrors
from soft_continuum.twin.optics import (
    blotched,
    box,
    DARK,
    FIELD,
    HEIGHT,
    jacobian,
    MARGIN,
    PLATE,
    printed,
    SAMPLES,
    Sensor,
    SKIN,
    Webcam,
    WIDTH,
)


class TagTwinCamera(Webcam):
    """A webcam before the arm, looking along +y."""

    def __init__(self, layout: TagLayout, model_errors: ModelErrors) -> None:
        """Place the camera where all tags of the fixed board are in the picture."""
        self._layout, given = layout, model_errors
        self._random = np.random.default_rng(given.seed)
        board, depth = layout.fixed[:, [0, 2]], layout.fixed[0, 1]
        low, high = board.min(axis=0), board.max(axis=0)
        half = (high - low) / 2.0 + layout.fixed_size
        self._distance = float(MARGIN * max(half[0] / FIELD, half[1] / (FIELD * HEIGHT / WIDTH)))
        self._foot = (low + high) / 2.0 + self._random.uniform(-0.5, 0.5, 2) * given.camera_shift
        super().__init__(given, self._random)
        rays = self.rays()
        self._depth = depth + self._random.normal(0.0, given.depth_offset)
        self._fixed = board + self._random.normal(0.0, given.fixed_offset, board.shape)
        self._board, self._front = (self._on_plane(rays, depth) for depth in (0.0, self._depth))
        self._jacobian = jacobian(self._front)
        self._still = self._background()
        for one in given.obstacles:
            away = np.linalg.norm(self._front - [one.x, one.z], axis=-1)
            self._still[away < one.radius] = DARK
        self.sensor = Sensor(given, self._random)
        self._modules = {n: white_modules(n) for n in range(len(layout.heights))}
        # How each tag is stuck: to the right and up, m, and turned, rad.
        self._offsets = self._random.normal(0.0, given.tag_offset, (len(layout.heights), 3))
        self._offsets[:, 2] /= layout.disc_size

    def drawn(self, discs: Array) -> NDArray[np.float32]:
        """Return the grey values of the arm in front of the board."""
        grey, discs = self._still.copy(), planar_pose(discs)
        for below, above, height in zip(
                discs, discs[1:], self._layout.disc_heights, strict=False):
            top = below[:2] + height * _directions(below[2])[1]
            ends = np.round(self.project(np.array([top, above[:2]]), self._depth)
                            * 16).astype(int)
            cv2.line(grey, ends[0].tolist(), ends[1].tolist(), SKIN, 24, cv2.LINE_AA, 4)
        for n, pose in enumerate(discs):
            self._draw_disc(grey, n, pose)
        return grey

    def project(self, points: Array, depth: float) -> Array:
        """Return the pixels of points (k, 2) m on a plane in front of the board."""
        return self.seen(np.column_stack([
            points[:, 0] - self._foot[0], self._foot[1] - points[:, 1],
            np.full(len(points), self._distance - depth)]))

    def _tag_pose(self, disc: int, pose: Array) -> tuple[Array, float]:
        """Return the middle (x, z) m and the angle (rad) of the tag of a disc at ``pose``."""
        across, along, turned = self._offsets[disc]
        right, up = _directions(pose[2])
        middle: Array = pose[:2] + (self._layout.heights[disc] + along) * up + across * right
        return middle, pose[2] + turned

    def _on_plane(self, rays: Array, depth: float) -> Array:
        """Return x and z of what every pixel sees on a plane before the board, m."""
        reach = (self._distance - depth) / rays[..., 2]
        return np.stack([self._foot[0] + reach * rays[..., 0],
                         self._foot[1] - reach * rays[..., 1]], axis=-1)

    def _background(self) -> NDArray[np.float32]:
        """Return the board with its fixed tags."""
        grey = blotched(self._random)
        changes = jacobian(self._board)
        size = self._layout.fixed_size
        for n, centre in zip(self._layout.fixed_numbers, self._fixed, strict=True):
            modules = white_modules(n)
            place = box(self.project(centre + 1.6 * size * CORNERS, 0.0))

            def shade(points: Array, old: Array, c: Array = centre,
                      m: NDArray[np.bool_] = modules) -> Array:
                return printed((points - c) / size, m, old)

            grey[place] = _sampled(self._board[place], changes[(slice(None), *place)],
                                   grey[place], shade)
        return np.asarray(grey, dtype=np.float32)

    def _draw_disc(self, grey: NDArray[np.float32], n: int, pose: Array) -> None:
        """Draw a disc as a light plate with its tag."""
        layout = self._layout
        height, size = layout.disc_heights[n], layout.disc_size
        width = max(height, size * (1.0 + 4.0 * QUIET_ZONE))
        right, up = _directions(pose[2])
        middle = pose[:2] + up * height / 2.0
        reach = np.hypot(width, height) / 2.0
        place = box(self.project(middle + 2.0 * reach * CORNERS, self._depth))
        if not grey[place].size:
            return
        centre, turned = self._tag_pose(n, pose)
        tag_right, tag_up = _directions(turned)

        def shade(points: Array, old: Array) -> Array:
            local = points - middle
            inside = (np.abs(local @ right) < width / 2.0) & (np.abs(local @ up) < height / 2.0)
            tag = points - centre
            plate = np.where(inside, PLATE, old)
            flat = np.stack([tag @ tag_right, tag @ tag_up], axis=-1) / size
            return printed(flat, self._modules[n], plate)

        grey[place] = _sampled(self._front[place], self._jacobian[(slice(None), *place)],
                               grey[place], shade)


def _directions(angle: float) -> tuple[Array, Array]:
    """Return the directions (x, z) to the right and up; not those of what measures."""
    return np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])


def _sampled(points: Array, changes: Array, old: NDArray[Any],
             shade: Callable[[Array, Array], Array]) -> Array:
    """Return the mean grey values over each pixel of a box; changes: of points over u and v."""
    total = np.zeros(old.shape)
    offsets = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    for du in offsets:
        for dv in offsets:
            total += shade(points + du * changes[0] + dv * changes[1], old)
    return total / SAMPLES**2
