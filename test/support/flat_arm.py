# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Planar arms for tests, in the numbers of the paper: offsets of guides, and an angle."""

from dataclasses import replace
from math import cos, inf, sin

import numpy as np

from soft_continuum.mechanics.arm import Arm, mounted, STANDARD_GRAVITY, tendon_pair


def made_of(axial_stiffness=inf, free_length=0.0, friction=0.0):
    """Return what both tendons are made of, as ``flat_arm`` and Arm.with_tendons take it."""
    return {'axial_stiffness': axial_stiffness, 'free_length': free_length, 'friction': friction}


def flat_arm(segments, offsets, discs, tendon=None, mounting_angle=0.0, gravity=STANDARD_GRAVITY,
             **changes):
    """
    Return a planar arm of leaf springs.

    offsets: m, of all guides, or of those at the lower and the upper end of each segment.
    mounting_angle: rad from upright.  gravity: m/s^2.
    """
    segments = tuple(segments)
    if not isinstance(offsets, float):
        offsets = tuple(offset for pair in offsets for offset in pair)
    return Arm(segments, tuple(discs),
               tendon_pair(offsets, len(segments), **(tendon or {})),
               gravity=mounted(mounting_angle, gravity), **changes)


def guides_of(arm):
    """Return the offsets of the guides at the lower and the upper end of each segment, m."""
    return [tuple(arm.tendons[0].offset_at(s, part) for part in (0.0, 1.0))
            for s in range(len(arm.segments))]


def path_compliance(arm):
    """Return by how much a tendon stretches per tension from stepper to tip, straight, m/N."""
    length = (sum((s.length**2 + (upper - lower)**2)**0.5
                  for s, (lower, upper) in zip(arm.segments, guides_of(arm), strict=True))
              + sum(d.height for d in arm.discs) + arm.tendons[0].free_length)
    return length / arm.tendons[0].axial_stiffness


def of_segments(arm, which, **changes):
    """Return a planar arm of some segments of another (0-based), and of the discs above them."""
    offsets = tuple(offset for s in which for offset in guides_of(arm)[s])
    return replace(
        arm, segments=tuple(arm.segments[s] for s in which),
        discs=(arm.discs[0], *(arm.discs[1 + s] for s in which)),
        tendons=tuple(replace(tendon, offset=offsets, end=len(which)) for tendon in arm.tendons),
        **changes)


def arcs_of(arm, angles):
    """Return bottom and top of every disc, x, z (m) and angle (rad), by chords of arcs."""
    x, z, turned, points = 0.0, 0.0, 0.0, []
    for k, disc in enumerate(arm.discs):
        points.append((x, z, turned))
        x, z = x + disc.height * sin(turned), z + disc.height * cos(turned)
        points.append((x, z, turned))
        if k < len(arm.segments):
            half = angles[k] / 2.0
            chord = arm.segments[k].length * (sin(half) / half if half else 1.0)
            x, z = x + chord * sin(turned + half), z + chord * cos(turned + half)
            turned += angles[k]
    return np.array(points)


def about_y(angles):
    """Return angles (segments,) as bending (segments, 2), rad."""
    return np.column_stack([np.zeros(len(angles)), angles])
