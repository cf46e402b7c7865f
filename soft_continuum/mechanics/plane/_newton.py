# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Newton's method for the statics of a planar chain, in time linear in the number of joints.

Unknowns are the absolute angles of the chain's rigid groups and the tendon tensions, which are the
Lagrange multipliers of the tendon lengths.  Each iteration assembles the linear system at the
present state, accepts the state if it is an equilibrium, and takes a step otherwise: one
tridiagonal factorisation, a few solves with it and one small dense system.

A tendon pulls or is slack (tension >= 0, length <= target, one of them with equality), so each
step solves for the taut tendons only, the active set, and changes the set until tensions and
lengths agree with it.

The functions are plain scalar Python over arrays, which ``_kernel`` has compiled.
"""

from typing import NamedTuple

import numpy as np

from soft_continuum.mechanics._compile import compiled, inlined
from soft_continuum.mechanics._linear_algebra import (
    negative_eigenvalues,
    NO_TENSION,
    small_solve,
    tridiagonal_solve,
)
from soft_continuum.mechanics.plane._assembly import (
    add_springs_and_loads,
    add_tendon,
    ANGLE,
    LENGTH,
    State,
    System,
    tendon_geometry,
    TendonDrive,
    TENSION,
    turn,
    work_arrays,
)

TAUT_TOLERANCE = 1e-9  # m of slack below which a tendon is just taut
LENGTH_TOLERANCE = 1e-13  # m by which a slack tendon may be too long after a step
MAX_CHANGES = 5  # of the active set in one step

# How a solve ended.
CONVERGED = 0
UNSTABLE = 1  # an equilibrium, but not a minimum of the energy
FAILED = 2
UNSETTLED = 3  # not an equilibrium yet

STEP_LIMIT = 0.7  # rad, the largest change of an angle in one iteration
MAX_ITERATIONS = 60
SETTLED_ANGLE = 1e-4  # rad, the largest change in the step before a state is accepted
SETTLED_TENSION = 1e-3  # the same of the tension, over 1 N plus the tension
STAGNATED = 1e-9  # rad: a step this small is limited by rounding


class Change(NamedTuple):
    """
    What a Newton step changed.

    angle: rad, the largest.  tension: the largest, over 1 N plus the tension.  negatives: number
    of directions of negative curvature before the step.
    """

    angle: float
    tension: float
    negatives: int


@inlined
def assemble(state, system, drive, bias, damping, iteration, work):  # type: ignore[no-untyped-def]
    """
    Fill ``work`` with the linear system at ``state``; return the number of columns used.

    Newton's steps may go back and forth about a jam that yields; those with its secant, a majorant
    of the energy, do not, and are taken in some iterations.
    """
    gradient, diagonal, moved = work.gradient, work.diagonal, work.moved
    for k in range(gradient.shape[0]):
        gradient[k] = bias[k] + damping * moved[k]
        diagonal[k] = damping
    turn(state.theta, work.cosine, work.sine)
    tendon_geometry(system, work, state.lengths)
    add_springs_and_loads(state.theta, system, work, iteration % 16 >= 8)
    used = 1
    for t in range(2):
        work.column[t] = 0
        if drive.mode[t] != LENGTH or drive.target[t] < np.inf:
            if drive.mode[t] == TENSION:
                state.tension[t] = drive.target[t]
            work.column[t] = used
            used = add_tendon(t, state.tension[t], system, work, used)
        else:
            state.tension[t] = 0.0
    return used


@inlined
def gaps(state, system, drive, work):  # type: ignore[no-untyped-def]
    """
    Fill the gaps of the tendons and the active set; where an angle drives a tendon, its row.

    Returns the largest gap of a taut tendon, m or rad.
    """
    theta, tension, lengths = state.theta, state.tension, state.lengths
    mode, target, compliance = drive.mode, drive.target, drive.compliance
    gap, taut, column, rows, group = work.gap, work.taut, work.column, work.rows, system.group
    per_segment = theta.shape[0] // system.guides.shape[0]
    error = 0.0
    for t in range(2):
        taut[t] = False
        row = column[t]
        if row > 0 and mode[t] == LENGTH:
            gap[t] = lengths[t] - compliance[t] * tension[t] - target[t]
            taut[t] = tension[t] > 0.0 or gap[t] > 0.0
        elif mode[t] == ANGLE:
            taut[t] = True
            disc = (drive.segment[t] + 1) * per_segment - 1
            gap[t] = theta[disc] - target[t]
            for k in range(rows.shape[1]):
                rows[row, k] = 0.0
            rows[row, group[disc]] = 1.0
            if disc >= per_segment:
                gap[t] -= theta[disc - per_segment]
                if group[disc - per_segment] >= 0:
                    rows[row, group[disc - per_segment]] = -1.0
        if taut[t]:
            error = max(error, abs(gap[t]))
    return error


@inlined
def unbalanced(tension, work):  # type: ignore[no-untyped-def]
    """Add the tendons to the gradient; return its largest moment, N m, or inf for nan and inf."""
    gradient, columns, column = work.gradient, work.columns, work.column
    residual = 0.0
    total = 0.0  # becomes nan when any is, which max ignores
    for t in range(2):
        if column[t] > 0:
            for k in range(gradient.shape[0]):
                gradient[k] += tension[t] * columns[k, column[t]]
    for k in range(gradient.shape[0]):
        residual = max(residual, abs(gradient[k]))
        total += gradient[k]
    return residual if residual < 1e30 and abs(total) < 1e30 else np.inf


@compiled
def accept(residual, best, error, last, tolerance):  # type: ignore[no-untyped-def]
    """
    Return CONVERGED or UNSTABLE when the assembled state is an equilibrium, else UNSETTLED.

    best: N m, the smallest residual so far: where rounding keeps the residual up, it is accepted
    below tolerance[1] once it stagnates.  last: Change of the last step, with which stability was
    judged: it must have changed little since.
    """
    balanced = residual <= tolerance[0] or (
        residual <= tolerance[1] and last.angle < STAGNATED and residual >= 0.5 * best)
    if not (balanced and error <= tolerance[2] and last.angle < SETTLED_ANGLE
            and last.tension < SETTLED_TENSION):
        return UNSETTLED
    return CONVERGED if last.negatives == 0 else UNSTABLE


@inlined
def solve_system(tension, drive, work, used):  # type: ignore[no-untyped-def]
    """Solve the assembled system; return (whether it could be solved, its negative pivots)."""
    gradient, columns, rows, products = work.gradient, work.columns, work.rows, work.products
    groups = gradient.shape[0]
    for k in range(groups):
        columns[k, 0] = -gradient[k]
    negative_pivots = tridiagonal_solve(work.diagonal, work.off, columns, used)
    for r in range(1, used):
        for c in range(used):
            products[r, c] = 0.0
        for k in range(groups):
            value = rows[r, k]
            if value != 0.0:
                for c in range(used):
                    products[r, c] += value * columns[k, c]
    solved = used == 1 or active_set_step(tension, drive, work, used)
    return solved, negative_pivots


@inlined
def move(state, system, drive, work, used):  # type: ignore[no-untyped-def]
    """Move ``state`` by the solved step; return the largest changes of angle and tension."""
    theta, tension, group, mode = state.theta, state.tension, system.group, drive.mode
    columns, moved, change = work.columns, work.moved, work.change
    column, taut = work.column, work.taut
    groups = moved.shape[0]
    for c in range(1, used):
        for k in range(groups):
            columns[k, 0] -= columns[k, c] * change[c - 1]
    largest = 0.0
    for k in range(groups):
        largest = max(largest, abs(columns[k, 0]))
    fraction = 1.0 if largest <= STEP_LIMIT else STEP_LIMIT / largest
    for i in range(theta.shape[0]):
        if group[i] >= 0:
            theta[i] += fraction * columns[group[i], 0]
    for k in range(groups):
        moved[k] += fraction * columns[k, 0]
    pulled = 0.0
    for t in range(2):
        if column[t] > 0:
            pull = change[column[t] - 1]
            pulled = max(pulled, abs(pull) / (1.0 + abs(tension[t])))
            tension[t] += fraction * pull
            if mode[t] == LENGTH and not taut[t] and fraction == 1.0:
                tension[t] = 0.0
    return largest, pulled


@compiled
def largest_turning(moved, group, segments):  # type: ignore[no-untyped-def]
    """Return the largest sum over the joints of a segment of how far they turned, rad."""
    per_segment = group.shape[0] // segments
    largest = 0.0
    below = 0.0
    for s in range(segments):
        total = 0.0
        for i in range(s * per_segment, (s + 1) * per_segment):
            k = group[i]
            turned = moved[k] if k >= 0 else 0.0
            total += abs(turned - below)
            below = turned
        largest = max(largest, total)
    return largest


@compiled
def newton(state, system, drive, bias, damping, tolerance):  # type: ignore[no-untyped-def]
    """
    Find the equilibrium near ``state``, which is changed in place, by full Newton steps.

    Returns (status, iterations, residual in N m, largest sum over the joints of one segment of
    how far they turned, rad).

    state, system, drive: the values of a State, a System and a TendonDrive, as plain tuples, which
    numba takes faster.  bias: (groups,) N m, dead moments.  damping: N m/rad towards the first
    state.  tolerance: (3,), residual N m; the same where rounding keeps it from falling further,
    N m; tendon length m.
    """
    state, system, drive = State(*state), System(*system), TendonDrive(*drive)
    segments = system.guides.shape[0]
    work = work_arrays(state.theta.shape[0], segments, bias.shape[0])
    last = Change(1.0, 1.0, 0)
    residual = 0.0
    best = 1e300
    for iteration in range(MAX_ITERATIONS):
        used = assemble(state, system, drive, bias, damping, iteration, work)
        error = gaps(state, system, drive, work)
        residual = unbalanced(state.tension, work)
        if residual == np.inf:
            return FAILED, iteration, residual, 0.0
        status = accept(residual, best, error, last, tolerance)
        if status != UNSETTLED:
            return (status, iteration, residual,
                    largest_turning(work.moved, system.group, segments))
        best = min(best, residual)
        solved, negatives = solve_system(state.tension, drive, work, used)
        if not solved:
            return FAILED, iteration, residual, 0.0
        held_tendons(state.tension, drive, work)
        angle, pull = move(state, system, drive, work, used)
        # A given angle says nothing about stability; that of a step that is large is not asked.
        if drive.mode[0] == ANGLE or drive.mode[1] == ANGLE:
            negatives = 0
        elif negatives > 0 and angle < SETTLED_ANGLE:
            negatives = negative_curvature(drive, work, used, negatives)
        last = Change(angle, pull, negatives)
    return FAILED, MAX_ITERATIONS, residual, 0.0


@compiled
def equilibrium(  # type: ignore[no-untyped-def]
        start, system, drive, straight, hold, tolerance, found):
    """
    Find the equilibrium that is one full step away from joint angles, and write it.

    start: joint angles (bodies,), rad, and tensions (2,), N, nan for none.  straight: (groups, m):
    number of rigid groups, and length of a tendon through the segments of the straight arm.
    hold: whether the tendons then hold the arm at the lengths that were found, those that carry
    nothing being slack, so that it is judged whether that is stable.  found: room for joint
    angles (bodies,), tensions, pulls and slack (2,), as in Equilibrium; on the way they are the
    absolute angles, tensions, lengths and targets.
    Returns what ``newton`` does.
    """
    angles, tensions = start
    groups, length = straight
    mode, target, compliance, segment = drive
    theta, tension, lengths, slack = found
    total = 0.0
    for i in range(len(angles)):
        total += angles[i]
        theta[i] = total
    for t in range(2):
        tension[t] = tensions[t] if tensions[t] == tensions[t] else 0.0  # unless nan
        slack[t] = target[t]
    state, bias = (theta, tension, lengths), np.zeros(groups)
    status, iterations, residual, turned = newton(
        state, system, drive, bias, 0.0, tolerance)
    if hold and status == CONVERGED and min(tension[0], tension[1]) >= -NO_TENSION:
        first, other, carry = mode[0], mode[1], max(tension[0], tension[1]) > NO_TENSION
        for t in range(2):
            mode[t] = LENGTH
            slack[t] = lengths[t] - compliance[t] * tension[t]
            if carry and not tension[t] > NO_TENSION:
                slack[t] = np.inf
        status, iterations, residual, _ = newton(
            state, system, (mode, slack, compliance, segment), bias, 0.0, tolerance)
        mode[0], mode[1] = first, other
    for t in range(2):
        loose = tension[t] <= 0.0 and (hold or mode[t] == LENGTH)
        slack[t] = max(slack[t] - lengths[t], 0.0) if loose else 0.0
        lengths[t] = length - lengths[t]
    group = system[5]
    for i in range(len(angles) - 1, -1, -1):
        below = theta[i - 1] if i > 0 else 0.0
        before = group[i - 1] if i > 0 else -1
        # Locked joints keep theirs to the last bit.
        theta[i] = theta[i] - below if group[i] != before else angles[i]
    return status, iterations, residual, turned


@compiled
def newton_batch(  # type: ignore[no-untyped-def]
        states, systems, groups, drives, tolerance, status, residual, turned, rows, first, last):
    """
    Find the equilibria of rows[first:last], as ``newton`` in LENGTH mode without friction.

    The first axis of the arrays of ``states``, target, status, residual and turned is the problem;
    that of the arrays of ``systems`` (but tables), groups, compliance and tolerance the same, or
    of length one when shared.
    """
    theta, tension, lengths = states
    bodies, joints, tables, guides, ratios, group = systems
    mode, target, compliance, segment = drives
    for i in rows[first:last]:
        g = i % groups.shape[0]
        status[i], _, residual[i], turned[i] = newton(
            (theta[i], tension[i], lengths[i]),
            (bodies[i % bodies.shape[0]], joints[i % joints.shape[0]], tables,
                   guides[i % guides.shape[0]], ratios, group[g]),
            (mode, target[i], compliance[i % compliance.shape[0]], segment),
            np.zeros(groups[g]), 0.0, tolerance[i % tolerance.shape[0]])


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
