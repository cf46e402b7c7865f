# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Self-contact and winding of an arm, which the statics do not model.

A backbone with a radius is a tube of capsules, one for each body.  Bodies nearer along the
backbone than half the circumference of the tube are neighbours and not checked: the sharpest
turn of a tube keeps those farther along at least a diameter apart (Gonzalez and
Maddocks, Global curvature, thickness, and the ideal shapes of knots, PNAS 96, 1999).
"""

from math import pi

import numpy as np

from soft_continuum.mechanics._checks import finite
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import check_start, Equilibrium
from soft_continuum.mechanics.statics import Booleans


def self_intersections(state: Equilibrium, radius: float) -> list[tuple[int, int]]:
    """
    Return the pairs of parts of an arm with a radius (m) that collide, the lower part first.

    Parts count from the base: 0 is the base disc, 1 the first segment, 2 the disc above it, and
    so on.  Raises ValueError for a radius that is not a positive number.
    """
    if not (finite(radius) and radius > 0.0):
        raise ValueError(f'the radius must be a positive number in m; given: {radius!r}')
    check_start(state, 'state')
    chain = state.chain
    n = chain.arm.bodies_per_segment
    points = np.concatenate([np.zeros((1, 3)), state.backbone])
    lengths = np.concatenate([[chain.arm.discs[0].height], chain.body_lengths])
    parts = np.concatenate([[0], *(
        [[2 * s + 1] * n + [2 * s + 2] for s in range(chain.segments)])])
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    one, other = np.triu_indices(len(lengths), 1)
    apart = along[other] - along[one + 1] >= pi * radius
    one, other = one[apart], other[apart]
    near = _distances(points[one], points[one + 1], points[other], points[other + 1]) < (
        2.0 * radius)
    pairs = {(int(parts[a]), int(parts[b])) for a, b in zip(one[near], other[near], strict=True)}
    return sorted(pairs)


def exceeds_pi(state: Equilibrium) -> Booleans:
    """
    Return which segments are bent by more than pi, (segments,).

    ``Equilibrium.bending`` cannot show this: it is the shorter rotation from disc to disc.
    Here the bending of all joints of a segment is summed.
    """
    check_start(state, 'state')
    each = state.chain.summed(state.joint_angles)
    found: Booleans = np.linalg.norm(each, axis=1) > pi
    return found


def _distances(start: Array, end: Array, other_start: Array, other_end: Array) -> Array:
    """Return distances (n,) m of line segments (n, 3): Ericson, Real-Time Collision Detection."""
    d, e, r = end - start, other_end - other_start, start - other_start
    a, f = _dot(d, d), _dot(e, e)
    b, c, g = _dot(d, e), _dot(d, r), _dot(e, r)
    tiny = 1e-18  # m^2: a disc without height is a point
    across = a * f - b * b
    s = np.where(across > 1e-12 * a * f, (b * g - c * f) / np.maximum(across, tiny**2), 0.0)
    s = np.where(a > tiny, np.clip(s, 0.0, 1.0), 0.0)
    t = np.where(f > tiny, np.clip((b * s + g) / np.maximum(f, tiny), 0.0, 1.0), 0.0)
    s = np.where(a > tiny, np.clip((b * t - c) / np.maximum(a, tiny), 0.0, 1.0), 0.0)
    found: Array = np.linalg.norm(r + s[:, None] * d - t[:, None] * e, axis=1)
    return found


def _dot(one: Array, other: Array) -> Array:
    found: Array = np.einsum('ij,ij->i', one, other)
    return found
