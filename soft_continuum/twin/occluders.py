# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What gets between the camera and the arm."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LENGTHS, WIDTHS = (200.0, 320.0), (50.0, 90.0)  # px; a tag of a disc has about 34
PERIODS = (30.0, 90.0)  # s to and fro


class Occluders:
    """Dark bars, such as hands, that move through a picture; each swings along x and along y."""

    def __init__(self, count: int, seed: int, size: tuple[int, int]) -> None:
        """Draw their sizes and ways; size: width and height of the picture, px."""
        random = np.random.default_rng([seed, 2])
        self._half_size = np.array(size) / 2.0
        length, width = (random.uniform(*sizes, count) / 2.0 for sizes in (LENGTHS, WIDTHS))
        angle = random.uniform(0.0, np.pi, count)
        along = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        across = width[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        self._corners = np.stack(
            [along + across, along - across, -along - across, across - along], axis=1)
        self._rates = 2.0 * np.pi / random.uniform(*PERIODS, (count, 2))
        self._phases = random.uniform(0.0, 2.0 * np.pi, (count, 2))

    def corners(self, time: float) -> Array:
        """Return where their corners are at a time, s, (count, 4, 2), px."""
        middle = self._half_size * (1.0 + np.sin(self._rates * time + self._phases))
        corners: Array = middle[:, None] + self._corners
        return corners
