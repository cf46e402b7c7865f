# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Energy gradient and Hessian of a planar chain in absolute angles, in compiled scalar code.

In absolute angles the springs give a tridiagonal Hessian, loads a diagonal one and every tendon
span a diagonal plus a rank-one term.  The arrays are in groups that numba passes as they are.
"""

from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics._compile import borrowing, compiled
from soft_continuum.mechanics.arm import Array

Indices = NDArray[np.int64]

# What sets a tendon's tension.
LENGTH = 0  # the tendon is at most this long: tension >= 0 is found
TENSION = 1  # the tension is given
ANGLE = 2  # the bending angle of one segment is given: the tension, of either sign, is found
BOTH_LENGTHS = np.zeros(2, dtype=np.int64)
"""The mode of both tendons, or the segment of none."""

TWO_OVER_PI = 2.0 / pi
ROUND = 1.5 * 2.0**52
QUARTER = (1.57079625129699707031, 7.54978941586159635336e-8, 5.39030285815811905290e-15)
"""A quarter of a turn, rad, as a sum whose first parts have few digits."""
SINE = (1.58962301576546568060e-10, -2.50507477628578072866e-8, 2.75573136213857245213e-6,
        -1.98412698295895385996e-4, 8.33333333332211858878e-3, -1.66666666666666307295e-1)
COSINE = (-1.13585365213876817300e-11, 2.08757008419747316778e-9, -2.75573141792967388112e-7,
          2.48015872888517045348e-5, -1.38888888888730564116e-3, 4.16666666666665929218e-2)


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


@compiled
def law(q, stiffness, table, length, tables):  # type: ignore[no-untyped-def]
    """
    Return moment (N m) and tangent (N m/rad) of one joint at relative angle q (rad).

    stiffness: N m/rad; or, with a table (its index, negative: linear), what multiplies the
    moments of the piecewise-linear, odd moment-curvature law over the joint's length (m).
    """
    if table < 0.0:
        return stiffness * q, stiffness
    rows = tables[int(table)]
    curvature = abs(q) / length
    row = 0
    while row < rows.shape[1] - 2 and curvature > rows[0, row + 1]:
        row += 1
    slope = (rows[1, row + 1] - rows[1, row]) / (rows[0, row + 1] - rows[0, row])
    moment = rows[1, row] + slope * (curvature - rows[0, row])
    return stiffness * (moment if q >= 0.0 else -moment), stiffness * (slope / length)


@compiled
def jam_law(q, joint, tables, secant):  # type: ignore[no-untyped-def]
    """
    Return moment (N m) and tangent (N m/rad) of the jam of one joint at relative angle q (rad).

    ``joint`` = (soft stiffness, soft table, jam stiffness, jam table, held angle, yield moment,
    length): the leaf spring acts about its natural shape, the jam about the held one and at most
    up to its yield moment.
    """
    offset = q - joint[4]
    moment, tangent = law(offset, joint[2], joint[3], joint[6], tables)
    if abs(moment) > joint[5]:
        moment = joint[5] if moment > 0.0 else -joint[5]
        tangent = 0.0
    if secant and offset != 0.0:
        tangent = max(tangent, moment / offset)
    return moment, tangent


@borrowing
def turn(theta, cosine, sine):  # type: ignore[no-untyped-def]
    """
    Fill the cosines and sines of the absolute angles, to 2e-16, for angles up to 1e5 rad.

    By the polynomials of Cephes (Moshier 1992, sin.c) without branches, so that several are
    computed at once; two calls of the C library for each angle would take a quarter of a solve.
    """
    for i in range(theta.shape[0]):
        # Adding and subtracting ROUND rounds to a whole number.
        quarters = (theta[i] * TWO_OVER_PI + ROUND) - ROUND
        x = ((theta[i] - quarters * QUARTER[0]) - quarters * QUARTER[1]) - quarters * QUARTER[2]
        z = x * x
        s = x + x * z * (((((SINE[0] * z + SINE[1]) * z + SINE[2]) * z + SINE[3]) * z + SINE[4])
                         * z + SINE[5])
        c = 1.0 - 0.5 * z + z * z * (((((COSINE[0] * z + COSINE[1]) * z + COSINE[2]) * z
                                       + COSINE[3]) * z + COSINE[4]) * z + COSINE[5])
        quarter = quarters - 4.0 * ((0.25 * quarters + ROUND) - ROUND)  # of a turn, -2 to 2
        along = 1.0 - abs(quarter)  # 1 or -1, or 0 where sine and cosine are exchanged
        across = quarter * (1.0 - abs(along))
        cosine[i] = along * c - across * s
        sine[i] = along * s + across * c


@borrowing
def tendon_geometry(system, work, lengths):  # type: ignore[no-untyped-def]
    """Fill the tendons' spans from the cosines and sines in ``work``, and lengths (2,), m."""
    cosine, sine, spans = work.cosine, work.sine, work.spans
    bodies, guides = system.bodies, system.guides
    segments = guides.shape[0]
    per_segment = cosine.shape[0] // segments
    for s in range(segments):
        first = s * per_segment
        disc = first + per_segment - 1
        lower_cos = cosine[first - 1] if s > 0 else 1.0
        lower_sin = sine[first - 1] if s > 0 else 0.0
        x = 0.0
        z = 0.0
        for i in range(first, disc):
            x += bodies[i, 0] * sine[i]
            z += bodies[i, 0] * cosine[i]
        across_x = guides[s, 1] * cosine[disc] - guides[s, 0] * lower_cos
        across_z = guides[s, 0] * lower_sin - guides[s, 1] * sine[disc]
        for t in range(2):
            side = 1.0 - 2.0 * t
            span_x = x + side * across_x
            span_z = z + side * across_z
            length = sqrt(span_x * span_x + span_z * span_z)
            spans[t, s, 0] = length
            spans[t, s, 1] = span_x / length
            spans[t, s, 2] = span_z / length
            lengths[t] = length + (lengths[t] if s > 0 else 0.0)


@borrowing
def add_tendon(t, tension, system, work, used):  # type: ignore[no-untyped-def]
    """
    Add one tendon to the system: its force column, its row, one column and row per curved span.

    The Hessian of a span's length is diagonal plus (d x u)(d x u)'/length.  Returns the number of
    columns used after it.
    """
    bodies, guides, ratios, group = system.bodies, system.guides, system.ratios, system.group
    cosine, sine, spans = work.cosine, work.sine, work.spans
    diagonal, columns, rows = work.diagonal, work.columns, work.rows
    segments = guides.shape[0]
    per_segment = cosine.shape[0] // segments
    side = 1.0 - 2.0 * t
    column = used
    used += 1
    for k in range(diagonal.shape[0]):
        columns[k, column] = 0.0
        rows[column, k] = 0.0
    for s in range(segments):
        first = s * per_segment
        disc = first + per_segment - 1
        lower = group[first - 1] if s > 0 else -1
        if lower == group[disc]:
            continue  # locked: its length is constant
        ux = spans[t, s, 1]
        uz = spans[t, s, 2]
        force = tension * ratios[t, s]
        curved = force != 0.0
        scale = sqrt(abs(force) / spans[t, s, 0])
        sign = 1.0 if force > 0.0 else -1.0
        if curved:
            for k in range(diagonal.shape[0]):
                columns[k, used] = 0.0
                rows[used, k] = 0.0
        for i in range(first - 1 if lower >= 0 else first, disc + 1):
            k = group[i]
            if i == first - 1:  # the lower guide moves with the disc below
                dx = side * guides[s, 0] * sine[i]
                dz = side * guides[s, 0] * cosine[i]
                bend = side * guides[s, 0] * (ux * cosine[i] - uz * sine[i])
            elif i == disc:
                dx = -side * guides[s, 1] * sine[i]
                dz = -side * guides[s, 1] * cosine[i]
                bend = -side * guides[s, 1] * (ux * cosine[i] - uz * sine[i])
            else:
                dx = bodies[i, 0] * cosine[i]
                dz = -bodies[i, 0] * sine[i]
                bend = -bodies[i, 0] * (ux * sine[i] + uz * cosine[i])
            along = ux * dx + uz * dz
            columns[k, column] += ratios[t, s] * along
            rows[column, k] += along
            if curved:
                across = scale * (ux * dz - uz * dx)
                columns[k, used] += sign * across
                rows[used, k] += across
                diagonal[k] += force * bend
        if curved:
            used += 1
    return used


@borrowing
def add_springs_and_loads(theta, system, work, secant):  # type: ignore[no-untyped-def]
    """Add springs and loads to the moment balance of every group and to its tridiagonal part."""
    bodies, joints, tables = system.bodies, system.joints, system.tables
    cosine, sine, group = work.cosine, work.sine, system.group
    gradient, diagonal, off = work.gradient, work.diagonal, work.off
    for i in range(theta.shape[0]):
        k = group[i]
        j = group[i - 1] if i > 0 else -1
        if k != j:
            q = theta[i] - (theta[i - 1] if i > 0 else 0.0)
            moment, tangent = law(q, joints[i, 0], joints[i, 1], joints[i, 6], tables)
            if joints[i, 2] > 0.0:
                jam, jam_tangent = jam_law(q, joints[i], tables, secant)
                moment += jam
                tangent += jam_tangent
            gradient[k] += moment
            diagonal[k] += tangent
            if j >= 0:
                gradient[j] -= moment
                diagonal[j] += tangent
                off[j] = -tangent
        if k >= 0:
            gradient[k] += bodies[i, 1] * cosine[i] - bodies[i, 2] * sine[i]
            diagonal[k] -= bodies[i, 1] * sine[i] + bodies[i, 2] * cosine[i]


@compiled
def _springs_and_loads(theta, system, groups):  # type: ignore[no-untyped-def]
    """Return a Work that holds the springs, the loads and the geometry of the tendons."""
    work = work_arrays(theta.shape[0], system.guides.shape[0], groups)
    turn(theta, work.cosine, work.sine)
    tendon_geometry(system, work, np.empty(2))
    add_springs_and_loads(theta, system, work, False)
    return work


@compiled
def moment_balance(theta, tension, system, groups):  # type: ignore[no-untyped-def]
    """
    Return the unbalanced moment of every rigid group (groups,), N m, at given tensions.

    system: the values of a System, as a plain tuple.
    """
    system = System(*system)
    work = _springs_and_loads(theta, system, groups)
    for t in range(2):
        if tension[t] != 0.0:
            add_tendon(t, tension[t], system, work, 0)
            for k in range(groups):
                work.gradient[k] += tension[t] * work.columns[k, 0]
    return work.gradient


@compiled
def dense_system(theta, tension, system, groups):  # type: ignore[no-untyped-def]
    """
    Return the Hessian (groups, groups) N m/rad at given tensions, and the tendons' columns.

    columns, rows: (groups, 2) m, moment per tension, and change of a tendon's length per angle;
    they differ by friction only.  system: the values of a System, as a plain tuple.
    """
    system = System(*system)
    work = _springs_and_loads(theta, system, groups)
    columns = np.empty((groups, 2))
    rows = np.empty((groups, 2))
    hessian = np.zeros((groups, groups))
    for t in range(2):
        used = add_tendon(t, tension[t], system, work, 0)
        for k in range(groups):
            columns[k, t] = work.columns[k, 0]
            rows[k, t] = work.rows[0, k]
        for c in range(1, used):
            for k in range(groups):
                for m in range(groups):
                    hessian[k, m] += work.columns[k, c] * work.rows[c, m]
    for k in range(groups):
        hessian[k, k] += work.diagonal[k]
        if k + 1 < groups:
            hessian[k, k + 1] += work.off[k]
            hessian[k + 1, k] += work.off[k]
    return hessian, columns, rows
