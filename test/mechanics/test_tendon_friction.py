# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tendons: friction at the guides by the Capstan formula, stretch, and given tensions."""

from dataclasses import replace
from math import exp, inf, radians

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import LEFT, Linearisation, RIGHT, SLACK, Statics
from soft_continuum.mechanics.laws import Jam
from soft_continuum.mechanics.plane.joints import tension_ratios
from support.energy_reference import Reference
from support.flat_arm import guides_of, made_of, path_compliance
from support.general_arms import arms, FEW, paper_like, pulls

PULLED, PAID_OUT, AT_REST = (1, 1), (-1, -1), (0, 0)


def rough(segments=3, friction=0.3, stretch=np.inf, **changes):
    return Statics(paper_like(segments, tendon=made_of(stretch, 0.0, friction), **changes))


def turned_by(arm, joint_angles):
    """
    Return the angle (2, runs), rad, that the tendons have turned by before each straight run.

    The runs lead through discs and along segments in turn, through the base disc first.
    """
    x, z, theta, body = 0.0, 0.0, 0.0, 0
    guides = guides_of(arm)
    offset = guides[0][0]
    path = [(x, z, theta, offset), (x, z + arm.discs[0].height, theta, offset)]
    z = arm.discs[0].height
    for s, segment in enumerate(arm.segments):
        for _ in range(arm.bodies_per_segment):
            theta, body = theta + joint_angles[body], body + 1
            x += segment.length / arm.bodies_per_segment * np.sin(theta)
            z += segment.length / arm.bodies_per_segment * np.cos(theta)
        theta, body = theta + joint_angles[body], body + 1
        path.append((x, z, theta, guides[s][1]))
        x += arm.discs[s + 1].height * np.sin(theta)
        z += arm.discs[s + 1].height * np.cos(theta)
        last = s + 1 == len(arm.segments)
        offset = guides[s + (0 if last else 1)][1 if last else 0]
        path.append((x, z, theta, offset))
    path = np.array(path).T
    turned = []
    for side in (1.0, -1.0):
        guides = path[:2] + side * path[3] * np.array([np.cos(path[2]), -np.sin(path[2])])
        (ax, az), (bx, bz) = np.diff(guides)[:, :-1], np.diff(guides)[:, 1:]
        turns = np.arctan2(np.abs(ax * bz - az * bx), ax * bx + az * bz)
        turned.append(np.cumsum([0.0, *turns]))
    return np.array(turned)


def wrapped(arm, joint_angles):
    """Return the angle (2, segments), rad, that the tendons have turned by before each span."""
    return turned_by(arm, joint_angles)[:, 1::2]


# Ratios

@pytest.mark.parametrize('degrees', [
    (36, 36, 36), (36, -36, 36), (-20, 50, 0), (90, 90, 90), (36,) * 6, (-60,) * 6])
@pytest.mark.parametrize('friction', [0.05, 0.3])
def test_an_arc_turns_the_tendon_by_half_its_angle_at_either_end(degrees, friction):
    arm = paper_like(len(degrees), tendon=made_of(friction=friction))
    statics = Statics(arm.with_tendons(offset=0.02))
    state = statics.chain.uniform(np.radians(degrees))
    turns = np.abs(np.radians(degrees))
    before = np.cumsum(turns) - turns / 2  # all of the segments below, half of its own
    for sliding, sign in ((PULLED, -1.0), (PAID_OUT, 1.0)):
        ratios = tension_ratios(statics.chain, state.joint_angles, sliding)
        expected = np.exp(sign * friction * before)
        assert ratios == pytest.approx(np.array([expected, expected]), rel=1e-12)


@FEW
@given(arms(friction=True, segments=(1, 6)), st.data())
def test_ratios_follow_from_the_angles_at_the_guides(arm, data):
    joints = len(arm.segments) * (arm.bodies_per_segment + 1)
    angles = np.array([data.draw(st.integers(-30, 30)) / 50 for _ in range(joints)])
    statics = Statics(arm)
    ratios = tension_ratios(statics.chain, angles, (1, -1))
    turned = wrapped(arm, angles)
    friction = arm.tendons[0].friction
    assert ratios[RIGHT] == pytest.approx(np.exp(-friction * turned[RIGHT]), rel=1e-9)
    assert ratios[LEFT] == pytest.approx(np.exp(friction * turned[LEFT]), rel=1e-9)


def test_a_segment_of_36_degrees_keeps_94_percent_behind_it_at_a_coefficient_of_one_tenth():
    arm = paper_like(2, tendon=made_of(friction=0.1))
    statics = Statics(replace(arm, segments=arm.segments[:1] * 2))
    state = statics.chain.uniform([radians(36), 0.0])
    ratios = tension_ratios(statics.chain, state.joint_angles, PULLED)
    assert ratios[RIGHT] == pytest.approx([exp(-0.1 * radians(18)), exp(-0.1 * radians(36))])
    assert ratios[RIGHT, 1] == pytest.approx(0.939, abs=5e-4)


def test_a_tendon_turns_in_discs_that_lead_it_inwards_as_well():
    statics = rough(2, 0.1)  # from 25 mm off the axis to 21.25 mm, in a disc of 30 mm
    state = statics.chain.straight()
    inwards = np.arctan2(0.00375, 0.03)
    ratios = tension_ratios(statics.chain, state.joint_angles, PULLED)
    assert ratios[RIGHT] == pytest.approx([1.0, exp(-0.1 * 2 * inwards)])


# Shapes

@FEW
@given(arms(friction=True, stretch=True, segments=(1, 4),
            jam=st.sampled_from([Jam(), Jam(5.0)])), st.data(),
       st.sampled_from([(1, 1), (-1, -1), (1, -1), (-1, 1), (1, 0)]))
def test_an_arm_with_friction_is_in_balance_and_stays_so(arm, data, sliding):
    statics = Statics(arm)
    straight = statics.chain.straight()
    soft = tuple(s == 0 or data.draw(st.booleans()) for s in range(len(arm.segments)))
    asked = data.draw(pulls(arm, straight, soft, most=0.4, both=True))
    state = statics.solve(straight, asked, soft, sliding=sliding)
    turned = wrapped(arm, state.joint_angles)
    ratios = np.exp(-arm.tendons[0].friction * np.array(sliding)[:, None] * turned)
    reference = Reference(arm, state.stiff, state.held)
    assert reference.unbalanced(state.joint_angles, state.tensions, ratios) < 1e-9
    again = statics.solve(state, asked, soft, sliding=sliding)
    # A given tension is the one at the base.
    driven = statics.solve_tensions(state, state.tensions, soft, sliding=sliding)
    for other in (again, driven):
        assert other.joint_angles == pytest.approx(state.joint_angles, abs=1e-8)
        assert other.tensions == pytest.approx(state.tensions, abs=1e-7)


@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_both_tendons_taut_with_friction_are_in_balance(gravity):
    statics, sliding = rough(3, 0.2, 2e3, gravity=gravity, mounting_angle=2.5), (1, -1)
    state = statics.solve(statics.chain.straight(), (0.03, -0.02), (True,) * 3, sliding=sliding)
    assert np.all(state.tensions > 0.0)
    turned = wrapped(statics.chain.arm, state.joint_angles)
    ratios = np.exp(-0.2 * np.array(sliding)[:, None] * turned)
    reference = Reference(statics.chain.arm)
    assert reference.unbalanced(state.joint_angles, state.tensions, ratios) < 1e-9


def test_six_segments_that_turn_the_tip_past_180_degrees_share_the_pull_evenly():
    # The heading of a tendon jumps from 180 to -180 degrees there; its turn does not.
    statics = rough(6, 0.1)
    state = statics.solve(statics.chain.straight(), (0.08, SLACK), (True,) * 6, sliding=PULLED)
    angles = state.bending_angles
    assert angles.sum() > radians(200)
    ratios = tension_ratios(statics.chain, state.joint_angles, PULLED)[RIGHT]
    assert np.all(np.diff(np.log(ratios)) > -0.1 * 1.2)
    assert np.abs(np.diff(angles[3:])).max() < 0.15  # alike, but for the loss along the way


@pytest.mark.parametrize('side', [RIGHT, LEFT])
@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_pulled_and_let_out_arms_bracket_the_frictionless_one(side, gravity):
    statics = rough(3, gravity=gravity, mounting_angle=np.pi)
    asked = [SLACK, SLACK]
    asked[side] = 0.03
    states = [statics.solve(statics.chain.straight(), asked, (True,) * 3, sliding=sliding)
              for sliding in (PULLED, AT_REST, PAID_OUT)]
    base, _, tip = np.abs([s.bending_angles for s in states]).T
    # Pulled, the tension has fallen at the tip: the base takes more of the pull, the tip less.
    assert np.all(np.diff(base) < -0.01)
    assert np.all(np.diff(tip) > 0.01)
    assert np.all(np.diff([s.tensions[side] for s in states]) < -0.05)
    assert states[0].pulls[side] == pytest.approx(states[2].pulls[side], abs=1e-12)


def test_a_pulled_tendon_needs_more_tension_at_the_base_for_the_same_angle_of_the_tip():
    statics = rough(2, 0.3)
    start = statics.chain.uniform([radians(60), 0.0])
    pull = 0.01 + start.pulls[RIGHT]
    soft = (False, True)
    pulled, rest, let_out = (
        statics.solve(start, (pull, SLACK), soft, sliding=sliding)
        for sliding in (PULLED, AT_REST, PAID_OUT))
    # One soft segment: the same length is the same shape, whatever the tension before it.
    assert pulled.joint_angles == pytest.approx(rest.joint_angles, abs=1e-9)
    turned = wrapped(statics.chain.arm, rest.joint_angles)[RIGHT, 1]
    assert pulled.tensions[RIGHT] == pytest.approx(rest.tensions[RIGHT] * exp(0.3 * turned))
    assert let_out.tensions[RIGHT] == pytest.approx(rest.tensions[RIGHT] * exp(-0.3 * turned))


def test_without_a_coefficient_the_direction_does_not_matter_nor_friction_at_rest():
    smooth = [(rough(3, 0.0), sliding) for sliding in (PULLED, AT_REST, PAID_OUT)]
    states = [statics.solve(statics.chain.straight(), (0.03, SLACK), (True,) * 3, sliding=sliding)
              for statics, sliding in (*smooth, (rough(3, 0.3), AT_REST))]
    for state in states[1:]:
        assert np.array_equal(state.joint_angles, states[0].joint_angles)
        assert np.array_equal(state.tensions, states[0].tensions)


def test_what_friction_takes_from_the_tension_does_not_stretch_the_tendon():
    # T falls along the tendon, and so does its strain: each span stretches by its own tension.
    statics = rough(3, 0.5, 500.0)
    asked = 0.03
    state = statics.solve(statics.chain.straight(), (asked, SLACK), (True,) * 3, sliding=PULLED)
    arm = statics.chain.arm
    ratios = np.exp(-0.5 * turned_by(arm, state.joint_angles))[RIGHT]
    length = (np.dot(ratios[::2], [d.height for d in arm.discs])
              + np.dot(ratios[1::2], [s.length for s in arm.segments]))
    stretch = state.tensions[RIGHT] * length / 500.0
    assert asked - state.pulls[RIGHT] == pytest.approx(stretch, rel=0.02)


@pytest.mark.parametrize('sliding', [(1,), (2, 0)])
def test_a_direction_that_is_none_is_refused(sliding):
    statics = rough(2, 0.1)
    with pytest.raises(ValueError, match='sliding'):
        statics.commanded_pulls(statics.chain.straight(), sliding)
    with pytest.raises(ValueError, match='sliding'):
        Linearisation(statics, statics.chain.straight(), sliding)


@pytest.mark.parametrize('stretch', [np.inf, 2000.0])
@pytest.mark.parametrize('sliding', [PULLED, PAID_OUT])
def test_an_arm_bent_to_an_angle_with_friction_has_that_angle_at_those_pulls(stretch, sliding):
    statics = rough(3, 0.3, stretch)
    soft, straight = (True,) * 3, statics.chain.straight()
    bent = statics.bend(straight, 0, 0.1, soft, sliding=sliding)
    pulls = np.where(bent.tensions > 0.0, statics.commanded_pulls(bent, sliding), SLACK)
    state = statics.solve(straight, pulls, soft, sliding=sliding)
    assert state.joint_angles == pytest.approx(bent.joint_angles, abs=1e-8)
    assert state.bending_angles[0] == pytest.approx(0.1, abs=1e-8)
    assert state.tensions == pytest.approx(bent.tensions, rel=1e-7)
    without = statics.bend(straight, 0, 0.1, soft)
    assert np.abs(without.joint_angles - bent.joint_angles).max() > 1e-4


# Tendons that stretch, and tendons of given tension.


@pytest.mark.parametrize('asked', [(0.015, SLACK), (0.015, -0.002), (-0.004, 0.01)])
@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_stretched_tendons_are_springs_in_the_energy(asked, gravity):
    arm = paper_like(2, gravity=gravity, mounting_angle=2.5, tendon=made_of(800.0, 0.5))
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), asked, (True, True))
    expected = Reference(arm).rest(
        statics.chain.straight().joint_angles, stretch=(asked, path_compliance(arm)))
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
