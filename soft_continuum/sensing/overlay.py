# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the camera sees, with the tags that were found and the arm of the model drawn over it."""

import cv2
import numpy as np

from soft_continuum.colours import Colour, MEASURED, MODEL
from soft_continuum.sensing.layout import directions
from soft_continuum.sensing.pictures import Array, Picture
from soft_continuum.sensing.tag_camera import Sight, TagCamera

SIZE = 640  # px, longer edge of what is drawn
QUALITY = 75  # of the JPEG
ON_CURVE = 12  # points of a segment's middle line
SHIFT = 4  # bits after the point of a pixel, as OpenCV draws


def overlay(picture: Picture, camera: TagCamera | None = None, sight: Sight | None = None,
            model: Array | None = None) -> bytes:
    """
    Return a JPEG of a grey picture (height, width), 640 px large, with what is known over it.

    sight: what the camera found in it: its tags are drawn in MEASURED.  model: (2 * discs, 3), x,
    z and angle of bottom and top of each disc in base_link, m and rad, as disc_poses has them, in
    MODEL; that takes a sight of enough fixed tags.
    """
    scale = SIZE / max(picture.shape)
    height, width = (max(1, round(scale * edge)) for edge in picture.shape)
    small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    drawn = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
    if camera is not None and sight is not None:
        for corners in sight.corners.values():
            _draw(drawn, camera.lens.distorted(corners) * scale, MEASURED, closed=True)
        if sight.plane is not None and model is not None:
            for points, closed in _wireframe(model, camera.layout.disc_size):
                pixels = sight.plane.project(points, camera.layout.depth)
                _draw(drawn, camera.lens.distorted(pixels) * scale, MODEL, closed)
    return bytes(cv2.imencode('.jpg', drawn, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])


def _wireframe(model: Array, width: float) -> list[tuple[Array, bool]]:
    """Return the outlines of the discs and the middle lines of the segments, as (k, 2) points."""
    lines = []
    for bottom, top in zip(model[::2], model[1::2], strict=True):
        side = directions(bottom[2])[0] * width / 2.0
        lines.append((np.array([bottom[:2] - side, bottom[:2] + side, top[:2] + side,
                                top[:2] - side]), True))
    for top, bottom in zip(model[1::2], model[2::2], strict=False):
        lines.append((_curve(top, bottom), False))
    return lines


def _curve(begin: Array, end: Array) -> Array:
    """Return points (k, 2) on the cubic that leaves and arrives along the directions of both."""
    t = np.linspace(0.0, 1.0, ON_CURVE)[:, None]
    length = np.linalg.norm(end[:2] - begin[:2])
    leaves, arrives = (directions(pose[2])[1] * length for pose in (begin, end))
    points: Array = ((1.0 + 2.0 * t) * (1.0 - t)**2 * begin[:2] + t * (1.0 - t)**2 * leaves
                     + t**2 * (3.0 - 2.0 * t) * end[:2] + t**2 * (t - 1.0) * arrives)
    return points


def _draw(picture: Picture, points: Array, colour: Colour, closed: bool) -> None:
    """Draw a line through points (k, 2) px, as far as they are numbers that OpenCV can take."""
    if np.isfinite(points).all() and np.abs(points).max() < 1e5:
        pixels = np.round(points * 2**SHIFT).astype(np.int32)
        cv2.polylines(picture, [pixels], closed, colour[::-1], 2, cv2.LINE_AA, SHIFT)
