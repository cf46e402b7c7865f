# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The way of a spatial chain from one equilibrium to the next, in compiled scalar code.

routing: (fixed, tendons, entries, bodies, vectors)
    Each span is the sum of fixed (spans, 3), in base_link, and of vectors (k, 3) in the frames of
    bodies (k,), those from entries[s] to entries[s + 1] (exclusive).  tendons (spans,).
"""

from math import sqrt

import numpy as np

from soft_continuum.mechanics._compile import borrowing, compiled
from soft_continuum.mechanics.spatial._arrays import System, workspace
from soft_continuum.mechanics.spatial._assembly import span_lengths
from soft_continuum.mechanics.spatial._newton import CONVERGED, newton
from soft_continuum.mechanics.spatial._rotations import (
    apply,
    matrix_at,
    multiply,
    transposed,
    write,
)

MAX_ITERATIONS = 4000  # on the way
UNTURNED = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0


@compiled
def lay_out(rotations, link, lengths, forces, torques, routing, count):  # type: ignore[no-untyped-def]
    """
    Return the arrays of _assembly from turns to constants, for bodies that are links.

    link (bodies,): -1 for what is fixed to the base; lengths, forces and torques: of the bodies;
    count: of tendons.  Then the numbers of the spans that move, and what of each path does not.
    """
    fixed, tendons, begins, of_entry, along = routing
    bodies, links = len(link), link[-1] + 1
    inside = np.empty((bodies, 3, 3))  # of each body in its link
    turns, loads = np.zeros((links, 3, 3)), np.zeros((links, 3, 3))
    moments = np.zeros((links, 3))
    own = UNTURNED
    for k in range(bodies):
        j = link[k]
        if j >= 0 and (k == 0 or link[k - 1] != j):
            own = matrix_at(rotations, k)
            write(matrix_at(inside, k - 1) if k > 0 else UNTURNED, turns, j)
        write(multiply(transposed(own), matrix_at(rotations, k)), inside, k)
        if j >= 0:
            for i in range(3):
                moments[j, i] += torques[k, i]
                for m in range(3):
                    loads[j, i, m] += lengths[k] * inside[k, i, 2] * forces[k, m]
    size = len(fixed)
    entries, vectors = np.empty(len(of_entry), np.int64), np.empty((len(of_entry), 3))
    spans, constants = np.empty((size, 3), np.int64), np.empty((size, 3))
    moving, unchanged = np.empty(size, np.int64), np.zeros(count)
    used, moved = 0, 0
    for s in range(size):
        first = used
        for i in range(3):
            constants[moved, i] = fixed[s, i]
        for e in range(begins[s], begins[s + 1]):
            j = link[of_entry[e]]
            vector = apply(matrix_at(inside, of_entry[e]),
                           (along[e, 0], along[e, 1], along[e, 2]))
            starts = j >= 0 and (used == first or entries[used - 1] != j)
            if starts:
                entries[used] = j
                used += 1
            for i in range(3):
                if j < 0:
                    constants[moved, i] += vector[i]
                elif starts:
                    vectors[used - 1, i] = vector[i]
                else:
                    vectors[used - 1, i] += vector[i]
        if used > first:
            spans[moved, 0], spans[moved, 1], spans[moved, 2] = tendons[s], first, used
            moving[moved] = s
            moved += 1
        else:
            unchanged[tendons[s]] += sqrt(
                constants[moved, 0]**2 + constants[moved, 1]**2 + constants[moved, 2]**2)
    return (turns, loads, moments, entries[:used].copy(), vectors[:used].copy(),
            spans[:moved].copy(), constants[:moved].copy(), moving[:moved].copy(), unchanged)


@borrowing
def take_over(rotations, tension, taut, there, here):  # type: ignore[no-untyped-def]
    """Copy a state of the links to another place."""
    for t in range(tension.shape[1]):
        tension[here, t], taut[here, t] = tension[there, t], taut[there, t]
    for k in range(rotations.shape[1]):
        write(matrix_at(rotations[there], k), rotations[here], k)


@compiled
def lead(  # type: ignore[no-untyped-def]
        rotations, tension, taut, system, drive, step, least, most):
    """
    Lead targets and what is out of balance from those at the start to those at the end.

    rotations (2, links, 3, 3), tension (2, tendons), taut (2, tendons): the first is changed in
    place, the other is where Newton's method ended last.
    drive: (kind, compliance, targets, bias, damping)
        kind, compliance (tendons,), damping: as of _newton.  targets (4, tendons): at the start,
        at the end, room for those between, and room for the paths.  bias (2, links, 3): at the
        start, and room.
    step, least: parts of the way, at first and at least.  most: iterations of Newton's method.
    Returns the part of the way that was reached, iterations, residual in N m, and how Newton's
    method ended last: its status, and whether that was downhill.
    """
    kind, compliance, targets, bias, damping = drive
    done, total, residual, status, downhill = 0.0, 0, 0.0, CONVERGED, True
    system = System(*system)
    work = workspace(system, len(kind))
    while done < 1.0:
        part = min(1.0, done + step)
        take_over(rotations, tension, taut, 0, 1)
        for t in range(len(kind)):
            targets[2, t] = targets[0, t] + part * (targets[1, t] - targets[0, t])
        for k in range(bias.shape[1]):
            for i in range(3):
                bias[1, k, i] = (1.0 - part) * bias[0, k, i]
        status, used, residual, downhill = newton(
            rotations[1], tension[1], taut[1], system,
            (kind, targets[2], compliance, bias[1], damping), most, work)
        total += used
        if status == CONVERGED:
            take_over(rotations, tension, taut, 1, 0)
            done, step = part, 2.0 * step
            continue
        step *= 0.5
        if step < least or total > MAX_ITERATIONS:
            break
    span_lengths(rotations[1], system, work.units, work.lengths, targets[3])
    return done, total, residual, status, downhill


@compiled
def carry(rotations, begin, link):  # type: ignore[no-untyped-def]
    """
    Return where all bodies are, (bodies, 3, 3), that are on links (links, 3, 3).

    begin (bodies, 3, 3): where they were when the links were laid out.  Made orthonormal by one
    step of Newton's method for the polar decomposition (Higham 1986), else rounding triples in
    each solve.
    """
    found = np.empty((len(link), 3, 3))
    turn = UNTURNED
    for k in range(len(link)):
        j = link[k]
        if j < 0:
            write(matrix_at(begin, k), found, k)
            continue
        if k == 0 or link[k - 1] != j:
            turn = multiply(matrix_at(rotations, j), transposed(matrix_at(begin, k)))
        m = multiply(turn, matrix_at(begin, k))
        s = multiply(transposed(m), m)
        write(multiply(m, (1.5 - 0.5 * s[0], -0.5 * s[1], -0.5 * s[2],
                           -0.5 * s[3], 1.5 - 0.5 * s[4], -0.5 * s[5],
                           -0.5 * s[6], -0.5 * s[7], 1.5 - 0.5 * s[8])), found, k)
    return found
