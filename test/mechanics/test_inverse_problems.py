# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""From angles to shapes, from a tip to angles, and what a planar arm reaches."""

from dataclasses import replace
from itertools import permutations
from math import nan, pi, radians

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import bending_for_tip, set_shape, Statics, workspace
from soft_continuum.mechanics import tip as tip_search
from soft_continuum.mechanics.laws import Jam
from support.flat_arm import made_of
from support.general_arms import arms, between, FEW, paper_like


def angles(statics, state):
    return state.bending_angles


def tip_of(statics, state):
    return state.points[-1]


def for_tip(statics, x, z, tangent=None, start=None):
    """Return the fit of a tip, x, z (m), and its tangent, rad."""
    turn = None if tangent is None else Rotation.from_rotvec([0.0, tangent, 0.0]).as_matrix()
    return bending_for_tip(statics, (x, 0.0, z), turn, start)


# Shapes

@FEW
@given(arms(segments=(1, 4)), st.data())
def test_a_shape_is_set_in_any_order(arm, data):
    statics = Statics(arm)
    wanted = [data.draw(between(-0.8, 0.8)) for _ in arm.segments]
    order = data.draw(st.permutations(range(len(arm.segments))))
    state = set_shape(statics, wanted, order=order)
    assert angles(statics, state) == pytest.approx(wanted, abs=1e-9)
    assert state.stiff == tuple(i != order[-1] for i in range(len(wanted))) or 0.0 in wanted


def test_weightless_the_order_does_not_matter():
    statics = Statics(paper_like(3))
    shapes = [set_shape(statics, (0.6, -0.4, 0.5), order=order).joint_angles
              for order in permutations(range(3))]
    for shape in shapes[1:]:
        assert shape == pytest.approx(shapes[0], abs=1e-9)


def test_a_segment_that_has_its_angle_is_left_alone():
    statics = Statics(paper_like(3, gravity=9.80665))
    start = set_shape(statics, (0.5, 0.4, 0.3))
    state = set_shape(statics, (0.5, -0.4, 0.3), start)
    joints = statics.chain.joints_per_segment
    assert np.array_equal(state.joint_angles[:joints], start.joint_angles[:joints])
    assert np.array_equal(state.joint_angles[2 * joints:], start.joint_angles[2 * joints:])


@pytest.mark.parametrize('jam', [Jam(3.0), Jam(10.0)])
@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_elastic_segments_have_their_angles_when_all_are_set(jam, gravity):
    statics = Statics(paper_like(3, jam, gravity=gravity))
    state = set_shape(statics, (0.6, -0.3, 0.5))
    assert angles(statics, state) == pytest.approx([0.6, -0.3, 0.5], abs=1e-8)


@pytest.mark.parametrize('wrong', [(0.1,), (0.1, 0.1, 0.1, 0.9), (0.1, nan, 0.1), (0.1, 'a', 0.1)])
def test_a_shape_of_the_wrong_size_or_no_number_is_refused(wrong):
    with pytest.raises(ValueError):
        set_shape(Statics(paper_like(3)), wrong)


@pytest.mark.parametrize('order', [(0, 5), (-1,), (0, 0), (0.5,)])
def test_an_order_of_segments_that_are_not_there_is_refused(order):
    with pytest.raises(ValueError, match='order'):
        set_shape(Statics(paper_like(3)), (0.1, 0.1, 0.1), order=order)


# Tips

def limited(limit=1.2, gravity=0.0, bodies=3):
    arm = paper_like(3, bodies=bodies, gravity=gravity)
    return Statics(replace(arm, segments=tuple(
        replace(s, bending_angle_limit=limit) for s in arm.segments)))


TIPS = [((0.7, 0.4, -0.5), 0.0), ((-0.9, 0.9, 0.9), 0.0), ((0.3, 0.3, 0.3), 9.80665),
        ((-0.5, 1.1, 0.2), 9.80665)]


@pytest.mark.parametrize(('shape', 'gravity'), TIPS)
@pytest.mark.parametrize('posed', [False, True])
def test_a_tip_that_the_arm_had_is_reached_again(shape, gravity, posed):
    statics = limited(gravity=gravity)
    tip = tip_of(statics, set_shape(statics, shape))
    fit = for_tip(statics, tip[0], tip[1], tip[2] if posed else None)
    assert fit.reached
    assert fit.distance < 1e-6
    assert fit.state.tip[:2] == pytest.approx(tip[:2], abs=1e-6)
    if posed:
        assert fit.state.tip[2] == pytest.approx(tip[2], abs=1e-4)
    assert np.all(np.abs(fit.bending[:, 1]) <= 1.2 + 1e-9)
    assert angles(statics, fit.state) == pytest.approx(fit.bending[:, 1], abs=1e-8)
    assert tip_of(statics, set_shape(statics, fit.bending[:, 1])) == pytest.approx(
        fit.state.tip, abs=1e-8)


@pytest.mark.parametrize('segment', [0, 1, 2])
@pytest.mark.parametrize('angle', [-1.1, -0.02, 0.6])
@pytest.mark.parametrize('posed', [False, True])
def test_a_tip_that_one_segment_reaches_softens_only_one(segment, angle, posed):
    statics = limited(gravity=9.80665)
    shape = [0.0] * 3
    shape[segment] = angle
    tip = tip_of(statics, set_shape(statics, shape))
    fit = for_tip(statics, tip[0], tip[1], tip[2] if posed else None)
    assert fit.reached
    assert len(fit.softened) == 1
    if posed:
        assert fit.softened == (segment,)
        assert fit.bending[:, 1] == pytest.approx(shape, abs=1e-5)


@pytest.mark.parametrize('pair', [(0, 1), (0, 2), (1, 2)])
@pytest.mark.parametrize('bend', [(0.8, 0.5), (-1.0, 0.9)])
def test_a_pose_that_two_segments_reach_softens_no_third(pair, bend):
    statics = limited()
    shape = np.zeros(3)
    shape[list(pair)] = bend
    tip = tip_of(statics, set_shape(statics, shape))
    fit = for_tip(statics, *tip)
    assert fit.reached
    assert fit.softened == pair


def test_a_tip_where_it_is_already_softens_nothing():
    statics = limited()
    start = set_shape(statics, (0.5, -0.3, 0.2))
    tip = tip_of(statics, start)
    fit = for_tip(statics, tip[0], tip[1], start=start)
    assert fit.softened == ()
    assert fit.state is start or np.array_equal(fit.state.joint_angles, start.joint_angles)


def test_from_another_shape_the_segments_that_stay_keep_their_angles():
    statics = limited()
    start = set_shape(statics, (0.5, -0.3, 0.2))
    tip = tip_of(statics, set_shape(statics, (0.5, 0.7, 0.2), start))
    fit = for_tip(statics, *tip, start=start)
    assert fit.softened == (1,)
    assert fit.bending[:, 1] == pytest.approx([0.5, 0.7, 0.2], abs=1e-5)


@pytest.mark.parametrize('jam', [Jam(), Jam(5.0)], ids=['rigid', 'elastic'])
def test_on_the_way_to_a_tip_only_the_segments_it_names_are_softened(jam):
    # An elastic segment gives way a little when another is bent; it is not set anew for that.
    statics = Statics(paper_like(3, jam, bodies=3))
    start = set_shape(statics, (0.4, 0.3, 0.2))
    tip = tip_of(statics, set_shape(statics, (0.8, nan, nan), start, order=(0,)))
    fit = for_tip(statics, tip[0], tip[1], start=start)
    assert fit.reached
    assert fit.softened == (0,)
    again = set_shape(statics, fit.bending[:, 1], start, order=fit.softened)
    assert tip_of(statics, again)[:2] == pytest.approx(tip[:2], abs=1e-6)


@pytest.fixture(scope='module', params=[0.0, 9.80665], ids=['weightless', 'upright'])
def sampled(request):
    """Return the statics of an arm limited to 1 rad, and a dense sample of its tips."""
    statics = limited(1.0, request.param, bodies=2)
    tips, shapes = workspace(statics, 4)
    return statics, tips, shapes


@pytest.mark.parametrize(('x', 'z'), [
    (0.0, 0.5), (0.4, 0.2), (-0.3, 0.05), (0.0, 0.05), (0.05, 0.2), (0.9, 0.9)])
def test_out_of_reach_no_sampled_tip_is_nearer(sampled, x, z):
    statics, tips, _ = sampled
    fit = for_tip(statics, x, z)
    nearest = np.hypot(tips[:, 0] - x, tips[:, 2] - z).min()
    assert fit.distance <= nearest + (1e-6 if nearest < tip_search.FAR else 1e-3)
    assert fit.distance == pytest.approx(np.hypot(fit.state.tip[0] - x, fit.state.tip[1] - z))
    assert np.all(np.abs(fit.bending[:, 1]) <= 1.0 + 1e-9)
    assert not fit.reached


@pytest.mark.parametrize(('x', 'z', 'tangent'), [
    (0.254, 0.354, 1.654), (-0.119, 0.081, 2.241), (0.021, 0.438, 0.838), (0.0, 0.5, 0.5)])
def test_out_of_reach_no_sampled_pose_is_nearer_with_0_1_m_per_rad(sampled, x, z, tangent):
    statics, tips, shapes = sampled
    fit = for_tip(statics, x, z, tangent)
    weights = np.array([1.0, 1.0, 0.1])
    poses = np.column_stack([tips[:, [0, 2]], shapes[..., 1].sum(axis=1)])

    def away(tip):
        off = tip - [x, z, tangent]
        off[..., 2] = (off[..., 2] + pi) % (2.0 * pi) - pi
        return np.linalg.norm(off * weights, axis=-1)

    assert away(fit.state.tip) <= away(poses).min() + 1e-6


def test_straight_above_the_nearest_tip_is_that_of_the_straight_arm():
    statics = limited()
    fit = for_tip(statics, 0.0, 1.0)
    assert fit.distance == pytest.approx(1.0 - statics.chain.arm.length, abs=1e-6)
    assert fit.bending[:, 1] == pytest.approx(0.0, abs=1e-3)


def test_a_tip_far_out_of_reach_is_soon_given_up(monkeypatch):
    # It took 43 s with elastic jams: each choice of segments was fitted by the statics.
    statics, calls, shape = Statics(paper_like(3, Jam(8.0), bodies=3)), [], tip_search.set_shape
    monkeypatch.setattr(tip_search, 'set_shape', lambda *given: calls.append(0) or shape(*given))
    fit = for_tip(statics, 5.0, 5.0)
    assert not fit.reached
    assert fit.distance < np.hypot(5.0, 5.0) - 0.9 * statics.chain.arm.length
    assert len(calls) < 100


def test_the_angles_for_a_tip_are_those_of_the_state_also_where_segments_give_way():
    statics = Statics(paper_like(3, Jam(3.0), bodies=3))
    fit = for_tip(statics, 0.2, 0.1)
    assert fit.bending[:, 1] == pytest.approx(angles(statics, fit.state), abs=1e-9)
    assert tip_of(statics, fit.state) == pytest.approx(fit.state.tip, abs=1e-12)


def test_the_angles_for_a_tip_are_within_the_limits_when_those_of_the_start_are_not():
    statics = limited()
    start = statics.bend(statics.chain.straight(), 0, 2.0)
    tip = tip_of(statics, start)
    fit = for_tip(statics, tip[0], tip[1], start=start)
    assert 0 in fit.softened
    assert np.abs(fit.bending[:, 1]).max() <= 1.2 + 1e-9


def test_a_segment_that_is_kept_and_gives_way_stays_within_its_limit():
    statics = Statics(paper_like(3, Jam(3.0), bodies=3, gravity=9.80665))
    arm = statics.chain.arm
    statics = Statics(replace(arm, segments=tuple(
        replace(s, bending_angle_limit=radians(60.0)) for s in arm.segments)))
    start = set_shape(statics, (radians(60.0) - 1e-6, 0.0, 0.0))
    beyond = set_shape(statics, (0.0, 0.0, 0.8), start, (2,))
    assert np.abs(beyond.bending_angles).max() > radians(60.5)
    fit = bending_for_tip(statics, beyond.poses[-1, :3], start=start)
    assert np.abs(fit.bending).max() <= radians(60.0) + 1e-6


@pytest.mark.parametrize('tip', [('a', 0.1), (nan, 0.1), (0.1, np.inf), (0.1, 0.2, nan)])
def test_a_tip_that_is_no_number_is_refused(tip):
    with pytest.raises(ValueError, match='wanted must be'):
        for_tip(limited(), *tip)


# Workspace

def test_all_tips_lie_within_the_length_of_the_arm_and_all_angles_within_the_limits(sampled):
    statics, tips, shapes = sampled
    assert tips.shape == (9**3, 3)
    assert shapes.shape == (9**3, 3, 2)
    assert np.abs(shapes).max() == pytest.approx(1.0, abs=1e-8)
    assert not shapes[..., 0].any() and not tips[:, 1].any()
    above = np.hypot(tips[:, 0], tips[:, 2] - 0.03)
    assert above.max() <= statics.chain.arm.length - 0.03 + 1e-12


def test_the_workspace_of_an_upright_arm_is_symmetric(sampled):
    _, tips, shapes = sampled
    angles = shapes[..., 1]
    order, mirrored = (np.lexsort(np.round(a, 6).T) for a in (angles, -angles))
    assert angles[order] == pytest.approx(-angles[mirrored], abs=1e-9)
    assert tips[order] == pytest.approx(tips[mirrored] * [-1.0, 1.0, 1.0], abs=1e-8)


def test_tips_of_the_workspace_are_those_of_the_shapes_set_one_after_the_other(sampled):
    statics, tips, shapes = sampled
    for i in (0, 100, 364, 500, 728):
        state = set_shape(statics, shapes[i])
        assert state.poses[-1, :3] == pytest.approx(tips[i], abs=1e-6)


def test_shapes_that_no_tendon_holds_are_left_out():
    # So heavy that it falls over before it is bent far.
    arm = paper_like(1, gravity=9.80665, payload=3.0, bodies=3)
    statics = Statics(arm.with_tendons(**made_of(50.0)))
    tips, shapes = workspace(statics, 4)
    assert len(tips) == len(shapes) < 9
    assert tips.shape[1:] == (3,)
    assert shapes.shape[1:] == (1, 2)
