# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What cannot be solved is refused, says why, and carries the last good state."""

from math import inf, nan, pi, radians

import numpy as np
import pytest

from soft_continuum.mechanics import (
    Arm,
    ArmError,
    bending_for_tip,
    Disc,
    Jam,
    LawError,
    LEFT,
    MomentCurvature,
    OverconstrainedError,
    RIGHT,
    Segment,
    set_shape,
    SLACK,
    solve_path,
    Statics,
    StaticsError,
    Tendon,
    Wrench,
)
from soft_continuum.mechanics.arm import tendon_pair
from support import paper_arm as paper
from support.flat_arm import flat_arm
from support.independent_statics import IndependentArm

FIRST = paper.only(0)
STIFF = (False, False, False)
ALL = (True, True, True)


# Input

@pytest.mark.parametrize('asked', [
    (nan, 0.0), (0.0, nan), (inf, 0.0), (0.0, inf), (), (0.01,), (0.0, 0.0, 0.0), ('a', 0.0),
    (1j, 0.0), np.array([1j, 0.0]), ('0.01', '0.0'), None, (None, 0.0), ((0.0,), 0.0), {}])
def test_pulls_that_are_not_two_numbers_are_refused(statics, asked):
    for call in (statics.solve, statics.solve_tensions):
        with pytest.raises(ValueError):
            call(statics.chain.straight(), asked, FIRST)


@pytest.mark.parametrize('start', [None, 0, (0.0, 0.0)])
def test_a_start_that_is_no_state_is_refused(statics, start):
    for call in (lambda: statics.solve(start, (0.0, SLACK), FIRST),
                 lambda: statics.solve_tensions(start, (0.0, 0.0), FIRST),
                 lambda: statics.bend(start, 0, 0.1),
                 lambda: solve_path(statics, start, (0.0, SLACK), FIRST),
                 *(() if start is None else (
                     lambda: set_shape(statics, [0.1] * len(FIRST), start),
                     lambda: bending_for_tip(statics, (0.0, 0.0, 0.2), start=start)))):
        with pytest.raises(ValueError, match='Equilibrium'):
            call()


@pytest.mark.parametrize('changes', [
    {'length': '7'}, {'length': None}, {'length': 1j}, {'mass': 'heavy'}])
def test_a_segment_of_no_numbers_is_refused(changes):
    with pytest.raises(ArmError, match='number'):
        Segment(**({'length': 0.07, 'stiffness_x': 0.02, 'stiffness_y': 0.02} | changes))


SEGMENTS, DISCS = (Segment.leaf_spring(0.07, 0.02),), (Disc(0.03), Disc(0.03))
PAIR = tendon_pair(0.02, 1)


@pytest.mark.parametrize('make', [
    lambda value: Arm(SEGMENTS, DISCS, PAIR, wrenches=(Wrench(1, (value, 0.0, 0.0)),)),
    lambda value: Arm(SEGMENTS, DISCS, PAIR, wrenches=(Wrench(value, (0.0, 0.0, 0.0)),)),
    lambda value: Arm(SEGMENTS, DISCS, PAIR, payload=value),
    lambda value: Arm(SEGMENTS, DISCS, value),
    lambda value: Arm(SEGMENTS, DISCS, PAIR, wrenches=value),
    lambda value: Arm(value, DISCS, PAIR),
    lambda value: Arm(SEGMENTS, value, PAIR),
    Jam,
    lambda value: Jam(3.0, yield_moment=value),
    lambda value: Jam(3.0, stiffness_exponent=value),
    lambda value: MomentCurvature((0.0, value), (0.0, 1.0)),
    lambda value: MomentCurvature(value, (0.0, 1.0)),
    lambda value: tendon_pair(value, 1),
    lambda value: Tendon('right', value, 0.02, 1),
    lambda value: tendon_pair(0.02, 1, friction=value),
    lambda value: Disc(0.03, value),
    lambda value: Segment.leaf_spring(0.07, 0.02, value),
])
@pytest.mark.parametrize('value', ['7', None, 1j, nan])
def test_what_is_no_number_is_refused_by_every_part_of_an_arm(make, value):
    with pytest.raises((ArmError, LawError), match='give|allowed|row|discs are|must be'):
        make(value)


def test_true_is_no_number_of_bodies(statics):
    with pytest.raises(ArmError, match='whole number'):
        statics.chain.arm.with_bodies(True)


@pytest.mark.parametrize('soft', [True, None, (), (True,), (True,) * 4])
def test_a_mask_of_the_wrong_length_is_refused(statics, soft):
    with pytest.raises(ValueError, match='3 segments'):
        statics.solve(statics.chain.straight(), (0.0, SLACK), soft)
    if soft is not None:  # bend then softens the one segment
        with pytest.raises(ValueError):
            statics.bend(statics.chain.straight(), 0, 0.1, soft)


def test_a_mask_with_nan_is_refused(statics):
    with pytest.raises(ValueError):
        statics.solve(statics.chain.straight(), (0.01, SLACK), (nan, False, False))


@pytest.mark.parametrize('bodies', [5, 6, 20])
def test_a_start_state_of_another_arm_is_refused(statics, bodies):
    # Unnoticed, more joints make the compiled loops write outside their arrays.
    other = Statics(statics.chain.arm.with_bodies(bodies))
    with pytest.raises(ValueError):
        statics.solve(other.chain.straight(), (0.01, SLACK), FIRST)


def test_a_start_state_of_as_many_joints_in_fewer_segments_is_refused(statics):
    three, arm = Statics(statics.chain.arm.with_bodies(3)), statics.chain.arm
    two = Statics(flat_arm(arm.segments[:2], 0.02, arm.discs[:3], bodies_per_segment=5))
    with pytest.raises(ValueError, match='12 joints in 2 segments'):
        three.solve(two.chain.uniform([0.5, 0.0]), (0.0, 0.0), FIRST)


@pytest.mark.parametrize('segment', [-1, 3, 1, 1.5])
def test_bending_a_segment_that_is_not_soft_is_refused(statics, segment):
    with pytest.raises(ValueError, match='segment'):
        statics.bend(statics.chain.straight(), segment, 0.1, FIRST)


@pytest.mark.parametrize('angle', [nan, inf, -inf, None, '1', 1j])
def test_bending_to_no_number_is_refused(statics, angle):
    with pytest.raises(ValueError, match='finite'):
        statics.bend(statics.chain.straight(), 0, angle)


# All stiff

def test_tendons_cannot_be_pulled_on_a_stiff_arm(statics):
    state = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    for asked in ((state.pulls[RIGHT] + 1e-4, SLACK), (SLACK, state.pulls[LEFT] + 1e-4)):
        with pytest.raises(OverconstrainedError, match='stiff') as caught:
            statics.solve(state, asked, STIFF)
        assert np.array_equal(caught.value.state.joint_angles, state.joint_angles)


def test_tendons_can_be_let_out_on_a_stiff_arm_and_go_slack(statics):
    state = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    out = statics.solve(state, (state.pulls[RIGHT] - 0.002, state.pulls[LEFT] - 0.003), STIFF)
    assert np.array_equal(out.joint_angles, state.joint_angles)
    assert out.slack == pytest.approx([0.002, 0.003])
    assert np.all(out.tensions == 0.0)


def test_the_tension_of_a_tendon_along_a_stiff_arm_is_unknown(statics):
    state = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    held = statics.solve(state, (state.pulls[RIGHT], SLACK), STIFF)
    assert np.isnan(held.tensions[RIGHT])
    assert held.tensions[LEFT] == 0.0
    assert held.slack[LEFT] == inf
    softened = statics.solve(held, (state.pulls[RIGHT], SLACK), FIRST)
    assert softened.joint_angles == pytest.approx(state.joint_angles, abs=1e-9)


# Too short

def test_two_tendons_cannot_both_shorten_a_segment_of_one_body():
    # Every shape of its two joints, tried out: none has both tendons that short.
    arm = flat_arm(SEGMENTS, 0.02, DISCS, bodies_per_segment=1)
    each = np.radians(np.arange(-170.0, 171.0, 2.0))
    angles = np.stack(np.meshgrid(each, each), axis=-1).reshape(-1, 2)
    _, right, left, _ = IndependentArm(arm).walk(angles)
    assert np.maximum(right, left).min() > 0.07 - 1e-12
    statics = Statics(arm)
    with pytest.raises(OverconstrainedError, match='pay out a tendon') as caught:
        statics.solve(statics.chain.straight(), (0.002, 0.002), (True,))
    assert isinstance(caught.value, StaticsError)


@pytest.mark.parametrize('asked', [(0.075, SLACK), (0.075, 0.0), (0.075, 0.075)])
def test_the_error_carries_an_equilibrium_on_the_path(statics, asked):
    # A span of 70 mm cannot become 75 mm shorter.
    with pytest.raises(OverconstrainedError, match='pay out a tendon') as caught:
        statics.solve(statics.chain.straight(), asked, FIRST)
    state = caught.value.state
    assert np.all(np.isfinite(state.joint_angles))
    assert np.all(state.tensions >= 0.0)
    for tendon in (RIGHT, LEFT):
        if asked[tendon] != SLACK:
            assert state.pulls[tendon] <= asked[tendon] + 1e-9
    arm = IndependentArm(statics.chain.arm)
    assert arm.unbalanced(state.joint_angles, state.tensions, FIRST) < 1e-6


def test_the_error_names_the_pulls_that_were_asked_for_and_how_far_they_got(statics):
    asked = r'right_tendon 200\.00 mm, left_tendon slack; .* ends at'
    with pytest.raises(OverconstrainedError, match=asked):
        statics.solve(statics.chain.straight(), (0.2, SLACK), FIRST)


def test_no_pull_beyond_the_length_of_the_arm(statics):
    with pytest.raises(OverconstrainedError):
        statics.solve(statics.chain.straight(), (10.0, SLACK), ALL)


def test_a_failed_solve_leaves_the_start_as_it_was(statics):
    state = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    angles, tensions, pulls = (
        v.copy() for v in (state.joint_angles, state.tensions, state.pulls))
    with pytest.raises(StaticsError):
        statics.solve(state, (0.075, 0.075), FIRST)
    assert np.array_equal(state.joint_angles, angles)
    assert np.array_equal(state.tensions, tensions)
    assert np.array_equal(state.pulls, pulls)


def test_a_solve_leaves_the_start_as_it_was(statics):
    state = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    angles, tensions = state.joint_angles.copy(), state.tensions.copy()
    statics.solve(state, (0.03, SLACK), ALL)
    assert np.array_equal(state.joint_angles, angles)
    assert np.array_equal(state.tensions, tensions)


# Whatever the arm's description allows can be solved

@pytest.mark.parametrize(('bodies', 'bending_stiffness'), [
    (1, 1e-6), (1, 0.02), (1, 1e3), (12, 1e-6), (12, 1e3), (300, 0.02), (300, 200.0)])
@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_a_pull_of_16_mm_bends_the_softest_and_the_stiffest_arm(
        bodies, bending_stiffness, gravity):
    # What a stiffness of 1e3 N m^2 leaves to rounding is far above 1e-10 N m.
    masses = min(0.05, bending_stiffness)
    arm = flat_arm([Segment.leaf_spring(0.07, bending_stiffness, masses)] * 3, 0.02,
                   [Disc(0.03, masses)] * 4, bodies_per_segment=bodies, gravity=gravity)
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), (0.0165, SLACK), FIRST)
    assert state.pulls[RIGHT] == pytest.approx(0.0165, abs=1e-9)
    assert 35.0 < paper.degrees_of(statics, state)[0] < 55.0


def test_an_arm_of_six_segments_with_300_bodies_each():
    arm = flat_arm([Segment.leaf_spring(0.05, 0.05, 0.01)] * 6, 0.02, [Disc(0.02, 0.01)] * 7,
                   bodies_per_segment=300, mounting_angle=pi)
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), (0.05, SLACK), (True,) * 6)
    assert state.residual < 1e-9
    assert np.all(paper.degrees_of(statics, state) > 5.0)


def test_a_solve_that_cannot_settle_gives_up_soon():
    # The two just-taut tendons hold twice the paper's arm on a ridge: half a million iterations.
    statics = Statics(paper.build(2.0))
    try:
        state = statics.solve(statics.chain.straight(), (0.0, 0.0), ALL)
    except StaticsError as error:
        state = error.state
    assert state.iterations < 20000


def test_letting_out_one_tendon_and_pulling_the_other_is_not_overconstrained():
    # On the straight way between two such pairs the tendons are too short, at its end they fit.
    arm = flat_arm(SEGMENTS, 0.02, DISCS, gravity=0.0)
    statics = Statics(arm)
    for degrees in (20.0, 40.0, 60.0, 80.0, 100.0):
        there = statics.bend(statics.chain.straight(), 0, radians(degrees))
        asked = there.pulls - np.array([0.0, 1e-6])
        state = statics.solve(statics.chain.straight(), asked, (True,))
        assert state.joint_angles == pytest.approx(there.joint_angles, abs=1e-8)
        over = statics.solve(there, asked[::-1], (True,))
        assert over.joint_angles == pytest.approx(-there.joint_angles, abs=1e-8)
