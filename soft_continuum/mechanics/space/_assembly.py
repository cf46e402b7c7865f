# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Unbalanced moments of a spatial chain and their derivatives, in compiled scalar code.

An increment of an orientation R is a rotation vector in its own frame, R exp(d), and derivatives
are symmetric: the second ones of the energy by d.  System and Work are what the solver works on.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics._compile import borrowing, compiled, inlined
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.space._laws import joint_law
from soft_continuum.mechanics.space._rotations import (
    apply,
    cross,
    inverse_jacobian,
    jacobian_terms,
    matrix_at,
    multiply,
    rotation_vector,
    transposed,
    turned_moment_slope,
)

Integers = NDArray[np.int64]
BAND = 3  # links: spans that couple no further ones go into the band


class System(NamedTuple):
    """
    The links of a chain, which are bodies or several that are locked together, and their loads.

    joints: (links, 4, 3), as of _laws.  turns: (links, 3, 3), orientation, in the link before or
    the base, of what the joint is on.  loads: (links, 3, 3), sum of (vector of a body) x (force
    that it carries), so that the energy is -trace(load R).  moments: (links, 3), dead moments,
    N m, in base_link.  entries: (k,), link of each vector (k, 3) of a span, in its frame.
    spans: (spans, 3), tendon, first and last entry (exclusive).  constants: (spans, 3), the part
    of a span in base_link.  tables: as of _laws.  ratios: (spans,), tension of a span over that
    at the base.
    """

    joints: Array
    turns: Array
    loads: Array
    moments: Array
    entries: Integers
    vectors: Array
    spans: Integers
    constants: Array
    tables: Array
    ratios: Array


class Work(NamedTuple):
    """
    The linear system of one Newton step and its parts.

    gradient: (3 links,), unbalanced moments, N m, in the frames of the links.  band: (3 links,
    half + 1), entry (c + i, c) of its derivative at [c, i].  columns: (3 links, width), the rest
    of the system: by the tensions of the chosen tendons; where tendons rub, also their slopes;
    two across each span that the band does not hold, and for each dead moment; last the
    right-hand side.  products, matrix, judged: (width, width), small systems, and right (width,).
    chosen: (tendons,), those whose tensions are found; of_column: (width,), the tendon or span of
    each unknown.  units: (spans, 3), directions of the spans, and lengths (spans,); paths:
    (tendons,), of the tendons, m.
    levers: (2, BAND + 1, 3), room.
    """

    gradient: Array
    band: Array
    columns: Array
    products: Array
    matrix: Array
    judged: Array
    right: Array
    chosen: NDArray[np.bool_]
    of_column: Integers
    units: Array
    lengths: Array
    paths: Array
    levers: Array


@compiled
def work_arrays(system, tendons):  # type: ignore[no-untyped-def]
    """Return a Work for a System with so many tendons."""
    links, spans, reach, width = len(system.joints), len(system.spans), 1, 2 * tendons + 1
    for k in range(links):
        width += 2 if system.moments[k].any() else 0
    for s in range(spans):
        far = system.entries[system.spans[s, 2] - 1] - system.entries[system.spans[s, 1]]
        if far <= BAND:
            reach = max(reach, far)
        else:
            width += 2
    return Work(
        np.empty(3 * links), np.empty((3 * links, 3 * reach + 3)), np.empty((3 * links, width)),
        np.empty((width, width)), np.empty((width, width)), np.empty((width, width)),
        np.empty(width), np.zeros(tendons, np.bool_), np.empty(width, np.int64),
        np.empty((spans, 3)), np.empty(spans), np.empty(tendons), np.empty((2, BAND + 1, 3)))


@inlined
def add_vector(vector, times, gradient, k):  # type: ignore[no-untyped-def]
    """Add a vector, times a number, to the unbalanced moment of link k."""
    for i in range(3):
        gradient[3 * k + i] += times * vector[i]


@inlined
def add_block(m, band, k):  # type: ignore[no-untyped-def]
    """Add a symmetric matrix to the diagonal block of link k; its lower half counts."""
    c = 3 * k
    band[c, 0] += m[0]
    band[c, 1] += m[3]
    band[c, 2] += m[6]
    band[c + 1, 0] += m[4]
    band[c + 1, 1] += m[7]
    band[c + 2, 0] += m[8]


@inlined
def subtract_below(m, band, k):  # type: ignore[no-untyped-def]
    """Subtract a matrix from the derivative of link k by the link before."""
    for i in range(3):
        for j in range(3):
            band[3 * k - 3 + j, 3 + i - j] -= m[3 * i + j]


@borrowing
def springs(rotations, system, by_secant, gradient, band):  # type: ignore[no-untyped-def]
    """
    Add the moments of the joints and their derivatives.

    The energy of a joint depends on the rotation Q of a link from the one before: by the latter's
    increment it changes as by -Q' times that of the former.
    by_secant: with secants where laws soften, a majorant of the energy.
    """
    joints, turns, tables = system.joints, system.turns, system.tables
    for k in range(len(rotations)):
        rotation, turn = matrix_at(rotations, k), matrix_at(turns, k)
        if k > 0:
            rotation = multiply(transposed(matrix_at(rotations, k - 1)), rotation)
        angle = rotation_vector(multiply(transposed(turn), rotation))
        moment, (xx, xy, yy, zz) = joint_law(joints, k, angle, tables, by_secant)
        f, more = jacobian_terms(angle)
        j = inverse_jacobian(angle, f)
        g = apply(transposed(j), moment)
        s = turned_moment_slope(angle, moment, f, more)
        # (J^-T D + slope) J^-1, of which the symmetric part counts
        m = multiply((
            j[0] * xx + j[3] * xy + s[0], j[0] * xy + j[3] * yy + s[1], j[6] * zz + s[2],
            j[1] * xx + j[4] * xy + s[3], j[1] * xy + j[4] * yy + s[4], j[7] * zz + s[5],
            j[2] * xx + j[5] * xy + s[6], j[2] * xy + j[5] * yy + s[7], j[8] * zz + s[8]), j)
        p, q, r = 0.5 * (m[1] + m[3]), 0.5 * (m[2] + m[6]), 0.5 * (m[5] + m[7])
        add_vector(g, 1.0, gradient, k)
        add_block((m[0], p, q, p, m[4], r, q, r, m[8]), band, k)
        if k == 0:
            continue
        back = transposed(rotation)
        add_vector(apply(rotation, g), -1.0, gradient, k - 1)
        x, y, z = 0.5 * g[0], 0.5 * g[1], 0.5 * g[2]
        subtract_below(multiply((
            m[0], p - z, q + y, p + z, m[4], r - x, q - y, r + x, m[8]), back), band, k)
        add_block(multiply(rotation, multiply((m[0], p, q, p, m[4], r, q, r, m[8]), back)),
                  band, k - 1)


@borrowing
def dead_loads(rotations, system, gradient, band):  # type: ignore[no-untyped-def]
    """Add the moments of dead forces and moments, and the symmetric part of their derivatives."""
    moments = system.moments
    for k in range(len(rotations)):
        rotation = matrix_at(rotations, k)
        m = multiply(matrix_at(system.loads, k), rotation)  # sum of v (R^T w)^T
        x, y, z = apply(transposed(rotation), (moments[k, 0], moments[k, 1], moments[k, 2]))
        add_vector((m[5] - m[7] + x, m[6] - m[2] + y, m[1] - m[3] + z), -1.0, gradient, k)
        p, q, r = -0.5 * (m[1] + m[3]), -0.5 * (m[2] + m[6]), -0.5 * (m[5] + m[7])
        add_block((m[4] + m[8], p, q, p, m[0] + m[8], r, q, r, m[0] + m[4]), band, k)


@borrowing
def span_lengths(rotations, system, units, lengths, paths):  # type: ignore[no-untyped-def]
    """Write unit vector (spans, 3) and length of each span, and the path of each tendon."""
    entries, vectors, spans = system.entries, system.vectors, system.spans
    constants = system.constants
    for t in range(len(paths)):
        paths[t] = 0.0
    for s in range(len(spans)):
        x, y, z = constants[s, 0], constants[s, 1], constants[s, 2]
        for e in range(spans[s, 1], spans[s, 2]):
            a, b, c = apply(matrix_at(rotations, entries[e]),
                            (vectors[e, 0], vectors[e, 1], vectors[e, 2]))
            x += a
            y += b
            z += c
        length = sqrt(x * x + y * y + z * z)
        lengths[s] = length
        units[s, 0], units[s, 1], units[s, 2] = x / length, y / length, z / length
        paths[spans[s, 0]] += length


@inlined
def lever(way, rotations, system, e):  # type: ignore[no-untyped-def]
    """Return the motion of an entry of a span along a direction per turn of its link."""
    local = apply(transposed(matrix_at(rotations, system.entries[e])), way)
    vectors = system.vectors
    return cross((vectors[e, 0], vectors[e, 1], vectors[e, 2]), local)


@borrowing
def along_span(s, force, column, slope, rotations, system, work):  # type: ignore[no-untyped-def]
    """
    Add the force (N) along a span, and its derivative with a direction that stays.

    column, slope: of work.columns, which get the moments by the tension, and the slopes of the
    path where they differ; negative: none.
    """
    way = work.units[s, 0], work.units[s, 1], work.units[s, 2]
    entries, vectors, columns = system.entries, system.vectors, work.columns
    for e in range(system.spans[s, 1], system.spans[s, 2]):
        k = entries[e]
        x, y, z = vectors[e, 0], vectors[e, 1], vectors[e, 2]
        a, b, c = apply(transposed(matrix_at(rotations, k)), way)
        moment = cross((x, y, z), (a, b, c))
        for i in range(3):
            if column >= 0:
                columns[3 * k + i, column] += system.ratios[s] * moment[i]
            if slope > column:
                columns[3 * k + i, slope] += moment[i]
        if force != 0.0:
            add_vector(moment, force, work.gradient, k)
            p, q, r = (0.5 * force * (a * y + b * x), 0.5 * force * (a * z + c * x),
                       0.5 * force * (b * z + c * y))
            add_block((-force * (b * y + c * z), p, q, p, -force * (a * x + c * z), r,
                       q, r, -force * (a * x + b * y)), work.band, k)


@inlined
def across(x, y, z):  # type: ignore[no-untyped-def]
    """Return two unit vectors across a third (Duff et al. 2017, JCGT 6)."""
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return (1.0 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


@borrowing
def across_span(s, force, rotations, system, work):  # type: ignore[no-untyped-def]
    """Add how a force over the length (N/m) holds a short span against what is across it."""
    begin, end = system.spans[s, 1], system.spans[s, 2]
    entries, levers, band = system.entries, work.levers, work.band
    ways = across(work.units[s, 0], work.units[s, 1], work.units[s, 2])
    for e in range(begin, end):
        for w in range(2):
            moved = lever(ways[w], rotations, system, e)
            for i in range(3):
                levers[w, e - begin, i] = moved[i]
        for other in range(begin, e + 1):
            c, far = 3 * entries[other], 3 * (entries[e] - entries[other])
            for i in range(3):
                for j in range(3 if far > 0 else i + 1):
                    band[c + j, far + i - j] += force * (
                        levers[0, e - begin, i] * levers[0, other - begin, j]
                        + levers[1, e - begin, i] * levers[1, other - begin, j])


@borrowing
def choose(tension, system, work):  # type: ignore[no-untyped-def]
    """Make the columns zero; return how many tendons are chosen, and whether any rubs."""
    columns, chosen, rubs = work.columns, 0, False
    for s in range(len(system.spans)):
        if system.ratios[s] != 1.0:
            rubs = True
    for t in range(len(tension)):
        if work.chosen[t]:
            work.of_column[chosen] = t
            chosen += 1
    for row in range(columns.shape[0]):
        for c in range(columns.shape[1]):
            columns[row, c] = 0.0
    return chosen, rubs


@borrowing
def tendons(rotations, tension, system, work):  # type: ignore[no-untyped-def]
    """
    Add the tendons; return how many unknowns are tensions, and how many there are by now.

    The others are forces across long spans.  The last number is the shift of their columns:
    between them are the slopes of tendons that rub.
    """
    columns, spans, ratios, entries = work.columns, system.spans, system.ratios, system.entries
    chosen, rubs = choose(tension, system, work)
    unknowns, shift = chosen, chosen if rubs else 0
    for s in range(len(spans)):
        column, t = -1, spans[s, 0]
        for c in range(chosen):
            if work.of_column[c] == t:
                column = c
        force = tension[t] * ratios[s]
        if column < 0 and force == 0.0:
            continue
        along_span(s, force, column, column + shift if column >= 0 else -1, rotations, system,
                   work)
        if force == 0.0:
            continue
        if entries[spans[s, 2] - 1] - entries[spans[s, 1]] <= BAND:
            across_span(s, force / work.lengths[s], rotations, system, work)
            continue
        ways = across(work.units[s, 0], work.units[s, 1], work.units[s, 2])
        for w in range(2):
            for e in range(spans[s, 1], spans[s, 2]):
                moved = lever(ways[w], rotations, system, e)
                for i in range(3):
                    columns[3 * entries[e] + i, shift + unknowns] += moved[i]
            work.of_column[unknowns] = s
            unknowns += 1
    return chosen, unknowns, shift


@borrowing
def dead_moments(rotations, system, used, work):  # type: ignore[no-untyped-def]
    """
    Add what is antisymmetric in the derivatives of dead moments m; return the columns used.

    That is -[m] / 2, and by two directions p, q across m: |m| (p q' - q p') / 2.
    """
    moments = system.moments
    for k in range(len(rotations)):
        x, y, z = moments[k, 0], moments[k, 1], moments[k, 2]
        size = sqrt(x * x + y * y + z * z)
        if size == 0.0:
            continue
        way = apply(transposed(matrix_at(rotations, k)), (x / size, y / size, z / size))
        one, other = across(way[0], way[1], way[2])
        for i in range(3):
            work.columns[3 * k + i, used] = one[i]
            work.columns[3 * k + i, used + 1] = other[i]
        work.right[used] = work.right[used + 1] = 2.0 / size
        used += 2
    return used


@borrowing
def assemble(rotations, tension, system, by_secant, work):  # type: ignore[no-untyped-def]
    """Fill ``work`` at a state; return what ``tendons`` does."""
    band = work.band
    for row in range(band.shape[0]):
        work.gradient[row] = 0.0
        for i in range(band.shape[1]):
            band[row, i] = 0.0
    springs(rotations, system, by_secant, work.gradient, band)
    dead_loads(rotations, system, work.gradient, band)
    span_lengths(rotations, system, work.units, work.lengths, work.paths)
    return tendons(rotations, tension, system, work)


@compiled
def balance(rotations, tension, system):  # type: ignore[no-untyped-def]
    """Return the unbalanced moments, (3 links,), N m, in the frames of the links."""
    system = System(*system)
    work = work_arrays(system, len(tension))
    assemble(rotations, tension, system, False, work)
    return work.gradient


@compiled
def linearise(rotations, tension, system):  # type: ignore[no-untyped-def]
    """
    Return the derivative of the unbalanced moments, with tensions that stay.

    That is a band as in Work, and columns (3 links, c) times forces (c,) in N/m times the same
    columns.  Last the derivatives by the tensions, and the slopes of the paths, (3 links,
    tendons), m.
    """
    system = System(*system)
    count = len(tension)
    work = work_arrays(system, count)
    for t in range(count):
        work.chosen[t] = True
    _, unknowns, shift = assemble(rotations, tension, system, False, work)
    forces = np.empty(unknowns - count)
    for c in range(count, unknowns):
        s = work.of_column[c]
        forces[c - count] = tension[system.spans[s, 0]] * system.ratios[s] / work.lengths[s]
    return (work.band, work.columns[:, shift + count:shift + unknowns].copy(), forces,
            work.columns[:, :count].copy(), work.columns[:, shift:shift + count].copy())
