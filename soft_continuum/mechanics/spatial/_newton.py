# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Newton's method for the equilibrium of a spatial chain, compiled, in O(links) a step.

The unknowns are the orientations of the links and the tensions.  With orientations the springs
couple neighbours only, dead loads act on each link alone, and a span of a tendon couples all links
between its guides through one vector.  So the matrix is block tridiagonal, plus two directions
for each longer span (those across it) and one row for each tendon: it is solved by eliminating the
links, and then a small dense system (Golub and Van Loan, Matrix Computations, 2.1.4 and 4.5).

An increment of an orientation R is a rotation vector in its own frame: R exp(d).

system: as of _assembly.
drive: (kind, target, compliance, bias, damping)
    kind (tendons,): LENGTH or TENSION.  target: m or N.  compliance: m/N.  bias (links, 3): what
    is left unbalanced, N m.  damping: N m of every link, which shortens steps.
"""

import numpy as np

from soft_continuum.mechanics._compile import compiled
from soft_continuum.mechanics._linear_algebra import negative_eigenvalues, small_solve
from soft_continuum.mechanics.spatial._assembly import (
    across_spans,
    dead_loads,
    span_lengths,
    springs,
    tendons,
)
from soft_continuum.mechanics.spatial._laws import creep, STIFFNESS
from soft_continuum.mechanics.spatial._rotations import multiply, rotate

LENGTH, TENSION = 0, 1
CONVERGED, DIVERGED, SINGULAR, CYCLED, UNSTABLE = 0, 1, 2, 3, 4
MAX_STEP = 0.3  # rad of a link in one step
MAX_SETS = 30  # of taut tendons that are tried
LENGTH_TOLERANCE = 1e-11  # m
SET_TOLERANCE = 1e-4  # rad: near enough to see which tendons carry
STEP_TOLERANCE = 1e-9  # rad: the next step would be far below rounding
TENSION_TOLERANCE = 1e-9  # N
NEUTRAL = 1e-7
"""Of the stiffness of a joint, against its turning: a round column may buckle to any side."""


@compiled
def eliminate(diagonal, lower, columns, used):  # type: ignore[no-untyped-def]
    """
    Solve a block tridiagonal system with blocks (3, 3) for all columns at once, in place.

    The upper blocks are the transposes of the lower ones.  ``diagonal`` is spoilt.  Returns the
    number of negative eigenvalues.
    """
    links = len(diagonal)
    negatives = 0
    inverse, factor, product = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for k in range(links):
        if k > 0:
            multiply(lower[k], diagonal[k - 1], factor)  # the inverse stands there by now
            for i in range(3):
                for j in range(3):
                    product[i, j] = (factor[i, 0] * lower[k, j, 0] + factor[i, 1] * lower[k, j, 1]
                                     + factor[i, 2] * lower[k, j, 2])
                    diagonal[k, i, j] -= product[i, j]
            for c in range(used):
                a, b, d = columns[3 * k - 3, c], columns[3 * k - 2, c], columns[3 * k - 1, c]
                for i in range(3):
                    columns[3 * k + i, c] -= factor[i, 0] * a + factor[i, 1] * b + factor[i, 2] * d
        m = diagonal[k]
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            for j in range(3):
                r, s = (j + 1) % 3, (j + 2) % 3
                inverse[j, i] = m[p, r] * m[q, s] - m[p, s] * m[q, r]
        determinant = m[0, 0] * inverse[0, 0] + m[0, 1] * inverse[1, 0] + m[0, 2] * inverse[2, 0]
        if determinant == 0.0:
            determinant = 1e-300
        minor = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
        for sign in (m[0, 0], m[0, 0] * minor, minor * determinant):
            negatives += 1 if sign < 0.0 else 0
        for i in range(3):
            for j in range(3):
                m[i, j] = inverse[i, j] / determinant
    for k in range(links - 1, -1, -1):
        for c in range(used):
            a, b, d = columns[3 * k, c], columns[3 * k + 1, c], columns[3 * k + 2, c]
            if k < links - 1:
                for j in range(3):
                    value = columns[3 * k + 3 + j, c]
                    a -= lower[k + 1, j, 0] * value
                    b -= lower[k + 1, j, 1] * value
                    d -= lower[k + 1, j, 2] * value
            m = diagonal[k]
            for i in range(3):
                columns[3 * k + i, c] = m[i, 0] * a + m[i, 1] * b + m[i, 2] * d
    return negatives


@compiled
def newton(rotations, tension, taut, system, drive, most):  # type: ignore[no-untyped-def]
    """
    Find the equilibrium near rotations (links, 3, 3).

    Returns status, iterations, residual in N m, and whether the energy with the damping had a
    minimum, under the lengths of the taut tendons, in the last step.  Also tension (tendons,) and
    taut (tendons,) are changed in place: tendons become slack that would push, and taut that would
    be too short; what joints hold beyond their yield moment is let go.  most: iterations.
    """
    kind, target, compliance, bias, damping = drive
    links, count, spans = len(rotations), len(tension), system[6]
    size = count + 2 * len(spans)
    raw, columns = np.empty((3 * links, size + 1)), np.empty((3 * links, size + 1))
    slopes, gradient = np.empty((3 * links, count)), np.empty((links, 3))
    forces = np.empty((3 * links, count))
    diagonal, lower = np.empty((links, 3, 3)), np.empty((links, 3, 3))
    units, lengths, paths = np.empty((len(spans), 3)), np.empty(len(spans)), np.empty(count)
    small, whole, right = np.empty((size, size)), np.empty((size, size)), np.empty(size)
    of_column, of_span = np.empty(size, np.int64), np.empty(size, np.int64)
    step = np.empty(3)
    sets, used, negatives = 0, 0, 0
    residual = 0.0
    for t in range(count):
        if kind[t] == TENSION:
            tension[t] = target[t]
        elif not taut[t]:
            tension[t] = 0.0
    for iteration in range(most):
        for k in range(links):
            for i in range(3):
                gradient[k, i] = -bias[k, i]
                for j in range(3):
                    diagonal[k, i, j] = 0.0
                    lower[k, i, j] = 0.0
                diagonal[k, i, i] = damping + NEUTRAL * system[0][k, STIFFNESS].min()
        # Newton's steps may go back and forth about a joint that yields; those by secants do not.
        by_secant = iteration % 16 >= 8
        springs(rotations, system, by_secant, gradient, diagonal, lower)
        dead_loads(rotations, system, gradient, diagonal)
        span_lengths(rotations, system, units, lengths, paths)
        tendons(rotations, system, tension, units, gradient, diagonal, forces, slopes)
        residual = 0.0
        used = 0
        raw[:] = 0.0
        for t in range(count):
            if kind[t] == LENGTH and taut[t]:
                of_column[used], of_span[used] = t, -1
                for row in range(3 * links):
                    raw[row, used] = forces[row, t]
                used += 1
        active = used
        used = across_spans(rotations, system, tension, units, lengths, raw, used, of_span,
                            diagonal, lower)
        for k in range(links):
            for i in range(3):
                raw[3 * k + i, used] = -gradient[k, i]
                residual = max(residual, abs(gradient[k, i]))
        for row in range(3 * links):
            for c in range(used + 1):
                columns[row, c] = raw[row, c]
        negatives = eliminate(diagonal, lower, columns, used + 1)
        worst = 0.0
        for a in range(used):
            begin, end = 0, 3 * links
            if a < active:
                for row in range(3 * links):
                    raw[row, a] = slopes[row, of_column[a]]
            else:  # a span moves with its own links only
                begin = 3 * system[4][spans[of_span[a], 1]]
                end = 3 * system[4][spans[of_span[a], 2] - 1] + 3
            for c in range(used + 1):
                total = 0.0
                for row in range(begin, end):
                    total += raw[row, a] * columns[row, c]
                if c < used:
                    small[a, c] = total
                else:
                    right[a] = total
            if a < active:
                t = of_column[a]
                missing = target[t] + compliance[t] * tension[t] - paths[t]
                worst = max(worst, abs(missing))
                small[a, a] += compliance[t]
                right[a] -= missing
            else:
                s = of_span[a]
                small[a, a] += lengths[s] / (tension[spans[s, 0]] * system[9][s])
        for a in range(used):
            for c in range(used):
                whole[a, c] = 0.5 * (small[a, c] + small[c, a])
        if not small_solve(small, right, used):
            return SINGULAR, iteration, residual, False
        largest = 0.0
        for row in range(3 * links):
            total = columns[row, used]
            for a in range(used):
                total -= columns[row, a] * right[a]
            columns[row, used] = total
            largest = max(largest, abs(total))
        if not largest < 1e6:  # nan too
            return DIVERGED, iteration, residual, False
        scale = min(1.0, MAX_STEP / max(largest, 1e-300))
        for k in range(links):
            for i in range(3):
                step[i] = scale * columns[3 * k + i, used]
            rotate(rotations[k], step)
        for a in range(active):
            tension[of_column[a]] += scale * right[a]
        if largest > SET_TOLERANCE or worst > SET_TOLERANCE:
            continue
        # Every taut tendon must pull, and no slack one be too short.
        least, release, most_short, take = -TENSION_TOLERANCE, -1, LENGTH_TOLERANCE, -1
        for t in range(count):
            if kind[t] == TENSION:
                continue
            if taut[t] and tension[t] < least:
                least, release = tension[t], t
            if not taut[t] and paths[t] - target[t] > most_short:
                most_short, take = paths[t] - target[t], t
        if release < 0 and take < 0:
            if largest > STEP_TOLERANCE or worst > LENGTH_TOLERANCE or by_secant:
                continue
            if negatives == negative_eigenvalues(whole[:used, :used]):
                creep(rotations, system)
                return CONVERGED, iteration + 1, residual, True
            # One that is just taut carries nothing, but may be what holds the arm.
            for t in range(count):
                if (kind[t] == LENGTH and not taut[t]
                        and paths[t] - target[t] > -LENGTH_TOLERANCE):
                    take = t
            if take < 0:
                return UNSTABLE, iteration + 1, residual, False
        sets += 1
        if sets > MAX_SETS:
            return CYCLED, iteration + 1, residual, False
        if release >= 0:
            taut[release] = False
            tension[release] = 0.0
        else:
            taut[take] = True
    # A minimum: as many negative directions as the lengths take away.
    return DIVERGED, most, residual, negatives == negative_eigenvalues(whole[:used, :used])
