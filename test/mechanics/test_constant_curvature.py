# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Arcs of constant curvature: geometry, pulls and their inverse, in the plane and in space."""

from dataclasses import replace
from math import cos, inf, nan, pi, sin

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import ArmError, constant_curvature, Disc, Segment, Tendon
from soft_continuum.mechanics.constant_curvature import fully_actuated
from soft_continuum.mechanics.space.chain import SpaceChain
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import description_file
from support import paper_arm as paper
from support.flat_arm import about_y, arcs_of, flat_arm, guides_of, of_segments
from support.general_arms import arms, between, FEW
from support.spatial_arms import in_space, three_segments


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


@FEW
@given(arms(segments=(1, 1)), between(-2.0, 2.0))
def test_pulls_are_those_of_guides_drawn_on_an_arc(arm, angle):
    expected = np.array(drawn(arm, 0.0)) - drawn(arm, angle)
    assert constant_curvature.pulls(arm, about_y([angle])) == pytest.approx(expected, abs=1e-14)


def test_an_angle_near_zero_joins_smoothly():
    for angle in (1.9e-4, 2.0e-4, 2.1e-4, 1e-9, 0.0):
        exact = 0.07 * (1.0 - (angle / 2)**2 / 6 + (angle / 2)**4 / 120)
        assert constant_curvature.chord(0.07, angle) == pytest.approx(exact, rel=1e-15)


@FEW
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


@FEW
@given(arms(segments=(1, 4)), st.data())
def test_discs_are_on_chords_of_arcs(arm, data):
    angles = [data.draw(between(-2.5, 2.5)) for _ in arm.segments]
    points, turns = constant_curvature.poses(arm, about_y(angles))
    arcs = arcs_of(arm, angles)
    assert points[:, [0, 2]] == pytest.approx(arcs[:, :2], abs=1e-14)
    assert turns[:, 0, 2] == pytest.approx(np.sin(arcs[::2, 2]), abs=1e-14)
    tip, turn = constant_curvature.tips(arm, about_y(angles))
    assert np.array_equal(tip, points[-1]) and np.array_equal(turn, turns[-1])


# In space

ANGLES = (0.6, -0.4, 1.1)
BENDING = ((0.3, 0.5), (-0.8, 0.1), (0.2, -0.6))


@pytest.mark.parametrize('angle', [0.3, 2.0, -1.2])
def test_in_any_plane_it_is_the_planar_one_turned(angle):
    flat, turn = paper.build(), Rotation.from_euler('z', angle)
    solid = in_space(flat)
    solid = replace(solid, tendons=tuple(replace(t, angle=t.angle + angle) for t in solid.tendons))
    bending = turn.apply([(0.0, a, 0.0) for a in ANGLES])[:, :2]
    assert constant_curvature.pulls(solid, bending) == pytest.approx(
        constant_curvature.pulls(flat, about_y(ANGLES)), abs=1e-14)
    there = turn.inv().apply(constant_curvature.poses(solid, bending)[0])
    assert there[:, [0, 2]] == pytest.approx(arcs_of(flat, ANGLES)[:, :2], abs=1e-14)
    assert there[:, 1] == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize('spacers', [0, 3])
@pytest.mark.parametrize('twist', [0.0, 15.0])
def test_a_chain_of_many_even_bodies_lies_on_the_arcs(spacers, twist):
    arm = three_segments(tendons=5, spacers=spacers, bodies_per_segment=400)
    arm = replace(arm, tendons=(*(replace(t, twist=twist) for t in arm.tendons[:4]),
                                replace(arm.tendons[4], end=2, offset=(0.02, 0.015, 0.01, 0.01))))
    chain = SpaceChain(arm)
    state = chain.uniform(BENDING)
    points, orientations = constant_curvature.poses(arm, BENDING)
    assert points == pytest.approx(state.points, abs=2e-4)
    assert orientations == pytest.approx(state.orientations, abs=1e-12)
    assert constant_curvature.pulls(arm, BENDING) == pytest.approx(state.pulls, abs=2e-4)


@pytest.mark.parametrize('about', [(1.0, 1.0), (0.0, 1.0)], ids=['about x and y', 'about y'])
def test_many_shapes_at_once_are_as_one_by_one(about):
    arm = three_segments()
    many = about * np.random.default_rng(0).uniform(-1.5, 1.5, (2, 4, 3, 2))
    points, orientations = constant_curvature.poses(arm, many)
    assert points.shape == (2, 4, 8, 3)
    alone = constant_curvature.poses(arm, many[1, 2])
    assert points[1, 2] == pytest.approx(alone[0], abs=1e-15)
    assert orientations[1, 2] == pytest.approx(alone[1], abs=1e-15)
    with pytest.raises(ArmError, match='one shape at a time'):
        constant_curvature.pulls(arm, many)


@pytest.mark.parametrize('tendons', [2, 3, 4, 6])
def test_pulls_are_those_of_arcs_and_the_other_way_round(tendons):
    turn = 0.4 if tendons != 2 else 0.0
    arm = three_segments(turn, tendons=tendons)
    if tendons == 2:
        arm = replace(arm, tendons=(arm.tendons[0], replace(arm.tendons[1], angle=pi / 2)))
    soft = (False, True, False)
    found = constant_curvature.bending(
        arm, constant_curvature.pulls(arm, BENDING), [BENDING[0], (0.0, 0.0), BENDING[2]], soft)
    assert found == pytest.approx(np.array(BENDING), abs=1e-9)


def test_nine_tendons_determine_three_segments_and_one_that_is_slack_is_not_missed():
    arm = three_segments(tendons=9)
    arm = replace(arm, tendons=tuple(replace(t, end=1 + k % 3) for k, t in enumerate(arm.tendons)))
    pulls = constant_curvature.pulls(arm, BENDING)
    assert constant_curvature.bending(arm, pulls) == pytest.approx(np.array(BENDING), abs=1e-8)
    pulls[4] = nan
    assert constant_curvature.bending(arm, pulls) == pytest.approx(np.array(BENDING), abs=1e-8)


def test_two_tendons_determine_the_bending_of_a_hinge():
    solid = in_space(paper.build())
    pulls = constant_curvature.pulls(solid, [(0.0, 0.0), (0.0, 0.7), (0.0, 0.0)])
    found = constant_curvature.bending(solid, pulls, soft=(False, True, False))
    assert found == pytest.approx(np.array([(0.0, 0.0), (0.0, 0.7), (0.0, 0.0)]), abs=1e-9)


@pytest.mark.parametrize(('tendons', 'soft'), [
    (3, (True, True, False)), (2, (True, False, False))])
def test_what_the_tendons_do_not_determine_is_refused(tendons, soft):
    with pytest.raises(ArmError, match='do not determine'):
        constant_curvature.bending(three_segments(tendons=tendons), np.zeros(tendons), soft=soft)


@pytest.mark.parametrize('bending', [[(0.0, 0.1)], [(0.0, nan)] * 3, [0.1, 0.2, 0.3],
                                     [(0.0, inf)] * 3])
def test_wrong_bending_is_refused(bending):
    for function in (constant_curvature.pulls, constant_curvature.poses):
        with pytest.raises(ArmError, match='two finite numbers'):
            function(three_segments(), bending)


def test_wrong_pulls_are_refused():
    with pytest.raises(ValueError, match='3 numbers'):
        constant_curvature.bending(three_segments(), (0.0, 0.0))


# Which arms tendons alone bend segment by segment.


PAPER = load_arm(description_file())
TENDON_ARM = load_arm(description_file().with_name('tendon_arm.yaml'))


def with_pairs(*ends):
    """Return the shipped tendon arm with opposite tendons in one plane that end at discs."""
    return replace(TENDON_ARM, tendons=tuple(
        Tendon(f'{side}_{k}', angle, 0.008, end) for k, end in enumerate(ends)
        for side, angle in (('right', 0.5), ('left', 0.5 + pi))))


@pytest.mark.parametrize(('arm', 'each_bends'), [
    (PAPER, False), (of_segments(PAPER, [0]), True), (TENDON_ARM, True),
    (replace(TENDON_ARM, segments=tuple(
        replace(s, stiffness_x=inf) for s in TENDON_ARM.segments)), True),
    (replace(TENDON_ARM, tendons=TENDON_ARM.tendons[-3:]), False),
    (three_segments(tendons=3), False),
    (replace(TENDON_ARM, tendons=TENDON_ARM.tendons[:5]), False),
    (with_pairs(1, 2, 3), True), (with_pairs(3, 3, 3), False), (with_pairs(2, 3), False)],
    ids=['two tendons along three segments bend them together', 'two bend one planar segment',
         'three for each segment bend each', 'those of hinges too', 'the tendons of one disc',
         'all end at the tip', 'one tendon less than bendings is too few',
         'a pair for each bends it in one plane', 'pairs to the tip do not',
         'a pair less than segments is too few'])
def test_tendons_alone_bend_each_segment_if_there_is_one_for_every_bending(arm, each_bends):
    assert fully_actuated(arm) == each_bends
