# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The path of a spatial chain from one equilibrium to the next, in compiled scalar code.

routing: (fixed, tendons, entries, bodies, vectors)
    Each span is the sum of fixed (spans, 3), in base_link, and of vectors (k, 3) in the frames of
    bodies (k,), those from entries[s] to entries[s + 1] (exclusive).  tendons (spans,).
"""

from math import asin, sqrt

import numpy as np

from soft_continuum.mechanics._compile import borrowing, compiled
from soft_continuum.mechanics._linear_algebra import NO_TENSION
from soft_continuum.mechanics.space._assembly import assemble, span_lengths, System, work_arrays
from soft_continuum.mechanics.space._newton import (
    CONVERGED,
    least_stiffness,
    LENGTH,
    newton,
    size_of,
)
from soft_continuum.mechanics.space._rotations import (
    apply,
    matrix_at,
    multiply,
    rotate,
    transposed,
    write,
)

ITERATIONS = 40  # of Newton's method in one step
MAX_STEP, DIRECT_STEP = 0.3, 0.7  # rad of a link in one iteration
MAX_ITERATIONS = 4000  # on the way
STEP = 0.003  # m of pull in one step at first
LEAST_STEP = 1.0 / 4096.0  # of the way to the target
AT_REST = 1e-7  # N m that may be out of balance at a start whose tensions are kept
DIRECT_ITERATIONS = 12  # of Newton's method, straight to the target
DIRECT_TURN = 3.0  # rad of all joints together: beyond, it may be another equilibrium
OIL, OIL_STEPS = 5e-3, 800  # of the stiffness of a joint, at first; steps until it rests
OIL_TRIED, OIL_ITERATIONS = 10, 20  # steps after which it is tried without: near its rest a few do
NUDGE = 1e-5  # rad along a nudge
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


@borrowing
def turned(rotations):  # type: ignore[no-untyped-def]
    """Return the total turn of the joints between two states."""
    total = 0.0
    for k in range(rotations.shape[1]):
        before, now = matrix_at(rotations[0], k), matrix_at(rotations[1], k)
        if k > 0:
            before = multiply(transposed(matrix_at(rotations[0], k - 1)), before)
            now = multiply(transposed(matrix_at(rotations[1], k - 1)), now)
        square = 0.0
        for i in range(9):
            square += (now[i] - before[i])**2
        total += 2.0 * asin(min(1.0, sqrt(square / 8.0)))
    return total


@borrowing
def may_be_another(rotations, tension):  # type: ignore[no-untyped-def]
    """Return whether a full step may have left the branch of the first equilibrium."""
    pulling = 0
    for t in range(tension.shape[1]):
        pulling += 1 if tension[1, t] > NO_TENSION else 0
    return pulling > 1 or turned(rotations) > DIRECT_TURN


@borrowing
def try_step(  # type: ignore[no-untyped-def]
        part, rotations, tension, taut, system, drive, most, limit, work):
    """Solve for the targets at a part of the way, from the first state into the other."""
    kind, compliance, targets, bias, damping = drive
    take_over(rotations, tension, taut, 0, 1)
    for t in range(len(kind)):
        targets[2, t] = targets[0, t] + part * (targets[1, t] - targets[0, t])
    for k in range(bias.shape[1]):
        for i in range(3):
            bias[1, k, i] = (1.0 - part) * bias[0, k, i]
    return newton(rotations[1], tension[1], taut[1], system,
                  (kind, targets[2], compliance, bias[1], damping), most, limit, work)


@borrowing
def in_steps(  # type: ignore[no-untyped-def]
        rotations, tension, taut, system, drive, step, work):
    """Go to the target in steps, at first this part of the way; return as ``follow`` does."""
    done, total, residual = 0.0, 0, 0.0
    while done < 1.0:
        part = min(1.0, done + step)
        status, used, residual, _ = try_step(
            part, rotations, tension, taut, system, drive, ITERATIONS, MAX_STEP, work)
        total += used
        if status == CONVERGED:
            take_over(rotations, tension, taut, 1, 0)
            done, step = part, 2.0 * step
            continue
        step *= 0.5
        if step < LEAST_STEP or total > MAX_ITERATIONS:
            break
    return done, total, residual


@borrowing
def relax(rotations, tension, taut, system, drive, nudge, work):  # type: ignore[no-untyped-def]
    """
    Find a new equilibrium for an arm that lost its own, by overdamped relaxation.

    nudge: (2,), about x and y of every link, to leave an unstable balance.  The damping is
    reduced while each step lowers the energy.  Returns whether the arm came to rest, iterations,
    and residual in N m.
    """
    kind, compliance, targets, bias, _ = drive
    damping, total, residual = 0.0, 0, 0.0
    for k in range(len(system.joints)):
        rotate(rotations[0, k], NUDGE * nudge[0], NUDGE * nudge[1], 0.0)
        damping += OIL * least_stiffness(system.joints, k) / len(system.joints)
        for i in range(3):
            bias[0, k, i] = 0.0
    for step in range(OIL_STEPS):
        status, used, residual, downhill = try_step(
            1.0, rotations, tension, taut, system, (kind, compliance, targets, bias, damping), 1,
            MAX_STEP, work)
        total += used
        if not downhill:
            damping *= 4.0
            continue
        damping *= 0.5
        take_over(rotations, tension, taut, 1, 0)
        span_lengths(rotations[0], system, work.units, work.lengths, work.paths)
        for t in range(len(kind)):
            tension[0, t] = max(tension[0, t], 0.0)
            taut[0, t] = tension[0, t] > 0.0 or (
                kind[t] == LENGTH and work.paths[t] > targets[1, t])
        if step % OIL_TRIED == 0:
            status, used, residual, _ = try_step(
                1.0, rotations, tension, taut, system, drive, OIL_ITERATIONS, MAX_STEP, work)
            total += used
            if status == CONVERGED:
                take_over(rotations, tension, taut, 1, 0)
                return True, total, residual
    return False, total, residual


@compiled
def follow(start, arm, links, room, drive, direct, held):  # type: ignore[no-untyped-def]
    """
    Follow an arm from a state to pulls, m, or tensions, N.

    start: (rotations (bodies, 3, 3), pulls, slack (tendons,)).
    arm: (lengths, forces, torques, routing, straight paths), as of ``lay_out``, and the nudge.
    links: (link of each body, joints, tables, ratios of all spans).
    room: (rotations (2, links, 3, 3), tension (2, tendons), taut (2, tendons), found).  First
    what was reached, then where Newton's method ended last; the first tension and taut are those
    at the start.  found (bodies, 3, 3): where the bodies are at last.
    drive: (kind, compliance, targets, bias, damping)
        kind, compliance (tendons,), damping: as of _newton.  targets (4, tendons): room for those
        at the start, pulls or tensions at the end, room for those between, and for the paths.
        bias (2, links, 3): room for what is out of balance at the start, and on the way.
    direct: whether a full step is tried first.  held: whether to go on where tensions do not
    balance the start.
    Returns the fraction of the path that was reached, negative if not begun; iterations;
    residual in N m; and whether the arm is at rest, at the end of the path or after a jump there.
    """
    begin, pulls, slack = start
    lengths, forces, torques, routing, straight, nudge = arm
    link, joints, tables, ratios = links
    rotations, tension, taut, found = room
    kind, compliance, targets, bias, _ = drive
    turns, loads, moments, entries, vectors, spans, constants, moving, unchanged = lay_out(
        begin, link, lengths, forces, torques, routing, len(kind))
    system = System(joints, turns, loads, moments, entries, vectors, spans, constants, tables,
                    ratios[moving])
    work = work_arrays(system, len(kind))
    for k in range(len(link)):
        if link[k] >= 0 and (k == 0 or link[k - 1] != link[k]):
            write(matrix_at(begin, k), rotations[0], link[k])
    assemble(rotations[0], tension[0], system, False, work)
    out = 0.0
    for k in range(bias.shape[1]):
        for i in range(3):
            bias[0, k, i] = work.gradient[3 * k + i]
        out = max(out, size_of(work.gradient, 3 * k))
    if out > AT_REST and not held:
        return -1.0, 0, out, False
    way = 0.0
    for t in range(len(kind)):
        targets[0, t] = tension[0, t]
        if kind[t] == LENGTH:
            length = straight[t] - unchanged[t]
            targets[0, t] = length - pulls[t] + slack[t] - compliance[t] * tension[0, t]
            targets[1, t] = length - targets[1, t]
            way = max(way, abs(targets[1, t] - targets[0, t]))
    done, total, residual, rests = 0.0, 0, 0.0, True
    if direct and way > STEP:
        status, total, residual, _ = try_step(
            1.0, rotations, tension, taut, system, drive, DIRECT_ITERATIONS, DIRECT_STEP,
            work)
        if status == CONVERGED and not may_be_another(rotations, tension):
            take_over(rotations, tension, taut, 1, 0)
            done = 1.0
    if done < 1.0:
        done, used, residual = in_steps(rotations, tension, taut, system, drive,
                                        min(1.0, STEP / max(way, STEP)), work)
        total += used
    if done < 1.0:
        rests, used, residual = relax(rotations, tension, taut, system, drive, nudge, work)
        total += used
    span_lengths(rotations[0], system, work.units, work.lengths, targets[3])
    for t in range(len(kind)):
        targets[3, t] += unchanged[t]
    carry(rotations[0], begin, link, found)
    return done, total, residual, rests


@borrowing
def carry(rotations, begin, link, found):  # type: ignore[no-untyped-def]
    """
    Write where all bodies are, (bodies, 3, 3), that are on links (links, 3, 3).

    begin (bodies, 3, 3): where they were when the links were laid out.  Made orthonormal by one
    step of Newton's method for the polar decomposition (Higham 1986), else rounding triples in
    each solve.
    """
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


@compiled
def follow_batch(  # type: ignore[no-untyped-def]
        starts, arms, links, rooms, drives, direct, outcome, first, last):
    """
    Lead arms to their pulls or tensions, problems ``first`` to ``last``, as ``follow``.

    Arrays have one axis more than there, in front: the problem in those of rooms, in targets and
    in outcome; in all others too, or shared by all problems when it is of length one.  Only the
    numbers of routing, link, tables and ratios are as there.
    rooms: (tension (m, 2, tendons), taut (m, 2, tendons), found (m, bodies, 3, 3)).
    drives: (kind, compliance, targets).
    outcome: (m,) each: part of the way, iterations, residual, whether at rest.
    """
    begin, pulls, slack = starts
    lengths, forces, torques, (fixed, tendons, begins, of_entry, along), straight, nudge = arms
    link, joints, tables, ratios = links
    tension, taut, found = rooms
    kind, compliance, targets = drives
    done, total, residual, rests = outcome
    rotations, bias = np.empty((2, joints.shape[1], 3, 3)), np.empty((2, joints.shape[1], 3))
    for i in range(first, last):
        s, a, j, t = (i % begin.shape[0], i % lengths.shape[0], i % joints.shape[0],
                      i % kind.shape[0])
        done[i], total[i], residual[i], rests[i] = follow(
            (begin[s], pulls[s], slack[s]),
            (lengths[a], forces[a], torques[a], (fixed[a], tendons, begins, of_entry, along[a]),
             straight[a], nudge[a]),
            (link, joints[j], tables, ratios), (rotations, tension[i], taut[i], found[i]),
            (kind[t], compliance[i % compliance.shape[0]], targets[i], bias, 0.0),
            direct[i % direct.shape[0]], False)
