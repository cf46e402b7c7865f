# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Every state that the solver returns is an equilibrium of the arm as it is described."""

from dataclasses import replace
from math import pi

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import (
    Disc,
    LEFT,
    OverconstrainedError,
    RIGHT,
    Segment,
    SLACK,
    Statics,
)
from soft_continuum.mechanics.arm import mounted
from support import paper_arm as paper
from support.flat_arm import flat_arm, guides_of
from support.independent_statics import IndependentArm
from support.random_arms import arms, between, masks, MODERATE, pulls


@st.composite
def solved(draw, steps=2, **kinds):
    """Return (statics, state before, pulls, soft, state) after a few random moves."""
    arm = draw(arms(**kinds))
    statics = Statics(arm)
    state = before = statics.chain.straight()
    for _ in range(steps):
        soft = draw(masks(arm))
        asked = draw(pulls(arm, soft, state))
        before = state
        try:
            state = statics.solve(state, asked, soft)
        except OverconstrainedError:
            assume(False)
    return statics, before, asked, soft, state


# Against a reference that shares nothing with the solver

@MODERATE
@given(solved(load=(0.0, 10.0)))
def test_no_moment_is_left_over_at_any_soft_joint(case):
    statics, _, _, soft, state = case
    arm = IndependentArm(statics.chain.arm)
    assert arm.unbalanced(state.joint_angles, state.tensions, soft) < 1e-9


@MODERATE
@given(solved(load=(0.0, 10.0)))
def test_lengths_are_those_of_the_independent_arm(case):
    statics, _, _, _, state = case
    arm = IndependentArm(statics.chain.arm)
    lengths = arm.values(state.joint_angles)[1:]
    assert state.pulls == pytest.approx(arm.straight_lengths - lengths, abs=1e-12)


@MODERATE
@given(solved(load=(0.0, 10.0)))
def test_the_energy_is_that_of_the_independent_arm(case):
    statics, _, _, _, state = case
    arm = IndependentArm(statics.chain.arm)
    straight = np.zeros(statics.chain.bodies)
    rise = arm.values(state.joint_angles)[0] - arm.values(straight)[0]
    ours = statics.chain.energy(state.joint_angles) - statics.chain.energy(straight)
    assert ours == pytest.approx(rise, abs=1e-12)


@MODERATE
@given(solved(load=(0.0, 10.0)))
def test_every_state_is_a_strict_minimum_for_the_tendons_that_carry(case):
    statics, _, _, soft, state = case
    assume(not any(0.0 <= s < 1e-9 and t == 0.0
                   for s, t in zip(state.slack, state.tensions, strict=True)))
    arm = IndependentArm(statics.chain.arm)
    assert arm.lowest_curvature(state.joint_angles, state.tensions, soft) > 0.0


@MODERATE
@given(st.data(), arms(load=(0.0, 2.0)))
def test_a_general_optimiser_finds_the_same_state(data, arm):
    statics = Statics(arm)
    soft = data.draw(masks(arm))
    straight = statics.chain.straight()
    asked = data.draw(pulls(arm, soft, straight))
    state = statics.solve(straight, asked, soft)
    reference = IndependentArm(arm)
    found, success = reference.minimise(straight.joint_angles, asked, soft)
    assert success
    assert state.joint_angles == pytest.approx(found, abs=2e-5)


@MODERATE
@given(solved(load=(0.0, 10.0)), st.integers(0, 2**32 - 1))
def test_no_small_feasible_change_lowers_the_energy(case, seed):
    statics, _, asked, soft, state = case
    arm = IndependentArm(statics.chain.arm)
    assume(not any(0.0 <= s < 1e-9 and t == 0.0
                   for s, t in zip(state.slack, state.tensions, strict=True)))
    random = np.random.default_rng(seed)
    free = arm.free_joints(soft)
    gradients = arm.gradients(state.joint_angles)[1:, free]
    hold = gradients[state.tensions > 0.0]
    limit = arm.straight_lengths - np.asarray(asked)
    rest = arm.values(state.joint_angles)[0]
    for _ in range(20):
        change = random.normal(size=free.sum())
        change *= 1e-3 / np.linalg.norm(change)
        moved = state.joint_angles.copy()
        moved[free] += change
        for _ in range(4):  # back onto the lengths of the tendons that carry
            if len(hold):
                over = (arm.values(moved)[1:] - limit)[state.tensions > 0.0]
                moved[free] -= np.linalg.pinv(hold, rcond=1e-8) @ over
        lengths = arm.values(moved)[1:]
        if np.any(lengths > limit + 1e-13):
            continue
        assert arm.values(moved)[0] > rest - 1e-13


# From first principles: the free body above every joint

def moments_above(chain, state):
    """Return the moment (N m, about +y) of weights and tendons on what is above each joint."""
    arm = chain.arm
    n = arm.bodies_per_segment
    ends = chain.backbone(state.joint_angles)
    # Weight in the base frame: the frame is turned by the mounting angle about +y.
    down = np.array(arm.gravity)[[0, 2]]
    points, forces, body_of = [], [], []
    for k, segment in enumerate(arm.segments):
        for i in range(n + 1):
            body = k * (n + 1) + i
            mass = arm.discs[k + 1].mass if i == n else segment.mass / n
            points.append((ends[body, :2] + ends[body + 1, :2]) / 2)
            forces.append(mass * down)
            body_of.append(body)
    guides = chain.guide_points(state.joint_angles)
    for tendon in (RIGHT, LEFT):
        for k in range(len(arm.segments)):
            lower, upper = guides[tendon, 2 * k + 1], guides[tendon, 2 * k + 2]
            pull = state.tensions[tendon] * (upper - lower) / np.linalg.norm(upper - lower)
            points += [lower, upper]
            forces += [pull, -pull]
            body_of += [k * (n + 1) - 1, (k + 1) * (n + 1) - 1]
    points, forces, body_of = np.array(points), np.array(forces), np.array(body_of)
    moments = np.empty(chain.bodies)
    for joint in range(chain.bodies):
        above = body_of >= joint
        arms_ = points[above] - ends[joint, :2]
        moments[joint] = (arms_[:, 1] * forces[above, 0] - arms_[:, 0] * forces[above, 1]).sum()
    return moments


@MODERATE
@given(solved(load=(0.0, 10.0)))
def test_each_spring_carries_the_moment_of_the_free_body_above_it(case):
    statics, _, _, soft, state = case
    chain = statics.chain
    free = np.repeat(soft, chain.joints_per_segment)
    springs = chain.joint_stiffness * state.joint_angles
    assert springs[free] == pytest.approx(moments_above(chain, state)[free], abs=1e-9)


def test_without_gravity_the_moment_in_a_segment_is_tension_times_offset_at_its_middle(weightless):
    # By symmetry the span is parallel to the middle body; n even has a joint in the middle.
    state = weightless.bend(weightless.chain.straight(), 0, paper.ANGLE)
    guides = weightless.chain.guide_points(state.joint_angles)
    ends = weightless.chain.backbone(state.joint_angles)
    lower, upper = guides[RIGHT, 1], guides[RIGHT, 2]
    along = (upper - lower) / np.linalg.norm(upper - lower)
    offset = lower - ends[6, :2]
    lever = abs(offset[0] * along[1] - offset[1] * along[0])
    moment = weightless.chain.joint_stiffness[6] * state.joint_angles[6]
    assert moment == pytest.approx(state.tensions[RIGHT] * lever, rel=1e-12)


# Tendons

@MODERATE
@given(solved(load=(0.0, 10.0)))
def test_a_tendon_pulls_or_is_slack_and_a_taut_one_is_as_long_as_its_pull_says(case):
    _, _, asked, _, state = case
    for tendon in (RIGHT, LEFT):
        assert state.tensions[tendon] >= 0.0
        assert state.slack[tendon] >= 0.0
        if state.tensions[tendon] > 0.0:
            assert state.taut[tendon]
            assert state.slack[tendon] == 0.0
            assert state.pulls[tendon] == pytest.approx(asked[tendon], abs=1e-12)
        else:
            assert not state.taut[tendon]
            left_over = state.pulls[tendon] - asked[tendon]
            assert state.slack[tendon] == pytest.approx(left_over, abs=1e-12)


@MODERATE
@given(solved())
def test_a_slack_tendon_might_as_well_be_cut(case):
    statics, before, asked, soft, state = case
    cut = [p if t > 0.0 else SLACK for p, t in zip(asked, state.tensions, strict=True)]
    again = statics.solve(state, cut, soft)
    assert again.joint_angles == pytest.approx(state.joint_angles, abs=1e-9)
    assert again.tensions == pytest.approx(state.tensions, abs=1e-7)


# Symmetries

@MODERATE
@given(solved())
def test_swapping_the_tendons_of_the_mirrored_arm_mirrors_the_shape(case):
    statics, before, asked, soft, state = case
    assume(not state.jumped)
    x, _, z = statics.chain.arm.gravity
    mirrored = Statics(replace(statics.chain.arm, gravity=(-x, 0.0, z)))
    start = mirrored.chain.state(-before.joint_angles)
    start = replace(start, tensions=before.tensions[::-1].copy())
    image = mirrored.solve(start, asked[::-1], soft)
    assert image.joint_angles == pytest.approx(-state.joint_angles, abs=1e-8)
    assert image.tensions == pytest.approx(state.tensions[::-1], abs=1e-6)
    assert image.pulls == pytest.approx(state.pulls[::-1], abs=1e-9)


@MODERATE
@given(arms(load=(0.0, 2.0), segments=(2, 5)), between(-1.0, 1.0), st.data())
def test_a_locked_bent_foot_is_the_same_as_a_turned_mounting(arm, angle, data):
    # All that is above segment 1 cannot tell a bent, locked segment from a turned base.
    above = flat_arm(
        arm.segments[1:], guides_of(arm)[1:], arm.discs[1:],
        mounting_angle=arm.mounting_angle + angle, gravity=float(np.linalg.norm(arm.gravity)),
        bodies_per_segment=arm.bodies_per_segment, discretisation=arm.discretisation)
    soft = (False, *data.draw(masks(above)))
    bent, turned = Statics(arm), Statics(above)
    start = bent.chain.uniform([angle] + [0.0] * (len(arm.segments) - 1))
    above = turned.chain.straight()
    asked = data.draw(pulls(turned.chain.arm, soft[1:], above))
    state = bent.solve(start, np.asarray(asked) + start.pulls, soft)
    other = turned.solve(above, asked, soft[1:])
    joints = arm.bodies_per_segment + 1
    assert state.joint_angles[joints:] == pytest.approx(other.joint_angles, abs=1e-8)
    assert state.tensions == pytest.approx(other.tensions, abs=1e-6)


def test_a_full_turn_of_the_mounting_changes_nothing(paper_arm):
    asked, soft = (0.012, SLACK), (True, True, True)
    states = []
    for mounting in (-1.5 * pi, 0.5 * pi):
        statics = Statics(replace(paper_arm, gravity=mounted(mounting)))
        states.append(statics.solve(statics.chain.straight(), asked, soft))
    assert states[0].joint_angles == pytest.approx(states[1].joint_angles, abs=1e-9)


def test_a_hanging_arm_hangs_straight_and_a_horizontal_one_sags_down(paper_arm):
    for mounting, sign in ((pi, 0.0), (pi / 2, 1.0), (-pi / 2, -1.0)):
        statics = Statics(replace(paper_arm, gravity=mounted(mounting)))
        state = statics.solve(statics.chain.straight(), (SLACK, SLACK), (True, True, True))
        angles = paper.degrees_of(statics, state)
        if sign:
            assert np.all(sign * angles > 5.0)
        else:
            assert angles == pytest.approx([0.0] * 3, abs=1e-9)


def test_a_horizontal_cantilever_sags_as_beam_theory_says():
    # Stiff and light, so that small deflections hold: uniform load plus load at the tip.
    arm = flat_arm([Segment.leaf_spring(0.5, 50.0, 0.2)], 0.02, [Disc(0.01), Disc(0.01, 0.1)],
                   bodies_per_segment=200, mounting_angle=pi / 2)
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), (SLACK, SLACK), (True,))
    g, length, stiffness = 9.80665, 0.5, 50.0
    force, moment, load = 0.1 * g, 0.1 * g * 0.005, 0.2 * g / length
    sag = (force * length**3 / 3 + moment * length**2 / 2 + load * length**4 / 8) / stiffness
    end = state.points[2]
    assert end[0] == pytest.approx(sag, rel=0.02)  # x of a base turned by 90 degrees points down


# Stiff segments

def test_a_stiff_segment_keeps_its_shape_to_the_last_bit(statics):
    # Rounding that differs from solve to solve would walk away over the life of an arm.
    state = statics.bend(statics.chain.straight(), 2, paper.ANGLE)
    locked = state.joint_angles[26:].copy()
    for angle in np.linspace(-0.6, 0.6, 50):
        state = statics.bend(state, 0, angle)
        state = statics.bend(state, 1, -angle)
    assert np.array_equal(state.joint_angles[26:], locked)


@MODERATE
@given(solved(steps=3, load=(0.0, 10.0)))
def test_a_stiff_segment_keeps_its_shape_to_rounding(case):
    statics, before, _, soft, state = case
    locked = ~np.repeat(soft, statics.chain.joints_per_segment)
    assert state.joint_angles[locked] == pytest.approx(before.joint_angles[locked], abs=1e-14)


@MODERATE
@given(solved(), st.data())
def test_stiffening_at_rest_moves_nothing(case, data):
    statics, _, asked, soft, state = case
    fewer = tuple(free and data.draw(st.booleans()) for free in soft)
    held = statics.solve(state, asked, fewer)
    assert held.joint_angles == pytest.approx(state.joint_angles, abs=1e-9)
    if any(fewer):
        assert not held.jumped
        assert statics.solve(held, asked, soft).joint_angles == pytest.approx(
            state.joint_angles, abs=1e-9)


def test_the_order_of_softening_matters_but_not_of_asking_twice(statics):
    state = statics.bend(statics.chain.straight(), 1, paper.ANGLE)
    asked = (state.pulls[RIGHT], SLACK)
    again = statics.solve(state, asked, paper.only(1))
    assert again.joint_angles == pytest.approx(state.joint_angles, abs=1e-12)
    assert again.tensions == pytest.approx(state.tensions, abs=1e-9)
