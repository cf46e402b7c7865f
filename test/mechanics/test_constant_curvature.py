# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Arcs of constant curvature: geometry, pulls, and their inverse."""

from math import cos, pi, sin

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import (
    ArmError,
    constant_curvature,
    Disc,
    Segment,
)
from soft_continuum.mechanics.plane.chain import PlaneChain
from support import paper_arm as paper
from support.flat_arm import about_y, arcs_of, flat_arm, guides_of
from support.random_arms import arms, between, MODERATE


def one_segment(length, limit):
    return flat_arm([Segment.leaf_spring(length, 0.02, bending_angle_limit=limit)], 0.025,
                    [Disc(0.03)] * 2)


def drawn(arm, angle):
    """Return right and left span by drawing the arc: its end point, then the four guides."""
    segment = arm.segments[0]
    if abs(angle) < 1e-12:
        x, z = 0.0, segment.length
    else:
        radius = segment.length / angle
        x, z = radius * (1 - cos(angle)), radius * sin(angle)
    (lower, upper), = guides_of(arm)
    spans = []
    for side in (1, -1):
        dx = x + side * upper * cos(angle) - side * lower
        dz = z - side * upper * sin(angle)
        spans.append(np.hypot(dx, dz))
    return spans


@MODERATE
@given(arms(segments=(1, 1)), between(-2.0, 2.0))
def test_pulls_are_those_of_guides_drawn_on_an_arc(arm, angle):
    expected = np.array(drawn(arm, 0.0)) - drawn(arm, angle)
    assert constant_curvature.pulls(arm, about_y([angle])) == pytest.approx(expected, abs=1e-14)


def test_an_angle_near_zero_joins_smoothly():
    for angle in (1.9e-4, 2.0e-4, 2.1e-4, 1e-9, 0.0):
        exact = 0.07 * (1.0 - (angle / 2)**2 / 6 + (angle / 2)**4 / 120)
        assert constant_curvature.chord(0.07, angle) == pytest.approx(exact, rel=1e-15)


@MODERATE
@given(arms(segments=(1, 1)), between(-1.5, 1.5))
def test_the_bending_angle_is_recovered_from_the_pull(arm, angle):
    pull, _ = constant_curvature.pulls(arm, about_y([angle]))
    found = constant_curvature.bending_angle(arm, 0, pull)
    # A slender segment has two angles of the same pull: the smaller one counts.
    assert constant_curvature.pulls(arm, about_y([found]))[0] == pytest.approx(pull, abs=1e-12)
    assert abs(found) <= abs(angle) + 1e-9


def test_a_pull_beyond_the_bending_angle_limit_is_refused():
    arm = paper.build()
    most, _ = constant_curvature.pulls(
        arm, about_y([arm.segments[0].bending_angle_limit, 0.0, 0.0]))
    with pytest.raises(ArmError, match='allowed'):
        constant_curvature.bending_angle(arm, 0, most + 1e-6)
    with pytest.raises(ArmError, match='allowed'):
        constant_curvature.bending_angle(arm, 0, float('nan'))


def test_a_pull_within_the_limit_has_the_smallest_angle_that_gives_it():
    # Wide guides meet before the limit: beyond, the same pull belongs to a second, useless angle.
    arm = one_segment(0.03, pi / 2)
    for angle in (0.3, 0.8, 1.1):
        pull, _ = constant_curvature.pulls(arm, about_y([angle]))
        assert constant_curvature.bending_angle(arm, 0, pull) == pytest.approx(angle, abs=1e-9)


def test_a_limit_of_a_full_turn_leaves_small_pulls_allowed():
    arm = one_segment(0.07, 2 * pi)
    pull, _ = constant_curvature.pulls(arm, about_y([0.6]))
    assert constant_curvature.bending_angle(arm, 0, pull) == pytest.approx(0.6, abs=1e-9)


@MODERATE
@given(arms(segments=(2, 4), bodies=(400, 400)), st.data())
def test_the_chain_with_many_even_joints_lies_on_the_arcs(arm, data):
    angles = [data.draw(between(-1.2, 1.2)) for _ in arm.segments]
    chain = PlaneChain(arm)
    state = chain.uniform(angles)
    arcs, _ = constant_curvature.poses(arm, about_y(angles))
    assert state.poses[:, :3] == pytest.approx(arcs, abs=2e-4)
    assert state.pulls == pytest.approx(constant_curvature.pulls(arm, about_y(angles)), abs=2e-4)


def test_calculation_points_of_the_straight_arm():
    points, _ = constant_curvature.poses(paper.build(), np.zeros((3, 2)))
    assert points[:, 2] == pytest.approx([0.0, 0.03, 0.1, 0.13, 0.2, 0.23, 0.3, 0.33])
    assert np.all(points[:, :2] == 0.0)


@MODERATE
@given(arms(segments=(1, 4)), st.data())
def test_discs_are_on_chords_of_arcs(arm, data):
    angles = [data.draw(between(-2.5, 2.5)) for _ in arm.segments]
    points, turns = constant_curvature.poses(arm, about_y(angles))
    arcs = arcs_of(arm, angles)
    assert points[:, [0, 2]] == pytest.approx(arcs[:, :2], abs=1e-14)
    assert turns[:, 0, 2] == pytest.approx(np.sin(arcs[::2, 2]), abs=1e-14)
    tip, turn = constant_curvature.tips(arm, about_y(angles))
    assert np.array_equal(tip, points[-1]) and np.array_equal(turn, turns[-1])
