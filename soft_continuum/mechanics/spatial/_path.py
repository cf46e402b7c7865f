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

from soft_continuum.mechanics._compile import compiled
from soft_continuum.mechanics.spatial._assembly import span_lengths
from soft_continuum.mechanics.spatial._newton import CONVERGED, newton
from soft_continuum.mechanics.spatial._rotations import apply, multiply, transposed_multiply

MAX_ITERATIONS = 4000  # on the way


@compiled
def lay_out(rotations, link, lengths, forces, torques, routing, count):  # type: ignore[no-untyped-def]
    """
    Return the arrays of _assembly from turns to constants, for bodies that are links.

    link (bodies,): -1 for what is fixed to the base; lengths, forces and torques: of the bodies;
    count: of tendons.  Then the numbers of the spans that move, and what of each path does not.
    """
    fixed, tendons, begins, of_entry, along = routing
    bodies, links = len(link), link[-1] + 1
    inside, own = np.empty((bodies, 3, 3)), np.empty((3, 3))  # of each body in its link
    turns, loads = np.zeros((links, 3, 3)), np.zeros((links, 3, 3))
    moments = np.zeros((links, 3))
    own[:] = np.eye(3)
    for k in range(bodies):
        j = link[k]
        if j >= 0 and (k == 0 or link[k - 1] != j):
            own[:] = rotations[k]
            for i in range(3):
                turns[j, i, i] = 1.0
            if k > 0:
                turns[j] = inside[k - 1]
        transposed_multiply(own, rotations[k], inside[k])
        if j >= 0:
            for i in range(3):
                moments[j, i] += torques[k, i]
                for m in range(3):
                    loads[j, i, m] += lengths[k] * inside[k, i, 2] * forces[k, m]
    size = len(fixed)
    entries, vectors = np.empty(len(of_entry), np.int64), np.empty((len(of_entry), 3))
    spans, constants = np.empty((size, 3), np.int64), np.empty((size, 3))
    moving, unchanged, vector = np.empty(size, np.int64), np.zeros(count), np.empty(3)
    used, moved = 0, 0
    for s in range(size):
        first = used
        constants[moved] = fixed[s]
        for e in range(begins[s], begins[s + 1]):
            j = link[of_entry[e]]
            apply(inside[of_entry[e]], along[e], vector)
            if j < 0:
                constants[moved] += vector
            elif used > first and entries[used - 1] == j:
                vectors[used - 1] += vector
            else:
                entries[used] = j
                vectors[used] = vector
                used += 1
        if used > first:
            spans[moved, 0], spans[moved, 1], spans[moved, 2] = tendons[s], first, used
            moving[moved] = s
            moved += 1
        else:
            unchanged[tendons[s]] += sqrt((constants[moved]**2).sum())
    return (turns, loads, moments, entries[:used].copy(), vectors[:used].copy(),
            spans[:moved].copy(), constants[:moved].copy(), moving[:moved].copy(), unchanged)


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
    while done < 1.0:
        part = min(1.0, done + step)
        rotations[1], tension[1], taut[1] = rotations[0], tension[0], taut[0]
        targets[2] = targets[0] + part * (targets[1] - targets[0])
        bias[1] = (1.0 - part) * bias[0]
        status, used, residual, downhill = newton(
            rotations[1], tension[1], taut[1], system,
            (kind, targets[2], compliance, bias[1], damping), most)
        total += used
        if status == CONVERGED:
            rotations[0], tension[0], taut[0] = rotations[1], tension[1], taut[1]
            done, step = part, 2.0 * step
            continue
        step *= 0.5
        if step < least or total > MAX_ITERATIONS:
            break
    spans, paths = len(system[6]), np.empty(len(kind))
    span_lengths(rotations[1], system, np.empty((spans, 3)), np.empty(spans), paths)
    targets[3] = paths
    return done, total, residual, status, downhill


@compiled
def carry(rotations, begin, link):  # type: ignore[no-untyped-def]
    """
    Return where all bodies are, (bodies, 3, 3), that are on links (links, 3, 3).

    begin (bodies, 3, 3): where they were when the links were laid out.  Made orthonormal by one
    step of Newton's method for the polar decomposition (Higham 1986), else rounding triples in
    each solve.
    """
    found = begin.copy()
    turn, turned, square = np.eye(3), np.empty((3, 3)), np.empty((3, 3))
    for k in range(len(link)):
        j = link[k]
        if j < 0:
            continue
        if k == 0 or link[k - 1] != j:
            for i in range(3):
                for m in range(3):
                    turn[i, m] = (rotations[j, i, 0] * begin[k, m, 0]
                                  + rotations[j, i, 1] * begin[k, m, 1]
                                  + rotations[j, i, 2] * begin[k, m, 2])
        multiply(turn, begin[k], turned)
        transposed_multiply(turned, turned, square)
        for i in range(3):
            for m in range(3):
                square[i, m] *= -0.5
            square[i, i] += 1.5
        multiply(turned, square, found[k])
    return found
