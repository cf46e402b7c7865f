# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What a drawn webcam does with light: rays through its lens, what its sensor adds, paper.

It shares no projection with what measures in the pictures: rays go out from the camera,
undistorted by fixed-point iteration.
"""

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from soft_continuum.sensing.layout import QUIET
from soft_continuum.sensing.lens import Lens
from soft_continuum.sensing.pictures import Array, MODULES, Picture
from soft_continuum.twin.model_errors import ModelErrors

WIDTH, HEIGHT = 1280, 960  # px
MARGIN = 1.25  # of what has to be in the picture
FIELD = 0.62  # tan of half the horizontal angle of view: a webcam of 64 degrees
WHITE, BLACK, BOARD, SKIN, PLATE = 225.0, 25.0, 150.0, 70.0, 215.0  # grey values
DARK = 60.0  # grey value of obstacles and occluders
SAMPLES = 3  # by SAMPLES of each pixel
SUNK = 0.5  # of the brightness that the darkest corner keeps at light 1


class Optics:
    """
    A lens that looks a little aside; ``lens`` is what its calibration says of it.

    Directions and points are in the axes of a camera that looks straight: right, down, forward.
    """

    def __init__(self, given: ModelErrors, random: np.random.Generator) -> None:
        """Draw where it looks, and how wrong its calibration is."""
        focal = WIDTH / 2.0 / FIELD
        self._focal, self._middle = focal, np.array([WIDTH / 2.0 - 0.5, HEIGHT / 2.0 - 0.5])
        self._bent = given.lens_distortion
        tilt = random.uniform(-1.0, 1.0, 3) * given.camera_tilt
        self._turn = cv2.Rodrigues(tilt)[0]
        wrong = 1.0 + random.normal(0.0, given.calibration_error)
        self.lens = Lens.of(
            (WIDTH, HEIGHT),
            [focal * wrong, 0, self._middle[0], 0, focal * wrong, self._middle[1], 0, 0, 1],
            [self._bent * wrong, 0, 0, 0, 0], 'plumb_bob')

    def seen(self, points: Array) -> Array:
        """Return where points (k, 3) m are in the picture, (k, 2) px."""
        solid = points @ self._turn.T
        flat = solid[:, :2] / solid[:, 2:]
        flat = flat * (1.0 + self._bent * (flat**2).sum(axis=1, keepdims=True))
        return np.asarray(flat * self._focal + self._middle)

    def rays(self) -> Array:
        """Return the direction of every pixel, (height, width, 3)."""
        flat = _undistorted(self._focal, *self._middle.tolist(), self._bent)
        rays = np.concatenate([flat, np.ones((HEIGHT, WIDTH, 1))], axis=-1) @ self._turn
        return np.asarray(rays)


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


class Sensor:
    """What shade, blur and noise make of a picture."""

    def __init__(self, given: ModelErrors, random: np.random.Generator) -> None:
        """Draw the noise; which part of it a picture has is drawn with each."""
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        dark = (u / WIDTH + v / HEIGHT) / 2.0 * given.shade * SUNK
        self._light = (1.0 - dark).astype(np.float32)
        self._blur, self._random = given.picture_blur, random
        self._noise = random.normal(
            0.0, max(given.picture_noise, 1e-9), WIDTH * HEIGHT * 2).astype(np.float32)

    def exposed(self, grey: NDArray[np.float32]) -> Picture:
        """Return a picture of grey values (height, width) as lens and sensor give it."""
        lit = grey * self._light
        if self._blur > 0.0:
            lit = cv2.GaussianBlur(lit, (0, 0), self._blur)
        start = int(self._random.integers(0, WIDTH * HEIGHT))
        lit += self._noise[start:start + WIDTH * HEIGHT].reshape(HEIGHT, WIDTH)
        picture: Picture = np.clip(np.rint(lit), 0, 255).astype(np.uint8)
        return picture


def blotched(random: np.random.Generator) -> NDArray[np.float32]:
    """Return a board whose grey is not even, (height, width)."""
    blotches = random.normal(0.0, 1.0, (12, 16)).astype(np.float32)
    board: NDArray[np.float32] = BOARD + 12.0 * cv2.resize(
        blotches, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    return board


def jacobian(places: NDArray[Any]) -> NDArray[Any]:
    """Return how the values (height, width, k) of pixels change to the right and down."""
    return np.stack([np.gradient(places, axis=1), np.gradient(places, axis=0)])


def printed(flat: Array, modules: NDArray[np.bool_], old: Array) -> Array:
    """
    Return the grey of a tag of size 1 about the origin, with its white margin, over the old one.

    flat: (..., 2), to the right and up.
    """
    reach = np.maximum(np.abs(flat[..., 0]), np.abs(flat[..., 1]))
    column, row = (np.clip((part * MODULES).astype(int), 0, MODULES - 1)
                   for part in (flat[..., 0] + 0.5, 0.5 - flat[..., 1]))
    ink = np.where(modules[row, column], WHITE, BLACK)
    return np.where(reach <= 0.5, ink, np.where(reach <= 0.5 + QUIET, WHITE, old))
