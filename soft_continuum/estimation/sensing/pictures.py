# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Types of images, and the appearance of tags in them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
"""Grey, (height, width)."""

BLACK = 8  # grey value that the brightest part of a picture exceeds
MODULES = 8
"""Modules (squares of one colour) along the edge of a tag's black square."""
FAMILY_SIZE = 587
"""Size of the family 36h11."""


def is_black(picture: Picture) -> bool:
    """Return whether an image is too dark to show anything."""
    return bool(picture.max() <= BLACK)


def family() -> Any:
    """Return the family 36h11 as a dictionary of OpenCV."""
    import cv2
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


def white_modules(number: int) -> NDArray[np.bool_]:
    """Return which modules of a tag are white, (MODULES, MODULES), from its upper left."""
    import cv2
    drawn: Picture = cv2.aruco.generateImageMarker(family(), number, MODULES)
    return drawn > 127
