# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Camera image with overlays of the detected tags and the modelled arm."""

import cv2
import numpy as np

from soft_continuum.colours import Colour, MEASURED, MODEL
from soft_continuum.estimation.sensing.pictures import Array, Picture
from soft_continuum.estimation.sensing.rigid import rotate, UP
from soft_continuum.estimation.sensing.tag_camera import TagCamera, TagDetections

SIZE = 640  # px, longer edge of what is drawn
QUALITY = 75  # of the JPEG
FAR = 1e3  # m, where no arm is
ON_CURVE = 12  # points of a segment's middle line
SHIFT = 4  # bits after the point of a pixel, as OpenCV draws


def overlay(picture: Picture, camera: TagCamera | None = None, seen: TagDetections | None = None,
            model: Array | None = None) -> bytes:
    """
    Return a JPEG of a grey image (height, width), 640 px large, with overlays.

    seen: its detections; tags are drawn in MEASURED.  model: (2 * discs, 7), poses of bottom and
    top of each disc in base_link, m and quaternion x, y, z, w, as in disc_poses, drawn in MODEL
    if enough fixed tags are seen.
    """
    scale = SIZE / max(picture.shape)
    height, width = (max(1, round(scale * edge)) for edge in picture.shape)
    small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    drawn = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
    if camera is not None and seen is not None:
        for corners in seen.corners.values():
            _draw(drawn, camera.lens.distorted(corners) * scale, MEASURED, closed=True)
        if seen.view is not None and model is not None and np.abs(model).max() < FAR:
            for points, closed in _wireframe(model, camera.layout.rim):
                pixels = seen.view.project(points)
                _draw(drawn, camera.lens.distorted(pixels) * scale, MODEL, closed)
    return bytes(cv2.imencode('.jpg', drawn, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])


def _wireframe(model: Array, rim: Array) -> list[tuple[Array, bool]]:
    """Return the outlines of the discs and the middle lines of the segments, as (k, 3) points."""
    lines = []
    outlines = [np.array([pose[:3] + rotate(pose[3:], point) for point in rim]) for pose in model]
    for bottom, top in zip(outlines[::2], outlines[1::2], strict=True):
        lines += [(bottom, True), (top, True)]
        lines += [(np.array(side), False) for side in zip(bottom, top, strict=True)]
    for top, bottom in zip(model[1::2], model[2::2], strict=False):
        lines.append((_curve(top, bottom), False))
    return lines


def _curve(begin: Array, end: Array) -> Array:
    """Return points (k, 3) on the cubic curve between two poses, tangent to both."""
    t = np.linspace(0.0, 1.0, ON_CURVE)[:, None]
    length = np.linalg.norm(end[:3] - begin[:3])
    leaves, arrives = (rotate(pose[3:], UP) * length for pose in (begin, end))
    points: Array = ((1.0 + 2.0 * t) * (1.0 - t)**2 * begin[:3] + t * (1.0 - t)**2 * leaves
                     + t**2 * (3.0 - 2.0 * t) * end[:3] + t**2 * (t - 1.0) * arrives)
    return points


def _draw(picture: Picture, points: Array, colour: Colour, closed: bool) -> None:
    """Draw a line through points (k, 2) px, unless OpenCV cannot represent them."""
    if np.isfinite(points).all() and np.abs(points).max() < 1e5:
        pixels = np.round(points * 2**SHIFT).astype(np.int32)
        cv2.polylines(picture, [pixels], closed, colour[::-1], 2, cv2.LINE_AA, SHIFT)
