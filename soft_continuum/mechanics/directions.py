# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Bending as angle and direction, and the directions in which a segment can bend.

A segment that bends by the angle a in the direction d leans towards d, about z from x of the disc
below; its rotation vector is a (-sin d, cos d).
"""

from collections.abc import Sequence
from math import cos, degrees, isfinite, sin

import numpy as np

from soft_continuum.mechanics._checks import bending_of, listed, real_array
from soft_continuum.mechanics.arm import Arm, Array

STRAIGHT = 1e-6  # rad: what bends by less, as rounding bends, has the direction 0
ONE_PLANE = 1e-3  # least over largest singular value of what tendons do to a segment
ALONG = 1e-3  # rad: a direction this close to a plane is in it
ONE_LINE = 1e-6  # rad: directions this close are parallel


def bending_towards(directions: Array) -> Array:
    """Return the bendings of 1 rad in directions (...), rad: (..., 2), rad."""
    return np.stack([-np.sin(directions), np.cos(directions)], axis=-1)


def bending_vectors(arm: Arm, angles: Sequence[float], directions: Sequence[float]
                    ) -> Array:
    """
    Return the bending (segments, 2), rad, of angles and directions (segments,), rad.

    directions: empty means 0 for every segment.  About rigid axes the bending is exactly 0.
    Raises ValueError for other sizes.
    """
    count = len(arm.segments)
    sizes, towards = (real_array(given, f'{name} must be numbers (rad)')
                      for name, given in (('angles', angles), ('directions', directions)))
    if sizes.shape != (count,) or towards.size and towards.shape != (count,):
        raise ValueError(f'angles and directions must be one number (rad) for each of the {count} '
                         f'segments; given: {angles!r}, {directions!r}')
    towards = towards if towards.size else np.zeros(count)
    vectors = sizes[:, None] * bending_towards(towards)
    return np.where(arm.bending_axes, vectors, 0.0)


def own_axes(arm: Arm) -> Array:
    """
    Return two bendings at right angles, (2, 2), of length 1, that follow the arm's symmetry.

    The second is towards the first tendon or load beside the axis, the first across that, with
    the sign of the side of the next one: they turn and are mirrored with the arm.
    """
    beside = [np.array(place) for place in (
        *(arm.places(t, (0.0,))[0, 0] for t in range(len(arm.tendons))),
        *(wrench.force[:2] for wrench in arm.wrenches),
        *((wrench.moment[1], -wrench.moment[0]) for wrench in arm.wrenches),
        arm.gravity[:2])]
    ways = [way / np.linalg.norm(way) for way in beside if np.linalg.norm(way) > 0.0]
    x, y = ways[0] if ways else (1.0, 0.0)
    sides = [side for way in ways if abs(side := x * way[1] - y * way[0]) > ONE_LINE]
    side = np.copysign(1.0, sides[0]) if sides else -1.0
    return np.array([[side * x, side * y], [-y, x]])


def hinged(arm: Arm) -> bool:
    """Return whether each segment bends about one axis, so that an angle gives its bending."""
    return bool(np.all(arm.bending_axes.sum(axis=1) == 1))


def within_limits(bending: Array, limits: Array) -> Array:
    """Return bending (..., segments, 2), rad, clipped to the limits (segments,), rad."""
    sizes = np.linalg.norm(bending, axis=-1)
    return np.asarray(bending * (limits / np.maximum(sizes, limits))[..., None])


def bending_directions(bending: Array) -> Array:
    """Return the directions (segments,), rad, -pi to pi, of bending (segments, 2), rad."""
    bending = bending_of(bending, len(listed(bending)))
    directions = np.arctan2(-bending[:, 0], bending[:, 1])
    return np.where(np.linalg.norm(bending, axis=1) > STRAIGHT, directions, 0.0)


def direction_problem(arm: Arm, segment: int, direction: float) -> str:
    """
    Return why a segment (0-based) cannot bend in a direction (rad); empty if none is known.

    Tension, gravity and stability are not considered; the statics check them.
    """
    places = np.array([place for t, end in enumerate(arm.tendon_ends) if end > segment
                       for place in arm.places(t, (0.0, 0.5, 1.0))[segment]])
    if not len(places):
        return f'no tendon passes segment {segment + 1}, so its bending cannot be set'
    about_x, about_y = arm.bending_axes[segment]
    if about_x and about_y:
        values, axes = np.linalg.svd(places)[1:]
        if values[0] > 0.0 and values[1] >= ONE_PLANE * values[0]:
            return ''
        plane, why = axes[0], 'the tendons that pass it lie in one plane'
    else:
        plane, why = np.array([1.0, 0.0] if about_y else [0.0, 1.0]), 'it is a hinge'
    if abs(plane[0] * sin(direction) - plane[1] * cos(direction)) <= ALONG:
        return ''
    one = degrees(np.arctan2(plane[1], plane[0])) % 180.0
    shown = f'{degrees(direction):.4g}' if isfinite(direction) else f'{direction}'
    return (f'segment {segment + 1} cannot bend in the direction {shown} degrees: {why}; '
            f'allowed: {one:.4g} and {one + 180.0:.4g} degrees')
