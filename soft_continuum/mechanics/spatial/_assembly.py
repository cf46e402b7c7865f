# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What is out of balance in a spatial chain, and its derivatives, in compiled scalar code.

system: (joints, turns, loads, moments, entries, vectors, spans, constants)
    joints (links, 4, 3): spring stiffness about x, y, z; that of its jam or friction; the rotation
    vector that these hold; the moment at which they slide, three times.  turns (links, 3, 3):
    orientation, in the link before or the base, of what the joint is on.  loads (links, 3, 3):
    sum of (vector of a body) x (force that it carries), so that the energy is -trace(load R).
    moments (links, 3): dead moments, N m, in base_link.
    entries (k,): link of each vector (k, 3) of a span, in its frame.  spans (spans, 3): tendon,
    first and last entry (exclusive).  constants (spans, 3): the part of a span in base_link.
"""

from math import sqrt

import numpy as np

from soft_continuum.mechanics._compile import compiled
from soft_continuum.mechanics.spatial._rotations import inverse_jacobian, rotation_vector

STIFFNESS, JAM, HELD, SLIDING = 0, 1, 2, 3


@compiled
def multiply(one, other, product):  # type: ignore[no-untyped-def]
    """Write a product of (3, 3) matrices."""
    for i in range(3):
        for j in range(3):
            product[i, j] = (one[i, 0] * other[0, j] + one[i, 1] * other[1, j]
                             + one[i, 2] * other[2, j])


@compiled
def transposed_multiply(one, other, product):  # type: ignore[no-untyped-def]
    """Write the product of the transpose of a (3, 3) matrix and another."""
    for i in range(3):
        for j in range(3):
            product[i, j] = (one[0, i] * other[0, j] + one[1, i] * other[1, j]
                             + one[2, i] * other[2, j])


@compiled
def joint_law(joint, angle, moment, slope):  # type: ignore[no-untyped-def]
    """
    Write the moment (3,) of a joint at a rotation vector, and its derivative (3, 3).

    What is held beyond the moment at which it slides is let go in the direction in which it pulls
    (radial return; Simo and Hughes, Computational Inelasticity, 1998, 2.3).
    """
    square = 0.0
    for i in range(3):
        moment[i] = joint[JAM, i] * (angle[i] - joint[HELD, i])
        square += moment[i] * moment[i]
    size, most = sqrt(square), joint[SLIDING, 0]
    part = 1.0 if size <= most else most / size
    for i in range(3):
        for j in range(3):
            slope[i, j] = 0.0
            if size > most:
                slope[i, j] = -part * moment[i] * moment[j] * joint[JAM, j] / square
        slope[i, i] += part * joint[JAM, i] + joint[STIFFNESS, i]
    for i in range(3):
        moment[i] = part * moment[i] + joint[STIFFNESS, i] * angle[i]


@compiled
def springs(rotations, system, gradient, diagonal, lower):  # type: ignore[no-untyped-def]
    """Add the moments of the joints and their derivatives; lower: d(g of k) by k - 1."""
    joints, turns = system[0], system[1]
    before, relative = np.empty((3, 3)), np.empty((3, 3))
    jacobian, weighted, product = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    turned, angle, moment = np.empty((3, 3)), np.empty(3), np.empty(3)
    slope = np.empty((3, 3))
    for k in range(len(rotations)):
        if k > 0:
            multiply(rotations[k - 1], turns[k], before)
        else:
            before[:] = turns[0]
        transposed_multiply(before, rotations[k], relative)
        rotation_vector(relative, angle)
        inverse_jacobian(angle, jacobian)
        joint_law(joints[k], angle, moment, slope)
        multiply(slope, jacobian, weighted)
        for i in range(3):
            for j in range(3):
                gradient[k, i] += jacobian[j, i] * moment[j]
        transposed_multiply(jacobian, weighted, product)
        for i in range(3):
            for j in range(3):
                diagonal[k, i, j] += product[i, j]
        if k == 0:
            continue
        # That of the link before is the transpose, in the frame of its upper joint.
        for i in range(3):
            total = 0.0
            for j in range(3):
                total += jacobian[i, j] * moment[j]
            angle[i] = total
            for j in range(3):
                turned[i, j] = jacobian[j, i]
        multiply(jacobian, slope, before)
        multiply(before, turned, product)
        turn = turns[k]
        for i in range(3):
            for j in range(3):
                gradient[k - 1, i] -= turn[i, j] * angle[j]
        multiply(turn, product, turned)
        for i in range(3):
            for j in range(3):
                diagonal[k - 1, i, j] += (turned[i, 0] * turn[j, 0] + turned[i, 1] * turn[j, 1]
                                          + turned[i, 2] * turn[j, 2])
        # d2/(d before)(d after) = -J^-1 D J^-1 + [M]x / 2, before rows: the transpose here.
        multiply(before, jacobian, product)
        product[0, 1] += 0.5 * moment[2]
        product[0, 2] -= 0.5 * moment[1]
        product[1, 0] -= 0.5 * moment[2]
        product[1, 2] += 0.5 * moment[0]
        product[2, 0] += 0.5 * moment[1]
        product[2, 1] -= 0.5 * moment[0]
        for i in range(3):
            for j in range(3):
                lower[k, j, i] -= (turn[i, 0] * product[0, j] + turn[i, 1] * product[1, j]
                                   + turn[i, 2] * product[2, j])


@compiled
def dead_loads(rotations, system, gradient, diagonal):  # type: ignore[no-untyped-def]
    """Add the moments of dead forces and moments, and their derivatives."""
    loads, moments = system[2], system[3]
    turned = np.empty((3, 3))
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
        diagonal[k, 0, 1] += 0.5 * z
        diagonal[k, 1, 0] -= 0.5 * z
        diagonal[k, 0, 2] -= 0.5 * y
        diagonal[k, 2, 0] += 0.5 * y
        diagonal[k, 1, 2] += 0.5 * x
        diagonal[k, 2, 1] -= 0.5 * x


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
def tendons(  # type: ignore[no-untyped-def]
        rotations, system, tension, units, gradient, diagonal, slopes):
    """Add the moments of the tendons; slopes: (3 links, tendons), m, of the paths."""
    entries, vectors, spans = system[4], system[5], system[6]
    slopes[:] = 0.0
    for s in range(len(spans)):
        t, unit = spans[s, 0], units[s]
        for e in range(spans[s, 1], spans[s, 2]):
            k, vector = entries[e], vectors[e]
            rotation = rotations[k]
            add_lever(unit, rotation, vector, slopes, k, t)
            if tension[t] != 0.0:
                trace = 0.0
                for i in range(3):
                    local = (rotation[0, i] * unit[0] + rotation[1, i] * unit[1]
                             + rotation[2, i] * unit[2])
                    trace += local * vector[i]
                    for j in range(3):
                        diagonal[k, i, j] += 0.5 * tension[t] * local * vector[j]
                        diagonal[k, j, i] += 0.5 * tension[t] * local * vector[j]
                for i in range(3):
                    diagonal[k, i, i] -= tension[t] * trace
    for k in range(len(rotations)):
        for i in range(3):
            for t in range(slopes.shape[1]):
                gradient[k, i] += tension[t] * slopes[3 * k + i, t]


@compiled
def balance(rotations, tension, system):  # type: ignore[no-untyped-def]
    """Return the unbalanced moments, (links, 3), N m, in the frames of the links."""
    links, count = len(rotations), len(tension)
    gradient, diagonal = np.zeros((links, 3)), np.zeros((links, 3, 3))
    lower, slopes = np.zeros((links, 3, 3)), np.empty((3 * links, count))
    units, lengths = np.empty((len(system[6]), 3)), np.empty(len(system[6]))
    paths = np.empty(count)
    springs(rotations, system, gradient, diagonal, lower)
    dead_loads(rotations, system, gradient, diagonal)
    span_lengths(rotations, system, units, lengths, paths)
    tendons(rotations, system, tension, units, gradient, diagonal, slopes)
    return gradient
