# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Whether OpenCV is there, and new enough: only cameras need it."""

REMEDY = "install it with: pip install 'soft_continuum[camera]'"


class OpenCVError(RuntimeError):
    """OpenCV cannot be used; the message says why and what to do."""


def require_opencv() -> None:
    """Raise OpenCVError unless OpenCV is there, 4.10 or later, as from PyPI."""
    try:
        import cv2
    except ImportError as error:
        raise OpenCVError(f'cameras need OpenCV ({error}); {REMEDY}') from None
    if tuple(map(int, cv2.__version__.split('.')[:2])) < (4, 10):
        raise OpenCVError(f'OpenCV {cv2.__version__} is too old, such as that of Ubuntu 24.04; '
                          f'{REMEDY}')
