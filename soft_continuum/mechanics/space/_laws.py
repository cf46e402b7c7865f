# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The moment in a joint of a spatial chain, and its yielding, in compiled scalar code.

joints (n, 4, 3): of each spring stiffness about x, y, z; that of its jam or friction; the rotation
vector that these hold; the moment at which they yield, and the tables of spring and jam (their
numbers, negative: linear).
tables (k, 2, rows): angles in rad, and moments over the first stiffness, rad.
"""

from math import inf, sqrt

from soft_continuum.mechanics._compile import borrowing, inlined
from soft_continuum.mechanics.space._rotations import (
    matrix_at,
    multiply,
    rotation_vector,
    transposed,
)

STIFFNESS, JAM, HELD, LAW = 0, 1, 2, 3
YIELD, SPRING_TABLE, JAM_TABLE = 0, 1, 2


@borrowing
def parts_of_law(angle, least, table, tables, most):  # type: ignore[no-untyped-def]
    """
    Return secant and tangent stiffness, over the first one, of a law at an angle, rad.

    least: the first stiffness, N m/rad.  most: N m, at which it yields.
    """
    secant, tangent = 1.0, 1.0
    if table >= 0.0 and angle > 0.0:
        number, row = int(table), 0
        while row < tables.shape[2] - 2 and angle > tables[number, 0, row + 1]:
            row += 1
        tangent = ((tables[number, 1, row + 1] - tables[number, 1, row])
                   / (tables[number, 0, row + 1] - tables[number, 0, row]))
        secant = (tables[number, 1, row] + tangent * (angle - tables[number, 0, row])) / angle
    if secant * least * angle > most:
        secant, tangent = most / (least * angle), 0.0
    return secant, tangent


@inlined
def bend(stiffness, angle, least):  # type: ignore[no-untyped-def]
    """Return the angle about the softer axis that stores as much as a bending, (2,) rad."""
    if least <= 0.0:
        return 0.0
    return sqrt((stiffness[0] * angle[0] * angle[0] + stiffness[1] * angle[1] * angle[1]) / least)


@inlined
def law(stiffness, angle, table, tables, most, by_secant):  # type: ignore[no-untyped-def]
    """
    Return the moment of springs at a rotation vector, and its slope: xx, xy, yy and zz.

    Stiffness and moment belong to the energy of an angle that counts both axes by their
    stiffness: of a round spring the moment is along the bending, and depends on its size.  Twist
    is linear.  A joint yields in the direction of its moment (radial return; Simo and Hughes,
    Computational Inelasticity, 1998, 2.3).
    """
    p, q, twist = stiffness[0] * angle[0], stiffness[1] * angle[1], stiffness[2] * angle[2]
    if table < 0.0 and most == inf:
        return (p, q, twist), (stiffness[0], 0.0, stiffness[1], stiffness[2])
    least = min(stiffness[0], stiffness[1])
    secant, tangent = parts_of_law(bend(stiffness, angle, least), least, table, tables, most)
    if by_secant:
        tangent = max(secant, tangent)
    along, more = p * angle[0] + q * angle[1], 0.0
    if tangent != secant and along > 0.0:
        more = (tangent - secant) / along
    return ((secant * p, secant * q, twist),
            (secant * stiffness[0] + more * p * p, more * p * q,
             secant * stiffness[1] + more * q * q, stiffness[2]))


@inlined
def row_of(joints, k, row):  # type: ignore[no-untyped-def]
    """Return one row of a joint as a vector."""
    return joints[k, row, 0], joints[k, row, 1], joints[k, row, 2]


@inlined
def joint_law(joints, k, angle, tables, by_secant):  # type: ignore[no-untyped-def]
    """Return the moment of the joint k at a rotation vector, and its slope as ``law`` has it."""
    m, s = law(row_of(joints, k, STIFFNESS), angle, joints[k, LAW, SPRING_TABLE], tables, inf,
               by_secant)
    if joints[k, JAM, 0] > 0.0:
        held = row_of(joints, k, HELD)
        away = angle[0] - held[0], angle[1] - held[1], angle[2] - held[2]
        n, t = law(row_of(joints, k, JAM), away, joints[k, LAW, JAM_TABLE], tables,
                   joints[k, LAW, YIELD], by_secant)
        return ((m[0] + n[0], m[1] + n[1], m[2] + n[2]),
                (s[0] + t[0], s[1] + t[1], s[2] + t[2], s[3] + t[3]))
    return m, s


@borrowing
def creep(rotations, joints, turns, tables):  # type: ignore[no-untyped-def]
    """Relax held shapes of joints to their yield moment, in place."""
    for k in range(len(rotations)):
        stiffness, most = row_of(joints, k, JAM), joints[k, LAW, YIELD]
        least = min(stiffness[0], stiffness[1])
        if least <= 0.0 or most == inf:
            continue
        before = matrix_at(turns, k)
        if k > 0:
            before = multiply(matrix_at(rotations, k - 1), before)
        now = rotation_vector(multiply(transposed(before), matrix_at(rotations, k)))
        held, table = row_of(joints, k, HELD), joints[k, LAW, JAM_TABLE]
        away = now[0] - held[0], now[1] - held[1], now[2] - held[2]
        angle = bend(stiffness, away, least)
        if parts_of_law(angle, least, table, tables, most)[1] > 0.0:
            continue
        low, high = 0.0, angle  # the angle at which it yields
        for _ in range(100):
            middle = 0.5 * (low + high)
            if parts_of_law(middle, least, table, tables, most)[1] > 0.0:
                low = middle
            else:
                high = middle
        joints[k, HELD, 0] += (1.0 - high / angle) * away[0]
        joints[k, HELD, 1] += (1.0 - high / angle) * away[1]
