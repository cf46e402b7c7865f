# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Where up is in the frame of a disc in space, from an IMU on it.

A Kalman filter as in the plane, of a direction and the three biases of the gyroscope: the
direction turns against the disc; the accelerometer says where it is, as long as the disc does not
accelerate.  How the disc is turned about the vertical nobody sees.
"""

from typing import Any

import numpy as np

from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.spatial.orientations import matrices
from soft_continuum.sensing.tilt import BIAS_WALK, ImuFilter, ImuSettings

UP, BIAS = slice(3), slice(3, 6)


class UpFilter(ImuFilter[Array]):
    """
    Estimates where up is in the frame of a disc, (3,), of length 1.

    up is that at ``time``; bias (3,) rad/s is of the gyroscope; covariance is (6, 6), of both.
    """

    def __init__(self, settings: ImuSettings) -> None:
        """Start without a sample; raises SensorError where gravity tells nothing."""
        super().__init__(settings)
        self.up, self.bias = np.full(3, np.nan), np.zeros(3)
        self._rate = np.zeros(3)
        self.covariance = np.zeros((6, 6))
        self.covariance[BIAS, BIAS] = settings.bias_deviation**2 * np.eye(3)

    @property
    def up_covariance(self) -> Array:
        """Of up, across it, (3, 3), what is off in every sample included."""
        found = self.covariance[UP, UP] + self._settings.deviation**2 * np.eye(3)
        across = np.eye(3) - np.outer(self.up, self.up)
        return np.asarray(across @ found @ across)

    def _size(self, rate: Array) -> float:
        return float(np.linalg.norm(rate))

    def _seen(self, acceleration: tuple[float, float, float]) -> tuple[Array, float]:
        size = float(np.linalg.norm(acceleration))
        return np.array(acceleration) / size, size

    def _predict(self, rate: Array, noise: float, step: float, restart: bool) -> None:
        if restart:
            gap = step if step > 0.0 else 0.0  # false for nan, before the first
            self.covariance[BIAS, BIAS] += BIAS_WALK**2 * gap * np.eye(3)
            return
        turn = (np.asarray(rate) - self.bias) * step
        angle = float(np.linalg.norm(turn))
        half = np.sinc(angle / 2.0 / np.pi) / 2.0
        back = matrices(np.array([[*(-half * turn), np.cos(angle / 2.0)]]))[0]
        self.up = back @ self.up
        x, y, z = self.up.tolist()  # it turns by -rate x up, or up x rate
        by_rate = step * np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        moves = np.eye(6)
        moves[UP, UP], moves[UP, BIAS] = back, by_rate
        self.covariance = moves @ self.covariance @ moves.T
        # At another angle the offset of the accelerometer is another angle.
        self.covariance[UP, UP] += (noise**2 * by_rate @ by_rate.T
                                    + self._settings.deviation**2 * angle * np.eye(3))
        self.covariance[BIAS, BIAS] += BIAS_WALK**2 * step * np.eye(3)

    def _restart(self, up: Array, variance: float) -> None:
        self.up = up
        self.covariance[UP], self.covariance[:, UP] = 0.0, 0.0
        self.covariance[UP, UP] = variance * np.eye(3)

    def _distance(self, up: Array, variance: float) -> float:
        away = up - self.up
        return float(away @ np.linalg.solve(self._total(variance), away))

    def _correct(self, up: Array, variance: float) -> None:
        gain = np.linalg.solve(self._total(variance), self.covariance[UP]).T
        if not self.is_quiet:
            gain[BIAS] = 0.0
        # Joseph's form, which holds for any gain.
        kept = np.eye(6)
        kept[:, UP] -= gain
        self.covariance = kept @ self.covariance @ kept.T + variance * gain @ gain.T
        step = gain @ (up - self.up)
        self.up = self.up + step[UP]
        self.up /= np.linalg.norm(self.up)
        self.bias = self.bias + step[BIAS]

    def _total(self, variance: float) -> Array:
        total: Array = self.covariance[UP, UP] + variance * np.eye(3)
        return total


def turned_upright(up: Array, to: Array) -> Array:
    """Return the quaternion x, y, z, w of the smallest turn from a direction (3,) to another."""
    turn = np.array([*np.cross(up, to), 1.0 + up @ to])
    if turn[3] < 1e-9:  # half a turn, about anything across it
        turn = np.array([*np.cross(up, np.eye(3)[np.argmin(np.abs(up))]), 0.0])
    return np.asarray(turn / np.linalg.norm(turn))


def pose_of_up(up: Array, covariance: Array, to: Array, unseen: float) -> tuple[Array, Array]:
    """
    Return the pose (7,) and covariance (6, 6) of a disc of which only up is known, (3,).

    covariance: (3, 3), of up.  to: where up is in base_link, (3,).  unseen: variance of what is
    not measured: where it is, and how it is turned about the vertical.
    """
    turn = turned_upright(up, to)
    matrix = matrices(turn[None])[0]
    lever = np.cross(np.eye(3), to).T @ matrix  # what moves up turns it across
    full: Any = unseen * np.eye(6)
    full[3:, 3:] = lever @ covariance @ lever.T + unseen * np.outer(to, to)
    return np.concatenate([np.zeros(3), turn]), full
