# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Simulated pictures of the arm and its tags, by casting a ray through every pixel.

It needs no graphics hardware and shares no projection with what measures in the pictures: rays go
out from the camera, undistorted by fixed-point iteration, to the plane of the tags.
"""

from collections.abc import Callable
from math import ceil, floor
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from soft_continuum.sensing.layout import CORNERS, QUIET, TagLayout
from soft_continuum.sensing.lens import Lens
from soft_continuum.sensing.pictures import Array, MODULES, Picture, white_modules
from soft_continuum.twin.differences import Differences
from soft_continuum.twin.occluders import Occluders

WIDTH, HEIGHT = 1280, 960  # px
MARGIN = 1.25  # of what has to be in the picture
FIELD = 0.62  # tan of half the horizontal angle of view: a webcam of 64 degrees
WHITE, BLACK, BOARD, SKIN, PLATE = 225.0, 25.0, 150.0, 70.0, 215.0  # grey values
DARK = 60.0  # grey value of obstacles and occluders
SAMPLES = 3  # by SAMPLES of each pixel
SUNK = 0.5  # of the brightness that the darkest corner keeps at light 1


class TwinCamera:
    """A webcam before the arm, looking along +y; ``lens`` is what its calibration says of it."""

    def __init__(self, layout: TagLayout, differences: Differences) -> None:
        """Place the camera where all tags of the fixed board are in the picture."""
        self._layout, given = layout, differences
        self._random = np.random.default_rng(given.seed)
        low, high = layout.fixed.min(axis=0), layout.fixed.max(axis=0)
        half = (high - low) / 2.0 + layout.fixed_size
        focal = WIDTH / 2.0 / FIELD
        self._distance = float(MARGIN * max(half[0] / FIELD, half[1] / (FIELD * HEIGHT / WIDTH)))
        self._foot = (low + high) / 2.0 + self._random.uniform(-0.5, 0.5, 2) * given.camera_shift
        self._focal, self._middle = focal, np.array([WIDTH / 2.0 - 0.5, HEIGHT / 2.0 - 0.5])
        self._bent, self._blur = given.lens_distortion, given.picture_blur
        tilt = self._random.uniform(-1.0, 1.0, 3) * given.camera_tilt
        self._turn = cv2.Rodrigues(tilt)[0]
        wrong = 1.0 + self._random.normal(0.0, given.calibration_error)
        self.lens = Lens.of(
            (WIDTH, HEIGHT),
            [focal * wrong, 0, self._middle[0], 0, focal * wrong, self._middle[1], 0, 0, 1],
            [self._bent * wrong, 0, 0, 0, 0], 'plumb_bob')
        rays = self._rays()
        self._depth = layout.depth + self._random.normal(0.0, given.depth_offset)
        self._fixed = layout.fixed + self._random.normal(
            0.0, given.fixed_offset, layout.fixed.shape)
        self._board, self._front = (self._on_plane(rays, depth) for depth in (0.0, self._depth))
        self._slopes = _slopes(self._front)
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        dark = (u / WIDTH + v / HEIGHT) / 2.0 * given.shade * SUNK
        self._light = (1.0 - dark).astype(np.float32)
        self._still = self._background()
        for one in given.obstacles:
            away = np.linalg.norm(self._front - [one.x, one.z], axis=-1)
            self._still[away < one.radius] = DARK
        self.occluders = Occluders(given.occluders, given.seed, (WIDTH, HEIGHT))
        self._noise = self._random.normal(
            0.0, max(given.picture_noise, 1e-9), WIDTH * HEIGHT * 2).astype(np.float32)
        self._modules = {n: white_modules(n) for n in range(len(layout.heights))}
        # How each tag is stuck: to the right and up, m, and turned, rad.
        self._offsets = self._random.normal(0.0, given.tag_offset, (len(layout.heights), 3))
        self._offsets[:, 2] /= layout.disc_size

    def picture(self, discs: Array, time: float = 0.0) -> Picture:
        """
        Return what it sees.

        discs: (discs, 3), x, z and angle of the bottom of each.  time: s, of what moves before it.
        """
        grey = self._still.copy()
        for below, above, height in zip(
                discs, discs[1:], self._layout.disc_heights, strict=False):
            top = below[:2] + height * _directions(below[2])[1]
            ends = np.round(self.seen_at(np.array([top, above[:2]]), self._depth)
                            * 16).astype(int)
            cv2.line(grey, ends[0].tolist(), ends[1].tolist(), SKIN, 24, cv2.LINE_AA, 4)
        for n, pose in enumerate(discs):
            self._draw_disc(grey, n, pose)
        for corners in self.occluders.corners(time):
            cv2.fillConvexPoly(grey, np.round(corners * 16).astype(np.int32), DARK, cv2.LINE_AA, 4)
        return self._exposed(grey)

    def seen_at(self, points: Array, depth: float) -> Array:
        """Return where points (k, 2) m on a plane before the board are in the picture, px."""
        solid = np.column_stack([
            points[:, 0] - self._foot[0], self._foot[1] - points[:, 1],
            np.full(len(points), self._distance - depth)]) @ self._turn.T
        flat = solid[:, :2] / solid[:, 2:]
        flat = flat * (1.0 + self._bent * (flat**2).sum(axis=1, keepdims=True))
        return np.asarray(flat * self._focal + self._middle)

    def stuck(self, disc: int, pose: Array) -> Array:
        """Return where a disc at ``pose`` would be if its tag were stuck where it should be."""
        middle, angle = self._tag_pose(disc, pose)
        bottom = middle - self._layout.heights[disc] * _directions(angle)[1]
        return np.array([*bottom, angle])

    def _tag_pose(self, disc: int, pose: Array) -> tuple[Array, float]:
        """Return the middle (x, z) m and the angle (rad) of the tag of a disc at ``pose``."""
        across, along, turned = self._offsets[disc]
        right, up = _directions(pose[2])
        middle: Array = pose[:2] + (self._layout.heights[disc] + along) * up + across * right
        return middle, pose[2] + turned

    def _rays(self) -> Array:
        """Return the direction of every pixel, right, down and forward, (height, width, 3)."""
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        seen = (np.stack([u, v], axis=-1) - self._middle) / self._focal
        flat, before = seen, np.full(1, np.inf)
        while np.abs(flat - before).max() > 1e-7:
            before = flat
            flat = seen / (1.0 + self._bent * (flat**2).sum(axis=-1, keepdims=True))
        rays = np.concatenate([flat, np.ones((HEIGHT, WIDTH, 1))], axis=-1) @ self._turn
        return np.asarray(rays)

    def _on_plane(self, rays: Array, depth: float) -> Array:
        """Return x and z of what every pixel sees on a plane before the board, m."""
        reach = (self._distance - depth) / rays[..., 2]
        return np.stack([self._foot[0] + reach * rays[..., 0],
                         self._foot[1] - reach * rays[..., 1]], axis=-1)

    def _background(self) -> NDArray[np.float32]:
        """Return the board with its fixed tags."""
        blotches = self._random.normal(0.0, 1.0, (12, 16)).astype(np.float32)
        grey = BOARD + 12.0 * cv2.resize(blotches, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
        slopes = _slopes(self._board)
        size = self._layout.fixed_size
        for n, centre in zip(self._layout.fixed_numbers, self._fixed, strict=True):
            modules = white_modules(n)
            box = self._box(centre + 1.6 * size * CORNERS, 0.0)

            def shade(points: Array, old: Array, c: Array = centre,
                      m: NDArray[np.bool_] = modules) -> Array:
                return _tag((points - c) / size, m, old)

            grey[box] = _sampled(self._board[box], slopes[(slice(None), *box)], grey[box], shade)
        return np.asarray(grey, dtype=np.float32)

    def _draw_disc(self, grey: NDArray[np.float32], n: int, pose: Array) -> None:
        """Draw a disc as a light plate with its tag."""
        layout = self._layout
        height, size = layout.disc_heights[n], layout.disc_size
        width = max(height, size * (1.0 + 4.0 * QUIET))
        right, up = _directions(pose[2])
        middle = pose[:2] + up * height / 2.0
        reach = np.hypot(width, height) / 2.0
        box = self._box(middle + 2.0 * reach * CORNERS, self._depth)
        if not grey[box].size:
            return
        centre, turned = self._tag_pose(n, pose)
        tag_right, tag_up = _directions(turned)

        def shade(points: Array, old: Array) -> Array:
            local = points - middle
            inside = (np.abs(local @ right) < width / 2.0) & (np.abs(local @ up) < height / 2.0)
            tag = points - centre
            plate = np.where(inside, PLATE, old)
            flat = np.stack([tag @ tag_right, tag @ tag_up], axis=-1) / size
            return _tag(flat, self._modules[n], plate)

        grey[box] = _sampled(self._front[box], self._slopes[(slice(None), *box)], grey[box],
                             shade)

    def _box(self, points: Array, depth: float) -> tuple[slice, slice]:
        """Return the rows and columns that hold all of the points."""
        seen = self.seen_at(points, depth)
        (u0, v0), (u1, v1) = seen.min(axis=0) - 2.0, seen.max(axis=0) + 3.0
        return (slice(max(0, floor(v0)), max(0, min(HEIGHT, ceil(v1)))),
                slice(max(0, floor(u0)), max(0, min(WIDTH, ceil(u1)))))

    def _exposed(self, grey: NDArray[np.float32]) -> Picture:
        """Return the picture as lens and sensor give it: shaded, blurred, with noise."""
        lit = grey * self._light
        if self._blur > 0.0:
            lit = cv2.GaussianBlur(lit, (0, 0), self._blur)
        start = int(self._random.integers(0, WIDTH * HEIGHT))
        lit += self._noise[start:start + WIDTH * HEIGHT].reshape(HEIGHT, WIDTH)
        picture: Picture = np.clip(np.rint(lit), 0, 255).astype(np.uint8)
        return picture


def _directions(angle: float) -> tuple[Array, Array]:
    """Return the directions (x, z) to the right and up; not those of what measures."""
    return np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])


def _slopes(places: Array) -> Array:
    """Return how the places (height, width, 2) that pixels see change to the right and down."""
    return np.stack([np.gradient(places, axis=1), np.gradient(places, axis=0)])


def _sampled(points: Array, slopes: Array, old: NDArray[Any],
             shade: Callable[[Array, Array], Array]) -> Array:
    """Return the mean grey values over each pixel of a box; slopes: of points over u and v."""
    total = np.zeros(old.shape)
    offsets = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    for du in offsets:
        for dv in offsets:
            total += shade(points + du * slopes[0] + dv * slopes[1], old)
    return total / SAMPLES**2


def _tag(flat: Array, modules: NDArray[np.bool_], old: Array) -> Array:
    """Return a tag of size 1 about the origin, with its white margin, over what was there."""
    reach = np.abs(flat).max(axis=-1)
    column, row = (np.clip((part * MODULES).astype(int), 0, MODULES - 1)
                   for part in (flat[..., 0] + 0.5, 0.5 - flat[..., 1]))
    ink = np.where(modules[row, column], WHITE, BLACK)
    return np.where(reach <= 0.5, ink, np.where(reach <= 0.5 + QUIET, WHITE, old))
