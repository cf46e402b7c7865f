# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tags of the family 36h11 in an image, and their corners to some hundredths of a pixel.

OpenCV finds the tags.  Its fast refinement uses the corners only, its precise one takes half a
second per image.  Here a line is fitted along each edge of the black square, and the corners are
their intersections.
"""

from collections.abc import Collection
from typing import Any

import cv2
import numpy as np

from soft_continuum.estimation.sensing.layout import family, MODULES
from soft_continuum.estimation.sensing.lens import Lens
from soft_continuum.estimation.sensing.pictures import Picture
from soft_continuum.mechanics.arm import Array

QUICK, THOROUGH = (13, 13, 10), (3, 23, 10)
"""Windows of the adaptive threshold, px: smallest, largest, step."""
ALONG = np.linspace(0.1, 0.9, 24)  # of an edge, from corner to corner: where it is looked for
REACH, STEP = 0.8, 0.25  # of a module to either side of the edge, and px between two samples
MIN_REACH, MAX_REACH = 1.5, 6.0  # px


class TagDetector:
    """Detects tags in images of one camera."""

    def __init__(self, lens: Lens, expected: Collection[int], passes: int = 1) -> None:
        """
        Store the calibration of the camera, and the numbers whose corners are refined.

        passes: number of edge fits, each from the corners of the previous one.  Tags seen
        obliquely need two: the first corners may be 1 px off.
        """
        self._lens, self._expected, self._passes = lens, set(expected), passes
        self._quick, self._thorough = _detector(QUICK), _detector(THOROUGH)

    def numbers(self, picture: Picture) -> tuple[int, ...]:
        """Return the numbers of the tags in a grey image, with duplicates."""
        return self._find(picture)[0]

    def detect(self, picture: Picture) -> list[tuple[int, Array]]:
        """
        Return (number, corners) of every tag in a grey image (height, width).

        corners: (4, 2) px without the distortion of the lens, in the order of OpenCV.
        """
        numbers, quads = self._find(picture)
        if not numbers:
            return []
        corners = self._refined(picture, quads)
        for _ in range(1, self._passes):
            seen = self._lens.distorted(corners.reshape(-1, 2)).reshape(quads.shape)
            corners = self._refined(picture, seen)
        return list(zip(numbers, corners, strict=True))

    def _refined(self, picture: Picture, quads: Array) -> Array:
        """Return the refined corners (tags, 4, 2) without distortion."""
        edges = _edge_points(picture, quads)
        flat = self._lens.undistorted(edges).reshape(edges.shape)
        return np.array([_corners(sides) for sides in flat])

    def _find(self, picture: Picture) -> tuple[tuple[int, ...], Array]:
        """Return the numbers and corners (tags, 4, 2) px of the tags."""
        for detector in (self._quick, self._thorough):
            found, seen, _ = detector.detectMarkers(picture)
            numbers = () if seen is None else tuple(int(n) for n in seen.ravel())
            if self._expected <= set(numbers):
                break
        return numbers, np.asarray(found, dtype=np.float64).reshape(-1, 4, 2)


def _detector(windows: tuple[int, int, int]) -> Any:
    parameters = cv2.aruco.DetectorParameters()
    (parameters.adaptiveThreshWinSizeMin, parameters.adaptiveThreshWinSizeMax,
     parameters.adaptiveThreshWinSizeStep) = windows
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.errorCorrectionRate = 0.2  # of what the code allows: clutter is no tag
    return cv2.aruco.ArucoDetector(family(), parameters)


def _edge_points(picture: Picture, quads: Array) -> Array:
    """Return points on the four edges of each tag, (tags, 4, points, 2) px."""
    ends = np.roll(quads, -1, axis=1)
    along = ends - quads
    lengths = np.linalg.norm(along, axis=2)
    # Corners are clockwise in the image: this normal points outwards, to the white.
    outwards = np.stack([along[..., 1], -along[..., 0]], axis=-1) / lengths[..., None]
    reach = np.clip(REACH * lengths.min(axis=1) / MODULES, MIN_REACH, MAX_REACH)
    steps = np.linspace(-1.0, 1.0, 1 + 2 * int(MAX_REACH / STEP))
    middles = quads[:, :, None] + ALONG[:, None] * along[:, :, None]
    offsets = reach[:, None, None, None] * steps[:, None]
    places = (middles[:, :, :, None] + offsets[:, None] * outwards[:, :, None, None]
              ).astype(np.float32)
    grey = cv2.remap(picture, places[..., 0].reshape(-1, steps.size),
                     places[..., 1].reshape(-1, steps.size), cv2.INTER_LINEAR,
                     borderMode=cv2.BORDER_REPLICATE).reshape(places.shape[:-1]).astype(float)
    rise = np.clip(np.diff(grey, axis=-1), 0.0, None)  # from black to white
    rise = np.where(rise < 0.1 * rise.max(axis=-1, keepdims=True), 0.0, rise)  # noise
    halfway = (steps[1:] + steps[:-1]) / 2.0
    offset = (rise * halfway).sum(axis=-1) / np.maximum(rise.sum(axis=-1), 1e-9)
    points: Array = middles + (offset * reach[:, None, None])[..., None] * outwards[:, :, None]
    return points


def _corners(sides: Array) -> Array:
    """Return the intersections of lines fitted to neighbouring edges, (4, 2)."""
    centres = sides.mean(axis=1)
    # The direction across each line is that of the least scatter.
    across = np.linalg.svd(sides - centres[:, None])[2][:, 1]
    distance = (across * centres).sum(axis=1)
    before = np.roll(np.arange(4), 1)
    corners: Array = np.linalg.solve(
        np.stack([across[before], across], axis=1),
        np.stack([distance[before], distance], axis=1)[..., None])[..., 0]
    return corners
