# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Readings of load cells and IMUs on the twin: ground truth with the errors of its preset."""

import numpy as np

from soft_continuum.twin.joints import Array
from soft_continuum.twin.plant import Plant


class Sensors:
    """A load cell in each tendon, and an IMU at the bottom centre of each disc, base first."""

    def __init__(self, plant: Plant) -> None:
        """Draw the constant errors, independently of those of the plant."""
        self._plant, given = plant, plant.model_errors
        self._random = np.random.default_rng([given.seed, 1])
        tendons = len(plant.arm.tendon_names)
        self._zero = self._random.normal(0.0, given.load_cell_zero, tendons)
        self._scale = 1.0 + self._random.normal(0.0, given.load_cell_scale, tendons)
        shape = len(plant.arm.discs), 3
        self._bias = np.hstack([self._random.normal(0.0, size, shape)
                                for size in (given.gyro_bias, given.accelerometer_bias)])
        self._noise = np.repeat([given.gyro_noise, given.accelerometer_noise], 3)

    def tensions(self) -> Array:
        """Return the readings of the load cells, (tendons,), N."""
        size = self._plant.model_errors.tension_noise
        noise = self._random.normal(0.0, size, len(self._zero))
        shown: Array = self._zero + self._scale * self._plant.tensions + noise
        return shown

    def motions(self) -> Array:
        """Return angular velocities and specific forces, (discs, 6), as Plant.motions."""
        shown: Array = self._plant.motions + self._bias + self._random.normal(
            0.0, self._noise, self._bias.shape)
        return shown
