# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Newton's method for the statics of a planar chain, in time linear in the number of joints.

Unknowns are the absolute angles of the chain's rigid groups and the tendon tensions.  In absolute
angles the springs give a tridiagonal Hessian, loads a diagonal one and every tendon span a
diagonal plus a rank-one term, so a step costs one tridiagonal factorisation, a few solves with it
and one small dense system.

The functions are plain scalar Python over arrays.  With numba they are compiled (and cached on
disk); without it the same source runs, slower, with the same result.
"""

from collections.abc import Callable
from math import cos, sin, sqrt
from typing import Any

import numpy as np

try:
    import numba

    COMPILED = True

    def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
        """Compile with numba, cached on disk and free of the interpreter lock."""
        return numba.njit(cache=True, nogil=True, error_model='numpy')(function)  # type: ignore
except ImportError:  # numba is optional: see docs/performance.md
    COMPILED = False

    def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
        """Leave the function as it is: numba is not installed."""
        return function

# What sets a tendon's tension.
LENGTH = 0  # the tendon is at most this long: tension >= 0 is found
TENSION = 1  # the tension is given
ANGLE = 2  # the bending angle of one segment is given: the tension, of either sign, is found

# How a solve ended.
CONVERGED = 0
UNSTABLE = 1  # an equilibrium, but not a minimum of the energy
FAILED = 2

RESIDUAL_TOLERANCE = 1e-11  # N m, on every group's moment balance
LENGTH_TOLERANCE = 1e-13  # m (and rad, in ANGLE mode)
JUST_TAUT = 1e-9  # m of slack that counts as none
STEP_LIMIT = 0.7  # rad, the largest change of an angle in one iteration
MAX_ITERATIONS = 40


@compiled
def joint_law(q, joint, tables):  # type: ignore[no-untyped-def]
    """
    Return moment (N m) and tangent (N m/rad) of one joint at relative angle q (rad).

    ``joint`` = (soft stiffness, soft table, jam stiffness, jam table, held angle, yield moment,
    length): the leaf spring acts about its natural shape, the jam about the held one and at most
    up to its yield moment.  A table index below zero means linear.
    """
    if joint[1] < 0.0:
        moment = joint[0] * q
        tangent = joint[0]
    else:
        moment, tangent = table_law(q, joint[6], tables[int(joint[1])])
        moment *= joint[0]
        tangent *= joint[0]
    if joint[2] > 0.0:
        offset = q - joint[4]
        if joint[3] < 0.0:
            jam = joint[2] * offset
            jam_tangent = joint[2]
        else:
            jam, jam_tangent = table_law(offset, joint[6], tables[int(joint[3])])
            jam *= joint[2]
            jam_tangent *= joint[2]
        if jam > joint[5]:
            jam = joint[5]
            jam_tangent = 0.0
        elif jam < -joint[5]:
            jam = -joint[5]
            jam_tangent = 0.0
        moment += jam
        tangent += jam_tangent
    return moment, tangent


@compiled
def table_law(q, length, table):  # type: ignore[no-untyped-def]
    """Return moment and tangent of an odd piecewise-linear moment-curvature table."""
    curvature = abs(q) / length
    row = 0
    while row < table.shape[1] - 2 and curvature > table[0, row + 1]:
        row += 1
    slope = (table[1, row + 1] - table[1, row]) / (table[0, row + 1] - table[0, row])
    moment = table[1, row] + slope * (curvature - table[0, row])
    return (moment if q >= 0.0 else -moment), slope / length


@compiled
def small_solve(matrix, rhs, size):  # type: ignore[no-untyped-def]
    """Solve a small dense system in place by elimination with partial pivoting."""
    for column in range(size):
        pivot = column
        for row in range(column + 1, size):
            if abs(matrix[row, column]) > abs(matrix[pivot, column]):
                pivot = row
        if matrix[pivot, column] == 0.0:
            return False
        if pivot != column:
            for k in range(size):
                matrix[column, k], matrix[pivot, k] = matrix[pivot, k], matrix[column, k]
            rhs[column], rhs[pivot] = rhs[pivot], rhs[column]
        for row in range(column + 1, size):
            factor = matrix[row, column] / matrix[column, column]
            for k in range(column, size):
                matrix[row, k] -= factor * matrix[column, k]
            rhs[row] -= factor * rhs[column]
    for row in range(size - 1, -1, -1):
        total = rhs[row]
        for k in range(row + 1, size):
            total -= matrix[row, k] * rhs[k]
        rhs[row] = total / matrix[row, row]
    return True


@compiled
def negative_eigenvalues(matrix, size):  # type: ignore[no-untyped-def]
    """Count the negative eigenvalues of a small symmetric matrix (destroyed) by its inertia."""
    negatives = 0
    scale = 0.0
    for step in range(size):
        scale = max(scale, abs(matrix[step, step]))
    for step in range(size):
        pivot = step
        for k in range(step + 1, size):
            if abs(matrix[k, k]) > abs(matrix[pivot, pivot]):
                pivot = k
        if pivot != step:
            for k in range(size):
                matrix[step, k], matrix[pivot, k] = matrix[pivot, k], matrix[step, k]
            for k in range(size):
                matrix[k, step], matrix[k, pivot] = matrix[k, pivot], matrix[k, step]
        if abs(matrix[step, step]) <= 1e-12 * scale:
            break  # what is left repeats other rows: two tendons that hold the same direction
        if matrix[step, step] < 0.0:
            negatives += 1
        for row in range(step + 1, size):
            factor = matrix[row, step] / matrix[step, step]
            for k in range(step + 1, size):
                matrix[row, k] -= factor * matrix[step, k]
    return negatives


@compiled
def tendon_geometry(cosine, sine, bodies, guides, spans, lengths):  # type: ignore[no-untyped-def]
    """Fill spans (2, segments, 3): length and unit direction; and lengths (2,), m."""
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


@compiled
def add_tendon(t, tension, ratios, cosine, sine, bodies, guides, spans, group,  # type: ignore[no-untyped-def]
               diagonal, columns, rows, used):
    """
    Add one tendon to the system: its force column, its row, one column and row per curved span.

    The Hessian of a span's length is diagonal plus (d x u)(d x u)'/length.  Returns the number of
    columns used after it.
    """
    segments = guides.shape[0]
    per_segment = cosine.shape[0] // segments
    side = 1.0 - 2.0 * t
    column = used
    used += 1
    columns[:, column] = 0.0
    rows[column, :] = 0.0
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
            columns[:, used] = 0.0
            rows[used, :] = 0.0
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


@compiled
def balance(theta, cosine, sine, bodies, joints, tables, group, gradient, diagonal, off):  # type: ignore[no-untyped-def]
    """Add springs and loads to the moment balance of every group and to its tridiagonal part."""
    for i in range(theta.shape[0]):
        k = group[i]
        j = group[i - 1] if i > 0 else -1
        if k != j:
            moment, tangent = joint_law(
                theta[i] - (theta[i - 1] if i > 0 else 0.0), joints[i], tables)
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
def tridiagonal_solve(diagonal, off, columns, used):  # type: ignore[no-untyped-def]
    """Solve for all columns at once, in place; return the number of negative pivots."""
    groups = diagonal.shape[0]
    negatives = 0
    for k in range(groups):
        if k > 0:
            factor = off[k - 1] / diagonal[k - 1]
            diagonal[k] -= factor * off[k - 1]
            for c in range(used):
                columns[k, c] -= factor * columns[k - 1, c]
        if diagonal[k] == 0.0:
            diagonal[k] = 1e-30
        if diagonal[k] < 0.0:
            negatives += 1
    for k in range(groups - 1, -1, -1):
        inverse = 1.0 / diagonal[k]
        if k < groups - 1:
            for c in range(used):
                columns[k, c] = (columns[k, c] - off[k] * columns[k + 1, c]) * inverse
        else:
            for c in range(used):
                columns[k, c] *= inverse
    return negatives


@compiled
def tension_step(products, used, column, taut, gap, tension, mode, compliance, step):  # type: ignore[no-untyped-def]
    """
    Solve the small system for the span auxiliaries and the changes of tension.

    A tendon that would push is let go and one that would be too long is taken up (``taut`` is
    changed).  Returns whether the system could be solved.
    """
    size = used - 1
    matrix = np.empty((size, size))
    for _ in range(5):
        for r in range(size):
            for c in range(size):
                matrix[r, c] = products[r + 1, c + 1]
            step[r] = products[r + 1, 0]
            matrix[r, r] += 1.0
        for t in range(2):
            r = column[t] - 1
            if r < 0:
                continue
            if taut[t]:
                matrix[r, r] += compliance[t] - 1.0
                step[r] += gap[t]
            else:
                matrix[r, :] = 0.0
                matrix[r, r] = 1.0
                step[r] = 0.0 if mode[t] == TENSION else -tension[t]
        if not small_solve(matrix, step, size):
            return False
        changed = False
        for t in range(2):
            r = column[t] - 1
            if r < 0 or mode[t] != LENGTH:
                continue
            if taut[t]:
                if tension[t] + step[r] < 0.0:
                    taut[t] = False
                    changed = True
            else:
                reach = gap[t] + products[r + 1, 0] - compliance[t] * step[r]
                for c in range(size):
                    reach -= products[r + 1, c + 1] * step[c]
                if reach > LENGTH_TOLERANCE:
                    taut[t] = True
                    changed = True
        if not changed:
            break
    return True


@compiled
def curvature_sign(products, used, column, held, compliance, tridiagonal_negatives):  # type: ignore[no-untyped-def]
    """
    Count the directions of negative curvature that the tendons which are held leave free.

    By Haynsworth's inertia additivity: the system is a minimum exactly when the small matrix has
    as many negative eigenvalues as the tridiagonal part.
    """
    if tridiagonal_negatives == 0:
        return 0
    index = np.empty(used, dtype=np.int64)
    size = 0
    for c in range(1, used):
        if (c != column[0] or held[0]) and (c != column[1] or held[1]):
            index[size] = c
            size += 1
    matrix = np.empty((size, size))
    for r in range(size):
        for c in range(size):
            matrix[r, c] = 0.5 * (products[index[r], index[c]] + products[index[c], index[r]])
        if index[r] == column[0]:
            matrix[r, r] += compliance[0]
        elif index[r] == column[1]:
            matrix[r, r] += compliance[1]
        else:
            matrix[r, r] += 1.0
    return abs(tridiagonal_negatives - negative_eigenvalues(matrix, size))


@compiled
def moment_balance(theta, tension, bodies, joints, tables, guides, ratios, group, groups):  # type: ignore[no-untyped-def]
    """Return the unbalanced moment of every rigid group (groups,), N m, at given tensions."""
    gradient = np.zeros(groups)
    diagonal = np.zeros(groups)
    off = np.zeros(groups)
    width = 3 + 2 * guides.shape[0]
    columns = np.empty((groups, width))
    rows = np.empty((width, groups))
    spans = np.empty((2, guides.shape[0], 3))
    cosine = np.cos(theta)
    sine = np.sin(theta)
    tendon_geometry(cosine, sine, bodies, guides, spans, np.empty(2))
    balance(theta, cosine, sine, bodies, joints, tables, group, gradient, diagonal, off)
    for t in range(2):
        if tension[t] != 0.0:
            add_tendon(t, tension[t], ratios, cosine, sine, bodies, guides, spans, group,
                       diagonal, columns, rows, 0)
            gradient += tension[t] * columns[:, 0]
    return gradient


@compiled
def newton(theta, tension, bodies, joints, tables, guides, ratios, group, mode, target,  # type: ignore[no-untyped-def]
           compliance, driven, bias, damping, limit, lengths):
    """
    Find the equilibrium near ``theta`` by full Newton steps.

    Changes ``theta`` (bodies,) rad and ``tension`` (2,) N in place and fills ``lengths`` (2,) m,
    the paths of the two tendons through the segments.  Returns (status, iterations, residual in
    N m, directions of negative curvature).

    bodies (n, 3): length m, load coefficients wx, wz N m of the energy wx sin + wz cos; joints
    (n, 7): see joint_law; guides (segments, 2): offset of the lower and upper guide of each span,
    m; ratios (2, segments): tension of a span over that at the base; group (n,): rigid group of
    each body, -1 for the base; mode, target, compliance (m/N), driven (2,): per tendon, the last
    being the segment whose bending angle drives it in ANGLE mode; bias (groups,): dead moments,
    N m; damping: N m/rad towards the entry state; limit: residual at the floor of rounding.
    """
    count = theta.shape[0]
    segments = guides.shape[0]
    per_segment = count // segments
    groups = bias.shape[0]
    width = 3 + 2 * segments
    gradient = np.empty(groups)
    diagonal = np.empty(groups)
    off = np.zeros(groups)
    columns = np.empty((groups, width))
    rows = np.empty((width, groups))
    products = np.empty((width, width))
    cosine = np.empty(count)
    sine = np.empty(count)
    spans = np.empty((2, segments, 3))
    offset = np.zeros(groups)
    step = np.empty(width)
    taut = np.zeros(2, dtype=np.bool_)
    held = np.zeros(2, dtype=np.bool_)
    gap = np.zeros(2)
    column = np.zeros(2, dtype=np.int64)
    largest = 1.0
    negatives = 0
    residual = 0.0
    best = 1e300
    for iteration in range(MAX_ITERATIONS):
        for i in range(count):
            cosine[i] = cos(theta[i])
            sine[i] = sin(theta[i])
        tendon_geometry(cosine, sine, bodies, guides, spans, lengths)
        gradient[:] = bias
        diagonal[:] = damping
        for k in range(groups):
            gradient[k] += damping * offset[k]
        balance(theta, cosine, sine, bodies, joints, tables, group, gradient, diagonal, off)
        used = 1
        error = 0.0
        for t in range(2):
            column[t] = 0
            taut[t] = False
            if mode[t] == LENGTH and target[t] == np.inf:
                tension[t] = 0.0
                continue
            if mode[t] == TENSION:
                tension[t] = target[t]
            column[t] = used
            used = add_tendon(t, tension[t], ratios, cosine, sine, bodies, guides, spans, group,
                              diagonal, columns, rows, used)
            for k in range(groups):
                gradient[k] += tension[t] * columns[k, column[t]]
            if mode[t] == LENGTH:
                gap[t] = lengths[t] - compliance[t] * tension[t] - target[t]
                taut[t] = tension[t] > 0.0 or gap[t] > 0.0
            elif mode[t] == ANGLE:
                disc = (driven[t] + 1) * per_segment - 1
                gap[t] = theta[disc] - target[t]
                rows[column[t], :] = 0.0
                rows[column[t], group[disc]] = 1.0
                if driven[t] > 0:
                    gap[t] -= theta[disc - per_segment]
                    if group[disc - per_segment] >= 0:
                        rows[column[t], group[disc - per_segment]] = -1.0
                taut[t] = True
            if taut[t]:
                error = max(error, abs(gap[t]))
        residual = 0.0
        for k in range(groups):
            residual = max(residual, abs(gradient[k]))
        if not residual < 1e30:
            return FAILED, iteration, residual, negatives
        # Where rounding keeps the residual up, it is accepted below the limit once it stagnates.
        balanced = residual <= RESIDUAL_TOLERANCE or (
            residual <= limit and largest < 1e-9 and residual >= 0.5 * best)
        best = min(best, residual)
        if balanced and error <= LENGTH_TOLERANCE and iteration > 0 and largest < 1e-4:
            return (CONVERGED if negatives == 0 else UNSTABLE), iteration, residual, negatives

        for k in range(groups):
            columns[k, 0] = -gradient[k]
        pivots = tridiagonal_solve(diagonal, off, columns, used)
        for r in range(1, used):
            products[r, :used] = 0.0
            for k in range(groups):
                value = rows[r, k]
                if value != 0.0:
                    for c in range(used):
                        products[r, c] += value * columns[k, c]
        if used > 1 and not tension_step(products, used, column, taut, gap, tension, mode,
                                         compliance, step):
            return FAILED, iteration, residual, negatives
        for t in range(2):  # a tendon that is just taut holds, though it carries nothing yet
            held[t] = taut[t] or (mode[t] == LENGTH and gap[t] > -JUST_TAUT)
        negatives = curvature_sign(products, used, column, held, compliance, pivots)

        largest = 0.0
        for k in range(groups):
            for c in range(1, used):
                columns[k, 0] -= columns[k, c] * step[c - 1]
            largest = max(largest, abs(columns[k, 0]))
        fraction = 1.0 if largest <= STEP_LIMIT else STEP_LIMIT / largest
        for i in range(count):
            if group[i] >= 0:
                theta[i] += fraction * columns[group[i], 0]
        for k in range(groups):
            offset[k] += fraction * columns[k, 0]
        for t in range(2):
            if column[t] > 0:
                tension[t] += fraction * step[column[t] - 1]
                if mode[t] == LENGTH and not taut[t] and fraction == 1.0:
                    tension[t] = 0.0
    return FAILED, MAX_ITERATIONS, residual, negatives
