# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How tendons move smoothly along a path, within speed and acceleration."""

from math import ceil, sqrt

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.sequencing import minimum_jerk
from soft_continuum.sequencing.monotone import monotone_cubic


def timed(points: Array, speed: float, acceleration: float,
          interval: float = 0.05) -> tuple[Array, Array]:
    """
    Return times (k,) s and pulls (k, tendons) m of a smooth motion through points (m, tendons).

    The path through the points is smooth in space and follows a minimum-jerk profile in time,
    just slow enough to keep each tendon within ``speed`` (m/s) and ``acceleration`` (m/s^2).
    """
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points, axis=0)).max(axis=1))])
    keep = np.concatenate([[True], np.diff(path) > 1e-12])
    path, points = path[keep], points[keep]
    total = path[-1]
    if total == 0.0:
        return np.array([0.0]), points[:1].copy()
    smooth = monotone_cubic(path, points)
    duration = minimum_jerk.duration(total, speed, acceleration)
    for _ in range(50):
        times = np.linspace(0.0, duration, max(3, ceil(duration / interval) + 1))
        t = times / duration
        pulls: Array = smooth(total * minimum_jerk.progress(t))
        speeds = np.diff(pulls, axis=0) / times[1]
        accelerations = np.diff(speeds, axis=0, prepend=0.0, append=0.0) / times[1]
        excess = max(np.abs(speeds).max() / speed,
                     sqrt(np.abs(accelerations).max() / acceleration))
        if excess <= 1.0:
            break
        duration *= max(1.01, excess)  # corners of the path, which the profile ignores
    pulls[0], pulls[-1] = points[0], points[-1]
    return times, pulls
