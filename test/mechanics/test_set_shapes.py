# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Pulls for a bending, which is had with the least tension; and shapes, set segment by segment."""

from dataclasses import replace
from itertools import permutations
from math import cos, nan, sin
from unittest import mock

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import (
    Jam,
    pulls_for_bending,
    set_shape,
    SLACK,
    Statics,
    StaticsError,
)
from soft_continuum.mechanics.space.statics import SpaceStatics
from support import paper_arm as paper
from support.flat_arm import made_of
from support.general_arms import arms, between, paper_like
from support.spatial_arms import in_space, random_arm, three_segments

ANY = (nan, nan)
SHAPE = np.array([(0.6, 0.3), (-0.5, 0.4), (0.8, -0.4)])


def fit_one(arm, bend, segment=0, **more):
    """Fit the bending of one soft segment from the straight arm."""
    statics, count = SpaceStatics(arm), len(arm.segments)
    wanted = np.full((count, 2), nan)
    wanted[segment] = bend
    soft = [s == segment for s in range(count)]
    return statics, soft, pulls_for_bending(
        statics, statics.chain.straight(), wanted, soft, **more)


@pytest.mark.parametrize('tendons', [3, 4, 6])
@pytest.mark.parametrize(('bend', 'gravity'), [
    ((0.6, 0.3), (0.0, 0.0, 9.8)), ((-0.7, 0.7), (0.0, 0.0, -9.8)),
    ((0.0, -1.3), (5.0, 0.0, 3.0))])
def test_a_segment_takes_its_bending(tendons, bend, gravity):
    statics, soft, fit = fit_one(three_segments(tendons=tendons, gravity=gravity), bend, 1)
    assert fit.state.bending[1] == pytest.approx(bend, abs=1e-9)
    assert np.all((fit.pulls == SLACK) == (fit.state.tensions < 1e-6))
    again = statics.solve(statics.chain.straight(), fit.pulls, soft)
    assert again.points == pytest.approx(fit.state.points, abs=1e-8)
    assert again.tensions == pytest.approx(fit.state.tensions, abs=1e-6)
    assert np.isnan(fit.error[[0, 2]]).all()


def test_tendons_side_by_side_that_do_not_stretch_share_their_tension_in_any_way():
    flat = paper.build(bodies_per_segment=6)
    short = tuple(replace(t, name=f'short_{t.name}', end=1, offset=t.offset[:2])
                  for t in flat.tendons)
    statics = SpaceStatics(replace(flat, tendons=flat.tendons + short))
    wanted = np.full((3, 2), nan)
    wanted[0] = 0.0, 0.2
    with mock.patch.object(statics, 'solve', wraps=statics.solve) as solve:
        fit = pulls_for_bending(statics, statics.chain.straight(), wanted, [True, False, False])
    assert fit.state.bending[0] == pytest.approx((0.0, 0.2), abs=1e-9)
    assert solve.call_count < 20  # the search ends, although their tensions do not settle


@pytest.mark.parametrize('angle', [-0.9, 0.4, 1.1])
def test_in_the_plane_pulls_are_the_planar_ones(angle):
    flat = paper.build(bodies_per_segment=6, mounting_angle=2.5)
    planar = Statics(flat)
    there = planar.bend(planar.chain.straight(), 1, angle)
    wanted = np.where(there.tensions > 0.0, there.pulls, SLACK)
    _, _, fit = fit_one(in_space(flat), (0.0, angle), 1)
    assert fit.pulls == pytest.approx(wanted, abs=1e-9)
    assert fit.state.tensions == pytest.approx(there.tensions, abs=1e-6)


def test_an_arm_that_is_turned_or_mirrored_has_the_same_pulls():
    turn, (x, y) = 0.7, (-0.5, 0.4)
    down = {'gravity': (0.0, 0.0, 9.8)}
    _, _, one = fit_one(three_segments(**down), (x, y))
    _, _, turned = fit_one(three_segments(turn, **down), (
        cos(turn) * x - sin(turn) * y, sin(turn) * x + cos(turn) * y))
    assert turned.pulls == pytest.approx(one.pulls, abs=1e-9)
    _, _, mirrored = fit_one(three_segments(**down), (-x, y))  # in the plane of x and z
    assert mirrored.pulls == pytest.approx(one.pulls[[0, 2, 1]], abs=1e-9)


@pytest.mark.parametrize('tendons', [3, 4, 6])
@pytest.mark.parametrize('pretension', [0.0, 0.5])
def test_no_other_tensions_of_that_bending_are_less(tendons, pretension):
    """Karush, Kuhn and Tucker: T = p + J' m where tendons carry more, and J' m below 0 else."""
    statics, soft, fit = fit_one(three_segments(tendons=tendons), (0.5, 0.2),
                                 pretension=pretension)
    tensions, step = fit.state.tensions, 1e-3

    def bending(change):
        return statics.solve(fit.state, np.zeros(tendons), soft,
                             tensions=np.maximum(tensions + change, 0.0)).bending[0]

    base = bending(0.0)
    slopes = np.array([(bending(step * one) - base) / step for one in np.eye(tendons)]).T
    more = tensions > pretension + 1e-6
    assert np.all(tensions >= pretension - 1e-9)
    assert not more.all()
    multipliers = np.linalg.lstsq(slopes[:, more].T, tensions[more])[0]
    assert slopes[:, more].T @ multipliers == pytest.approx(tensions[more], rel=1e-2)
    assert np.all(slopes[:, ~more].T @ multipliers < pretension + 0.05)


def test_tendons_that_end_at_three_discs_bend_all_segments_at_once():
    arm = three_segments(tendons=9)
    arm = replace(arm, tendons=tuple(replace(t, end=1 + k % 3) for k, t in enumerate(arm.tendons)))
    statics = SpaceStatics(arm)
    fit = pulls_for_bending(statics, statics.chain.straight(), SHAPE, (True,) * 3)
    assert fit.state.bending == pytest.approx(SHAPE, abs=1e-9)


@pytest.mark.parametrize('seed', [0, 1, 5, 6, 7, 9, 13, 18])
def test_helical_tendons_that_stretch_hold_random_arms(seed):
    arm, draw = random_arm(seed, jam=Jam()), np.random.default_rng(seed)
    segment = int(draw.integers(len(arm.segments)))
    bend = draw.uniform(-0.8, 0.8, 2)
    statics, soft, fit = fit_one(arm, bend, segment, pretension=0.2)
    assert fit.state.bending[segment] == pytest.approx(bend, abs=1e-9)
    assert fit.state.tensions.min() >= 0.2 - 1e-9
    again = statics.solve(statics.chain.straight(), fit.pulls, soft)
    assert again.tensions == pytest.approx(fit.state.tensions, abs=1e-5)


def test_one_component_may_be_anything():
    arm = replace(three_segments(), tendons=three_segments(tendons=2).tendons)
    _, _, fit = fit_one(arm, (nan, 0.5))
    assert fit.state.bending[0] == pytest.approx((0.0, 0.5), abs=1e-9)


ARM = three_segments()
LOW = replace(ARM, tendons=tuple(replace(t, end=1) for t in ARM.tendons))
PLANE = replace(ARM, tendons=three_segments(tendons=2).tendons)
CORNER = replace(ARM, tendons=ARM.tendons[:2])


@pytest.mark.parametrize(('arm', 'wanted', 'soft', 'words'), [
    (LOW, [ANY, (0.2, 0.5), ANY], (0, 1, 0), 'no tendon passes segment 2'),
    (ARM, [(0.2, 0.5)] * 3, (1, 1, 1), '3 tendons cannot set 6 bendings'),
    (PLANE, [(0.2, 0.5), ANY, ANY], (1, 0, 0),
     'segment 1 .* one plane .t0 at 0, t1 at 180 degrees .* needs a tendon beside it'),
    (CORNER, [(0.2, -0.5), ANY, ANY], (1, 0, 0),
     'segment 1 .* no tendon pulls it towards 2.. degrees .* t0 at 0, t1 at 120'),
    (three_segments(tendons=6), [(0.2, 0.3), (-0.2, 0.4), (0.3, -0.1)], (1, 1, 1),
     'do not hold all soft segments at once'),
    (three_segments(payload=1.0, gravity=(0.0, 0.0, -9.8)), [(0.6, 0.3), ANY, ANY], (1, 0, 0),
     'not stable'),
])
def test_what_cannot_be_held_is_named(arm, wanted, soft, words):
    statics = SpaceStatics(arm)
    with pytest.raises(StaticsError, match=words):
        pulls_for_bending(statics, statics.chain.straight(), wanted, soft)


@pytest.mark.parametrize(('wanted', 'more', 'words'), [
    ([(0.1, 0.2)], {}, 'each of the 3 segments'),
    ([ANY, (0.1, 0.2), ANY], {}, 'a number for at least one soft segment'),
    ([(0.1, 0.2), ANY, ANY], {'pretension': -1.0}, 'pretension'),
])
def test_what_is_no_request_is_refused(wanted, more, words):
    statics = SpaceStatics(ARM)
    with pytest.raises(ValueError, match=words):
        pulls_for_bending(statics, statics.chain.straight(), wanted, (1, 0, 0), **more)


def test_a_hinge_does_not_bend_about_its_other_axis():
    with pytest.raises(ValueError, match='segment 1 does not bend about x'):
        fit_one(in_space(paper.build()), (0.2, 0.3))
    for arm in (paper.build(), in_space(paper.build())):
        with pytest.raises(ValueError, match='segment 1 does not bend about x'):
            set_shape(Statics(arm), SHAPE)


# Shapes

MODELS = pytest.mark.parametrize('make', [
    lambda **more: paper_like(3, gravity=9.80665, **more),
    lambda **more: three_segments(gravity=(0.0, 0.0, 9.8), **more)], ids=['plane', 'space'])


def shape_of(statics):
    """Return a shape for an arm, (segments, 2) rad."""
    return SHAPE * (statics.chain.arm.bending_axes)


@MODELS
@pytest.mark.parametrize('order', [(0, 1, 2), (2, 0, 1)])
@pytest.mark.parametrize('jam', [Jam(), Jam(3.0), Jam(20.0)])
def test_a_shape_is_set_in_any_order(make, order, jam):
    statics = Statics(make(jam=jam))
    wanted = shape_of(statics)
    state = set_shape(statics, wanted, order=order)
    assert state.bending == pytest.approx(wanted, abs=1e-8)
    assert state.stiff == tuple(s != order[-1] for s in range(3))


@settings(max_examples=8)
@given(arms(), st.data())
def test_a_random_planar_arm_is_set_in_any_order(arm, data):
    statics, segments = Statics(arm), range(len(arm.segments))
    wanted = [data.draw(between(-0.8, 0.8)) for _ in segments]
    state = set_shape(statics, wanted, order=data.draw(st.permutations(segments)))
    assert state.bending_angles == pytest.approx(wanted, abs=1e-9)


def test_weightless_the_order_does_not_matter():
    statics = Statics(paper_like(3))
    first, *others = (set_shape(statics, (0.6, -0.4, 0.5), order=order).joint_angles
                      for order in permutations(range(3)))
    for shape in others:
        assert shape == pytest.approx(first, abs=1e-9)


@MODELS
def test_a_segment_that_has_its_bending_is_left_alone(make):
    statics = Statics(make())
    start = set_shape(statics, shape_of(statics))
    wanted = shape_of(statics) * [[1.0], [-1.0], [1.0]]
    state = set_shape(statics, wanted, start)
    assert state.bending == pytest.approx(wanted, abs=1e-8)
    others = np.repeat([True, False, True], statics.chain.joints_per_segment)
    assert state.joint_angles[others] == pytest.approx(start.joint_angles[others], abs=1e-14)


@MODELS
@pytest.mark.parametrize(('bending', 'order', 'words'), [
    *((wrong, None, 'two finite numbers|must be numbers') for wrong in (
        (0.1,), [(0.1, 0.2)], (0.1, 0.1, 0.1, 0.9), (0.0, nan, 0.1), (0.1, 'a', 0.1))),
    *((0.0 * SHAPE, wrong, 'order') for wrong in ((0, 5), (-1,), (0, 0), (0.5,)))])
def test_what_is_no_shape_or_order_is_refused(make, bending, order, words):
    with pytest.raises(ValueError, match=words):
        set_shape(Statics(make()), bending, order=order)


def test_a_shape_is_set_as_without_friction():
    arm = paper_like(2, tendon=made_of(friction=0.3))
    ours, theirs = (set_shape(Statics(one), [0.3, -0.2]) for one in (arm, arm.without_friction()))
    assert ours.joint_angles == pytest.approx(theirs.joint_angles, abs=1e-9)
