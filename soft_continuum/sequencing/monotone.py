# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A smooth curve through points; that of SciPy would take 20 MB and a second of every start."""

from collections.abc import Callable

import numpy as np

from soft_continuum.mechanics.arm import Array


def monotone_cubic(x: Array, y: Array) -> Callable[[Array], Array]:
    """
    Return the cubic curve through points that turns nowhere but at the points.

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
