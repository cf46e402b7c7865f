# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The active set of a Newton step: which tendons are taut, and whether that makes a minimum.

A tendon pulls or is slack (tension >= 0, length <= target, one of them with equality), so each
step solves for the taut tendons only, and changes the set until tensions and lengths agree with
it.
"""

import numpy as np

from soft_continuum.mechanics._compile import compiled, inlined
from soft_continuum.mechanics._linear_algebra import (
    negative_eigenvalues,
    NO_TENSION,
    small_solve,
)
from soft_continuum.mechanics.plane._arrays import LENGTH, TENSION

TAUT_TOLERANCE = 1e-9  # m of slack below which a tendon is just taut
LENGTH_TOLERANCE = 1e-13  # m by which a slack tendon may be too long after a step
MAX_CHANGES = 5  # of the active set in one step


@inlined
def active_set_step(tension, drive, work, used):  # type: ignore[no-untyped-def]
    """
    Solve the small system for the span auxiliaries and the changes of tension (work.change).

    A tendon that would push becomes slack and one that would be too long becomes taut
    (work.taut).  Returns whether the system could be solved.
    """
    products, column, taut, gap = work.products, work.column, work.taut, work.gap
    mode, compliance, change = drive.mode, drive.compliance, work.change
    size = used - 1
    matrix = work.matrix
    dropped = False
    for _ in range(MAX_CHANGES):
        for r in range(size):
            for c in range(size):
                matrix[r, c] = products[r + 1, c + 1]
            change[r] = products[r + 1, 0]
            matrix[r, r] += 1.0
        for t in range(2):
            r = column[t] - 1
            if r < 0:
                continue
            if taut[t]:
                matrix[r, r] += (compliance[t] if mode[t] == LENGTH else 0.0) - 1.0
                change[r] += gap[t]
            else:
                for c in range(size):
                    matrix[r, c] = 0.0
                matrix[r, r] = 1.0
                change[r] = 0.0 if mode[t] == TENSION else -tension[t]
        if not small_solve(matrix, change, size):
            # Two just-taut tendons impose the same: the one that carries less becomes slack, or
            # that with less to pull in.  If both are needed, only buckling gives them way.
            less = tension[0] - tension[1]
            if less == 0.0:
                less = gap[0] - gap[1]
            t = 0 if less < 0.0 else 1
            if dropped or not (
                    taut[0] and taut[1] and mode[t] == LENGTH and gap[t] <= TAUT_TOLERANCE):
                return False
            taut[t] = False
            dropped = True
            continue
        changed = False
        for t in range(2):
            r = column[t] - 1
            if r < 0 or mode[t] != LENGTH:
                continue
            if taut[t]:
                if tension[t] + change[r] < 0.0:
                    taut[t] = False
                    changed = True
            else:
                excess = gap[t] + products[r + 1, 0] - compliance[t] * change[r]
                for c in range(size):
                    excess -= products[r + 1, c + 1] * change[c]
                if excess > LENGTH_TOLERANCE:
                    taut[t] = True
                    changed = True
        if not changed:
            break
    return True


@inlined
def held_tendons(tension, drive, work):  # type: ignore[no-untyped-def]
    """
    Choose the tendons whose lengths count as fixed when stability is judged (work.held).

    One tendon that is just taut leaves the arm free to move to its slack side.  Of two that carry
    nothing, each blocks the side that the other leaves free, and their rows are the same.
    """
    column, mode, gap, change = work.column, drive.mode, work.gap, work.change
    taut, held = work.taut, work.held
    pair = ((column[0] > 0) & (column[1] > 0) & (mode[0] == LENGTH) & (mode[1] == LENGTH)
            & (min(gap[0], gap[1]) > -TAUT_TOLERANCE))
    for t in range(2):
        pulls = tension[t] + change[column[t] - 1] > NO_TENSION
        held[t] = taut[t] & ((mode[t] != LENGTH) | pulls)
    held[0] |= pair & (not held[1])


@compiled
def negative_curvature(drive, work, used, negative_pivots):  # type: ignore[no-untyped-def]
    """
    Count the directions of negative curvature that the held tendons leave free.

    By Haynsworth's inertia additivity: the state is a minimum exactly when the small matrix has
    as many negative eigenvalues as the tridiagonal part has negative pivots.
    """
    products, column, held = work.products, work.column, work.held
    index = np.empty(used, dtype=np.int64)
    size = 0
    for c in range(1, used):
        if (c != column[0] or held[0]) and (c != column[1] or held[1]):
            index[size] = c
            size += 1
    if size == 0:
        return negative_pivots
    matrix = np.empty((size, size))
    for r in range(size):
        for c in range(size):
            matrix[r, c] = 0.5 * (products[index[r], index[c]] + products[index[c], index[r]])
        if index[r] == column[0]:
            matrix[r, r] += drive.compliance[0]
        elif index[r] == column[1]:
            matrix[r, r] += drive.compliance[1]
        else:
            matrix[r, r] += 1.0
    return abs(negative_pivots - negative_eigenvalues(matrix, size))
