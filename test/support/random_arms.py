# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Random arms, masks and pulls of every kind, for hypothesis."""

from math import pi

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from soft_continuum.mechanics import Disc, Segment, SLACK
from support.flat_arm import flat_arm, guides_of

MODERATE = settings(max_examples=40, suppress_health_check=[
    HealthCheck.too_slow, HealthCheck.filter_too_much])


def between(low, high):
    """Return a strategy for numbers from ``low`` to ``high`` without odd corner values."""
    return st.integers(0, 1000).map(lambda i: low + (high - low) * i / 1000)


@st.composite
def arms(draw, load=(0.0, 2.0), bodies=(1, 8), segments=(1, 6)):
    """
    Return a random arm whose guides cannot meet below 140 degrees of bending.

    load: range of weight times length squared over the softest E I; the arm has one equilibrium
    without tendons up to about 2.
    """
    count = draw(st.integers(*segments))
    lengths = [draw(between(0.04, 0.12)) for _ in range(count)]
    offsets = [(draw(between(0.15, 0.4)) * length, draw(between(0.15, 0.4)) * length)
               for length in lengths]
    segment_masses = [draw(between(0.0, 0.08)) for _ in range(count)]
    disc_masses = [draw(between(0.0, 0.08)) for _ in range(count + 1)]
    heights = [draw(between(0.005, 0.04)) for _ in range(count + 1)]
    weight = 9.80665 * (sum(segment_masses) + sum(disc_masses[1:]))
    reach = sum(lengths) + sum(heights[1:])
    ratio = draw(between(*load))
    softest = weight * reach**2 / ratio if weight * ratio > 1e-3 else 0.02
    softest = min(max(softest, 0.002), 20.0)
    stiffness = [softest * draw(between(1.0, 4.0)) for _ in range(count)]
    return flat_arm(
        [Segment.leaf_spring(*values) for values in zip(
            lengths, stiffness, segment_masses, strict=True)], offsets,
        [Disc(*values) for values in zip(heights, disc_masses, strict=True)],
        bodies_per_segment=draw(st.integers(*bodies)),
        mounting_angle=draw(between(-pi, pi)),
        gravity=draw(st.sampled_from([0.0, 9.80665])))


@st.composite
def masks(draw, arm):
    """Return soft flags with at least one segment soft."""
    count = len(arm.segments)
    soft = [draw(st.booleans()) for _ in range(count)]
    soft[draw(st.integers(0, count - 1))] = True
    return tuple(soft)


@st.composite
def pulls(draw, arm, soft, state, tendons=None):
    """
    Return pulls for the right, the left or both tendons, from the state on.

    They turn every soft segment by up to half a radian more; of both tendons the antagonist is
    paid out by up to 30 % more or less than it would have to follow.
    """
    which = draw(st.sampled_from(['right', 'left', 'both'])) if tendons is None else tendons
    reach = sum(min(pair) for pair, free in zip(guides_of(arm), soft, strict=True) if free)
    pull = draw(between(-0.25, 0.5)) * reach
    right, left = (float(p) for p in state.pulls)
    if which == 'right':
        return right + pull, SLACK
    if which == 'left':
        return SLACK, left + pull
    follow = -abs(pull) * draw(between(1.0, 1.3)) - 1e-4
    return draw(st.sampled_from([(right + pull, left + follow), (right + follow, left + pull)]))
