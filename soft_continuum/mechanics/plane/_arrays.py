# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arrays that the compiled solver works on, in groups that numba passes as they are."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics._compile import compiled
from soft_continuum.mechanics.arm import Array

Indices = NDArray[np.int64]

# What sets a tendon's tension.
LENGTH = 0  # the tendon is at most this long: tension >= 0 is found
TENSION = 1  # the tension is given
ANGLE = 2  # the bending angle of one segment is given: the tension, of either sign, is found


BOTH_LENGTHS = np.zeros(2, dtype=np.int64)
"""The mode of both tendons, or the segment of none."""


class State(NamedTuple):
    """
    The state that a solve changes in place.

    theta: (bodies,) rad, absolute angles.  tension: (2,) N.  lengths: (2,) m, the paths of the two
    tendons through the segments.
    """

    theta: Array
    tension: Array
    lengths: Array


class System(NamedTuple):
    """
    The chain and the loads on it.

    bodies: (n, 3), length m and load coefficients wx, wz N m of the energy wx sin + wz cos.
    joints: (n, 7), see joints.py.  tables: (k, 2, rows), moment-curvature laws.  guides:
    (segments, 2) m, offset of the lower and upper guide of each span.  ratios: (2, segments),
    tension of a span over that at the base.  group: (n,), rigid group of each body, -1 for the
    base.
    """

    bodies: Array
    joints: Array
    tables: Array
    guides: Array
    ratios: Array
    group: Indices


class TendonDrive(NamedTuple):
    """
    What sets the tension of each tendon; all arrays are (2,).

    mode: LENGTH, TENSION or ANGLE.  target: m, N or rad.  compliance: m/N.  segment: the segment
    whose bending angle is given, in ANGLE mode.
    """

    mode: Indices
    target: Array
    compliance: Array
    segment: Indices


class Work(NamedTuple):
    """
    The linear system of one Newton step and its parts.

    gradient, diagonal, off: (groups,), moments and tridiagonal Hessian.  columns, rows: (groups,
    width) and (width, groups), the low-rank rest of the system; column 0 is the right-hand side.
    products: (width, width), rows times solved columns.  matrix: (width, width), the small system
    of the active set.  cosine, sine: (bodies,).  spans: (2,
    segments, 3), length m and unit direction.  moved: (groups,) rad since the start.  change:
    (width,), auxiliaries and changes of tension.  column: (2,), the column of each tendon, 0
    where it is slack for good.  gap: (2,) m or rad by which a tendon is beyond its target.  taut:
    (2,), the active set.  held: (2,), the tendons that stability is judged with.
    """

    gradient: Array
    diagonal: Array
    off: Array
    columns: Array
    rows: Array
    products: Array
    matrix: Array
    cosine: Array
    sine: Array
    spans: Array
    moved: Array
    change: Array
    column: Indices
    gap: Array
    taut: NDArray[np.bool_]
    held: NDArray[np.bool_]


@compiled
def work_arrays(bodies, segments, groups):  # type: ignore[no-untyped-def]
    """Return a Work for a chain of so many bodies, segments and rigid groups."""
    width = 3 + 2 * segments  # right-hand side, two tendons, and one for each of their spans
    moments, turned = np.zeros((4, groups)), np.empty((2, bodies))
    small, flags = np.empty((2, width, width)), np.zeros((2, 2), dtype=np.bool_)
    return Work(
        moments[0], moments[1], moments[2], np.empty((groups, width)), np.empty((width, groups)),
        small[0], small[1], turned[0], turned[1], np.empty((2, segments, 3)), moments[3],
        np.empty(width), np.zeros(2, dtype=np.int64), np.zeros(2), flags[0], flags[1])
