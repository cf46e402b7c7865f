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

from math import cos, sin

import numpy as np

from soft_continuum.mechanics._assembly import add_tendon, balance, tendon_geometry
from soft_continuum.mechanics._compile import compiled, compiled_parallel, prange

# What sets a tendon's tension.
LENGTH = 0  # the tendon is at most this long: tension >= 0 is found
TENSION = 1  # the tension is given
ANGLE = 2  # the bending angle of one segment is given: the tension, of either sign, is found

# How a solve ended.
CONVERGED = 0
UNSTABLE = 1  # an equilibrium, but not a minimum of the energy
FAILED = 2

JUST_TAUT = 1e-9  # m of slack that counts as none
SHORT = 1e-13  # m by which a tendon may be too long after a step
SLIGHT = 1e-7  # N of tension that counts as none
SINGULAR = 1e-12  # of the largest entry of a column: a pivot that counts as none
STEP_LIMIT = 0.7  # rad, the largest change of an angle in one iteration
MAX_ITERATIONS = 60


@compiled
def small_solve(matrix, rhs, size):  # type: ignore[no-untyped-def]
    """
    Solve a small dense system in place by elimination with partial pivoting.

    Returns False where it is singular but for rounding: two tendons that ask for the same.
    """
    for column in range(size):
        least = 0.0
        for row in range(size):
            least = max(least, SINGULAR * abs(matrix[row, column]))
        pivot = column
        for row in range(column + 1, size):
            if abs(matrix[row, column]) > abs(matrix[pivot, column]):
                pivot = row
        if not abs(matrix[pivot, column]) > least:
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
def negative_eigenvalues(matrix):  # type: ignore[no-untyped-def]
    """Count the negative eigenvalues of a small symmetric matrix; tiny ones count as zero."""
    values = np.linalg.eigvalsh(matrix)
    floor = 1e-12 * np.abs(values).max()
    return (values < -floor).sum()


@compiled
def tridiagonal_solve(diagonal, off, columns, used):  # type: ignore[no-untyped-def]
    """
    Solve for all columns at once, in place; return the number of negative pivots.

    ``diagonal`` is left with the inverse pivots.
    """
    groups = diagonal.shape[0]
    negatives = 0
    inverse = 0.0
    for k in range(groups):
        if k > 0:
            factor = off[k - 1] * inverse
            diagonal[k] -= factor * off[k - 1]
            for c in range(used):
                columns[k, c] -= factor * columns[k - 1, c]
        pivot = diagonal[k] if diagonal[k] != 0.0 else 1e-30
        if pivot < 0.0:
            negatives += 1
        inverse = 1.0 / pivot
        diagonal[k] = inverse
    for c in range(used):
        columns[groups - 1, c] *= inverse
    for k in range(groups - 2, -1, -1):
        for c in range(used):
            columns[k, c] = (columns[k, c] - off[k] * columns[k + 1, c]) * diagonal[k]
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
            # Two just-taut tendons ask for the same: the one that carries less is let go.
            t = 0 if tension[0] < tension[1] else 1
            if not (taut[0] and taut[1] and mode[t] == LENGTH and gap[t] <= JUST_TAUT):
                return False
            taut[t] = False
            continue
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
                if reach > SHORT:
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
    if size == 0:
        return tridiagonal_negatives
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
    return abs(tridiagonal_negatives - negative_eigenvalues(matrix))


@compiled
def most_turned(offset, group, segments):  # type: ignore[no-untyped-def]
    """Return the largest sum over the joints of a segment of how far they turned, rad."""
    per_segment = group.shape[0] // segments
    most = 0.0
    below = 0.0
    for s in range(segments):
        total = 0.0
        for i in range(s * per_segment, (s + 1) * per_segment):
            k = group[i]
            turned = offset[k] if k >= 0 else 0.0
            total += abs(turned - below)
            below = turned
        most = max(most, total)
    return most


@compiled
def newton(theta, tension, bodies, joints, tables, guides, ratios, group, mode, target,  # type: ignore[no-untyped-def]
           compliance, driven, bias, damping, tolerance, lengths):
    """
    Find the equilibrium near ``theta`` by full Newton steps.

    Changes ``theta`` (bodies,) rad and ``tension`` (2,) N in place and fills ``lengths`` (2,) m,
    the paths of the two tendons through the segments.  Returns (status, iterations, residual in
    N m, the most that the joints of one segment turned by in all, rad).

    bodies (n, 3): length m, load coefficients wx, wz N m of the energy wx sin + wz cos; joints
    (n, 7): see balance; guides (segments, 2): offset of the lower and upper guide of each span,
    m; ratios (2, segments): tension of a span over that at the base; group (n,): rigid group of
    each body, -1 for the base; mode, target, compliance (m/N), driven (2,): per tendon, the last
    being the segment whose bending angle drives it in ANGLE mode; bias (groups,): dead moments,
    N m; damping: N m/rad towards the entry state; tolerance (3,): residual, N m; the same where
    rounding keeps it from falling further, N m; tendon length, m.
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
    pulled = 1.0
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
        # Newton's steps may go back and forth about a jam that yields; those with its secant,
        # a majorant of the energy, do not.
        secant = iteration % 16 >= 8
        balance(theta, cosine, sine, bodies, joints, tables, group, gradient, diagonal, off,
                secant)
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
        total = 0.0  # becomes nan when any is, which max passes over
        for k in range(groups):
            residual = max(residual, abs(gradient[k]))
            total += gradient[k]
        if not (residual < 1e30 and abs(total) < 1e30):
            return FAILED, iteration, residual, 0.0
        # Where rounding keeps the residual up, it is accepted below the limit once it stagnates.
        balanced = residual <= tolerance[0] or (
            residual <= tolerance[1] and largest < 1e-9 and residual >= 0.5 * best)
        best = min(best, residual)
        # Stability was judged before the last step, so that step must have changed little.
        if (balanced and error <= tolerance[2] and iteration > 0 and largest < 1e-4
                and pulled < 1e-3):
            return ((CONVERGED if negatives == 0 else UNSTABLE), iteration, residual,
                    most_turned(offset, group, segments))

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
            return FAILED, iteration, residual, 0.0
        # One tendon that is just taut leaves a way out to its slack side; of two, each holds the
        # side that the other leaves, and their rows say the same.
        pair = (column[0] > 0 and column[1] > 0 and mode[0] == LENGTH and mode[1] == LENGTH
                and min(gap[0], gap[1]) > -JUST_TAUT)
        for t in range(2):
            held[t] = (pair and t == 0) or (
                taut[t] and (mode[t] != LENGTH or tension[t] + step[column[t] - 1] > SLIGHT))
        if mode[0] != ANGLE and mode[1] != ANGLE:  # otherwise it says nothing about stability
            negatives = curvature_sign(products, used, column, held, compliance, pivots)

        for c in range(1, used):
            change = step[c - 1]
            for k in range(groups):
                columns[k, 0] -= columns[k, c] * change
        largest = 0.0
        for k in range(groups):
            largest = max(largest, abs(columns[k, 0]))
        fraction = 1.0 if largest <= STEP_LIMIT else STEP_LIMIT / largest
        for i in range(count):
            if group[i] >= 0:
                theta[i] += fraction * columns[group[i], 0]
        for k in range(groups):
            offset[k] += fraction * columns[k, 0]
        pulled = 0.0
        for t in range(2):
            if column[t] > 0:
                change = step[column[t] - 1]
                pulled = max(pulled, abs(change) / (1.0 + abs(tension[t])))
                tension[t] += fraction * change
                if mode[t] == LENGTH and not taut[t] and fraction == 1.0:
                    tension[t] = 0.0
    return FAILED, MAX_ITERATIONS, residual, 0.0


@compiled_parallel
def newton_batch(theta, tension, bodies, joints, tables, guides, group, groups, target,  # type: ignore[no-untyped-def]
                 compliance, tolerance, lengths, status, residual, turned):
    """
    Find many equilibria at once, as ``newton`` in LENGTH mode without friction, on all cores.

    The first axis of theta, tension, target, lengths, status, residual and turned is the problem;
    that of bodies, joints, guides, group, groups, compliance and tolerance the same, or of length
    one when shared.
    """
    for i in prange(theta.shape[0]):
        g = i % groups.shape[0]
        status[i], _, residual[i], turned[i] = newton(
            theta[i], tension[i], bodies[i % bodies.shape[0]], joints[i % joints.shape[0]],
            tables, guides[i % guides.shape[0]], np.ones((2, guides.shape[1])), group[g],
            np.zeros(2, dtype=np.int64), target[i], compliance[i % compliance.shape[0]],
            np.zeros(2, dtype=np.int64), np.zeros(groups[g]), 0.0,
            tolerance[i % tolerance.shape[0]], lengths[i])
