# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Arms for the tests of all that goes beyond the paper: the paper's, simple ones, random ones."""

from math import inf, pi

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from soft_continuum.mechanics import SLACK
from soft_continuum.mechanics.arm import Disc, PAPER, SECOND_ORDER, Segment
from soft_continuum.mechanics.laws import Jam
from support.flat_arm import flat_arm, guides_of, made_of

FEW, MODERATE = (settings(max_examples=examples, suppress_health_check=[
    HealthCheck.too_slow, HealthCheck.filter_too_much]) for examples in (20, 40))

RIGID = Jam()
STIFFNESS = (0.0265, 0.0091, 0.0033)  # N m^2, E I of the paper's segments
DIAMETER = (0.050, 0.0425, 0.035)  # m


def paper_like(segments=3, jam=RIGID, soft_law=None, bodies=5, gravity=0.0, **changes):
    """Return an arm with the paper's proportions and 1 to 6 segments, weightless by default."""
    kinds = [min(i, 2) for i in range(segments)]
    return flat_arm(
        [Segment.leaf_spring(0.07, STIFFNESS[i], 0.05, soft_law=soft_law, jam=jam) for i in kinds],
        [(DIAMETER[i] / 2,) * 2 for i in kinds], [Disc(0.03, 0.04)] * (segments + 1),
        bodies_per_segment=bodies, gravity=gravity, **changes)


def between(low, high):
    """Return a strategy for numbers from ``low`` to ``high`` without odd corner values."""
    return st.integers(0, 1000).map(lambda i: low + (high - low) * i / 1000)


@st.composite
def masks(draw, arm):
    """Return soft flags with at least one segment soft."""
    count = len(arm.segments)
    soft = [draw(st.booleans()) for _ in range(count)]
    soft[draw(st.integers(0, count - 1))] = True
    return tuple(soft)


@st.composite
def arms(draw, jam=RIGID, segments=(1, 4), bodies=(1, 5), load=(0.0, 1.0), stretch=False,
         friction=False):
    """
    Return a random arm that stands by itself with all segments soft.

    jam: of every segment, or a strategy for it.  load: range of weight times length squared over
    the softest E I.
    """
    count = draw(st.integers(*segments))
    lengths = [draw(between(0.04, 0.12)) for _ in range(count)]
    heights = [draw(between(0.005, 0.04)) for _ in range(count + 1)]
    masses = [draw(between(0.0, 0.08)) for _ in range(2 * count + 1)]
    softest = max(0.002, 9.80665 * sum(masses) * (sum(lengths) + sum(heights))**2
                  / max(draw(between(*load)), 0.1))
    softest = min(softest, 20.0)
    parts, offsets = [], []
    for i, length in enumerate(lengths):
        offsets.append([draw(between(0.15, 0.4)) * length for _ in range(2)])
        parts.append(Segment.leaf_spring(
            length, softest * draw(between(1.0, 4.0)), masses[i],
            jam=draw(jam) if isinstance(jam, st.SearchStrategy) else jam))
    tendon = made_of(
        axial_stiffness=draw(st.sampled_from([inf, 1e3, 1e5])) if stretch else inf,
        free_length=draw(between(0.0, 1.0)) if stretch else 0.0,
        friction=draw(between(0.0, 0.3)) if friction else 0.0)
    return flat_arm(
        parts, offsets, [Disc(h, m) for h, m in zip(heights, masses[count:], strict=True)],
        bodies_per_segment=draw(st.integers(*bodies)),
        discretisation=draw(st.sampled_from([PAPER, SECOND_ORDER])), tendon=tendon,
        mounting_angle=draw(between(-pi, pi)), gravity=draw(st.sampled_from([0.0, 9.80665])))


@st.composite
def pulls(draw, arm, state, soft, most=0.5, both=False):
    """
    Return pulls of one tendon that turn all soft segments by up to ``most`` rad each.

    both: of two tendons as well, of which one is paid out by up to 30 % more than it follows.
    """
    moving = soft if any(soft) else (True,) * len(soft)
    reach = sum(min(pair) for pair, free in zip(guides_of(arm), moving, strict=True) if free)
    one = draw(between(-0.2, most)) * reach
    follow = -abs(one) * draw(between(1.0, 1.3)) - 1e-4 if both and draw(st.booleans()) else SLACK
    right, left = (float(pull) for pull in state.pulls)
    if draw(st.booleans()):
        return right + one, left + follow
    return right + follow, left + one
