# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Simulated pictures of a spatial arm and its rings of tags, by casting rays through every pixel.

Everything consists of flat convex faces; a pixel shows the first face that its ray meets.  A
segment is a strip that faces the camera.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from soft_continuum.sensing.layout import QUIET_ZONE, RingLayout
from soft_continuum.sensing.pictures import Array, white_modules
from soft_continuum.twin.model_errors import ModelErrors
from soft_continuum.twin.optics import (
    blotched,
    box,
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

FRONT = -pi / 2  # rad about z from x: from where the camera of a planar arm looks
REACH = 0.7  # of the arm's length, to the sides and up: where the tip has to be in the picture
FACING = 0.75  # cosine, of how a fixed tag looks that has to be in the picture
SUNK_IN = 0.003  # m by which the body of a ring is nearer to the axis than its tags
DULL = 0.5  # of its brightness that a face keeps when it is seen from its side
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


class RingTwinCamera(Webcam):
    """A webcam beside a spatial arm."""

    def __init__(self, layout: RingLayout, model_errors: ModelErrors, direction: float = FRONT
                 ) -> None:
        """Place it in a direction from the arm, rad about z from x, with the whole arm in view."""
        self._layout, given = layout, model_errors
        tags = np.random.default_rng(given.seed)  # the same for all cameras of one arm
        self._random = np.random.default_rng([given.seed, round(1e3 * direction) % 2**16])
        self._fixed = [_moved(_face(row[:3], row[3], layout.fixed_size), tags, given.fixed_offset,
                              layout.fixed_size) for row in layout.fixed]
        self._rings = [self._ring(n, tags, given.tag_offset) for n in range(len(layout.heights))]
        self._fixed_modules = [white_modules(n) for n in layout.fixed_numbers]
        super().__init__(given, self._random)
        self._place(direction, given.camera_shift)
        rays = self.rays()
        self._flat = (rays[..., :2] / rays[..., 2:]).astype(np.float32)
        self._changes = jacobian(self._flat)
        self._still = self._with(
            blotched(self._random), [_Piece(corners, 0.0, modules) for corners, modules in zip(
                self._fixed, self._fixed_modules, strict=True)])
        self.sensor = Sensor(given, self._random)

    def drawn(self, discs: Array) -> NDArray[np.float32]:
        """Return the grey values of the arm in front of the static background."""
        return self._with(self._still, [*self._rings_at(discs), *self._segments_at(discs)])

    def project(self, points: Array) -> Array:
        """Return the pixels (k, 2) of points (k, 3) m in base_link."""
        return self.seen((points - self._eye) @ self._axes.T)

    def _place(self, direction: float, shift: float) -> None:
        """Stand where the arm and the fixed tags that look here are in the picture."""
        layout = self._layout
        back = np.array([cos(direction), sin(direction), 0.0])
        right = np.array([-back[1], back[0], 0.0])
        length = REACH * (sum(layout.disc_heights) + sum(layout.segment_lengths))
        around = np.arange(8) * pi / 4.0
        points: list[Array] = [np.array([[0.0, 0.0, -layout.face], [0.0, 0.0, length / REACH]]),
                               np.column_stack([length * np.cos(around), length * np.sin(around),
                                                np.full(8, length)])]
        points += [tag for tag, row in zip(self._fixed, layout.fixed, strict=True)
                   if cos(row[3] - direction) > FACING]
        all_of_it = np.vstack(points)
        middle = (all_of_it[:, 2].min() + all_of_it[:, 2].max()) / 2.0
        needed = all_of_it @ back + MARGIN / FIELD * np.maximum(
            np.abs(all_of_it @ right), np.abs(all_of_it[:, 2] - middle) * WIDTH / HEIGHT)
        needed += shift / 2.0 / FIELD * WIDTH / HEIGHT
        across, up = self._random.uniform(-0.5, 0.5, 2) * shift
        self._eye = needed.max() * back + across * right + [0.0, 0.0, middle + up]
        self._axes = np.array([right, [0.0, 0.0, -1.0], -back])

    def _ring(self, n: int, random: np.random.Generator, off: float) -> list[_Piece]:
        """Return the tags of a disc in its frame as they are stuck, and the body below them."""
        layout = self._layout
        middle = np.array([0.0, 0.0, layout.disc_heights[n] / 2.0])
        half = layout.face / 2.0
        turns = 2.0 * pi / layout.faces * np.arange(layout.faces)
        radius = half / np.tan(pi / layout.faces)
        tags = [_moved(_face([radius * cos(turn), radius * sin(turn), 0.0], turn,
                             layout.disc_size), random, off, layout.disc_size) for turn in turns]
        every = _moved(np.vstack(tags), random, off, radius).reshape(-1, 4, 3) + middle
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

    def _rings_at(self, discs: Array) -> Iterator[_Piece]:
        for pose, ring in zip(discs, self._rings, strict=True):
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
            sides *= layout.disc_radii[n + 1] / np.linalg.norm(sides, axis=1, keepdims=True)
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
        whole = box(np.vstack([self.seen(corners) for _, corners in local]))
        if not grey[whole].size:
            return grey
        rows, columns = grey[whole].shape
        fine = np.empty((SAMPLES * rows, SAMPLES * columns), dtype=np.float32)
        fine.reshape(rows, SAMPLES, columns, SAMPLES)[:] = grey[whole][:, None, :, None]
        nearest = np.full(fine.shape, np.inf, dtype=np.float32)
        for piece, corners in local:
            own = box(self.seen(corners))
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
                            axis=-1) * (1.0 + 2.0 * QUIET_ZONE)
            fine[seen] = printed(flat, piece.modules, np.zeros(len(flat))) * bright
        nearest[seen] = depth


def _face(centre: Sequence[float] | Array, direction: float, size: float) -> Array:
    """Return the corners of an upright tag with its margin, counterclockwise from lower left."""
    half = size * (0.5 + QUIET_ZONE)
    right = half * np.array([-sin(direction), cos(direction), 0.0])
    up = np.array([0.0, 0.0, half])
    corners: Array = np.asarray(centre) + np.array(
        [-right - up, right - up, right + up, up - right])
    return corners


def _moved(points: Array, random: np.random.Generator, off: float, size: float) -> Array:
    """Return points (k, 3), stuck off by ``off`` m along each axis, and turned by that / size."""
    shift, turn = random.normal(0.0, off, 3), random.normal(0.0, off / size, 3)
    middle = points.mean(axis=0)
    moved: Array = Rotation.from_rotvec(turn).apply(points - middle) + middle + shift
    return moved


def _front(corners: Array) -> Array:
    """Return the direction out of a piece, of length 1."""
    front: Array = np.cross(corners[1] - corners[0], corners[2] - corners[1])
    return front / np.linalg.norm(front)
