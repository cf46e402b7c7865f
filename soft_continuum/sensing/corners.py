# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tags of the family 36h11 in a picture, and their corners to some hundredths of a pixel.

OpenCV finds the tags.  Its fast refinement looks at the corners only, its precise one takes half
a second per picture; here a line is fitted along each edge of the black square, and the corners
are where these cross.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from soft_continuum.sensing.lens import Lens

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

MODULES = 8
"""Modules along the edge of the black square: each is a square of one colour."""
ALONG = np.linspace(0.1, 0.9, 24)  # of an edge, from corner to corner: where it is looked for
REACH, STEP = 0.8, 0.25  # of a module to either side of the edge, and px between two samples
MIN_REACH, MAX_REACH = 1.5, 6.0  # px


class TagDetector:
    """Finds tags in pictures of one camera."""

    def __init__(self, lens: Lens) -> None:
        """Take the calibration of the camera."""
        self._lens = lens
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.errorCorrectionRate = 0.2  # of what the code allows: clutter is no tag
        self._detector = cv2.aruco.ArucoDetector(
            cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), parameters)

    def numbers(self, picture: Picture) -> tuple[int, ...]:
        """Return the numbers of the tags in a grey picture; what is seen twice stands twice."""
        numbers = self._detector.detectMarkers(picture)[1]
        return () if numbers is None else tuple(int(n) for n in numbers.ravel())

    def detect(self, picture: Picture) -> list[tuple[int, Array]]:
        """
        Return (number, corners) of every tag in a grey picture (height, width).

        corners: (4, 2) px without the distortion of the lens, in the order of OpenCV.
        """
        found, numbers, _ = self._detector.detectMarkers(picture)
        if numbers is None:
            return []
        quads = np.asarray(found, dtype=np.float64).reshape(-1, 4, 2)
        edges = _edge_points(picture, quads)
        flat = cv2.undistortPoints(
            edges.reshape(-1, 1, 2), self._lens.matrix, self._lens.distortion,
            P=self._lens.matrix).reshape(edges.shape)
        return [(int(n), _corners(sides)) for n, sides in zip(numbers.ravel(), flat, strict=True)]


def _edge_points(picture: Picture, quads: Array) -> Array:
    """Return points on the four edges of each tag, (tags, 4, points, 2) px."""
    ends = np.roll(quads, -1, axis=1)
    along = ends - quads
    lengths = np.linalg.norm(along, axis=2)
    # Corners go round clockwise in the picture: this normal points outwards, to the white.
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
    """Return where the lines through the points of neighbouring edges cross, (4, 2)."""
    centres = sides.mean(axis=1)
    # The direction across each line is that of the least scatter.
    across = np.linalg.svd(sides - centres[:, None])[2][:, 1]
    distance = (across * centres).sum(axis=1)
    before = np.roll(np.arange(4), 1)
    corners: Array = np.linalg.solve(
        np.stack([across[before], across], axis=1),
        np.stack([distance[before], distance], axis=1)[..., None])[..., 0]
    return corners
