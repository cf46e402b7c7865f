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
from support.random_arms import between, masks  # noqa: F401  # for the same tests

FEW = settings(max_examples=25, suppress_health_check=[
    HealthCheck.too_slow, HealthCheck.filter_too_much])

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
def pulls(draw, arm, state, soft, most=0.5):
    """Return pulls of one tendon that turn all soft segments by up to ``most`` rad each."""
    moving = soft if any(soft) else (True,) * len(soft)
    reach = sum(min(pair) for pair, free in zip(guides_of(arm), moving, strict=True) if free)
    one = draw(between(-0.2, most)) * reach
    if draw(st.booleans()):
        return float(state.pulls[0]) + one, SLACK
    return SLACK, float(state.pulls[1]) + one
