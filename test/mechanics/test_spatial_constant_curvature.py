# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Arcs in space: in one plane the planar ones, everywhere those of a chain of many bodies."""

from dataclasses import replace
from math import inf, nan, pi

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import ArmError, constant_curvature
from soft_continuum.mechanics.space.chain import SpaceChain
from support import paper_arm as paper
from support.flat_arm import about_y, arcs_of
from support.spatial_arms import in_space, three_segments

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
    arm = replace(arm, tendons=tuple(
        replace(t, end=1 + k % 3) for k, t in enumerate(arm.tendons)))
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
