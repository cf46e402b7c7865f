# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Smooth tendon motion along a path, within limits of speed and acceleration.

SciPy's curve is not used: importing it would take 20 MB and a second at every start.
"""

from collections.abc import Callable
from math import ceil, sqrt
from typing import TypeVar

import numpy as np

from soft_continuum.mechanics.arm import Array

Time = TypeVar('Time', float, Array)


def minimum_jerk(t: Time) -> Time:
    """
    Return the completed part of the path at a part of the time, both 0 to 1.

    The minimum-jerk profile, from rest to rest (Flash and Hogan, 1985).
    """
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


def minimum_jerk_duration(length: float, speed: float, acceleration: float) -> float:
    """Return the time (s) for a distance (m) within a speed (m/s) and an acceleration (m/s^2)."""
    # Their peaks: 15/8 and 10/sqrt(3) of the mean.
    return max(15 / 8 * length / speed, sqrt(10 / sqrt(3) * length / acceleration))


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
    duration = minimum_jerk_duration(total, speed, acceleration)
    for _ in range(50):
        times = np.linspace(0.0, duration, max(3, ceil(duration / interval) + 1))
        t = times / duration
        pulls: Array = smooth(total * minimum_jerk(t))
        speeds = np.diff(pulls, axis=0) / times[1]
        accelerations = np.diff(speeds, axis=0, prepend=0.0, append=0.0) / times[1]
        excess = max(np.abs(speeds).max() / speed,
                     sqrt(np.abs(accelerations).max() / acceleration))
        if excess <= 1.0:
            break
        duration *= max(1.01, excess)  # corners of the path, which the profile ignores
    pulls[0], pulls[-1] = points[0], points[-1]
    return times, pulls


def monotone_cubic(x: Array, y: Array) -> Callable[[Array], Array]:
    """
    Return the cubic curve through points with extrema only at the points.

    x: (k,), rising, k of at least 2.  y: (k, n).  The curve takes (m,) and returns (m, n).
    F. N. Fritsch and J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300; at the ends as SciPy's
    PchipInterpolator.
    """
    h = np.diff(x)[:, None]
    slopes = np.diff(y, axis=0) / h
    d = np.broadcast_to(slopes[0], y.shape).copy()
    if len(h) > 1:
        before, after = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            mean = (before + after) / (before / slopes[:-1] + after / slopes[1:])
        d[1:-1] = np.where(slopes[:-1] * slopes[1:] > 0.0, mean, 0.0)
        d[0] = _end_slope(h[0], h[1], slopes[0], slopes[1])
        d[-1] = _end_slope(h[-1], h[-2], slopes[-1], slopes[-2])
    bend = (d[:-1] + d[1:] - 2 * slopes) / h
    rise = (slopes - d[:-1]) / h - bend

    def curve(at: Array) -> Array:
        i = np.clip(np.searchsorted(x, at, side='right') - 1, 0, len(h) - 1)
        t = (at - x[i])[:, None]
        values: Array = y[i] + t * (d[i] + t * (rise[i] + t * bend[i] / h[i]))
        return values
    return curve


def _end_slope(h: Array, next_h: Array, slope: Array, next_slope: Array) -> Array:
    end = ((2 * h + next_h) * slope - h * next_slope) / (h + next_h)
    turns = (slope * next_slope < 0.0) & (np.abs(end) > 3 * np.abs(slope))
    return np.where(end * slope <= 0.0, 0.0, np.where(turns, 3 * slope, end))
