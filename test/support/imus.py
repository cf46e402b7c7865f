# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What an IMU on a disc would measure, by rotations in space and by differences of positions.

Shares no formula with what measures: the disc goes round a point below it as on a rigid arm.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

GRAVITY = 9.80665


@dataclass(frozen=True)
class Errors:
    """Standard deviations: per sample, of bias and offset of a device, of the bias in a second."""

    acceleration: float = 0.05
    rate: float = 0.003
    offset: float = 0.0
    bias: float = 0.02
    walk: float = 2e-4


@dataclass(frozen=True)
class Record:
    """times (k,) s, angles (k,) rad, acceleration (k, 3), rates (k, 3), biases (k,) about y."""

    times: np.ndarray
    angles: np.ndarray
    accelerations: np.ndarray
    rates: np.ndarray
    biases: np.ndarray


def steps(times, rng, size=0.6, duration=1.2):
    """Return angles that rest for some seconds, go elsewhere smoothly, rest again and so on."""
    angles, now, begin = np.zeros(len(times)), 0.0, 3.0
    while begin < times[-1]:
        then = rng.uniform(-size, size)
        s = np.clip((times - begin) / duration, 0.0, 1.0)
        angles += (then - now) * (10 * s**3 - 15 * s**4 + 6 * s**5)
        now, begin = then, begin + duration + rng.uniform(1.0, 4.0)
    return angles


def record(rng, angles, rate=100.0, mounting=0.0, length=0.25, errors=Errors(), lean=0.0):
    """
    Return what an IMU measures at ``angles`` (k,) rad of its disc.

    mounting: rad, of the base from upright about y.  lean: rad, of the whole arm about x.
    """
    step, count = 1.0 / rate, len(angles)
    base = Rotation.from_euler('x', lean) * Rotation.from_euler('y', mounting)
    poses = base * Rotation.from_euler('y', angles[:, None])
    positions = poses.apply([0.0, 0.0, length])
    acceleration = np.gradient(np.gradient(positions, step, axis=0), step, axis=0)
    felt = poses.inv().apply(acceleration + [0.0, 0.0, GRAVITY])
    turned = np.zeros((count, 3))
    turned[1:] = (poses[:-1].inv() * poses[1:]).as_rotvec() / step
    biases = errors.bias * rng.standard_normal() + np.cumsum(
        errors.walk * np.sqrt(step) * rng.standard_normal(count))
    turned += errors.rate * rng.standard_normal((count, 3))
    turned[:, 1] += biases
    felt += (errors.acceleration * rng.standard_normal((count, 3))
             + errors.offset * rng.standard_normal(3))
    return Record(step * np.arange(count), angles, felt, turned, biases)
