# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What is out of balance in a spatial chain, and its derivatives, in compiled scalar code.

system: (joints, turns, loads, moments, entries, vectors, spans, constants, tables, ratios)
    joints (links, 4, 3), tables: as of _laws.  turns (links, 3, 3): orientation, in the link
    before or the base, of what the joint is on.  loads (links, 3, 3): sum
    of (vector of a body) x (force that it carries), so that the energy is -trace(load R).
    moments (links, 3): dead moments, N m, in base_link.
    entries (k,): link of each vector (k, 3) of a span, in its frame.  spans (spans, 3): tendon,
    first and last entry (exclusive).  constants (spans, 3): the part of a span in base_link.
    ratios (spans,): tension of a span over that at the base.
"""

from math import sqrt

import numpy as np

from soft_continuum.mechanics._compile import compiled
from soft_continuum.mechanics.spatial._laws import joint_law
from soft_continuum.mechanics.spatial._rotations import (
    apply,
    inverse_jacobian,
    multiply,
    rotation_vector,
    transposed_multiply,
    turned_moment_slope,
)


@compiled
def add_half_cross(vector, times, matrix):  # type: ignore[no-untyped-def]
    """Add half of the matrix of a cross product with a vector (3,), times a number."""
    x, y, z = 0.5 * times * vector[0], 0.5 * times * vector[1], 0.5 * times * vector[2]
    matrix[0, 1] -= z
    matrix[1, 0] += z
    matrix[0, 2] += y
    matrix[2, 0] -= y
    matrix[1, 2] -= x
    matrix[2, 1] += x


@compiled
def springs(  # type: ignore[no-untyped-def]
        rotations, system, by_secant, gradient, diagonal, lower):
    """
    Add the moments of the joints and their derivatives; lower: d(g of k) by k - 1.

    by_secant: with secants where laws soften, a majorant of the energy.
    """
    joints, turns = system[0], system[1]
    before, relative = np.empty((3, 3)), np.empty((3, 3))
    jacobian, transpose, slope = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    left, product, turned = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    angle, moment, law, away = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3)
    for k in range(len(rotations)):
        if k > 0:
            multiply(rotations[k - 1], turns[k], before)
        else:
            before[:] = turns[0]
        transposed_multiply(before, rotations[k], relative)
        rotation_vector(relative, angle)
        inverse_jacobian(angle, jacobian)
        joint_law(joints[k], angle, system[8], by_secant, away, moment, law)
        turned_moment_slope(angle, moment, slope)
        transposed_multiply(jacobian, law, left)
        for i in range(3):
            for j in range(3):
                transpose[i, j] = jacobian[j, i]
                left[i, j] += slope[i, j]
        # On the link: J^-T M and (J^-T D + slope) J^-1, less what the turning frame adds.
        multiply(left, jacobian, product)
        apply(transpose, moment, angle)
        add_half_cross(angle, -1.0, product)
        for i in range(3):
            gradient[k, i] += angle[i]
            for j in range(3):
                diagonal[k, i, j] += product[i, j]
        if k == 0:
            continue
        # By the link before, in the frame of its upper joint: by -J^-T there.
        turn = turns[k]
        multiply(left, transpose, product)
        for i in range(3):
            for j in range(3):
                lower[k, i, j] -= (product[i, 0] * turn[j, 0] + product[i, 1] * turn[j, 1]
                                   + product[i, 2] * turn[j, 2])
        # On the link before: -J^-1 M, the same with the rotation vector reversed.
        multiply(jacobian, law, left)
        for i in range(3):
            for j in range(3):
                left[i, j] += slope[i, j]
        add_half_cross(moment, -2.0, left)
        multiply(left, transpose, product)
        apply(jacobian, moment, angle)
        add_half_cross(angle, 1.0, product)
        multiply(turn, product, turned)
        for i in range(3):
            for j in range(3):
                gradient[k - 1, i] -= turn[i, j] * angle[j]
                diagonal[k - 1, i, j] += (turned[i, 0] * turn[j, 0] + turned[i, 1] * turn[j, 1]
                                          + turned[i, 2] * turn[j, 2])


@compiled
def dead_loads(rotations, system, gradient, diagonal):  # type: ignore[no-untyped-def]
    """Add the moments of dead forces and moments, and their derivatives."""
    loads, moments = system[2], system[3]
    turned, moment = np.empty((3, 3)), np.empty(3)
    for k in range(len(rotations)):
        multiply(loads[k], rotations[k], turned)  # sum of v (R^T w)^T
        gradient[k, 0] -= turned[1, 2] - turned[2, 1]
        gradient[k, 1] -= turned[2, 0] - turned[0, 2]
        gradient[k, 2] -= turned[0, 1] - turned[1, 0]
        trace = turned[0, 0] + turned[1, 1] + turned[2, 2]
        for i in range(3):
            diagonal[k, i, i] += trace
            for j in range(3):
                diagonal[k, i, j] -= 0.5 * (turned[i, j] + turned[j, i])
        x, y, z = 0.0, 0.0, 0.0
        for i in range(3):
            x += rotations[k, i, 0] * moments[k, i]
            y += rotations[k, i, 1] * moments[k, i]
            z += rotations[k, i, 2] * moments[k, i]
        gradient[k, 0] -= x
        gradient[k, 1] -= y
        gradient[k, 2] -= z
        # Half of the derivative: the frame in which moments balance turns as well.
        moment[0], moment[1], moment[2] = x, y, z
        add_half_cross(moment, -1.0, diagonal[k])


@compiled
def span_lengths(rotations, system, units, lengths, paths):  # type: ignore[no-untyped-def]
    """Write unit vector (spans, 3) and length of each span, and the path of each tendon."""
    entries, vectors, spans, constants = system[4], system[5], system[6], system[7]
    paths[:] = 0.0
    for s in range(len(spans)):
        x, y, z = constants[s, 0], constants[s, 1], constants[s, 2]
        for e in range(spans[s, 1], spans[s, 2]):
            rotation = rotations[entries[e]]
            a, b, c = vectors[e, 0], vectors[e, 1], vectors[e, 2]
            x += rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * c
            y += rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * c
            z += rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * c
        length = sqrt(x * x + y * y + z * z)
        lengths[s] = length
        units[s, 0], units[s, 1], units[s, 2] = x / length, y / length, z / length
        paths[spans[s, 0]] += length


@compiled
def across(unit, one, other):  # type: ignore[no-untyped-def]
    """Write two unit vectors across a third (Duff et al. 2017, JCGT 6)."""
    sign = 1.0 if unit[2] >= 0.0 else -1.0
    a = -1.0 / (sign + unit[2])
    b = unit[0] * unit[1] * a
    one[0], one[1], one[2] = 1.0 + sign * unit[0] * unit[0] * a, sign * b, -sign * unit[0]
    other[0], other[1], other[2] = b, sign + unit[1] * unit[1] * a, -unit[1]


@compiled
def add_lever(way, rotation, vector, column, k, c):  # type: ignore[no-untyped-def]
    """Add by how much a point of a link moves along a direction as the link turns."""
    x = rotation[0, 0] * way[0] + rotation[1, 0] * way[1] + rotation[2, 0] * way[2]
    y = rotation[0, 1] * way[0] + rotation[1, 1] * way[1] + rotation[2, 1] * way[2]
    z = rotation[0, 2] * way[0] + rotation[1, 2] * way[1] + rotation[2, 2] * way[2]
    column[3 * k, c] += vector[1] * z - vector[2] * y
    column[3 * k + 1, c] += vector[2] * x - vector[0] * z
    column[3 * k + 2, c] += vector[0] * y - vector[1] * x


@compiled
def add_neighbours(  # type: ignore[no-untyped-def]
        way, force, rotations, system, begin, end, diagonal, lower):
    """Add how a force (N/m) holds a span against one way across it, where it joins neighbours."""
    levers = np.zeros((6, 1))
    first = system[4][begin]
    for e in range(begin, end):
        k = system[4][e]
        add_lever(way, rotations[k], system[5][e], levers, k - first, 0)
    for i in range(3):
        for j in range(3):
            diagonal[first, i, j] += force * levers[i, 0] * levers[j, 0]
            if end - begin == 2:
                diagonal[first + 1, i, j] += force * levers[3 + i, 0] * levers[3 + j, 0]
                lower[first + 1, i, j] += force * levers[3 + i, 0] * levers[j, 0]


@compiled
def across_spans(  # type: ignore[no-untyped-def]
        rotations, system, tension, units, lengths, columns, used, of_span, diagonal, lower):
    """
    Add how tensions hold the spans against what is across them; return the columns used.

    The tension over the length, N/m, of the span ``of_span`` acts along each two new columns
    (3 links, :).  Spans between neighbours go into the blocks instead.
    """
    spans, ratios = system[6], system[9]
    one, other = np.empty(3), np.empty(3)
    for s in range(len(spans)):
        begin, end = spans[s, 1], spans[s, 2]
        if tension[spans[s, 0]] == 0.0:
            continue
        across(units[s], one, other)
        if end - begin <= 2 and system[4][end - 1] - system[4][begin] <= 1:
            force = tension[spans[s, 0]] * ratios[s] / lengths[s]
            for way in (one, other):
                add_neighbours(way, force, rotations, system, begin, end, diagonal, lower)
            continue
        for e in range(begin, end):
            k = system[4][e]
            add_lever(one, rotations[k], system[5][e], columns, k, used)
            add_lever(other, rotations[k], system[5][e], columns, k, used + 1)
        of_span[used], of_span[used + 1] = s, s
        used += 2
    return used


@compiled
def tendons(  # type: ignore[no-untyped-def]
        rotations, system, tension, units, gradient, diagonal, forces, slopes):
    """
    Add the moments of the tendons.

    forces, slopes: (3 links, tendons), m, by a tension, and of the paths: the same but for
    friction.
    """
    entries, vectors, spans, ratios = system[4], system[5], system[6], system[9]
    forces[:] = 0.0
    slopes[:] = 0.0
    weighed = np.empty(3)
    for s in range(len(spans)):
        t, unit = spans[s, 0], units[s]
        for i in range(3):
            weighed[i] = ratios[s] * unit[i]
        for e in range(spans[s, 1], spans[s, 2]):
            k, vector = entries[e], vectors[e]
            rotation = rotations[k]
            add_lever(unit, rotation, vector, slopes, k, t)
            add_lever(weighed, rotation, vector, forces, k, t)
            if tension[t] != 0.0:
                trace = 0.0
                for i in range(3):
                    local = tension[t] * (rotation[0, i] * weighed[0] + rotation[1, i] * weighed[1]
                                          + rotation[2, i] * weighed[2])
                    trace += local * vector[i]
                    for j in range(3):
                        diagonal[k, i, j] += 0.5 * local * vector[j]
                        diagonal[k, j, i] += 0.5 * local * vector[j]
                for i in range(3):
                    diagonal[k, i, i] -= trace
    for k in range(len(rotations)):
        for i in range(3):
            for t in range(slopes.shape[1]):
                gradient[k, i] += tension[t] * forces[3 * k + i, t]


@compiled
def balance(rotations, tension, system):  # type: ignore[no-untyped-def]
    """Return the unbalanced moments, (links, 3), N m, in the frames of the links."""
    links, count = len(rotations), len(tension)
    gradient, diagonal = np.zeros((links, 3)), np.zeros((links, 3, 3))
    lower, slopes = np.zeros((links, 3, 3)), np.empty((3 * links, count))
    pulling = np.empty((3 * links, count))
    units, lengths = np.empty((len(system[6]), 3)), np.empty(len(system[6]))
    paths = np.empty(count)
    springs(rotations, system, False, gradient, diagonal, lower)
    dead_loads(rotations, system, gradient, diagonal)
    span_lengths(rotations, system, units, lengths, paths)
    tendons(rotations, system, tension, units, gradient, diagonal, pulling, slopes)
    return gradient


@compiled
def linearise(rotations, tension, system):  # type: ignore[no-untyped-def]
    """
    Return the derivative of the unbalanced moments, with tensions that stay.

    That is diagonal and lower blocks (links, 3, 3), whose transposes are the upper ones, and
    columns (3 links, c) times forces (c,) in N/m times the same columns.  Last slopes
    (3 links, tendons), m, of the paths, which are also the derivatives by the tensions.
    """
    links, count, spans = len(rotations), len(tension), system[6]
    gradient, diagonal = np.zeros((links, 3)), np.zeros((links, 3, 3))
    lower, slopes = np.zeros((links, 3, 3)), np.empty((3 * links, count))
    pulling = np.empty((3 * links, count))
    units, lengths = np.empty((len(spans), 3)), np.empty(len(spans))
    paths, of_span = np.empty(count), np.empty(2 * len(spans), np.int64)
    columns, forces = np.zeros((3 * links, 2 * len(spans))), np.empty(2 * len(spans))
    springs(rotations, system, False, gradient, diagonal, lower)
    dead_loads(rotations, system, gradient, diagonal)
    span_lengths(rotations, system, units, lengths, paths)
    tendons(rotations, system, tension, units, gradient, diagonal, pulling, slopes)
    used = across_spans(rotations, system, tension, units, lengths, columns, 0, of_span,
                        diagonal, lower)
    for c in range(used):
        s = of_span[c]
        forces[c] = tension[spans[s, 0]] * system[9][s] / lengths[s]
    return diagonal, lower, columns[:, :used].copy(), forces[:used].copy(), slopes
