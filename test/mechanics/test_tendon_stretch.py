# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tendons that stretch, and tendons of given tension."""

from math import inf

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import LEFT, RIGHT, SLACK, Statics
from soft_continuum.mechanics.laws import Jam
from support.energy_reference import Reference
from support.flat_arm import guides_of, made_of
from support.general_arms import arms, between, FEW, masks, paper_like, pulls


def tendon_length(arm):
    """Return the length of a tendon from stepper to tip in the straight arm, m."""
    return (sum((s.length**2 + (upper - lower)**2)**0.5
                for s, (lower, upper) in zip(arm.segments, guides_of(arm), strict=True))
            + sum(d.height for d in arm.discs) + arm.tendons[0].free_length)


@FEW
@given(arms(stretch=True), st.data())
def test_a_tendon_is_longer_than_asked_for_by_t_l_over_ea(arm, data):
    statics = Statics(arm)
    straight = statics.chain.straight()
    soft = data.draw(masks(arm))
    asked = np.array(data.draw(pulls(arm, straight, soft)))
    state = statics.solve(straight, asked, soft)
    stretch = state.tensions * tendon_length(arm) / arm.tendons[0].axial_stiffness
    path = Reference(arm).pulls(state.joint_angles)
    taut = state.tensions > 0.0
    assert asked[taut] - path[taut] == pytest.approx(stretch[taut], abs=1e-12)
    assert state.pulls == pytest.approx(path, abs=1e-12)
    assert statics.commanded_pulls(state)[taut] == pytest.approx(asked[taut], abs=1e-12)
    assert np.all(state.slack[taut] == 0.0)
    assert state.slack[~taut] == pytest.approx((path - asked)[~taut], abs=1e-12)


@pytest.mark.parametrize('segments', [1, 2])
@pytest.mark.parametrize('asked', [(0.015, SLACK), (0.015, -0.002), (-0.004, 0.01)])
@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_stretched_tendons_are_springs_in_the_energy(segments, asked, gravity):
    arm = paper_like(segments, gravity=gravity, mounting_angle=2.5, tendon=made_of(800.0, 0.5))
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), asked, (True,) * segments)
    expected = Reference(arm).rest(
        statics.chain.straight().joint_angles, stretch=(asked, tendon_length(arm) / 800.0))
    assert state.joint_angles == pytest.approx(expected, abs=1e-6)


def test_the_stiffer_the_tendon_the_closer_to_one_that_does_not_stretch():
    arm = paper_like(3, gravity=9.80665, mounting_angle=2.0)
    apart, shapes = [], {}
    for stiffness in (1e4, 1e5, 1e6, inf):
        statics = Statics(arm.with_tendons(**made_of(stiffness)))
        state = statics.solve(statics.chain.straight(), (0.03, SLACK), (True,) * 3)
        shapes[stiffness] = np.append(state.joint_angles, state.tensions)
    apart = [np.abs(shapes[s] - shapes[inf]).max() for s in (1e4, 1e5, 1e6)]
    assert apart[0] / apart[1] == pytest.approx(10.0, rel=0.05)
    assert apart[1] / apart[2] == pytest.approx(10.0, rel=0.05)


def test_free_length_stretches_as_well():
    short, long = (Statics(paper_like(1, tendon=made_of(1e3, free))) for free in (0.0, 0.37))
    # 0.07 m of segment and two discs of 0.03 m: with 0.37 m more it is 0.5 m, not 0.13 m.
    assert short.compliance == pytest.approx([0.13e-3] * 2)
    assert long.compliance == pytest.approx([0.5e-3] * 2)


def test_both_tendons_pulled_alike_stretch_where_rigid_ones_buckle_the_arm():
    arm = paper_like(1)
    rigid = Statics(arm)
    buckled = rigid.solve(rigid.chain.straight(), (0.0005, 0.0005), (True,))
    assert buckled.jumped
    assert np.abs(buckled.joint_angles).max() > 0.1
    statics = Statics(arm.with_tendons(**made_of(500.0)))
    state = statics.solve(statics.chain.straight(), (0.0005, 0.0005), (True,))
    assert not state.jumped
    assert state.joint_angles == pytest.approx(0.0, abs=1e-10)
    assert state.tensions == pytest.approx([500.0 * 0.0005 / 0.13] * 2, rel=1e-9)


def test_the_antagonist_stiffens_the_arm():
    # Against a force both tendons of a straight arm work: it gives way less than with none.
    statics = Statics(paper_like(1, gravity=9.80665, mounting_angle=np.pi / 2,
                                 tendon=made_of(500.0)))
    straight = statics.chain.straight()
    hanging = statics.solve(straight, (SLACK, SLACK), (True,))
    held = statics.solve(straight, (0.0005, 0.0005), (True,))
    assert held.tensions[LEFT] > held.tensions[RIGHT] >= 0.0
    assert 0.0 < held.joint_angles.sum() < 0.5 * hanging.joint_angles.sum()


# Given tensions

@FEW
@given(arms(stretch=True), st.data())
def test_the_tensions_found_for_given_lengths_give_these_lengths(arm, data):
    statics = Statics(arm)
    soft = data.draw(masks(arm))
    straight = statics.chain.straight()
    asked = data.draw(pulls(arm, straight, soft, most=0.3))
    state = statics.solve(straight, asked, soft)
    again = statics.solve_tensions(state, state.tensions, soft)
    assume(not again.jumped)
    assert again.joint_angles == pytest.approx(state.joint_angles, abs=1e-8)
    assert again.tensions == pytest.approx(state.tensions, abs=1e-12)
    assert again.pulls == pytest.approx(state.pulls, abs=1e-9)


@FEW
@given(arms(stretch=True, jam=st.sampled_from([Jam(), Jam(5.0)])), st.data(),
       between(0.0, 0.4), between(0.0, 0.4))
def test_the_lengths_found_for_given_tensions_give_these_tensions(arm, data, right, left):
    statics = Statics(arm)
    soft = data.draw(masks(arm))
    firm = min(s.stiffness_y / (s.length * max(pair))
               for s, pair in zip(arm.segments, guides_of(arm), strict=True))
    tensions = np.array([right, left]) * firm
    straight = statics.chain.straight()
    state = statics.solve_tensions(straight, tensions, soft)
    assert state.tensions == pytest.approx(tensions)
    asked = np.where(tensions > 0.0, statics.commanded_pulls(state), SLACK)
    again = statics.solve(state, asked, soft)
    assert again.joint_angles == pytest.approx(state.joint_angles, abs=1e-8)
    assert again.tensions == pytest.approx(tensions, abs=1e-7)


@FEW
@given(arms(), st.data(), between(0.0, 0.4), between(0.0, 0.4))
def test_given_tensions_balance_springs_and_loads(arm, data, right, left):
    statics = Statics(arm)
    soft = data.draw(masks(arm))
    firm = min(s.stiffness_y / (s.length * max(pair))
               for s, pair in zip(arm.segments, guides_of(arm), strict=True))
    tensions = (right * firm, left * firm)
    state = statics.solve_tensions(statics.chain.straight(), tensions, soft)
    reference = Reference(arm, state.stiff, state.held)
    assert reference.unbalanced(state.joint_angles, tensions) < 1e-9


def test_without_tension_both_tendons_might_as_well_be_cut():
    statics = Statics(paper_like(2, gravity=9.80665, mounting_angle=2.0))
    straight = statics.chain.straight()
    one = statics.solve_tensions(straight, (0.0, 0.0), (True, True))
    other = statics.solve(straight, (SLACK, SLACK), (True, True))
    assert one.joint_angles == pytest.approx(other.joint_angles, abs=1e-10)


@pytest.mark.parametrize('tensions', [
    (-1.0, 0.0), (np.nan, 0.0), (inf, 0.0), (1.0,), (1.0, 0.0, 0.0)])
def test_tensions_that_cannot_be_are_refused(tensions):
    statics = Statics(paper_like(1))
    with pytest.raises(ValueError, match='tensions'):
        statics.solve_tensions(statics.chain.straight(), tensions, (True,))
    assert (RIGHT, LEFT) == (0, 1)
