# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The way to an equilibrium: small steps, jumps, falls, and the bending angle as the drive."""

from dataclasses import replace
from math import pi, radians

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import Disc, LEFT, RIGHT, Segment, SLACK, Statics, StaticsError
from soft_continuum.mechanics.arm import mounted
from support import paper_arm as paper
from support.flat_arm import flat_arm
from support.independent_statics import IndependentArm
from support.random_arms import arms, between, masks, MODERATE, pulls

ALL = (True, True, True)


def in_small_steps(statics, start, asked, soft, steps=50):
    """Return the states on a straight way to ``asked``; SLACK is slack from the start."""
    states = [start]
    for part in np.linspace(0.0, 1.0, steps + 1)[1:]:
        now = [a + part * (b - a) if np.isfinite(b) else b
               for a, b in zip(start.pulls, asked, strict=True)]
        states.append(statics.solve(states[-1], now, soft))
    return states


def tall_and_weak(mounting_angle=0.0):
    """Return an arm that cannot stand upright by itself."""
    return flat_arm([Segment.leaf_spring(0.3, 0.005, 0.1)], 0.02, [Disc(0.03), Disc(0.03, 0.3)],
                    mounting_angle=mounting_angle)


# Small steps and large ones

@MODERATE
@given(st.data(), arms(load=(0.0, 2.0)))
def test_many_small_steps_end_where_one_large_step_ends(data, arm):
    statics = Statics(arm)
    soft = data.draw(masks(arm))
    straight = statics.chain.straight()
    asked = data.draw(pulls(arm, soft, straight))
    steps = in_small_steps(statics, straight, asked, soft)
    assume(not any(state.jumped for state in steps))
    large = statics.solve(straight, asked, soft)
    assert large.joint_angles == pytest.approx(steps[-1].joint_angles, abs=1e-8)
    assert large.tensions == pytest.approx(steps[-1].tensions, abs=1e-6)
    assert not large.jumped


@pytest.mark.parametrize('mounting', [0.0, pi / 4, pi / 2, pi, -pi / 2])
@pytest.mark.parametrize('segment', [0, 1, 2])
def test_a_segment_follows_its_tendon_smoothly_to_90_degrees_and_back(
        paper_arm, mounting, segment):
    statics = Statics(replace(paper_arm, gravity=mounted(mounting)))
    bent = statics.bend(statics.chain.straight(), segment, pi / 2)
    tendon = RIGHT if bent.tensions[RIGHT] > 0.0 else LEFT
    asked = [SLACK, SLACK]
    asked[tendon] = bent.pulls[tendon]
    first = statics.solve(statics.chain.straight(), asked, paper.only(segment))
    assert first.joint_angles == pytest.approx(bent.joint_angles, abs=1e-8)
    asked[tendon] = 0.0
    back = statics.solve(first, asked, paper.only(segment))
    there_again = statics.solve(
        back, [bent.pulls[t] if t == tendon else SLACK for t in (RIGHT, LEFT)],
        paper.only(segment))
    assert there_again.joint_angles == pytest.approx(bent.joint_angles, abs=1e-8)


# Falls

def test_a_tall_weak_arm_buckles_and_says_that_it_jumped():
    statics = Statics(tall_and_weak())
    state = statics.solve(statics.chain.straight(), (SLACK, SLACK), (True,))
    assert state.jumped
    assert abs(paper.degrees_of(statics, state)[0]) > 30.0
    arm = IndependentArm(statics.chain.arm)
    assert arm.unbalanced(state.joint_angles, state.tensions, (True,)) < 1e-9
    assert arm.lowest_curvature(state.joint_angles, state.tensions, (True,)) > 0.0


def test_an_arm_that_can_stand_does_not_jump(statics):
    state = statics.solve(statics.chain.straight(), (SLACK, SLACK), paper.only(0))
    assert not state.jumped
    assert np.all(state.joint_angles == 0.0)


def test_the_papers_arm_cannot_stand_upright_with_all_segments_soft(statics):
    state = statics.solve(statics.chain.straight(), (SLACK, SLACK), ALL)
    assert state.jumped
    arm = IndependentArm(statics.chain.arm)
    assert arm.lowest_curvature(state.joint_angles, state.tensions, ALL) > 0.0


@pytest.mark.parametrize('asked', [(0.0, SLACK), (SLACK, 0.0), (-1e-10, SLACK)])
def test_one_tendon_that_is_just_taut_does_not_keep_an_unstable_arm_upright(statics, asked):
    # It holds only one side: the arm falls to the other and the tendon goes slack.
    state = statics.solve(statics.chain.straight(), asked, ALL)
    arm = IndependentArm(statics.chain.arm)
    assert arm.lowest_curvature(state.joint_angles, state.tensions, ALL) > 0.0
    assert state.jumped


def test_two_tendons_that_are_just_taut_keep_it_upright(statics):
    # Falling either way would lengthen one of them.
    state = statics.solve(statics.chain.straight(), (0.0, 0.0), ALL)
    assert np.abs(state.joint_angles).max() < 1e-9
    assert not state.jumped


def test_two_tendons_that_are_just_taut_do_not_keep_a_heavy_arm_from_buckling_into_an_s():
    # Twice the masses: the bow that leaves both lengths as they are has negative curvature.
    statics = Statics(paper.build(2.0))
    arm = IndependentArm(statics.chain.arm)
    straight = np.zeros(statics.chain.bodies)
    along_both = np.linalg.svd(arm.gradients(straight)[1:2])[2][1:].T
    hessian = along_both.T @ arm.hessians(straight)[0] @ along_both
    assert np.linalg.eigvalsh(hessian)[0] < -0.1
    state = statics.solve(statics.chain.straight(), (0.0, 0.0), ALL)
    assert np.abs(state.joint_angles).max() > 0.01
    assert arm.values(state.joint_angles)[0] < arm.values(straight)[0] - 1e-3


@pytest.mark.parametrize('soft', [ALL, (True, True, False)])
@pytest.mark.parametrize('tip', [-55.0, -20.0, -5.0, 5.0, 20.0, 55.0])
def test_an_arm_that_leans_falls_to_the_side_to_which_it_leans(statics, soft, tip):
    leaning = statics.chain.uniform([0.0, 0.0, radians(tip)])
    state = statics.solve(leaning, (SLACK, SLACK), soft)
    # Only weight acts: in the start state its moment about every joint is of the tip's sign.
    assert np.all(np.sign(state.bending_angles[:2]) == np.sign(tip))


@pytest.mark.parametrize(('mass_factor', 'soft'), [(0.85, (True, True, False)), (0.75, ALL)])
def test_a_long_way_that_passes_a_jump_says_so(mass_factor, soft):
    # The left tendon pulls an arm that leans right over the top: it falls over to the left.
    statics = Statics(paper.build(mass_factor))
    leaning = statics.solve(statics.chain.uniform([0.1, 0.15, 0.0]), (SLACK, -0.008), soft)
    assert paper.degrees_of(statics, leaning)[0] > 4.0
    steps = in_small_steps(statics, leaning, (SLACK, 0.01), soft, 200)
    angles = np.array([paper.degrees_of(statics, state) for state in steps])
    assert np.abs(np.diff(angles, axis=0)).max() > 7.0
    assert any(state.jumped for state in steps[1:])
    at_once = statics.solve(leaning, (SLACK, 0.01), soft)
    assert at_once.joint_angles == pytest.approx(steps[-1].joint_angles, abs=1e-7)
    assert at_once.jumped


@MODERATE
@given(arms(load=(3.0, 30.0), segments=(1, 3)), st.data())
def test_whatever_falls_comes_to_rest_in_a_strict_minimum(arm, data):
    statics = Statics(arm)
    soft = data.draw(masks(arm))
    state = statics.solve(statics.chain.straight(), (SLACK, SLACK), soft)
    reference = IndependentArm(arm)
    assert reference.unbalanced(state.joint_angles, state.tensions, soft) < 1e-9
    assert reference.lowest_curvature(state.joint_angles, state.tensions, soft) > 0.0
    assert np.abs(state.bending_angles).max() < 1.1 * pi


# Driven by the bending angle

@MODERATE
@given(arms(load=(0.0, 2.0)), st.data(), between(-1.3, 1.3), between(-1.0, 1.0))
def test_bend_reaches_its_angle_and_solve_agrees(arm, data, angle, before):
    statics = Statics(arm)
    segment = data.draw(st.integers(0, len(arm.segments) - 1))
    start = statics.chain.uniform([before] * len(arm.segments))
    state = statics.bend(start, segment, angle)
    assert state.bending_angles[segment] == pytest.approx(
        angle, abs=1e-10)
    assert np.all(state.tensions >= 0.0)
    asked = np.where(state.tensions > 0.0, state.pulls, SLACK)
    again = statics.solve(state, asked, paper.only(segment, len(arm.segments)))
    assert again.joint_angles == pytest.approx(state.joint_angles, abs=1e-9)
    assert again.tensions == pytest.approx(state.tensions, abs=1e-7)
    assert IndependentArm(arm).lowest_curvature(
        state.joint_angles, state.tensions, paper.only(segment, len(arm.segments))) > 0.0


@pytest.mark.parametrize(('mounting', 'soft', 'angle'), [
    (4.255784892092421, (True, True, False), -13.179),
    (35.6, ALL, 33.6),
])
def test_bend_tries_the_other_tendon_when_one_cannot(paper_arm, mounting, soft, angle):
    statics = Statics(replace(paper_arm, gravity=mounted(radians(mounting))))
    # The left tendon does it, as pulling it step by step shows.
    state = statics.solve(statics.chain.straight(), (SLACK, SLACK), soft)
    passed, angles = False, [state.bending_angles[0]]
    for pull in state.pulls[LEFT] + np.linspace(0.0, 0.09, 181):
        try:
            state = statics.solve(state, (SLACK, pull), soft)
        except StaticsError:
            break
        angles.append(state.bending_angles[0])
        low, high = sorted(angles[-2:])
        passed = passed or (low <= radians(angle) <= high and high - low < 0.2)
    assert passed
    bent = statics.bend(statics.chain.straight(), 0, radians(angle), soft)
    assert bent.tensions[LEFT] > 0.0


def test_bend_to_where_the_segment_rests_takes_no_tension(paper_arm):
    for mounting in np.linspace(-pi, pi, 25):
        statics = Statics(replace(paper_arm, gravity=mounted(mounting)))
        for soft in (paper.only(0), paper.only(2)):
            rest = statics.solve(statics.chain.straight(), (SLACK, SLACK), soft)
            segment = soft.index(True)
            angle = rest.bending_angles[segment]
            bent = statics.bend(rest, segment, angle)
            assert bent.tensions == pytest.approx([0.0, 0.0], abs=1e-7)
