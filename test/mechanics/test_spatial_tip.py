# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Bending for a tip in space is that of an arm that had its tip there."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import (
    bending_for_tip,
    Jam,
    set_shape,
    Statics,
    workspace,
)
from soft_continuum.mechanics import tip as tip_search
from soft_continuum.mechanics.space.statics import SpaceStatics
from support import paper_arm as paper
from support.spatial_arms import in_space, three_segments

SHAPES = [((0.7, 0.4), (0.2, -0.5), (-0.3, 0.3)), ((0.0, 0.0), (-0.9, 0.5), (0.0, 0.0)),
          ((0.4, -0.6), (0.0, 0.0), (0.9, 0.2))]


def hanging(segments=3, **changes):
    arm = three_segments(gravity=(2.0, 1.0, 9.0), bodies_per_segment=3, **changes)
    return SpaceStatics(replace(
        arm, segments=arm.segments[:segments], discs=arm.discs[:segments + 1],
        tendons=tuple(replace(t, end=segments) for t in arm.tendons)))


@pytest.mark.parametrize('shape', SHAPES)
@pytest.mark.parametrize('posed', [False, True])
def test_a_tip_that_the_arm_had_is_reached_again(shape, posed):
    statics = hanging()
    had = set_shape(statics, shape)
    fit = bending_for_tip(statics, had.tip, had.orientations[-1] if posed else None)
    assert fit.reached
    assert fit.state.tip == pytest.approx(had.tip, abs=1e-6)
    assert fit.state.bending == pytest.approx(fit.bending, abs=1e-12)
    bent = np.flatnonzero(np.linalg.norm(shape, axis=1))
    assert len(fit.softened) <= len(bent)
    if posed:
        assert fit.state.orientations[-1] == pytest.approx(had.orientations[-1], abs=1e-4)
        assert fit.softened == tuple(bent)
        assert fit.bending == pytest.approx(np.array(shape), abs=1e-4)
    again = set_shape(statics, fit.bending, order=fit.softened)
    assert again.tip == pytest.approx(fit.state.tip, abs=1e-6)


def test_in_the_plane_it_is_the_planar_one():
    flat = paper.build(bodies_per_segment=3)
    planar, solid = Statics(flat), SpaceStatics(flat)
    x, z = 0.12, 0.24
    one, other = (bending_for_tip(statics, (x, 0.0, z)) for statics in (planar, solid))
    assert one.reached and other.reached
    assert len(other.softened) == len(one.softened)
    assert other.state.tip == pytest.approx((x, 0.0, z), abs=1e-6)


def test_where_it_is_already_nothing_is_softened():
    statics = hanging()
    start = set_shape(statics, SHAPES[0])
    assert bending_for_tip(statics, start.tip, start=start).softened == ()


def test_from_another_shape_the_others_keep_their_bending():
    statics = hanging()
    start = set_shape(statics, SHAPES[0])
    wanted = np.array(SHAPES[0])
    wanted[1] = (-0.4, 0.6)
    there = set_shape(statics, wanted, start, (1,))
    fit = bending_for_tip(statics, there.tip, there.orientations[-1], start)
    assert fit.softened == (1,)
    assert fit.bending == pytest.approx(wanted, abs=1e-5)


def test_a_turned_arm_has_the_turned_bending():
    turn = Rotation.from_euler('z', 0.7)
    one = SpaceStatics(three_segments(gravity=(0.0, 0.0, 9.0), bodies_per_segment=3))
    other = SpaceStatics(three_segments(0.7, gravity=(0.0, 0.0, 9.0), bodies_per_segment=3))
    had = set_shape(one, SHAPES[0])
    fit = bending_for_tip(other, turn.apply(had.tip), turn.as_matrix() @ had.orientations[-1]
                          @ turn.as_matrix().T)
    assert fit.bending == pytest.approx(
        turn.apply(np.column_stack([SHAPES[0], np.zeros(3)]))[:, :2], abs=1e-4)


@pytest.fixture(scope='module')
def sampled():
    """Return the statics of two segments, and a sample of their tips."""
    statics = hanging(2)
    return statics, *workspace(statics, 2, 6)


@pytest.mark.parametrize('goal', [(0.3, 0.1, 0.0), (0.0, -0.3, 0.1), (0.02, 0.0, -0.2)])
def test_out_of_reach_no_sampled_tip_is_nearer(sampled, goal):
    statics, tips, _ = sampled
    fit = bending_for_tip(statics, goal)
    assert not fit.reached
    assert fit.distance == pytest.approx(np.linalg.norm(fit.state.tip - goal), abs=1e-12)
    assert fit.distance <= np.linalg.norm(tips - goal, axis=1).min() + 1e-6
    assert np.linalg.norm(fit.bending, axis=1).max() <= np.pi / 2 + 1e-6


def test_the_workspace_is_of_shapes_within_the_limits(sampled):
    statics, tips, bending = sampled
    assert tips.shape == (13**2, 3)
    assert bending.shape == (13**2, 2, 2)
    assert np.linalg.norm(bending, axis=2).max() == pytest.approx(np.pi / 2, abs=1e-8)
    for i in (0, 40, 168):
        assert set_shape(statics, bending[i]).tip == pytest.approx(tips[i], abs=1e-7)
    length = statics.chain.arm.length
    assert np.linalg.norm(tips - [0.0, 0.0, 0.02], axis=1).max() <= length - 0.02 + 1e-9


def test_the_workspace_of_a_hanging_arm_is_symmetric():
    arm = hanging(1).chain.arm
    tips, _ = workspace(SpaceStatics(replace(arm, gravity=(0.0, 0.0, 9.0))), 2, 6)
    turned = Rotation.from_euler('z', 120.0, degrees=True).apply(tips)
    for tip in turned:
        assert np.linalg.norm(tips - tip, axis=1).min() < 1e-8


def test_hinges_stay_in_their_plane():
    solid = in_space(paper.build(bodies_per_segment=2))
    one = replace(solid, segments=solid.segments[:1], discs=solid.discs[:2], tendons=tuple(
        replace(t, offset=t.offset[:2], end=1) for t in solid.tendons))
    tips, bending = workspace(SpaceStatics(one), 3, 6)
    assert len(tips) == 7
    assert np.abs(tips[:, 1]).max() < 1e-9
    assert np.abs(bending[:, 0, 0]).max() < 1e-9


@pytest.mark.parametrize(('goal', 'turn', 'words'), [
    ((0.1, 0.2), None, 'x, y and z'), ((0.1, 0.2, np.nan), None, 'x, y and z'),
    ((0.1, 0.2, 0.1), np.eye(2), 'rotation matrix'),
    ((0.1, 0.2, 0.1), -np.eye(3), 'rotation matrix')])
def test_what_is_no_tip_is_refused(goal, turn, words):
    with pytest.raises(ValueError, match=words):
        bending_for_tip(hanging(1), goal, turn)


def test_a_tip_far_out_of_reach_is_soon_given_up(monkeypatch):
    # It took 22 s with elastic jams.
    arm, calls, shape = hanging().chain.arm, [], tip_search.set_shape
    monkeypatch.setattr(tip_search, 'set_shape', lambda *given: calls.append(0) or shape(*given))
    statics = SpaceStatics(replace(arm, segments=tuple(
        replace(segment, jam=Jam(8.0)) for segment in arm.segments)))
    fit = bending_for_tip(statics, (5.0, 0.0, 0.0))
    assert not fit.reached
    assert fit.distance < 5.0  # it leans there
    assert len(calls) < 10


def test_no_search_sets_more_shapes_than_it_may(sampled, monkeypatch):
    statics, *_ = sampled
    calls, shape, goal = [], tip_search.set_shape, (0.1, 0.05, 0.05)
    monkeypatch.setattr(tip_search, 'set_shape', lambda *given: calls.append(0) or shape(*given))
    full = bending_for_tip(statics, goal)
    assert not full.reached
    monkeypatch.setattr(tip_search, 'MAX_SHAPES', len(calls) - 5)
    calls.clear()
    fit = bending_for_tip(statics, goal)
    assert len(calls) == tip_search.MAX_SHAPES
    assert full.distance <= fit.distance < 1.1 * full.distance


@pytest.mark.parametrize('counts', [(0, 6), (2, 0), (2.5, 6)])
def test_what_is_no_workspace_is_refused(counts):
    with pytest.raises(ValueError, match='a whole number'):
        workspace(hanging(1), *counts)
