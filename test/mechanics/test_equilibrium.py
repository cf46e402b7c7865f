# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Every state is an equilibrium of the arm as it is described, wherever it was followed from."""

from dataclasses import replace
from math import inf, pi, radians

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import (
    Jam,
    LEFT,
    MomentCurvature,
    OverconstrainedError,
    RIGHT,
    SLACK,
    Statics,
    StaticsError,
    Wrench,
)
from soft_continuum.mechanics.arm import mounted
from support import paper_arm as paper
from support.energy_reference import Reference
from support.flat_arm import flat_arm, guides_of, path_compliance
from support.general_arms import arms, between, FEW, masks, MODERATE, pulls

ALL = (True, True, True)
TABLE = MomentCurvature((0.0, 2.0, 6.0), (0.0, 400.0, 800.0))  # stiffer than any random segment
JAMS = st.sampled_from([
    Jam(), Jam(), Jam(1.5), Jam(8.0), Jam(200.0), Jam(law=TABLE), Jam(8.0, yield_moment=0.02),
    Jam(1.5, yield_moment=0.003), Jam(law=TABLE, yield_moment=0.05)])


@st.composite
def solved(draw, steps=3, load=(0.0, 20.0)):
    """Return (statics, state before, pulls, soft, state) after a few random moves."""
    arm = draw(arms(jam=JAMS, stretch=True, load=load, bodies=(1, 6), segments=(1, 5)))
    light = 0.1 * min(s.stiffness_y for s in arm.segments) / arm.length**2
    arm = replace(arm, payload=light / 10.0 * draw(between(0.0, 1.0)), wrenches=tuple(
        Wrench(draw(st.integers(0, len(arm.segments))),
               (light * draw(between(-1.0, 1.0)), 0.0, light * draw(between(-1.0, 1.0))))
        for _ in range(draw(st.integers(0, 2)))))
    statics = Statics(arm)
    state = before = statics.chain.straight()
    for _ in range(steps):
        soft = draw(masks(arm))
        asked = np.array(draw(st.one_of(
            pulls(arm, state, soft, both=True), st.just((SLACK, SLACK)))))
        before = state
        try:
            state = statics.solve(state, asked, soft)
        except OverconstrainedError:
            assume(False)
    return statics, before, asked, soft, state


def just_taut(state):
    """Return whether a tendon is neither slack nor pulls."""
    return any(slack < 1e-9 and tension == 0.0
               for slack, tension in zip(state.slack, state.tensions, strict=True))


@MODERATE
@given(solved())
def test_a_state_is_a_strict_minimum_of_an_energy_that_was_written_separately(case):
    statics, before, asked, soft, state = case
    arm = statics.chain.arm
    reference = Reference(arm, state.stiff, state.held)
    assert reference.unbalanced(state.joint_angles, state.tensions) < 1e-9
    assert just_taut(state) or reference.stable(state.joint_angles, state.tensions)
    soft_arm, straight = Reference(arm), np.zeros(statics.chain.bodies)
    rise = soft_arm.energy(state.joint_angles) - soft_arm.energy(straight)
    assert statics.chain.energy(state.joint_angles) == pytest.approx(rise, rel=1e-9, abs=1e-12)
    # Tendons.
    path, taut = reference.pulls(state.joint_angles), np.array(state.taut)
    stretch = state.tensions * path_compliance(arm)
    assert state.pulls == pytest.approx(path, abs=1e-12)
    assert np.all(taut == (state.tensions > 0.0))
    assert (asked - path)[taut] == pytest.approx(stretch[taut], abs=1e-12)
    assert statics.commanded_pulls(state)[taut] == pytest.approx(asked[taut], abs=1e-12)
    assert not state.slack[taut].any() and not state.tensions[~taut].any()
    assert state.slack[~taut] == pytest.approx((path - asked)[~taut], abs=1e-12)
    assert np.all(state.slack >= 0.0)
    # Stiff segments.
    rigid = np.repeat([not s and g.jam.rigid for s, g in zip(soft, arm.segments, strict=True)],
                      arm.bodies_per_segment + 1)
    assert state.joint_angles[rigid] == pytest.approx(before.joint_angles[rigid], abs=1e-14)
    limits = np.repeat([s.jam.yield_moment for s in arm.segments], arm.bodies_per_segment + 1)
    moments = np.abs(reference.jam_moments(state.joint_angles))
    assert np.all(moments[~rigid] <= limits[~rigid] * (1.0 + 1e-9))


@FEW
@given(solved(), st.data())
def test_a_state_stays_when_it_is_solved_again_stiffened_or_driven_by_its_tensions(case, data):
    statics, _, asked, soft, state = case
    assume(not just_taut(state))
    fewer = tuple(free and data.draw(st.booleans()) for free in soft)
    rigid = [not s and g.jam.rigid for s, g in zip(fewer, statics.chain.arm.segments, strict=True)]
    cut = np.where(state.tensions > 0.0, asked, SLACK)  # a slack tendon might as well be cut
    again = [statics.solve(state, asked, soft), statics.solve(state, cut, soft)]
    if not all(rigid):
        again.append(statics.solve(state, asked, fewer))
        again.append(statics.solve(again[-1], asked, soft))
    driven = statics.solve_tensions(state, state.tensions, soft)
    if not driven.jumped:  # only their lengths may have held it
        again.append(driven)
    for other in again:
        assert not other.jumped
        assert other.joint_angles == pytest.approx(state.joint_angles, abs=1e-8)
        # A length to 1e-13 m is a tension to 1e-7 N in the stiffest of these.
        assert other.tensions == pytest.approx(state.tensions, abs=1e-7)
        assert other.pulls == pytest.approx(state.pulls, abs=1e-9)
    assert again[0].held == pytest.approx(state.held, abs=1e-9)


@FEW
@given(solved(load=(0.0, 1.0)))
def test_a_softened_arm_forgets_the_shapes_it_was_held_in(case):
    statics, _, _, _, state = case
    soft = (True,) * len(state.stiff)
    free, never = (statics.solve(start, (SLACK, SLACK), soft)
                   for start in (state, statics.chain.straight()))
    assert free.joint_angles == pytest.approx(never.joint_angles, abs=1e-9)


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


@FEW
@given(arms(load=(0.0, 2.0), segments=(2, 5), bodies=(1, 8)), between(-1.0, 1.0), st.data())
def test_a_locked_bent_foot_is_the_same_as_a_turned_mounting(arm, angle, data):
    # All that is above segment 1 cannot tell a bent, locked segment from a turned base.
    above = flat_arm(
        arm.segments[1:], guides_of(arm)[1:], arm.discs[1:],
        mounting_angle=arm.mounting_angle + angle, gravity=float(np.linalg.norm(arm.gravity)),
        bodies_per_segment=arm.bodies_per_segment, discretisation=arm.discretisation)
    soft = (False, *data.draw(masks(above)))
    bent, turned = Statics(arm), Statics(above)
    start = bent.chain.uniform([angle] + [0.0] * (len(arm.segments) - 1))
    straight = turned.chain.straight()
    asked = data.draw(pulls(above, straight, soft[1:], both=True))
    state = bent.solve(start, np.asarray(asked) + start.pulls, soft)
    other = turned.solve(straight, asked, soft[1:])
    assert state.joint_angles[arm.bodies_per_segment + 1:] == pytest.approx(
        other.joint_angles, abs=1e-8)
    assert state.tensions == pytest.approx(other.tensions, abs=1e-6)


def test_a_stiff_segment_keeps_its_shape_to_the_last_bit(statics):
    # Rounding that differs from solve to solve would walk away over the life of an arm.
    state = statics.bend(statics.chain.straight(), 2, paper.ANGLE)
    locked = state.joint_angles[26:].copy()
    for angle in np.linspace(-0.6, 0.6, 50):
        state = statics.bend(state, 0, angle)
        state = statics.bend(state, 1, -angle)
    assert np.array_equal(state.joint_angles[26:], locked)


# Small steps and large ones

def in_small_steps(statics, start, asked, soft, steps=50):
    """Return the states on a straight way to ``asked``; SLACK is slack from the start."""
    states = [start]
    for part in np.linspace(0.0, 1.0, steps + 1)[1:]:
        now = [a + part * (b - a) if np.isfinite(b) else b
               for a, b in zip(start.pulls, asked, strict=True)]
        states.append(statics.solve(states[-1], now, soft))
    return states


@FEW
@given(st.data(), arms(load=(0.0, 2.0), segments=(1, 6), bodies=(1, 8)))
def test_many_small_steps_end_where_one_large_step_ends(data, arm):
    statics = Statics(arm)
    soft = data.draw(masks(arm))
    straight = statics.chain.straight()
    asked = data.draw(pulls(arm, straight, soft, both=True))
    steps = in_small_steps(statics, straight, asked, soft, 30)
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
    straight, soft = statics.chain.straight(), paper.only(segment)
    bent = statics.bend(straight, segment, pi / 2)
    carries = bent.tensions > 0.0
    asked = np.where(carries, bent.pulls, SLACK)
    first = statics.solve(straight, asked, soft)
    back = statics.solve(first, np.where(carries, 0.0, SLACK), soft)
    for there in (first, statics.solve(back, asked, soft)):
        assert there.joint_angles == pytest.approx(bent.joint_angles, abs=1e-8)


# Falls

@pytest.mark.parametrize('asked', [(SLACK, SLACK), (0.0, SLACK), (SLACK, 0.0), (-1e-10, SLACK)])
def test_the_papers_arm_cannot_stand_with_all_segments_soft_and_one_tendon_just_taut(
        statics, asked):
    # It holds only one side: the arm falls to the other and the tendon goes slack.
    state = statics.solve(statics.chain.straight(), asked, ALL)
    assert state.jumped
    assert Reference(statics.chain.arm).stable(state.joint_angles, state.tensions)


def test_two_tendons_that_are_just_taut_keep_it_upright(statics):
    # Falling either way would lengthen one of them.
    state = statics.solve(statics.chain.straight(), (0.0, 0.0), ALL)
    assert np.abs(state.joint_angles).max() < 1e-9
    assert not state.jumped


def test_two_tendons_that_are_just_taut_do_not_keep_a_heavy_arm_from_buckling_into_an_s():
    # Twice the masses: the bow that leaves both lengths as they are has negative curvature.
    statics = Statics(paper.build(2.0))
    arm, straight = Reference(statics.chain.arm), np.zeros(statics.chain.bodies)
    assert not arm.stable(straight, (1e-8, 1e-8))
    state = statics.solve(statics.chain.straight(), (0.0, 0.0), ALL)
    assert np.abs(state.joint_angles).max() > 0.01
    assert arm.energy(state.joint_angles) < arm.energy(straight) - 1e-3
    assert state.iterations < 20000  # on a ridge it once took half a million


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


# Driven by the bending angle

@FEW
@given(arms(load=(0.0, 2.0), segments=(1, 6), bodies=(1, 8)), st.data(), between(-1.3, 1.3),
       between(-1.0, 1.0))
def test_bend_reaches_its_angle_and_solve_agrees(arm, data, angle, before):
    statics = Statics(arm)
    segment = data.draw(st.integers(0, len(arm.segments) - 1))
    soft = paper.only(segment, len(arm.segments))
    state = statics.bend(statics.chain.uniform([before] * len(soft)), segment, angle)
    assert state.bending_angles[segment] == pytest.approx(angle, abs=1e-10)
    assert np.all(state.tensions >= 0.0)
    again = statics.solve(state, np.where(state.tensions > 0.0, state.pulls, SLACK), soft)
    assert again.joint_angles == pytest.approx(state.joint_angles, abs=1e-9)
    assert again.tensions == pytest.approx(state.tensions, abs=1e-7)
    assert Reference(arm, state.stiff, state.held).stable(state.joint_angles, state.tensions)


@pytest.mark.parametrize(('mounting', 'soft', 'angle'), [
    (4.255784892092421, (True, True, False), -13.179), (35.6, ALL, 33.6)])
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


@pytest.mark.parametrize('segment', [0, 2])
def test_bend_to_where_the_segment_rests_takes_no_tension(paper_arm, segment):
    for mounting in np.linspace(-pi, pi, 13):
        statics = Statics(replace(paper_arm, gravity=mounted(mounting)))
        rest = statics.solve(statics.chain.straight(), (SLACK, SLACK), paper.only(segment))
        bent = statics.bend(rest, segment, rest.bending_angles[segment])
        assert bent.tensions == pytest.approx([0.0, 0.0], abs=1e-7)


# Given tensions

@FEW
@given(arms(stretch=True, jam=st.sampled_from([Jam(), Jam(5.0)])), st.data(),
       between(0.0, 0.4), between(0.0, 0.4))
def test_given_tensions_balance_and_their_lengths_give_them_back(arm, data, right, left):
    statics = Statics(arm)
    soft = data.draw(masks(arm))
    firm = min(s.stiffness_y / (s.length * max(pair))
               for s, pair in zip(arm.segments, guides_of(arm), strict=True))
    tensions = np.array([right, left]) * firm
    state = statics.solve_tensions(statics.chain.straight(), tensions, soft)
    assert state.tensions == pytest.approx(tensions)
    assert Reference(arm, state.stiff, state.held).unbalanced(state.joint_angles, tensions) < 1e-9
    asked = np.where(tensions > 0.0, statics.commanded_pulls(state), SLACK)
    again = statics.solve(state, asked, soft)
    assert again.joint_angles == pytest.approx(state.joint_angles, abs=1e-8)
    assert again.tensions == pytest.approx(tensions, abs=1e-7)


def test_an_infinite_ratio_is_the_papers_rigid_segment():
    assert Jam().rigid
    assert Jam().ratio == inf
    assert not Jam(5.0).rigid
    assert not Jam(law=TABLE).rigid
