# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Newton's method for many planar chains side by side, one in each lane of the vectors.

The same steps as in _newton.py, for linear joints without jams and tendons of given length without
friction.  The last axis of all arrays is the lane, and innermost loops go over it: the compiler
makes vector instructions of them.  A lane that is done takes the next problem.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics._compile import borrowing, compiled, inlined
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.plane._assembly import Indices, TendonDrive, turn, work_arrays
from soft_continuum.mechanics.plane._newton import (
    accept,
    active_set_step,
    Change,
    FAILED,
    held_tendons,
    largest_turning,
    MAX_ITERATIONS,
    negative_curvature,
    SETTLED_ANGLE,
    STEP_LIMIT,
    UNSETTLED,
)

LANES = 64  # of which each instruction takes as many as it can


class Lanes(NamedTuple):
    """
    The chains in the lanes, and the linear systems of their Newton steps, as in Work and System.

    length, wx, wz, stiffness, theta, cosine, sine: (bodies, lanes).  lower, upper: (segments,
    lanes), guides.  tension, path: (2, lanes), N and m.  spans, x, z: (2, segments, lanes), length
    and direction.  moved, gradient, diagonal, off: (groups, lanes).  rows, columns: (width,
    groups, lanes); low, high: (width,), the groups between which a row is not zero.  products:
    (width, width, lanes), below the diagonal.  gap, taut, held: (2, lanes).  step: (width, lanes),
    as change.  All others are (lanes,).  scale: of a row.  error: m, largest gap of a taut tendon.
    worst, best, total: N m, largest unbalanced moment, the least of these so far, and a sum that
    is nan when any is.  angle, pull, negatives: as in Change.  fraction: of the step that is
    taken.  iteration; problem: -1 for none.
    """

    length: Array
    wx: Array
    wz: Array
    stiffness: Array
    theta: Array
    cosine: Array
    sine: Array
    lower: Array
    upper: Array
    tension: Array
    path: Array
    spans: Array
    x: Array
    z: Array
    moved: Array
    gradient: Array
    diagonal: Array
    off: Array
    rows: Array
    columns: Array
    products: Array
    gap: Array
    step: Array
    scale: Array
    error: Array
    worst: Array
    best: Array
    total: Array
    angle: Array
    pull: Array
    negatives: Array
    fraction: Array
    taut: NDArray[np.bool_]
    held: NDArray[np.bool_]
    low: Indices
    high: Indices
    iteration: Indices
    problem: Indices


@compiled
def lanes_for(bodies, segments, groups, lanes):  # type: ignore[no-untyped-def]
    """Return Lanes for so many chains of so many bodies, segments and rigid groups."""
    width = 3 + 2 * segments
    body, group, one = (
        np.zeros((7, bodies, lanes)), np.zeros((4, groups, lanes)), np.zeros((9, lanes)))
    guide, tendon = np.zeros((2, segments, lanes)), np.zeros((3, 2, lanes))
    span, systems = np.ones((3, 2, segments, lanes)), np.zeros((2, width, groups, lanes))
    flags, ends = np.zeros((2, 2, lanes), dtype=np.bool_), np.zeros((2, width), dtype=np.int64)
    return Lanes(
        body[0], body[1], body[2], body[3], body[4], body[5], body[6], guide[0], guide[1],
        tendon[0], tendon[1], span[0], span[1], span[2], group[0], group[1], group[2], group[3],
        systems[0], systems[1], np.zeros((width, width, lanes)), tendon[2],
        np.zeros((width, lanes)), one[0], one[1], one[2], one[3], one[4], one[5], one[6], one[7],
        one[8], flags[0], flags[1], ends[0], ends[1], np.zeros(lanes, dtype=np.int64),
        np.full(lanes, -1))


@inlined
def clear(row):  # type: ignore[no-untyped-def]
    """Fill a row of lanes with zeros."""
    for lane in range(row.shape[0]):
        row[lane] = 0.0


@inlined
def add(row, sign, one, other):  # type: ignore[no-untyped-def]
    """Add sign * one * other to a row of lanes."""
    for lane in range(row.shape[0]):
        row[lane] += sign * one[lane] * other[lane]


@borrowing
def spans_of(t, lanes):  # type: ignore[no-untyped-def]
    """Fill length and direction of the spans of one tendon, and its length."""
    cosine, sine = lanes.cosine, lanes.sine
    segments = lanes.lower.shape[0]
    per_segment = cosine.shape[0] // segments
    side = 1.0 - 2.0 * t
    path = lanes.path[t]
    clear(path)
    for s in range(segments):
        first = s * per_segment
        disc = first + per_segment - 1
        x, z, length = lanes.x[t, s], lanes.z[t, s], lanes.spans[t, s]
        clear(x)
        clear(z)
        add(x, side, lanes.upper[s], cosine[disc])
        add(z, -side, lanes.upper[s], sine[disc])
        if s > 0:
            add(x, -side, lanes.lower[s], cosine[first - 1])
            add(z, side, lanes.lower[s], sine[first - 1])
        else:
            lower = lanes.lower[0]
            for lane in range(x.shape[0]):
                x[lane] -= side * lower[lane]
        for i in range(first, disc):
            add(x, 1.0, lanes.length[i], sine[i])
            add(z, 1.0, lanes.length[i], cosine[i])
        for lane in range(x.shape[0]):
            length[lane] = sqrt(x[lane] * x[lane] + z[lane] * z[lane])
            x[lane] /= length[lane]
            z[lane] /= length[lane]
            path[lane] += length[lane]


@borrowing
def springs_and_loads(group, lanes):  # type: ignore[no-untyped-def]
    """Fill the moment balance and the tridiagonal part with springs and loads."""
    theta, gradients, diagonals = lanes.theta, lanes.gradient, lanes.diagonal
    for k in range(gradients.shape[0]):
        clear(gradients[k])
        clear(diagonals[k])
    for i in range(theta.shape[0]):
        k = group[i]
        j = group[i - 1] if i > 0 else -1
        if k < 0:
            continue
        gradient, diagonal = gradients[k], diagonals[k]
        stiffness, angle = lanes.stiffness[i], theta[i]
        if k != j:
            if i > 0:
                below = theta[i - 1]
                for lane in range(angle.shape[0]):
                    gradient[lane] += stiffness[lane] * (angle[lane] - below[lane])
                    diagonal[lane] += stiffness[lane]
            else:
                for lane in range(angle.shape[0]):
                    gradient[lane] += stiffness[lane] * angle[lane]
                    diagonal[lane] += stiffness[lane]
            if j >= 0:
                before, stiffer, off = gradients[j], diagonals[j], lanes.off[j]
                below = theta[i - 1]
                for lane in range(angle.shape[0]):
                    before[lane] -= stiffness[lane] * (angle[lane] - below[lane])
                    stiffer[lane] += stiffness[lane]
                    off[lane] = -stiffness[lane]
        wx, wz, cosine, sine = lanes.wx[i], lanes.wz[i], lanes.cosine[i], lanes.sine[i]
        for lane in range(angle.shape[0]):
            gradient[lane] += wx[lane] * cosine[lane] - wz[lane] * sine[lane]
            diagonal[lane] -= wx[lane] * sine[lane] + wz[lane] * cosine[lane]


@borrowing
def add_tendon(t, group, lanes, used):  # type: ignore[no-untyped-def]
    """Add one tendon and its spans to the systems; return the columns used after it."""
    rows, columns = lanes.rows, lanes.columns
    segments, groups = lanes.lower.shape[0], lanes.gradient.shape[0]
    per_segment = lanes.cosine.shape[0] // segments
    side = 1.0 - 2.0 * t
    tendon = used
    used += 1
    force, scale = lanes.tension[t], lanes.scale
    lanes.low[tendon], lanes.high[tendon] = 0, groups
    for k in range(groups):
        clear(rows[tendon, k])
    for s in range(segments):
        first = s * per_segment
        disc = first + per_segment - 1
        low = group[first - 1] if s > 0 else -1
        if low == group[disc]:
            continue  # locked: its length is constant
        x, z, span = lanes.x[t, s], lanes.z[t, s], lanes.spans[t, s]
        below = low >= 0
        low, high = low if below else group[first], group[disc] + 1
        lanes.low[used], lanes.high[used] = low, high
        for k in range(low, high):
            clear(rows[used, k])
        for lane in range(span.shape[0]):
            scale[lane] = sqrt(force[lane] / span[lane])
        for i in range(first - 1 if below else first, disc + 1):
            k = group[i]
            along, across, diagonal = rows[tendon, k], rows[used, k], lanes.diagonal[k]
            cosine, sine = lanes.cosine[i], lanes.sine[i]
            if i == first - 1 or i == disc:
                sign = side if i == first - 1 else -side
                offset = lanes.lower[s] if i == first - 1 else lanes.upper[s]
                for lane in range(span.shape[0]):
                    arm = sign * offset[lane]
                    bend = arm * (x[lane] * cosine[lane] - z[lane] * sine[lane])
                    along[lane] += arm * (x[lane] * sine[lane] + z[lane] * cosine[lane])
                    across[lane] += bend
                    diagonal[lane] += force[lane] * bend
            else:
                length = lanes.length[i]
                for lane in range(span.shape[0]):
                    bend = -length[lane] * (x[lane] * sine[lane] + z[lane] * cosine[lane])
                    along[lane] += length[lane] * (x[lane] * cosine[lane] - z[lane] * sine[lane])
                    across[lane] += bend
                    diagonal[lane] += force[lane] * bend
        for k in range(groups):
            clear(columns[used, k])
        for k in range(low, high):
            across, column = rows[used, k], columns[used, k]
            for lane in range(span.shape[0]):
                across[lane] *= scale[lane]
                column[lane] = across[lane]
        used += 1
    for k in range(groups):
        row, column, gradient = rows[tendon, k], columns[tendon, k], lanes.gradient[k]
        for lane in range(row.shape[0]):
            column[lane] = row[lane]
            gradient[lane] += force[lane] * row[lane]
    return used


@borrowing
def solve_systems(lanes, used):  # type: ignore[no-untyped-def]
    """Solve the tridiagonal parts for all columns, and fill the products with the rows."""
    rows, columns, products = lanes.rows, lanes.columns, lanes.products
    negatives = lanes.negatives
    groups = lanes.gradient.shape[0]
    clear(negatives)
    for k in range(groups):
        diagonal, gradient, right = lanes.diagonal[k], lanes.gradient[k], columns[0, k]
        for lane in range(diagonal.shape[0]):
            right[lane] = -gradient[lane]
        if k > 0:
            factor, off, inverse = lanes.gradient[k - 1], lanes.off[k - 1], lanes.diagonal[k - 1]
            for lane in range(diagonal.shape[0]):
                factor[lane] = off[lane] * inverse[lane]
                diagonal[lane] -= factor[lane] * off[lane]
            for c in range(used):
                if k > lanes.low[c]:
                    add(columns[c, k], -1.0, factor, columns[c, k - 1])
        for lane in range(diagonal.shape[0]):
            negatives[lane] += 1.0 if diagonal[lane] < 0.0 else 0.0
            diagonal[lane] = 1.0 / (diagonal[lane] if diagonal[lane] != 0.0 else 1e-30)
    for k in range(groups - 1, -1, -1):
        inverse, off = lanes.diagonal[k], lanes.off[k]
        for c in range(used):
            column = columns[c, k]
            if k < groups - 1:
                add(column, -1.0, off, columns[c, k + 1])
            for lane in range(column.shape[0]):
                column[lane] *= inverse[lane]
    for r in range(1, used):
        for c in range(r + 1):
            short = r if lanes.high[r] - lanes.low[r] < groups or c == 0 else c
            clear(products[r, c])
            for k in range(lanes.low[short], lanes.high[short]):
                add(products[r, c], 1.0, rows[short, k], columns[r + c - short, k])


@borrowing
def assemble(target, group, column, lanes):  # type: ignore[no-untyped-def]
    """
    Fill the systems; return the number of columns used.

    target: (2,), not finite where a tendon is slack for good.  column: (2,), filled as in Work.
    """
    worst, total = lanes.worst, lanes.total
    springs_and_loads(group, lanes)
    used = 1
    for t in range(2):
        spans_of(t, lanes)
        column[t] = 0
        if target[t] < np.inf:
            column[t] = used
            used = add_tendon(t, group, lanes, used)
        else:
            clear(lanes.tension[t])
    clear(worst)
    clear(total)
    for k in range(lanes.gradient.shape[0]):
        gradient = lanes.gradient[k]
        for lane in range(gradient.shape[0]):
            size = abs(gradient[lane])
            worst[lane] = size if size > worst[lane] else worst[lane]
            total[lane] += size
    return used


@borrowing
def take(lane, problem, theta, tension, bodies, joints, guides, lanes):  # type: ignore[no-untyped-def]
    """Put a problem into a lane."""
    for i in range(theta.shape[0]):
        lanes.theta[i, lane] = theta[i]
        lanes.stiffness[i, lane] = joints[i, 0]
        lanes.length[i, lane] = bodies[i, 0]
        lanes.wx[i, lane] = bodies[i, 1]
        lanes.wz[i, lane] = bodies[i, 2]
    for s in range(guides.shape[0]):
        lanes.lower[s, lane] = guides[s, 0]
        lanes.upper[s, lane] = guides[s, 1]
    for t in range(2):
        lanes.tension[t, lane] = max(tension[t], 0.0)
    for k in range(lanes.moved.shape[0]):
        lanes.moved[k, lane] = 0.0
    lanes.problem[lane], lanes.iteration[lane] = problem, 0
    lanes.angle[lane], lanes.pull[lane], lanes.best[lane] = 1.0, 1.0, 1e300


@borrowing
def put(lane, theta, tension, lengths, lanes):  # type: ignore[no-untyped-def]
    """Take the problem out of a lane."""
    for i in range(theta.shape[0]):
        theta[i] = lanes.theta[i, lane]
    for t in range(2):
        tension[t], lengths[t] = lanes.tension[t, lane], lanes.path[t, lane]
    lanes.problem[lane] = -1


@borrowing
def products_of(lane, used, lanes, work):  # type: ignore[no-untyped-def]
    """Copy the products of one lane."""
    for r in range(1, used):
        for c in range(r + 1):
            work.products[r, c] = work.products[c, r] = lanes.products[r, c, lane]


@borrowing
def find_gaps(lane, drive, lanes, work):  # type: ignore[no-untyped-def]
    """Fill gaps and active set of a lane; return the largest gap of a taut tendon, m."""
    error = 0.0
    for t in range(2):
        tension = lanes.tension[t, lane]
        lanes.taut[t, lane] = False
        if work.column[t] > 0:
            gap = lanes.path[t, lane] - drive.compliance[t] * tension - drive.target[t]
            lanes.gap[t, lane] = gap
            if tension > 0.0 or gap > 0.0:
                lanes.taut[t, lane] = True
                error = max(error, abs(gap))
    return error


@borrowing
def find_step(lane, tension, drive, used, lanes, work):  # type: ignore[no-untyped-def]
    """
    Find the changes of auxiliaries and tensions of a lane; return whether they were found.

    tension: (2,) N, filled.
    """
    column, change = work.column, work.change
    products_of(lane, used, lanes, work)
    for t in range(2):
        tension[t] = lanes.tension[t, lane]
        work.gap[t], work.taut[t] = lanes.gap[t, lane], lanes.taut[t, lane]
    if not active_set_step(tension, drive, work, used):
        return False
    held_tendons(tension, drive, work)
    for c in range(used - 1):
        lanes.step[c, lane] = change[c]
    lanes.pull[lane] = 0.0
    for t in range(2):
        lanes.taut[t, lane], lanes.held[t, lane] = work.taut[t], work.held[t]
        if column[t] > 0:
            pull = abs(change[column[t] - 1]) / (1.0 + abs(tension[t]))
            lanes.pull[lane] = max(lanes.pull[lane], pull)
    return True


@borrowing
def move(group, column, used, lanes):  # type: ignore[no-untyped-def]
    """Move all chains by their steps, of limited size; a fraction of zero keeps one."""
    columns, angle, fraction = lanes.columns, lanes.angle, lanes.fraction
    clear(angle)
    for k in range(lanes.moved.shape[0]):
        change = columns[0, k]
        for c in range(1, used):
            add(change, -1.0, columns[c, k], lanes.step[c - 1])
        for lane in range(change.shape[0]):
            size = abs(change[lane])
            angle[lane] = size if size > angle[lane] else angle[lane]
    for lane in range(angle.shape[0]):
        if angle[lane] > STEP_LIMIT:
            fraction[lane] *= STEP_LIMIT / angle[lane]
    for i in range(lanes.theta.shape[0]):
        if group[i] >= 0:
            add(lanes.theta[i], 1.0, fraction, columns[0, group[i]])
    for k in range(lanes.moved.shape[0]):
        add(lanes.moved[k], 1.0, fraction, columns[0, k])
    for t in range(2):
        if column[t] > 0:
            tension, taut = lanes.tension[t], lanes.taut[t]
            add(tension, 1.0, fraction, lanes.step[column[t] - 1])
            for lane in range(tension.shape[0]):
                if not taut[lane] and fraction[lane] == 1.0:
                    tension[lane] = 0.0


@compiled
def newton_lanes(  # type: ignore[no-untyped-def]
        states, systems, groups, drives, tolerance, status, residual, turned, rows, first, last):
    """
    Find the equilibria of rows[first:last], as ``newton_batch``.

    All have the same rigid groups and tendons that are driven, and linear joints without jams.
    """
    theta, tension, lengths = states
    bodies, joints, tables, guides, ratios, grouping = systems
    mode, target, compliance, segment = drives
    one = rows[first]
    group, size = grouping[one % grouping.shape[0]], groups[one % groups.shape[0]]
    count, segments = theta.shape[1], guides.shape[1]
    lanes = lanes_for(count, segments, size, min(LANES, last - first))
    work, force = work_arrays(count, segments, size), np.zeros(2)
    problem, following, busy = lanes.problem, first, 0
    while True:
        for lane in range(problem.shape[0]):
            if problem[lane] < 0 and following < last:
                i = rows[following]
                take(lane, i, theta[i], tension[i], bodies[i % bodies.shape[0]],
                     joints[i % joints.shape[0]], guides[i % guides.shape[0]], lanes)
                following += 1
                busy += 1
        if busy == 0:
            return
        turn(lanes.theta.reshape(-1), lanes.cosine.reshape(-1), lanes.sine.reshape(-1))
        used = assemble(target[one], group, work.column, lanes)
        for lane in range(problem.shape[0]):
            i = problem[lane]
            if i < 0:
                continue
            drive = TendonDrive(mode, target[i], compliance[i % compliance.shape[0]], segment)
            error, worst = find_gaps(lane, drive, lanes, work), lanes.worst[lane]
            end = FAILED
            finite = worst < 1e30 and lanes.total[lane] < 1e30
            if finite and lanes.iteration[lane] < MAX_ITERATIONS:
                end = accept(
                    worst, lanes.best[lane], error, Change(
                        lanes.angle[lane], lanes.pull[lane], int(lanes.negatives[lane])),
                    tolerance[i % tolerance.shape[0]])
            if end != UNSETTLED:
                for k in range(size):
                    work.moved[k] = lanes.moved[k, lane]
                status[i], residual[i] = end, worst
                turned[i] = largest_turning(work.moved, group, segments)
                put(lane, theta[i], tension[i], lengths[i], lanes)
                busy -= 1
        solve_systems(lanes, used)
        for lane in range(problem.shape[0]):
            i = problem[lane]
            lanes.fraction[lane] = 0.0
            if i < 0:
                continue
            lanes.best[lane] = min(lanes.best[lane], lanes.worst[lane])
            lanes.iteration[lane] += 1
            drive = TendonDrive(mode, target[i], compliance[i % compliance.shape[0]], segment)
            if find_step(lane, force, drive, used, lanes, work):
                lanes.fraction[lane] = 1.0
            else:
                status[i], residual[i] = FAILED, lanes.worst[lane]
                put(lane, theta[i], tension[i], lengths[i], lanes)
                busy -= 1
        move(group, work.column, used, lanes)
        for lane in range(problem.shape[0]):
            i = problem[lane]
            if i >= 0 and lanes.negatives[lane] > 0.0 and lanes.angle[lane] < SETTLED_ANGLE:
                products_of(lane, used, lanes, work)
                for t in range(2):
                    work.held[t] = lanes.held[t, lane]
                drive = TendonDrive(mode, target[i], compliance[i % compliance.shape[0]], segment)
                lanes.negatives[lane] = negative_curvature(
                    drive, work, used, int(lanes.negatives[lane]))
