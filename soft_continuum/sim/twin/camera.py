# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Simulated pictures of an arm and its tags, by casting rays through every pixel.

Everything consists of flat convex faces; a pixel shows the first face that its ray meets.  A
segment is a strip that faces the camera.  It shares no projection with the measuring code: rays go
out from the camera, undistorted by fixed-point iteration.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, cos, floor, pi, sin

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from soft_continuum.estimation.sensing.layout import (
    FRONT,
    Layout,
    MODULES,
    QUIET_ZONE,
    RingLayout,
    white_modules,
)
from soft_continuum.estimation.sensing.lens import Lens
from soft_continuum.estimation.sensing.pictures import Picture
from soft_continuum.mechanics.arm import Array
from soft_continuum.sim.twin.model_errors import ModelErrors

WIDTH, HEIGHT = 1280, 960  # px
WHITE, BLACK, BOARD, SKIN, PLATE = 225.0, 25.0, 150.0, 70.0, 215.0  # grey values
DARK = 60.0  # grey value of obstacles and occluders
SAMPLES = 3  # by SAMPLES of each pixel
SUNK = 0.5  # of the brightness that the darkest corner keeps at light 1
OCCLUDER_LENGTHS, OCCLUDER_WIDTHS = (200.0, 320.0), (50.0, 90.0)
"""px; a tag of a disc has about 34."""
OCCLUDER_PERIODS = (30.0, 90.0)  # s to and fro
WITH_MARGIN = 1.0 + 2.0 * QUIET_ZONE  # width of a tag with its white margin, over its size
MARGIN = 1.25  # of what has to be in the picture
FIELD = 0.62  # tan of half the horizontal angle of view: a webcam of 64 degrees
REACH = 0.7  # of the arm's length, to the sides and up: where the tip has to be in the picture
FACING = 0.75  # cosine, of how a fixed tag looks that has to be in the picture
SUNK_IN = 0.003  # m by which the body of a disc is behind its tags
DULL = 0.5  # of its brightness that a face keeps when it is seen from its side
CIRCLE = np.array([(cos(a), 0.0, sin(a)) for a in np.arange(32) * pi / 16.0])  # seen from FRONT
ALONG = np.linspace(0.0, 1.0, 9)[:, None]  # of a segment: ends of its strips


@dataclass(frozen=True)
class _Piece:
    """
    A convex flat piece: corners (k, 3) m in base_link, counterclockwise seen from its front.

    modules: of the tag on it, whose right and up are from the fourth to the third and to the
    first corner; None for plain grey.
    """

    corners: Array
    grey: float
    modules: NDArray[np.bool_] | None = None


class TwinCamera:
    """
    A slightly misaligned webcam beside an arm; ``lens`` is its calibration.

    Rays are in the axes of a camera that looks straight: right, down, forward.
    """

    def __init__(self, layout: Layout, model_errors: ModelErrors, direction: float = FRONT
                 ) -> None:
        """
        Place it in a direction from the arm, rad about z from x, with the whole arm in view.

        Draw its misalignment, its calibration errors, and how tags are stuck.
        """
        self._layout, given, focal = layout, model_errors, WIDTH / 2.0 / FIELD
        tags = np.random.default_rng(given.seed)  # the same for all cameras of one arm
        random = np.random.default_rng([given.seed, round(1e3 * direction) % 2**16])
        fixed = [_Piece(self._stuck(_face(row[:3], row[3], layout.fixed_size * WITH_MARGIN), tags,
                                    given.fixed_offset, layout.fixed_size), 0.0, white_modules(n))
                 for n, row in zip(layout.fixed_numbers, layout.fixed, strict=True)]
        self._radii: Sequence[float] = (layout.disc_size / 3.0,) * len(layout.heights)
        self._axis, obstacles = np.zeros(7), []
        if isinstance(layout, RingLayout):
            self._radii = layout.disc_radii
        else:  # in the plane that is measured are its tags, before its axis
            self._axis[1] = self._radii[0] + tags.normal(0.0, given.depth_offset)
            obstacles = [_Piece([one.x, self._axis[1], one.z] + one.radius * CIRCLE, DARK)
                         for one in given.obstacles]
        self._discs = [self._disc(n, tags, given.tag_offset) for n in range(len(layout.heights))]
        self._focal, self._middle = focal, np.array([WIDTH / 2.0 - 0.5, HEIGHT / 2.0 - 0.5])
        self._bent = given.lens_distortion
        self._turn = cv2.Rodrigues(random.uniform(-1.0, 1.0, 3) * given.camera_tilt)[0]
        wrong = 1.0 + random.normal(0.0, given.calibration_error)
        self.lens = Lens.of(
            (WIDTH, HEIGHT),
            [focal * wrong, 0, self._middle[0], 0, focal * wrong, self._middle[1], 0, 0, 1],
            [self._bent * wrong, 0, 0, 0, 0], 'plumb_bob')
        self._place(direction, random, given.camera_shift, [
            piece.corners for piece, row in zip(fixed, layout.fixed, strict=True)
            if cos(row[3] - direction) > FACING])
        flat = _undistorted(focal, *self._middle.tolist(), self._bent)
        rays = np.concatenate([flat, np.ones((HEIGHT, WIDTH, 1))], axis=-1) @ self._turn
        self._flat = (rays[..., :2] / rays[..., 2:]).astype(np.float32)
        self._changes = np.gradient(self._flat, axis=(1, 0))
        self._still = self._with(_blotched(random), fixed + obstacles)
        self.sensor, self.occluders = Sensor(given, random), Occluders(given.occluders, given.seed)

    def picture(self, discs: Array, time: float = 0.0) -> Picture:
        """
        Return its image.

        discs: (discs, 7), pose of the bottom of each, position (m) and quaternion x, y, z, w.
        time: s, for moving occluders.
        """
        discs = discs + self._axis
        grey = self._with(self._still, [*self._discs_at(discs), *self._segments_at(discs)])
        for corners in self.occluders.corners(time):
            cv2.fillConvexPoly(grey, np.round(corners * 16).astype(np.int32), DARK, cv2.LINE_AA, 4)
        return self.sensor.exposed(grey)

    def project(self, points: Array) -> Array:
        """Return the pixels (k, 2) of points (k, 3) m in base_link."""
        return self._seen((points - self._eye) @ self._axes.T)

    def _seen(self, points: Array) -> Array:
        """Return the pixels (k, 2) of points (k, 3) m."""
        solid = points @ self._turn.T
        flat = solid[:, :2] / solid[:, 2:]
        flat = flat * (1.0 + self._bent * (flat**2).sum(axis=1, keepdims=True))
        return np.asarray(flat * self._focal + self._middle)

    def _place(self, direction: float, random: np.random.Generator, shift: float,
               tags: list[Array]) -> None:
        """Stand where the arm and the fixed tags that look here are in the picture."""
        layout = self._layout
        back = np.array([cos(direction), sin(direction), 0.0])
        right = np.array([-back[1], back[0], 0.0])
        length = REACH * (sum(layout.disc_heights) + sum(layout.segment_lengths))
        around = np.arange(8) * pi / 4.0
        aside = np.column_stack([np.cos(around), np.sin(around), np.ones(8)]) * layout.axes[:3]
        all_of_it = np.vstack([[0.0, 0.0, -layout.face], [0.0, 0.0, length / REACH],
                               length * aside, *tags])
        middle = (all_of_it[:, 2].min() + all_of_it[:, 2].max()) / 2.0
        needed = all_of_it @ back + MARGIN / FIELD * np.maximum(
            np.abs(all_of_it @ right), np.abs(all_of_it[:, 2] - middle) * WIDTH / HEIGHT)
        needed += shift / 2.0 / FIELD * WIDTH / HEIGHT
        across, up = random.uniform(-0.5, 0.5, 2) * shift
        self._eye = needed.max() * back + across * right + [0.0, 0.0, middle + up]
        self._axes = np.array([right, [0.0, 0.0, -1.0], -back])

    def _stuck(self, points: Array, random: np.random.Generator, off: float, size: float) -> Array:
        """
        Return points (k, 3), moved by ``off`` m along each axis, and turned by that / size.

        Those on planar arms stay in the plane.
        """
        shift, turn = off * self._layout.axes.reshape(2, 3) * random.normal(0.0, 1.0, (2, 3))
        middle = points.mean(axis=0)
        moved: Array = Rotation.from_rotvec(turn / size).apply(points - middle) + middle + shift
        return moved

    def _disc(self, n: int, random: np.random.Generator, off: float) -> list[_Piece]:
        """Return the tags of a disc in its frame as they are stuck, and the body below them."""
        layout, size, height = self._layout, self._layout.disc_size, self._layout.disc_heights[n]
        middle = np.array([0.0, 0.0, height / 2.0])
        if not isinstance(layout, RingLayout):
            middle[1] = -self._radii[0]
            tag = self._stuck(_face(middle, FRONT, layout.face), random, off, size)
            plate = _face(middle + [0.0, SUNK_IN, 0.0], FRONT,
                          max(height, layout.face + 2.0 * QUIET_ZONE * size), height)
            return [_Piece(tag, 0.0, white_modules(n)), _Piece(plate, PLATE)]
        half = layout.face / 2.0
        turns = 2.0 * pi / layout.faces * np.arange(layout.faces)
        radius = layout.radius
        tags = [self._stuck(_face([radius * cos(turn), radius * sin(turn), 0.0], turn,
                                  layout.face), random, off, size) for turn in turns]
        every = self._stuck(np.vstack(tags), random, off, radius).reshape(-1, 4, 3) + middle
        pieces = [_Piece(corners, 0.0, white_modules(layout.faces * n + k))
                  for k, corners in enumerate(every)]
        inner = (radius - SUNK_IN) / cos(pi / layout.faces)
        rim = np.column_stack([inner * np.cos(turns + turns[1] / 2.0),
                               inner * np.sin(turns + turns[1] / 2.0), np.zeros(len(turns))])
        low, high = rim + middle - [0.0, 0.0, half], rim + middle + [0.0, 0.0, half]
        pieces += [_Piece(high, PLATE), _Piece(low[::-1], PLATE)]
        pieces += [_Piece(np.array([low[k - 1], low[k], high[k], high[k - 1]]), PLATE)
                   for k in range(layout.faces)]
        return pieces

    def _discs_at(self, discs: Array) -> Iterator[_Piece]:
        for pose, ring in zip(discs, self._discs, strict=True):
            turn = Rotation.from_quat(pose[3:]).as_matrix()
            for piece in ring:
                yield _Piece(piece.corners @ turn.T + pose[:3], piece.grey, piece.modules)

    def _segments_at(self, discs: Array) -> Iterator[_Piece]:
        """Yield the segments, as cubics between the discs, in strips."""
        layout = self._layout
        axes = Rotation.from_quat(discs[:, 3:]).as_matrix()[:, :, 2]
        for n, length in enumerate(layout.segment_lengths):
            begin = discs[n, :3] + layout.disc_heights[n] * axes[n]
            line = ((1.0 + 2.0 * ALONG) * (1.0 - ALONG)**2 * begin
                    + ALONG * (1.0 - ALONG)**2 * length * axes[n]
                    + ALONG**2 * (3.0 - 2.0 * ALONG) * discs[n + 1, :3]
                    + ALONG**2 * (ALONG - 1.0) * length * axes[n + 1])
            along = np.gradient(line, axis=0)
            sides = np.cross(along, self._eye - line)
            sides *= self._radii[n + 1] / np.linalg.norm(sides, axis=1, keepdims=True)
            left, right = line - sides, line + sides
            for k in range(len(line) - 1):
                yield _Piece(np.array([left[k], right[k], right[k + 1], left[k + 1]]), SKIN)

    def _with(self, still: NDArray[np.float32], pieces: Sequence[_Piece]) -> NDArray[np.float32]:
        """Return a picture with these pieces before it."""
        grey = still.copy()
        local = [(piece, (piece.corners - self._eye) @ self._axes.T) for piece in pieces]
        local = [(piece, corners) for piece, corners in local
                 if corners[:, 2].min() > 0.01 and _front(corners) @ corners[0] < 0.0]
        if not local:
            return grey
        whole = _box(np.vstack([self._seen(corners) for _, corners in local]))
        if not grey[whole].size:
            return grey
        rows, columns = grey[whole].shape
        fine = np.empty((SAMPLES * rows, SAMPLES * columns), dtype=np.float32)
        fine.reshape(rows, SAMPLES, columns, SAMPLES)[:] = grey[whole][:, None, :, None]
        nearest = np.full(fine.shape, np.inf, dtype=np.float32)
        for piece, corners in local:
            own = _box(self._seen(corners))
            if not grey[own].size:
                continue
            inner = tuple(slice(SAMPLES * (o.start - b.start), SAMPLES * (o.stop - b.start))
                          for o, b in zip(own, whole, strict=True))
            self._draw(piece, corners, own, fine[inner], nearest[inner])
        grey[whole] = fine.reshape(rows, SAMPLES, columns, SAMPLES).mean(axis=(1, 3))
        return grey

    def _draw(self, piece: _Piece, corners: Array, own: tuple[slice, slice],
              fine: NDArray[np.float32], nearest: NDArray[np.float32]) -> None:
        """Draw one piece into the samples of its box, where it is nearer than what is there."""
        steps = ((np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5).astype(np.float32)
        x, y = ((middle[:, None, :, None] + steps * to_right[:, None, :, None]
                 + steps[:, None, None] * down[:, None, :, None]).reshape(fine.shape)
                for middle, to_right, down in zip(*(np.moveaxis(part[own], -1, 0) for part in (
                    self._flat, *self._changes)), strict=True))
        seen = np.ones(fine.shape, dtype=bool)
        for a, b, c in np.cross(corners, np.roll(corners, -1, axis=0)).astype(np.float32):
            seen &= a * x + b * y + c < 0.0  # on the inner side of the plane of eye and edge
        front = _front(corners)
        rays = np.column_stack([x[seen], y[seen], np.ones(np.count_nonzero(seen))])
        depth = (front @ corners[0]) / (rays @ front)
        nearer = depth < nearest[seen]
        seen[seen] = nearer
        depth, rays = depth[nearer], rays[nearer]
        bright = DULL + (1.0 - DULL) * abs(front @ corners[0]) / np.linalg.norm(corners[0])
        if piece.modules is None:
            fine[seen] = piece.grey * bright
        else:
            right, up = corners[1] - corners[0], corners[3] - corners[0]
            places = depth[:, None] * rays - corners.mean(axis=0)
            flat = np.stack([places @ side / (side @ side) for side in (right, up)],
                            axis=-1) * WITH_MARGIN
            fine[seen] = _printed(flat, piece.modules) * bright
        nearest[seen] = depth


@lru_cache(2)  # cameras of one kind differ in how they stand
def _undistorted(focal: float, right: float, down: float, bent: float) -> Array:
    """Return in which direction each pixel looks without the lens, (height, width, 2)."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    seen = (np.stack([u, v], axis=-1) - (right, down)) / focal
    flat, before = seen, np.full(1, np.inf)
    while np.abs(flat - before).max() > 1e-7:
        before = flat
        flat = seen / (1.0 + bent * (flat[..., :1]**2 + flat[..., 1:]**2))
    return flat


def _face(centre: Sequence[float] | Array, direction: float, width: float, height: float = 0.0
          ) -> Array:
    """Return the corners of an upright face or square, counterclockwise from lower left."""
    right = width / 2.0 * np.array([-sin(direction), cos(direction), 0.0])
    up = np.array([0.0, 0.0, (height or width) / 2.0])
    corners: Array = np.asarray(centre) + np.array(
        [-right - up, right - up, right + up, up - right])
    return corners


def _front(corners: Array) -> Array:
    """Return the direction out of a piece, of length 1."""
    front: Array = np.cross(corners[1] - corners[0], corners[2] - corners[1])
    return front / np.linalg.norm(front)


class Sensor:
    """Shade, blur and noise of an image."""

    def __init__(self, given: ModelErrors, random: np.random.Generator) -> None:
        """Draw the noise; each image uses a random part of it."""
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        dark = (u / WIDTH + v / HEIGHT) / 2.0 * given.shade * SUNK
        self._light = (1.0 - dark).astype(np.float32)
        self._blur, self._random = given.picture_blur, random
        self._noise = random.normal(
            0.0, max(given.picture_noise, 1e-9), WIDTH * HEIGHT * 2).astype(np.float32)

    def exposed(self, grey: NDArray[np.float32]) -> Picture:
        """Return an image of grey values (height, width) with the effects of lens and sensor."""
        lit = grey * self._light
        if self._blur > 0.0:
            lit = cv2.GaussianBlur(lit, (0, 0), self._blur)
        start = int(self._random.integers(0, WIDTH * HEIGHT))
        lit += self._noise[start:start + WIDTH * HEIGHT].reshape(HEIGHT, WIDTH)
        picture: Picture = np.clip(np.rint(lit), 0, 255).astype(np.uint8)
        return picture


class Occluders:
    """Dark bars, such as hands, that move through an image; each swings along x and y."""

    def __init__(self, count: int, seed: int) -> None:
        """Draw their sizes and ways."""
        random = np.random.default_rng([seed, 2])
        self._half_size = np.array([WIDTH, HEIGHT]) / 2.0
        length, width = (random.uniform(*sizes, count) / 2.0 for sizes in (
            OCCLUDER_LENGTHS, OCCLUDER_WIDTHS))
        angle = random.uniform(0.0, np.pi, count)
        along = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        across = width[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        self._corners = np.stack(
            [along + across, along - across, -along - across, across - along], axis=1)
        self._rates = 2.0 * np.pi / random.uniform(*OCCLUDER_PERIODS, (count, 2))
        self._phases = random.uniform(0.0, 2.0 * np.pi, (count, 2))

    def corners(self, time: float) -> Array:
        """Return their corners at a time (s), (count, 4, 2) px."""
        middle = self._half_size * (1.0 + np.sin(self._rates * time + self._phases))
        corners: Array = middle[:, None] + self._corners
        return corners


def _box(seen: Array) -> tuple[slice, slice]:
    """Return the rows and columns that hold all of these pixels (k, 2)."""
    (u0, v0), (u1, v1) = seen.min(axis=0) - 2.0, seen.max(axis=0) + 3.0
    rows = [min(HEIGHT, max(0, v)) for v in (floor(v0), ceil(v1))]
    columns = [min(WIDTH, max(0, u)) for u in (floor(u0), ceil(u1))]
    return slice(*rows), slice(*columns)


def _blotched(random: np.random.Generator) -> NDArray[np.float32]:
    """Return a board of uneven grey, (height, width)."""
    blotches = random.normal(0.0, 1.0, (12, 16)).astype(np.float32)
    board: NDArray[np.float32] = BOARD + 12.0 * cv2.resize(
        blotches, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    return board


def _printed(flat: Array, modules: NDArray[np.bool_]) -> Array:
    """
    Return the grey of a tag of size 1 about the origin, which is white around it.

    flat: (..., 2), to the right and up.
    """
    reach = np.maximum(np.abs(flat[..., 0]), np.abs(flat[..., 1]))
    column, row = (np.clip((part * MODULES).astype(int), 0, MODULES - 1)
                   for part in (flat[..., 0] + 0.5, 0.5 - flat[..., 1]))
    ink = np.where(modules[row, column], WHITE, BLACK)
    return np.where(reach <= 0.5, ink, WHITE)
