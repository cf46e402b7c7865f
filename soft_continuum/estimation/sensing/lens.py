# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Camera calibration: focal length, centre and distortion, in the YAML format of ROS.

From images of a printed board (ChArUco: a chessboard with tags).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

import numpy as np

from soft_continuum.estimation.sensing.pictures import Picture
from soft_continuum.mechanics._checks import real_array, whole
from soft_continuum.mechanics.arm import Array
from soft_continuum.parameters.files import read_yaml
from soft_continuum.text import printable

MODELS = {'plumb_bob': 5, 'rational_polynomial': 8, '': 8, 'none': 0}
"""Largest number of coefficients of the supported distortion models of sensor_msgs/CameraInfo.

OpenCV orders them so that omitted trailing coefficients are 0."""
MIN_FOCAL = 0.05
"""Smallest focal length over the size of the picture, for a view of 170 degrees."""
COLUMNS, ROWS = 7, 9
SQUARE, MARKER = 0.025, 0.018  # m; only their ratio matters
MIN_CORNERS = 12  # of the 48 of the board, in one picture
MIN_PICTURES, MAX_PICTURES = 8, 60
MIN_COVERAGE = 0.5  # of the width and of the height of the picture, by all corners together
MAX_RESIDUAL = 1.0  # px, RMS
MIN_TILT = 0.15  # rad between the board in two of the pictures: all alike tell no focal length


class LensError(ValueError):
    """The calibration is invalid, or of another camera."""


@dataclass(frozen=True)
class Lens:
    """
    A calibrated camera.

    size: (width, height) px.  matrix: (3, 3), focal lengths and centre, px.  distortion: the
    coefficients of OpenCV, as in sensor_msgs/CameraInfo, five or eight.
    """

    size: tuple[int, int]
    matrix: Array
    distortion: Array

    @classmethod
    def of(cls, size: tuple[int, int], matrix: Any, distortion: Any, model: str = '') -> Self:
        """Check and return a calibration; raises LensError."""
        try:
            k = real_array(matrix, 'the camera matrix must be numbers').reshape(-1)
            d = np.trim_zeros(real_array(
                distortion, 'the distortion coefficients must be numbers').reshape(-1), 'b')
        except ValueError as error:
            raise LensError(
                f'{printable(error)}; call: soft_continuum calibrate camera') from None
        if not all(whole(pixels) and pixels > 0 for pixels in size):
            raise LensError(f'the size of the picture is {printable(size, 40)}; allowed: width '
                            'and height in px, whole numbers above 0')
        if k.size != 9 or not (np.isfinite(k).all() and k[0] > 0.0 and k[4] > 0.0):
            raise LensError('the camera is not calibrated: its focal length is missing; '
                            'call: soft_continuum calibrate camera')
        (fx, fy), centre = k[[0, 4]], k[[2, 5]]
        if (k[[1, 3, 6, 7, 8]].tolist() != [0.0, 0.0, 0.0, 0.0, 1.0]
                or min(fx, fy) < MIN_FOCAL * max(size)
                or not np.all((centre > 0) & (centre < size))):
            raise LensError(
                f'the camera matrix is {k.tolist()}; expected fx 0 cx, 0 fy cy, 0 0 1, row by row '
                f'and in px, with (cx, cy) in the picture of {size[0]} x {size[1]} px, fx and fy '
                f'{MIN_FOCAL:g} of its size or more; call: soft_continuum calibrate camera')
        if d.size > MODELS.get(model.lower(), -1) or not np.isfinite(d).all():
            raise LensError(
                f'distortion model {printable(model, 40)!r} with {d.size} coefficients that are '
                'not 0 is not supported; supported: plumb_bob with up to 5, rational_polynomial '
                'with up to 8, none with none; have the driver publish one of these, or call: '
                'soft_continuum calibrate camera, and give its file as camera.calibration')
        return cls(size, k.reshape(3, 3), np.pad(d, (0, (5 if d.size <= 5 else 8) - d.size)))

    @property
    def projection(self) -> Array:
        """The projection matrix of ROS calibrations, (3, 4)."""
        return np.hstack([self.matrix, np.zeros((3, 1))])

    @classmethod
    def from_info(cls, message: Any) -> Self:
        """Return the calibration in a sensor_msgs/CameraInfo; raises LensError."""
        return cls.of((message.width, message.height), message.k, message.d,
                      message.distortion_model)

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """
        Return the calibration in a YAML file of the camera drivers of ROS, OpenCV or `topic echo`.

        Raises OSError, ParameterError for a file that is not YAML, LensError.
        """
        values = read_yaml(path)
        try:
            if 'k' in values:  # a sensor_msgs/CameraInfo
                return cls.from_info(SimpleNamespace(**values))
            return cls.of((values['image_width'], values['image_height']),
                          values['camera_matrix']['data'],
                          values['distortion_coefficients']['data'],
                          str(values.get('distortion_model') or ''))
        except LensError as error:
            raise LensError(f'{path}: {error}') from None
        except (KeyError, TypeError, AttributeError):
            raise LensError(f'{path} is not a camera calibration; needed: image_width, '
                            'image_height, camera_matrix and distortion_coefficients') from None

    def undistorted(self, points: Array) -> Array:
        """Return points (k, 2) px of an image without the distortion of the lens."""
        import cv2
        # The usual five iterations leave errors of 0.2 px for a wide lens.
        enough = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9
        given = np.asarray(points, dtype=float).reshape(-1, 1, 2), self.matrix, self.distortion
        if hasattr(cv2, 'undistortPointsIter'):  # before OpenCV 5
            flat = cv2.undistortPointsIter(*given, np.eye(3), self.matrix, enough)
        else:
            flat = cv2.undistortPoints(*given, P=self.matrix, criteria=enough)
        return np.asarray(flat).reshape(-1, 2)

    def distorted(self, points: Array) -> Array:
        """Return ``undistorted`` points (k, 2) px with the distortion of the lens, (k, 2) px."""
        import cv2
        middle, focal = self.matrix[:2, 2], np.diag(self.matrix)[:2]
        rays = np.column_stack([(points - middle) / focal, np.ones(len(points))])
        seen = cv2.projectPoints(
            rays, np.zeros(3), np.zeros(3), self.matrix, self.distortion)[0]
        return np.asarray(seen).reshape(-1, 2)

    def text(self, name: str) -> str:
        """Return the calibration as a YAML file of the camera drivers of ROS."""
        def matrix(rows: int, values: Array) -> str:
            numbers = ', '.join(repr(float(v)) for v in values.reshape(-1))
            return (f'\n  rows: {rows}\n  cols: {values.size // rows}\n  data: [{numbers}]')

        model = {5: 'plumb_bob', 8: 'rational_polynomial'}[self.distortion.size]
        return (f'image_width: {self.size[0]}\nimage_height: {self.size[1]}\n'
                f'camera_name: {name}\n'
                f'camera_matrix:{matrix(3, self.matrix)}\n'
                f'distortion_model: {model}\n'
                f'distortion_coefficients:{matrix(1, self.distortion)}\n'
                f'rectification_matrix:{matrix(3, np.eye(3))}\n'
                f'projection_matrix:{matrix(3, self.projection)}\n')


@dataclass(frozen=True)
class LensCalibration:
    """A lens, the number of images used, and the residual of their corners, px RMS."""

    lens: Lens
    pictures: int
    residual: float


def board() -> Any:
    """Return the board that ``soft_continuum tags`` prints; its tags are of another family."""
    import cv2
    return cv2.aruco.CharucoBoard(
        (COLUMNS, ROWS), SQUARE, MARKER,
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))


def calibrate(pictures: Iterable[Picture]) -> LensCalibration:
    """
    Return the camera calibration for grey images (height, width) of the board.

    Raises LensError, which names what is missing.
    """
    import cv2
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
