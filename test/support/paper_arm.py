# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's arm (Table I, section II) and the way its shapes are set."""

from math import radians

import numpy as np

from soft_continuum.mechanics import Disc, LEFT, RIGHT, Segment, SLACK
from support.flat_arm import flat_arm

YOUNGS_MODULUS = 200e9  # Pa
LEAF_WIDTH = 0.0127  # m
LEAF_THICKNESS = (0.50e-3, 0.35e-3, 0.25e-3)  # m
OUTER_DIAMETER = (0.050, 0.0425, 0.035)  # m

# Not published: estimated from the geometry (docs/explanation/mechanics.md).
SEGMENT_MASS = (0.069, 0.050, 0.034)  # kg
DISC_MASS = (0.060, 0.060, 0.045, 0.033)  # kg, base first

ANGLE = radians(36.0)
FORMS = {'C': (1, 1, 1), 'upright C': (-1, 1, 1), 'S': (1, -1, 1)}


def build(mass_factor=1.0, **changes):
    """Return the paper's arm with its estimated masses times ``mass_factor``."""
    segments = [
        Segment.leaf_spring(0.07, YOUNGS_MODULUS * LEAF_WIDTH * t**3 / 12, m * mass_factor)
        for t, m in zip(LEAF_THICKNESS, SEGMENT_MASS, strict=True)]
    return flat_arm(segments, [(d / 2, d / 2) for d in OUTER_DIAMETER],
                    [Disc(0.03, m * mass_factor) for m in DISC_MASS], **changes)


def only(segment, segments=3):
    """Return the mask in which only ``segment`` (0-based) is soft."""
    return tuple(i == segment for i in range(segments))


def set_form(statics, signs, angle=ANGLE):
    """Return the states after each segment in turn was softened, bent and stiffened."""
    state, states = statics.chain.straight(), []
    for segment, sign in enumerate(signs):
        state = statics.bend(state, segment, sign * angle)
        states.append(state)
    return states


def pulls_of_each_step(statics, states, signs):
    """Return by how much the pulled tendon was shortened while each segment moved, m."""
    before, steps = statics.chain.straight(), []
    for state, sign in zip(states, signs, strict=True):
        tendon = RIGHT if sign > 0 else LEFT
        steps.append(state.pulls[tendon] - before.pulls[tendon])
        before = state
    return steps


def apply_pulls(statics, steps, signs):
    """Return the states reached by given pulls per segment, the other tendon not modelled."""
    state, states = statics.chain.straight(), []
    for segment, (step, sign) in enumerate(zip(steps, signs, strict=True)):
        tendon = RIGHT if sign > 0 else LEFT
        pulls = [SLACK, SLACK]
        pulls[tendon] = state.pulls[tendon] + step
        state = statics.solve(state, pulls, only(segment))
        states.append(state)
    return states


def degrees_of(statics, state):
    """Return the bending angle of each segment in degrees."""
    return np.degrees(state.bending_angles)


def position_errors(statics, state, other_statics, other):
    """Return the distances (m) between calculation points, and theirs (m) from the base."""
    points, true = state.points[1:], other.points[1:]
    return np.linalg.norm(points - true, axis=1), np.linalg.norm(true, axis=1)


def plane_points(state):
    """Return x and z, m, and angle, rad, of the points of a state of a planar arm."""
    return state.chain.plane_points(state.configuration)
