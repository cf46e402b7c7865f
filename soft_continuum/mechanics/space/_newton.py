# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Newton's method for the equilibrium of a spatial chain, compiled, in O(links) a step.

The unknowns are the orientations of the links and the tensions.  With orientations the springs
couple neighbours only, dead loads act on each link alone, and a span of a tendon couples all links
between its guides through one vector.  So the matrix is a band, plus two directions for each
longer span (those across it) and one column for each tendon: it is solved by eliminating the
links, and then a small dense system (Golub and Van Loan, Matrix Computations, 2.1.4 and 4.3.5).

An increment of an orientation R is a rotation vector in its own frame: R exp(d).

drive: (kind, target, compliance, bias, damping)
    kind (tendons,): LENGTH or TENSION.  target: m or N.  compliance: m/N.  bias (links, 3): what
    is left unbalanced, N m.  damping: N m of every link, which shortens steps.
"""

from math import sqrt

from soft_continuum.mechanics._compile import borrowing, inlined
from soft_continuum.mechanics._linear_algebra import (
    back_substitute,
    condense,
    negative_eigenvalues,
    small_solve,
)
from soft_continuum.mechanics.space._assembly import assemble, dead_moments
from soft_continuum.mechanics.space._laws import creep, STIFFNESS
from soft_continuum.mechanics.space._rotations import rotate

LENGTH, TENSION = 0, 1
CONVERGED, DIVERGED, SINGULAR, CYCLED, UNSTABLE = 0, 1, 2, 3, 4
MAX_SETS = 30  # of taut tendons that are tried
LENGTH_TOLERANCE = 1e-11  # m
SET_TOLERANCE = 1e-4  # rad: near enough to see which tendons carry
STEP_TOLERANCE = 1e-9  # rad: the next step would be far below rounding
TENSION_TOLERANCE = 1e-9  # N
NEUTRAL = 1e-7
"""Part of a joint's stiffness, against its turning: a round column may buckle to any side."""


@inlined
def least_stiffness(joints, k):  # type: ignore[no-untyped-def]
    """Return the smallest stiffness of the spring of a joint, N m/rad."""
    return min(joints[k, STIFFNESS, 0], joints[k, STIFFNESS, 1], joints[k, STIFFNESS, 2])


@inlined
def size_of(values, first):  # type: ignore[no-untyped-def]
    """Return the length of three numbers of a list, which no turn of their frame changes."""
    return sqrt(values[first]**2 + values[first + 1]**2 + values[first + 2]**2)


@borrowing
def out_of_balance(tension, system, drive, work):  # type: ignore[no-untyped-def]
    """
    Take the bias off and add the damping.

    Returns the largest moment, N m, and the largest gap of a tendon, m.
    """
    _, target, compliance, bias, damping = drive
    residual, gap = 0.0, 0.0
    for k in range(len(bias)):
        stiffness = damping + NEUTRAL * least_stiffness(system.joints, k)
        for i in range(3):
            work.gradient[3 * k + i] -= bias[k, i]
            work.band[3 * k + i, 0] += stiffness
        residual = max(residual, size_of(work.gradient, 3 * k))
    for t in range(len(tension)):
        if work.chosen[t]:
            gap = max(gap, abs(target[t] + compliance[t] * tension[t] - work.paths[t]))
    return residual, gap


@borrowing
def step(rotations, tension, system, drive, used, limit, work):  # type: ignore[no-untyped-def]
    """
    Take one step; return whether there is one, its largest rotation, rad, and negative pivots.

    used: what _assembly.assemble returns.  limit: rad of a link.  work.judged is left with the
    symmetric small system.
    """
    _, target, compliance, _, _ = drive
    chosen, forces, shift = used
    matrix, judged, right, products = work.matrix, work.judged, work.right, work.products
    columns = work.columns
    size = dead_moments(rotations, system, forces + shift, work) - shift
    last = size + shift
    for row in range(len(work.gradient)):
        columns[row, last] = -work.gradient[row]
    negatives = condense(work.band, columns, last + 1, products)
    for a in range(size):
        for c in range(size):
            matrix[a, c] = products[a + shift, c if c < chosen else c + shift]
        if a < chosen:
            t = work.of_column[a]
            matrix[a, a] += compliance[t]
            right[a] = products[a + shift, last] - (
                target[t] + compliance[t] * tension[t] - work.paths[t])
        elif a < forces:
            s = work.of_column[a]
            matrix[a, a] += work.lengths[s] / (tension[system.spans[s, 0]] * system.ratios[s])
            right[a] = products[a + shift, last]
        else:
            other = a + 1 if (a - forces) % 2 == 0 else a - 1
            matrix[a, other] += work.right[a + shift] * (a - other)
    for a in range(forces, size):
        right[a] = products[a + shift, last]
    for a in range(forces):
        for c in range(forces):
            judged[a, c] = 0.5 * (matrix[a, c] + matrix[c, a])
    if not small_solve(matrix, right, size):
        return False, 0.0, negatives
    for row in range(len(columns)):
        for a in range(size):
            columns[row, last] -= columns[row, a if a < chosen else a + shift] * right[a]
    back_substitute(work.band, columns, last)
    largest = 0.0
    for k in range(len(rotations)):
        largest = max(largest, size_of(columns[:, last], 3 * k))
    if not largest < 1e6:  # nan too
        return False, largest, negatives
    scale = min(1.0, limit / max(largest, 1e-300))
    for k in range(len(rotations)):
        rotate(rotations[k], scale * columns[3 * k, last], scale * columns[3 * k + 1, last],
               scale * columns[3 * k + 2, last])
    for a in range(chosen):
        tension[work.of_column[a]] += scale * right[a]
    return True, largest, negatives


@borrowing
def wrong_tendon(tension, taut, drive, work):  # type: ignore[no-untyped-def]
    """
    Return the tendons that should change sides most: a taut one that pushes, a slack one.

    The latter is too short; -1 for none.
    """
    kind, target, _, _, _ = drive
    least, release, most_short, take = -TENSION_TOLERANCE, -1, LENGTH_TOLERANCE, -1
    for t in range(len(tension)):
        if kind[t] == TENSION:
            continue
        if taut[t] and tension[t] < least:
            least, release = tension[t], t
        if not taut[t] and work.paths[t] - target[t] > most_short:
            most_short, take = work.paths[t] - target[t], t
    return release, take


@borrowing
def just_taut(taut, drive, work):  # type: ignore[no-untyped-def]
    """Return a tendon that carries nothing, but may be what holds the arm; -1 for none."""
    kind, target, _, _, _ = drive
    found = -1
    for t in range(len(taut)):
        if kind[t] == LENGTH and not taut[t] and work.paths[t] - target[t] > -LENGTH_TOLERANCE:
            found = t
    return found


@borrowing
def newton(rotations, tension, taut, system, drive, most, limit, work):  # type: ignore[no-untyped-def]
    """
    Find the equilibrium near rotations (links, 3, 3).

    Returns status, iterations, residual in N m, and whether the energy with the damping had a
    minimum, under the lengths of the taut tendons, in the last step.  Also tension (tendons,) and
    taut (tendons,) are changed in place: tendons become slack that would push, and taut that would
    be too short; what joints hold beyond their yield moment is let go.  most: iterations.
    limit: rad of a link in one step.
    """
    kind, target, _, _, _ = drive
    calm = least_stiffness(system.joints, 0)
    for k in range(len(rotations)):
        calm = min(calm, least_stiffness(system.joints, k))
    calm *= 0.01 * STEP_TOLERANCE / len(rotations)  # N m: all that would follow is tiny
    for t in range(len(tension)):
        if kind[t] == TENSION:
            tension[t] = target[t]
        elif not taut[t]:
            tension[t] = 0.0
    sets, negatives, forces, near, by_secant = 0, 0, 0, False, False
    residual = 0.0
    for iteration in range(most):
        for t in range(len(tension)):
            work.chosen[t] = kind[t] == LENGTH and taut[t]
        # Newton's steps may go back and forth about a joint that yields; those by secants do not.
        judged_by_secant, by_secant = by_secant, iteration % 16 >= 8
        used = assemble(rotations, tension, system, by_secant, work)
        residual, gap = out_of_balance(tension, system, drive, work)
        done = near and residual <= calm and gap <= LENGTH_TOLERANCE and not judged_by_secant
        if not done:
            forces = used[1]
            solved, largest, negatives = step(
                rotations, tension, system, drive, used, limit, work)
            if not solved:
                return SINGULAR if largest == 0.0 else DIVERGED, iteration, residual, False
            near = largest <= SET_TOLERANCE and gap <= SET_TOLERANCE
            if not near:
                continue
            done = largest <= STEP_TOLERANCE and gap <= LENGTH_TOLERANCE and not by_secant
        # Every taut tendon must pull, and no slack one be too short.
        release, take = wrong_tendon(tension, taut, drive, work)
        if release < 0 and take < 0:
            if not done:
                continue
            # A minimum: as many negative directions as the lengths take away.
            if negatives == negative_eigenvalues(work.judged, forces):
                creep(rotations, system.joints, system.turns, system.tables)
                return CONVERGED, iteration + 1, residual, True
            take = just_taut(taut, drive, work)
            if take < 0:
                return UNSTABLE, iteration + 1, residual, False
        sets += 1
        near = False
        if sets > MAX_SETS:
            return CYCLED, iteration + 1, residual, False
        if release >= 0:
            taut[release] = False
            tension[release] = 0.0
        else:
            taut[take] = True
    return DIVERGED, most, residual, negatives == negative_eigenvalues(work.judged, forces)
