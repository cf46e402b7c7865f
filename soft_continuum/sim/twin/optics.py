# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Optics of a simulated webcam: sensor noise, paper, occluders."""

from math import ceil, floor

import cv2
import numpy as np
from numpy.typing import NDArray

from soft_continuum.estimation.sensing.pictures import Array, MODULES, Picture
from soft_continuum.sim.twin.model_errors import ModelErrors

WIDTH, HEIGHT = 1280, 960  # px
WHITE, BLACK, BOARD, SKIN, PLATE = 225.0, 25.0, 150.0, 70.0, 215.0  # grey values
DARK = 60.0  # grey value of obstacles and occluders
SAMPLES = 3  # by SAMPLES of each pixel
SUNK = 0.5  # of the brightness that the darkest corner keeps at light 1
OCCLUDER_LENGTHS, OCCLUDER_WIDTHS = (200.0, 320.0), (50.0, 90.0)
"""px; a tag of a disc has about 34."""
OCCLUDER_PERIODS = (30.0, 90.0)  # s to and fro


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


def box(seen: Array) -> tuple[slice, slice]:
    """Return the rows and columns that hold all of these pixels (k, 2)."""
    (u0, v0), (u1, v1) = seen.min(axis=0) - 2.0, seen.max(axis=0) + 3.0
    rows = [min(HEIGHT, max(0, v)) for v in (floor(v0), ceil(v1))]
    columns = [min(WIDTH, max(0, u)) for u in (floor(u0), ceil(u1))]
    return slice(*rows), slice(*columns)


def blotched(random: np.random.Generator) -> NDArray[np.float32]:
    """Return a board of uneven grey, (height, width)."""
    blotches = random.normal(0.0, 1.0, (12, 16)).astype(np.float32)
    board: NDArray[np.float32] = BOARD + 12.0 * cv2.resize(
        blotches, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    return board


def printed(flat: Array, modules: NDArray[np.bool_]) -> Array:
    """
    Return the grey of a tag of size 1 about the origin, which is white around it.

    flat: (..., 2), to the right and up.
    """
    reach = np.maximum(np.abs(flat[..., 0]), np.abs(flat[..., 1]))
    column, row = (np.clip((part * MODULES).astype(int), 0, MODULES - 1)
                   for part in (flat[..., 0] + 0.5, 0.5 - flat[..., 1]))
    ink = np.where(modules[row, column], WHITE, BLACK)
    return np.where(reach <= 0.5, ink, WHITE)
