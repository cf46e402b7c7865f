# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The moment in a joint of a spatial chain, and what it lets go, in compiled scalar code.

joint (4, 3): spring stiffness about x, y, z; that of its jam or friction; the rotation vector that
these hold; the moment at which they yield, and the tables of spring and jam (their numbers,
negative: linear).
tables (k, 2, rows): angles in rad, and moments over the first stiffness, rad.
"""

from math import sqrt

import numpy as np

from soft_continuum.mechanics._compile import compiled
from soft_continuum.mechanics.spatial._rotations import (
    multiply,
    rotation_vector,
    transposed_multiply,
)

STIFFNESS, JAM, HELD, LAW = 0, 1, 2, 3
YIELD, SPRING_TABLE, JAM_TABLE = 0, 1, 2


@compiled
def parts_of_law(angle, least, table, tables, most):  # type: ignore[no-untyped-def]
    """
    Return secant and tangent stiffness, over the first one, of a law at an angle, rad.

    least: the first stiffness, N m/rad.  most: N m, at which it yields.
    """
    secant, tangent = 1.0, 1.0
    if table >= 0.0 and angle > 0.0:
        rows = tables[int(table)]
        row = 0
        while row < rows.shape[1] - 2 and angle > rows[0, row + 1]:
            row += 1
        tangent = (rows[1, row + 1] - rows[1, row]) / (rows[0, row + 1] - rows[0, row])
        secant = (rows[1, row] + tangent * (angle - rows[0, row])) / angle
    if secant * least * angle > most:
        secant, tangent = most / (least * angle), 0.0
    return secant, tangent


@compiled
def bend(stiffness, angle, least):  # type: ignore[no-untyped-def]
    """Return the angle about the softer axis that stores as much as a bending, (2,) rad."""
    if least <= 0.0:
        return 0.0
    return sqrt((stiffness[0] * angle[0] * angle[0] + stiffness[1] * angle[1] * angle[1]) / least)


@compiled
def add_law(  # type: ignore[no-untyped-def]
        stiffness, angle, table, tables, most, by_secant, moment, slope):
    """
    Add the moment (3,) of springs at a rotation vector, and its derivative (3, 3).

    Stiffness and moment belong to the energy of an angle that counts both axes by their
    stiffness: of a round spring the moment is along the bending, and depends on its size.  Twist
    is linear.  What yields lets go in the direction of its moment (radial return; Simo and Hughes,
    Computational Inelasticity, 1998, 2.3).
    """
    least = min(stiffness[0], stiffness[1])
    secant, tangent = 1.0, 1.0
    if table >= 0.0 or most < np.inf:
        secant, tangent = parts_of_law(bend(stiffness, angle, least), least, table, tables, most)
    if by_secant:
        tangent = max(secant, tangent)
    along = 0.0
    for i in range(2):
        along += stiffness[i] * angle[i] * angle[i]
        moment[i] += secant * stiffness[i] * angle[i]
        slope[i, i] += secant * stiffness[i]
    if tangent != secant and along > 0.0:
        for i in range(2):
            for j in range(2):
                slope[i, j] += ((tangent - secant) * stiffness[i] * angle[i]
                                * stiffness[j] * angle[j] / along)
    moment[2] += stiffness[2] * angle[2]
    slope[2, 2] += stiffness[2]


@compiled
def joint_law(joint, angle, tables, by_secant, away, moment, slope):  # type: ignore[no-untyped-def]
    """
    Write the moment (3,) of a joint at a rotation vector, and its derivative (3, 3).

    away: (3,), is overwritten with how far it is from the shape held, rad.
    """
    for i in range(3):
        moment[i] = 0.0
        away[i] = angle[i] - joint[HELD, i]
        for j in range(3):
            slope[i, j] = 0.0
    add_law(joint[STIFFNESS], angle, joint[LAW, SPRING_TABLE], tables, np.inf, by_secant, moment,
            slope)
    if joint[JAM, 0] > 0.0:
        add_law(joint[JAM], away, joint[LAW, JAM_TABLE], tables, joint[LAW, YIELD], by_secant,
                moment, slope)


@compiled
def creep(rotations, system):  # type: ignore[no-untyped-def]
    """Let go what joints hold beyond the moment at which they yield, in place."""
    joints, turns, tables = system[0], system[1], system[8]
    before, relative, away = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for k in range(len(rotations)):
        stiffness, most = joints[k, JAM], joints[k, LAW, YIELD]
        least = min(stiffness[0], stiffness[1])
        if least <= 0.0 or most == np.inf:
            continue
        before[:] = turns[0]
        if k > 0:
            multiply(rotations[k - 1], turns[k], before)
        transposed_multiply(before, rotations[k], relative)
        rotation_vector(relative, away)
        for i in range(3):
            away[i] -= joints[k, HELD, i]
        angle = bend(stiffness, away, least)
        secant, tangent = parts_of_law(angle, least, joints[k, LAW, JAM_TABLE], tables, most)
        if tangent > 0.0:
            continue
        low, high = 0.0, angle  # the angle at which it yields
        for _ in range(100):
            middle = 0.5 * (low + high)
            if parts_of_law(middle, least, joints[k, LAW, JAM_TABLE], tables, most)[1] > 0.0:
                low = middle
            else:
                high = middle
        for i in range(2):
            joints[k, HELD, i] += (1.0 - high / angle) * away[i]
