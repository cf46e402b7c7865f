# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Grey images, and their sources besides ROS: a video device, a video file, a folder."""

from collections.abc import Iterator
from pathlib import Path
import re

import numpy as np
from numpy.typing import NDArray

from soft_continuum.text import printable

Picture = NDArray[np.uint8]
"""Grey, (height, width)."""

BLACK = 8  # grey value that the brightest part of a picture exceeds
SUFFIXES = ('.png', '.jpg', '.jpeg', '.bmp', '.pgm', '.tif', '.tiff')
DEVICE = re.compile(r'/dev/video\d+|/dev/v4l/.+')


class SourceError(ValueError):
    """The source has no images, or no more; the message says why."""


def is_black(picture: Picture) -> bool:
    """Return whether an image is too dark to show anything."""
    return bool(picture.max() <= BLACK)


def is_device(source: str) -> bool:
    """Return whether a source is a device, which streams without end at its own rate."""
    return DEVICE.fullmatch(source) is not None


def pictures(source: str, size: tuple[int, int]) -> Iterator[Picture]:
    """
    Yield the grey images (height, width) of a device, a video file or a folder, in order.

    size: (width, height) px requested from a device.  Raises SourceError.
    """
    import cv2
    path = Path(source)
    try:
        if path.is_dir():
            yield from _of_folder(path)
        elif is_device(source) or path.is_file():
            yield from _of_video(source, size)
        else:
            raise SourceError(f'camera.source {printable(source)!r} does not exist; give a video '
                              'device such as /dev/video0, a video file or a folder of images')
    except (OSError, cv2.error) as error:
        raise SourceError(f'{source} cannot be read: {error}') from None


def _of_folder(folder: Path) -> Iterator[Picture]:
    import cv2
    paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)
    if not paths:
        raise SourceError(f'{folder} contains no images; supported: {", ".join(SUFFIXES)}')
    for path in paths:
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if picture is None:
            raise SourceError(f'{path} cannot be read as an image')
        yield np.asarray(picture, dtype=np.uint8)


def _of_video(source: str, size: tuple[int, int]) -> Iterator[Picture]:
    import cv2
    video = cv2.VideoCapture(source)
    try:
        if not video.isOpened():
            raise SourceError(f'{source} cannot be opened; is it a video, is the camera plugged '
                              'in, free, and may you use it (group video)?')
        if is_device(source):
            video.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
            video.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
            video.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        while True:
            read, picture = video.read()
            if not read:
                if is_device(source):
                    raise SourceError(f'{source} delivers no more images; is it still plugged in?')
                return
            yield np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    finally:
        video.release()
