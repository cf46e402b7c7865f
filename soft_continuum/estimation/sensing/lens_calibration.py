# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Camera calibration from images of a printed board (ChArUco: a chessboard with tags)."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from soft_continuum.estimation.sensing.lens import Lens, LensError
from soft_continuum.estimation.sensing.pictures import Picture

COLUMNS, ROWS = 7, 9
SQUARE, MARKER = 0.025, 0.018  # m; only their ratio matters
MIN_CORNERS = 12  # of the 48 of the board, in one picture
MIN_PICTURES, MAX_PICTURES = 8, 60
MIN_COVERAGE = 0.5  # of the width and of the height of the picture, by all corners together
MAX_RESIDUAL = 1.0  # px, RMS
MIN_TILT = 0.15  # rad between the board in two of the pictures: all alike tell no focal length


@dataclass(frozen=True)
class LensCalibration:
    """A lens, the number of images used, and the residual of their corners, px RMS."""

    lens: Lens
    pictures: int
    residual: float


def board() -> cv2.aruco.CharucoBoard:
    """Return the board that ``soft_continuum tags`` prints; its tags are of another family."""
    return cv2.aruco.CharucoBoard(
        (COLUMNS, ROWS), SQUARE, MARKER,
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))


def calibrate(pictures: Iterable[Picture]) -> LensCalibration:
    """
    Return the camera calibration for grey images (height, width) of the board.

    Raises LensError, which names what is missing.
    """
    printed = board()
    detector = cv2.aruco.CharucoDetector(printed)
    solid: list[Any] = []
    flat: list[Any] = []
    size, seen = (0, 0), 0
    for picture in pictures:
        seen += 1
        shape = picture.shape[1], picture.shape[0]
        if size not in ((0, 0), shape):
            raise LensError(f'images of {size[0]} x {size[1]} and of {shape[0]} x {shape[1]} px '
                            'are mixed; take all at the resolution that will be used')
        size = shape
        corners, numbers, _, _ = detector.detectBoard(picture)
        if numbers is not None and len(numbers) >= MIN_CORNERS:
            points, places = printed.matchImagePoints(corners, numbers)
            solid.append(points)
            flat.append(places)
    solid, flat = ([kept[i] for i in _evenly(len(kept))] for kept in (solid, flat))
    if len(solid) < MIN_PICTURES:
        raise LensError(f'the board is seen in {len(solid)} of {seen} images; needed: '
                        f'{MIN_PICTURES}, each with a quarter of the board or more, sharp and lit')
    reach = np.ptp(np.vstack(flat).reshape(-1, 2), axis=0) / size
    if reach.min() < MIN_COVERAGE:
        raise LensError(f'the board was seen in {reach[0]:.0%} of the width and {reach[1]:.0%} of '
                        f'the height; needed: {MIN_COVERAGE:.0%}: hold it in the corners, too')
    residual, matrix, distortion, turns, _ = cv2.calibrateCamera(solid, flat, size, None, None)
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    if np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max() < MIN_TILT:
        raise LensError('the board has the same tilt in all images; tilt it to all sides')
    if residual > MAX_RESIDUAL:
        raise LensError(f'the corners have a residual of {residual:.2f} px; allowed: '
                        f'{MAX_RESIDUAL:g}: is the board flat, are the images sharp and of one '
                        'camera with a fixed focus?')
    return LensCalibration(Lens.of(size, matrix, distortion.ravel()[:5], 'plumb_bob'),
                           len(solid), float(residual))


def _evenly(count: int) -> list[int]:
    """Return the indices of up to MAX_PICTURES evenly chosen images."""
    chosen: list[int] = np.unique(
        np.linspace(0, max(0, count - 1), min(count, MAX_PICTURES)).astype(int)).tolist()
    return chosen
