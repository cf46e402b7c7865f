# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of images to and from messages."""

import array

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image

from soft_continuum.text import printable

MAX_PICTURE_BYTES = 40_000_000
"""Largest image message: 12 megapixels in colour."""
CHANNELS = {'mono8': 1, '8UC1': 1, 'rgb8': 3, 'bgr8': 3, '8UC3': 3, 'rgba8': 4, 'bgra8': 4}
"""Supported encodings of sensor_msgs/Image, and their bytes per pixel."""


def grey_picture(message: Image) -> NDArray[np.uint8]:
    """Return an image (height, width) in grey; raises ValueError for an unsupported one."""
    if message.encoding not in CHANNELS:
        raise ValueError(f'images of encoding {printable(message.encoding, 40)!r} are not '
                         f'supported; supported: {", ".join(CHANNELS)}')
    channels, row = CHANNELS[message.encoding], message.step
    if (message.width * message.height == 0 or row < message.width * channels
            or len(message.data) < row * message.height):
        raise ValueError(f'an image of {message.width} x {message.height} px with '
                         f'{len(message.data)} bytes in rows of {row}')
    data = np.frombuffer(message.data, dtype=np.uint8)[:row * message.height]
    pixels = data.reshape(message.height, row)[:, :message.width * channels]
    if channels == 1:
        return np.ascontiguousarray(pixels)
    # Green, which most of the light is, and of which the sensor has most pixels.
    return np.ascontiguousarray(pixels.reshape(message.height, message.width, channels)[..., 1])


def grey_message(picture: NDArray[np.uint8]) -> Image:
    """Return a grey image (height, width) as a message without header."""
    message = Image(height=picture.shape[0], width=picture.shape[1], encoding='mono8',
                    step=picture.shape[1])
    message.data = array.array('B', picture.tobytes())
    return message
