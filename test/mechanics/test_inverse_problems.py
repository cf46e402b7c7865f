# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""From a tip to bending, and what an arm reaches: of planar and of spatial arms."""

from dataclasses import replace
from math import nan, pi, radians

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import bending_for_tip, set_shape, Statics, workspace
from soft_continuum.mechanics import tip as tip_search
from soft_continuum.mechanics.laws import Jam
from support.flat_arm import about_y, made_of
from support.general_arms import paper_like, RIGID
from support.spatial_arms import mirrored, three_segments, turned


def plane(limit=1.2, gravity=0.0, bodies=3, jam=RIGID):
    """Return the statics of a planar arm that is upright."""
    return limited(paper_like(3, jam, bodies=bodies, gravity=gravity), limit)


def space(segments=3, limit=pi / 2, jam=RIGID):
    """Return the statics of a spatial arm that hangs askew."""
    arm = three_segments(gravity=(2.0, 1.0, 9.0), bodies_per_segment=3, jam=jam)
    return limited(replace(
        arm, segments=arm.segments[:segments], discs=arm.discs[:segments + 1],
        tendons=tuple(replace(t, end=segments) for t in arm.tendons)), limit)


def limited(arm, limit):
    return Statics(replace(arm, segments=tuple(
        replace(s, bending_angle_limit=limit) for s in arm.segments)))


def one_bent(segment, angle):
    return angle * np.eye(3)[segment]


MODELS = pytest.mark.parametrize('make', [plane, space])
IN_PLANE = (0.5, -0.3, 0.2)
IN_SPACE = np.array([(0.7, 0.4), (0.2, -0.5), (-0.3, 0.3)])
SHAPES = {plane: about_y(IN_PLANE), space: IN_SPACE}


# Tips

@pytest.mark.parametrize(('shape', 'gravity', 'posed'), [
    ((0.7, 0.4, -0.5), 0.0, False), ((-0.9, 0.9, 0.9), 0.0, True),
    ((0.3, 0.3, 0.3), 9.80665, False), ((-0.5, 1.1, 0.2), 9.80665, True),
    *((one_bent(segment, angle), 9.80665, posed) for segment in range(3)
      for angle in (-1.1, -0.02, 0.6) for posed in (False, True)),
    ((0.8, 0.5, 0.0), 0.0, True), ((-1.0, 0.0, 0.9), 0.0, True), ((0.0, 0.8, 0.5), 0.0, True),
    (IN_SPACE, None, True), (((0.0, 0.0), (-0.9, 0.5), (0.0, 0.0)), None, True),
    (((0.4, -0.6), (0.0, 0.0), (0.9, 0.2)), None, False)])
def test_a_tip_that_the_arm_had_is_reached_again_and_no_segment_more_is_softened(
        shape, gravity, posed):
    statics = space() if gravity is None else plane(gravity=gravity)
    shape = np.array(shape) if gravity is None else about_y(shape)
    had = set_shape(statics, shape)
    tip, turn = had.poses[-1, :3], had.rotations[-1]
    fit = bending_for_tip(statics, tip, turn if posed else None)
    assert fit.reached
    assert fit.distance < 1e-6
    assert fit.state.poses[-1, :3] == pytest.approx(tip, abs=1e-6)
    assert fit.state.bending == pytest.approx(fit.bending, abs=1e-8)
    assert np.linalg.norm(fit.bending, axis=1).max() <= statics.chain.arm.bending_angle_limits[0]
    bent = np.flatnonzero(np.linalg.norm(shape, axis=1))
    assert len(fit.softened) <= len(bent)
    if posed:
        assert fit.softened == tuple(bent)
        assert fit.state.rotations[-1] == pytest.approx(turn, abs=1e-4)
        if gravity is None or len(bent) == 1:
            assert fit.bending == pytest.approx(shape, abs=1e-4)
    again = set_shape(statics, fit.bending, order=fit.softened)
    assert again.poses[-1, :3] == pytest.approx(fit.state.poses[-1, :3], abs=1e-6)


@MODELS
def test_where_it_is_already_nothing_is_softened(make):
    statics = make()
    start = set_shape(statics, SHAPES[make])
    fit = bending_for_tip(statics, start.poses[-1, :3], start=start)
    assert fit.softened == ()
    assert np.array_equal(fit.state.configuration, start.configuration)


@MODELS
def test_from_another_shape_the_segments_that_stay_keep_their_bending(make):
    statics = make()
    start, wanted = set_shape(statics, SHAPES[make]), SHAPES[make].copy()
    wanted[1] = (0.0, 0.7) if make is plane else (-0.4, 0.6)
    there = set_shape(statics, wanted, start, (1,))
    fit = bending_for_tip(statics, there.poses[-1, :3], there.rotations[-1], start)
    assert fit.softened == (1,)
    assert fit.bending == pytest.approx(wanted, abs=1e-5)


# At the edge of reach: a pose that several shapes have, and a tip that many have.
@pytest.mark.parametrize(('segments', 'seed', 'size', 'posed'), [
    (3, 6, 1.0, True), (2, 1, 1.0, False)])
def test_a_tip_has_one_answer_in_every_frame(segments, seed, size, posed):
    arm, draw = space(segments, limit=1.0).chain.arm, np.random.default_rng(seed)
    ways = draw.uniform(0.0, 2.0 * pi, segments)
    had = set_shape(Statics(arm), size * np.column_stack([np.cos(ways), np.sin(ways)]))
    turns = np.arange(1, 8) * 2.0 * pi / 9.0 + 0.1
    answers = []
    for an_arm, frame in [
            (arm, np.eye(3)), (mirrored(arm), np.diag([1.0, -1.0, 1.0])),
            *((turned(arm, turn), Rotation.from_euler('z', turn).as_matrix()) for turn in turns)]:
        fit = bending_for_tip(Statics(an_arm), frame @ had.poses[-1, :3],
                              frame @ had.rotations[-1] @ frame.T if posed else None)
        # A mirror turns rotation vectors the other way.
        answers.append((fit.reached, fit.softened, np.linalg.det(frame) * fit.bending
                        @ frame[:2, :2]))
    for reached, softened, bending in answers:
        assert reached
        assert softened == answers[0][1]
        assert bending == pytest.approx(answers[0][2], abs=1e-6)


@pytest.mark.parametrize('jam', [Jam(), Jam(5.0)], ids=['rigid', 'elastic'])
def test_on_the_way_to_a_tip_only_the_segments_it_names_are_softened(jam):
    # An elastic segment gives way a little when another is bent; it is not set anew for that.
    statics = plane(pi / 2, jam=jam)
    start = set_shape(statics, (0.4, 0.3, 0.2))
    tip = set_shape(statics, (0.8, nan, nan), start, order=(0,)).poses[-1, :3]
    fit = bending_for_tip(statics, tip, start=start)
    assert fit.reached
    assert fit.softened == (0,)
    assert fit.bending == pytest.approx(fit.state.bending, abs=1e-9)
    again = set_shape(statics, fit.bending, start, order=fit.softened)
    assert again.poses[-1, :3] == pytest.approx(tip, abs=1e-6)


@pytest.fixture(scope='module')
def sampled():
    """Return how to get the statics of an arm, and a dense sample of its tips."""
    found = {}

    def sample(kind):
        if kind not in found:
            statics = space(2) if kind is None else plane(1.0, kind, bodies=2)
            found[kind] = statics, *workspace(statics, *((2, 6) if kind is None else (4,)))
        return found[kind]

    return sample


@pytest.mark.parametrize(('kind', 'goal', 'tangent'), [
    (0.0, (0.0, 0.5), None), (9.80665, (0.4, 0.2), None), (9.80665, (0.0, 0.05), None),
    (0.0, (0.9, 0.9), None),
    (0.0, (0.254, 0.354), 1.654), (9.80665, (-0.119, 0.081), 2.241),
    (9.80665, (0.021, 0.438), 0.838), (0.0, (0.0, 0.5), 0.5), (None, (0.1, 0.05, 0.05), None)])
def test_out_of_reach_no_sampled_tip_or_pose_is_nearer_with_0_1_m_per_rad(
        sampled, kind, goal, tangent):
    statics, tips, bending = sampled(kind)
    goal = np.array(goal if kind is None else (goal[0], 0.0, goal[1]))
    turn = None if tangent is None else Rotation.from_rotvec([0.0, tangent, 0.0]).as_matrix()
    fit = bending_for_tip(statics, goal, turn)

    def away(tip, angle):
        off = (angle - (tangent or 0.0) + pi) % (2.0 * pi) - pi
        return np.hypot(np.linalg.norm(tip - goal, axis=-1), 0.1 * off * (tangent is not None))

    nearest = away(tips, bending[..., 1].sum(axis=1)).min()
    found = away(fit.state.poses[-1, :3], fit.bending[:, 1].sum())
    assert found <= nearest + (1e-6 if nearest < tip_search.FAR or tangent else 1e-3)
    assert fit.distance == pytest.approx(np.linalg.norm(fit.state.poses[-1, :3] - goal), abs=1e-12)
    limit = statics.chain.arm.bending_angle_limits[0]
    assert np.linalg.norm(fit.bending, axis=1).max() <= limit + 1e-6
    assert not fit.reached or tangent


def counted(monkeypatch):
    """Return a list that gets an item for each shape that is set."""
    calls, shape = [], tip_search.set_shape
    monkeypatch.setattr(tip_search, 'set_shape', lambda *given: calls.append(0) or shape(*given))
    return calls


@pytest.mark.parametrize(('make', 'most'), [(plane, 100), (space, 10)])
def test_a_tip_far_out_of_reach_is_soon_given_up(make, most, monkeypatch):
    # It took 43 s with elastic jams: each choice of segments was fitted by the statics.
    statics, calls = make(jam=Jam(8.0)), counted(monkeypatch)
    fit = bending_for_tip(statics, (5.0, 0.0, 0.0))
    assert not fit.reached
    assert fit.distance < 5.0  # it leans there
    assert len(calls) < most


def test_no_search_sets_more_shapes_than_it_may(monkeypatch):
    statics, calls, goal = plane(1.0, bodies=2), counted(monkeypatch), (0.05, 0.0, 0.2)
    full = bending_for_tip(statics, goal)
    assert not full.reached
    monkeypatch.setattr(tip_search, 'MAX_SHAPES', len(calls) - 5)
    calls.clear()
    fit = bending_for_tip(statics, goal)
    assert len(calls) == tip_search.MAX_SHAPES
    assert full.distance <= fit.distance < 1.1 * full.distance


def test_the_angles_for_a_tip_are_within_the_limits_when_those_of_the_start_are_not():
    statics = plane()
    start = statics.bend(statics.chain.straight(), 0, 2.0)
    fit = bending_for_tip(statics, start.poses[-1, :3], start=start)
    assert 0 in fit.softened
    assert np.abs(fit.bending[:, 1]).max() <= 1.2 + 1e-9


def test_a_segment_that_is_kept_and_gives_way_stays_within_its_limit():
    statics = plane(radians(60.0), 9.80665, jam=Jam(3.0))
    start = set_shape(statics, (radians(60.0) - 1e-6, 0.0, 0.0))
    beyond = set_shape(statics, (0.0, 0.0, 0.8), start, (2,))
    assert np.abs(beyond.bending_angles).max() > radians(60.5)
    fit = bending_for_tip(statics, beyond.poses[-1, :3], start=start)
    assert np.abs(fit.bending).max() <= radians(60.0) + 1e-6


@MODELS
@pytest.mark.parametrize(('goal', 'turn', 'words'), [
    *((goal, None, 'wanted must be x, y and z') for goal in (
        (0.1, 0.2), ('a', 0.0, 0.1), (0.1, 0.2, nan), (0.1, np.inf, 0.1))),
    *(((0.1, 0.2, 0.1), turn, 'wanted must be a .3, 3. rotation matrix') for turn in (
        np.eye(2), -np.eye(3), np.full((3, 3), nan)))])
def test_what_is_no_tip_is_refused(make, goal, turn, words):
    with pytest.raises(ValueError, match=words):
        bending_for_tip(make(), goal, turn)


# Workspace

@pytest.mark.parametrize(('kind', 'shapes'), [(0.0, 9**3), (9.80665, 9**3), (None, 13**2)])
def test_the_workspace_is_of_shapes_that_are_set_within_the_limits(sampled, kind, shapes):
    statics, tips, bending = sampled(kind)
    arm = statics.chain.arm
    assert tips.shape == (shapes, 3)
    assert bending.shape == (shapes, len(arm.segments), 2)
    assert np.linalg.norm(bending, axis=2).max() == pytest.approx(
        arm.bending_angle_limits[0], abs=1e-8)
    for i in (0, shapes // 4, shapes // 2, shapes - 1):
        assert set_shape(statics, bending[i]).poses[-1, :3] == pytest.approx(tips[i], abs=1e-6)
    base = arm.discs[0].height
    assert np.linalg.norm(tips - [0.0, 0.0, base], axis=1).max() <= arm.length - base + 1e-9
    if kind is not None:
        assert not bending[..., 0].any() and not tips[:, 1].any()


def test_the_workspace_of_an_upright_or_hanging_arm_is_symmetric(sampled):
    _, tips, _ = sampled(9.80665)
    hanging = Statics(replace(space(1).chain.arm, gravity=(0.0, 0.0, 9.0)))
    around, _ = workspace(hanging, 2, 6)
    turn = Rotation.from_euler('z', 120.0, degrees=True)
    for ours, images in ((tips, tips * [-1.0, 1.0, 1.0]), (around, turn.apply(around))):
        for image in images:
            assert np.linalg.norm(ours - image, axis=1).min() < 1e-8


def test_shapes_that_no_tendon_holds_are_left_out():
    # So heavy that it falls over before it is bent far.
    arm = paper_like(1, gravity=9.80665, payload=3.0, bodies=3)
    tips, shapes = workspace(Statics(arm.with_tendons(**made_of(50.0))), 4)
    assert len(tips) == len(shapes) < 9
    assert tips.shape[1:] == (3,)
    assert shapes.shape[1:] == (1, 2)


@pytest.mark.parametrize('counts', [(0, 6), (2, 0), (2.5, 6)])
def test_what_is_no_workspace_is_refused(counts):
    with pytest.raises(ValueError, match='a whole number'):
        workspace(space(1), *counts)
