# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where an equilibrium ends: buckling, snapping through, and coming to rest."""

from dataclasses import replace
from functools import partial

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.linalg import eigh

from soft_continuum.mechanics import (
    Disc,
    OverconstrainedError,
    Segment,
    SLACK,
    Statics,
    StaticsError,
)
from soft_continuum.mechanics.arm import mounted
from soft_continuum.mechanics.laws import Jam
from support.energy_reference import Reference
from support.flat_arm import flat_arm, made_of
from support.general_arms import arms, FEW, masks, paper_like, pulls

BOTH_SLACK = (SLACK, SLACK)


def column(payload, bodies=6, height=0.02, **changes):
    """Return a weightless column of 0.2 m and 0.01 N m^2 with a load on top."""
    return flat_arm([Segment.leaf_spring(0.2, 0.01)], 0.02, [Disc(height)] * 2,
                    bodies_per_segment=bodies, payload=payload, **changes)


def critical_payload(arm):
    """Return the payload (kg) at which the straight arm ceases to be a minimum of the energy."""
    straight = np.zeros(len(arm.segments) * (arm.bodies_per_segment + 1))
    bare, laden = (Reference(replace(arm, payload=p)).hessian(straight, (0.0, 0.0))
                   for p in (0.0, 1.0))
    return 1.0 / eigh(bare - laden, bare, eigvals_only=True)[-1]


# Buckling

def test_the_column_buckles_at_eulers_load():
    arm = column(0.0, bodies=25, height=0.001, discretisation='second_order')
    euler = np.pi**2 * 0.01 / (4 * 0.201**2)  # clamped below, free above
    assert -critical_payload(arm) * arm.gravity[2] == pytest.approx(euler, rel=0.01)


@pytest.mark.parametrize('bodies', [1, 4, 12])
@pytest.mark.parametrize('discretisation', ['paper', 'second_order'])
@pytest.mark.parametrize('below', [0.5, 0.999])
def test_below_its_critical_load_a_column_stands(bodies, discretisation, below):
    arm = column(0.0, bodies, discretisation=discretisation)
    statics = Statics(replace(arm, payload=below * critical_payload(arm)))
    state = statics.solve(statics.chain.straight(), BOTH_SLACK, (True,))
    assert state.joint_angles == pytest.approx(0.0, abs=1e-9)
    assert not state.jumped


@pytest.mark.parametrize('bodies', [1, 4, 12])
@pytest.mark.parametrize('discretisation', ['paper', 'second_order'])
@pytest.mark.parametrize('above', [1.001, 1.1, 1.5])
def test_above_its_critical_load_a_column_buckles_and_rests_in_a_minimum(
        bodies, discretisation, above):
    arm = column(0.0, bodies, discretisation=discretisation)
    arm = replace(arm, payload=above * critical_payload(arm))
    statics, reference = Statics(arm), Reference(arm)
    straight = statics.chain.straight()
    state = statics.solve(straight, BOTH_SLACK, (True,))
    assert state.jumped
    assert np.abs(state.joint_angles.sum()) > 0.05
    assert reference.unbalanced(state.joint_angles, (0.0, 0.0)) < 1e-9
    assert reference.stable(state.joint_angles, (0.0, 0.0))
    assert reference.energy(state.joint_angles) < reference.energy(straight.joint_angles)
    again = statics.solve(state, BOTH_SLACK, (True,))
    assert not again.jumped
    assert again.joint_angles == pytest.approx(state.joint_angles, abs=1e-9)


def test_a_buckled_column_leans_to_the_side_it_was_given():
    arm = column(1.2 * critical_payload(column(0.0)))
    statics = Statics(arm)
    for side in (1.0, -1.0):
        state = statics.solve(statics.chain.uniform([0.01 * side]), BOTH_SLACK, (True,))
        assert side * state.joint_angles.sum() > 0.3


def test_a_stiff_segment_carries_what_a_soft_one_does_not():
    critical = critical_payload(column(0.0))
    segment = replace(column(0.0).segments[0], jam=Jam(1.5))
    arm = replace(column(1.2 * critical), segments=(segment,))
    statics = Statics(arm)
    stiff = statics.solve(statics.chain.straight(), BOTH_SLACK, (False,))
    assert not stiff.jumped
    assert stiff.joint_angles == pytest.approx(0.0, abs=1e-9)
    soft = statics.solve(stiff, BOTH_SLACK, (True,))
    assert soft.jumped


def test_a_jam_that_yields_stands_straight_but_not_bent():
    # Bent far enough for the jam to yield, springs alone do not carry the load.
    critical = critical_payload(column(0.0))
    segment = replace(column(0.0).segments[0], jam=Jam(3.0, yield_moment=0.002))
    arm = replace(column(1.2 * critical), segments=(segment,))
    statics = Statics(arm)
    upright = statics.solve(statics.chain.straight(), BOTH_SLACK, (False,))
    assert not upright.jumped
    state = upright
    angles, jumped = [], []
    for tension in np.linspace(0.0, 0.4, 41):
        state = statics.solve_tensions(state, (tension, 0.0), (False,))
        angles.append(state.joint_angles.sum())
        jumped.append(state.jumped)
    assert any(jumped)
    assert not jumped[1]
    fell = jumped.index(True)
    assert angles[fell] - angles[fell - 1] > 0.3
    reference = Reference(arm, state.stiff, state.held)
    assert reference.unbalanced(state.joint_angles, state.tensions) < 1e-9


@FEW
@given(arms(load=(0.0, 1.0)), st.data())
def test_an_arm_that_stands_by_itself_follows_its_tendon_without_a_jump(arm, data):
    statics = Statics(arm)
    soft = data.draw(masks(arm))
    straight = statics.chain.straight()
    state = statics.solve(straight, data.draw(pulls(arm, straight, soft)), soft)
    assert not state.jumped
    assert Reference(arm, state.stiff).stable(state.joint_angles, state.tensions)


# Snapping through

def snapping():
    """Return a buckled column between two tendons as soft as springs, and its rest."""
    payload = 1.1 * critical_payload(column(0.0))
    statics = Statics(column(payload, tendon=made_of(1.0)))
    return statics, statics.solve(statics.chain.uniform([0.1]), BOTH_SLACK, (True,))


def sweep(statics, state, drives):
    """Return the states for the right tendon pulled and the left one paid out by each drive."""
    states = []
    for drive in drives:
        state = statics.solve(state, (drive, -drive), (True,))
        states.append(state)
    return states


def test_a_buckled_column_snaps_through_and_back_at_different_pulls():
    statics, rest = snapping()
    drives = np.linspace(0.08, -0.08, 65)
    there = sweep(statics, rest, drives)
    back = sweep(statics, there[-1], drives[::-1])
    snaps = []
    for states, way in ((there, drives), (back, drives[::-1])):
        angles = np.array([s.joint_angles.sum() for s in states])
        jumps = [i for i, s in enumerate(states) if s.jumped]
        assert len(jumps) == 1
        step = np.diff(angles)
        assert int(np.abs(step).argmax()) + 1 == jumps[0]
        assert np.abs(step[jumps[0] - 1]) > 1.4
        assert np.abs(np.delete(step, jumps[0] - 1)).max() < 0.2
        snaps.append(way[jumps[0]])
    assert snaps[0] < -0.02
    assert snaps[1] > 0.02
    assert snaps[0] == pytest.approx(-snaps[1], abs=1e-9)  # the column is symmetric


def test_between_the_two_snaps_either_side_is_stable():
    statics, rest = snapping()
    right = sweep(statics, rest, [0.02, 0.0, -0.02])
    left = sweep(statics, sweep(statics, rest, [-0.05, -0.08])[-1], [-0.02, 0.0, 0.02])
    for one, other in zip(right, left[::-1], strict=True):
        assert one.joint_angles.sum() > 0.5
        assert other.joint_angles.sum() < -0.5
    reference = Reference(statics.chain.arm)
    for state in (right[1], left[1]):
        assert reference.stable(state.joint_angles, (0.0, 0.0))


def test_one_long_step_past_the_snap_ends_where_small_ones_do_and_says_that_it_jumped():
    statics, rest = snapping()
    at_once = statics.solve(rest, (-0.1, 0.1), (True,))
    assert at_once.jumped
    small = sweep(statics, rest, np.linspace(0.0, -0.1, 41))[-1]
    assert at_once.joint_angles == pytest.approx(small.joint_angles, abs=1e-8)


def test_a_jump_sets_energy_free():
    statics, rest = snapping()
    states = sweep(statics, rest, np.linspace(0.0, -0.1, 41))
    fell = next(i for i, s in enumerate(states) if s.jumped)
    reference = Reference(statics.chain.arm)
    compliance = statics.compliance[0]

    def energy(state):
        return (reference.energy(state.joint_angles)
                + 0.5 * compliance * (state.tensions**2).sum())

    drive = -0.1 * fell / 40  # energy of the shape before, held at the pulls after
    before = states[fell - 1].joint_angles
    path = reference.pulls(before)
    stretch = np.maximum(np.array([drive, -drive]) - path, 0.0)
    held = reference.energy(before) + (stretch**2).sum() / (2 * compliance)
    assert energy(states[fell]) < held - 1e-3


def test_an_arm_held_by_both_tendons_needs_no_jump_to_be_let_down():
    statics = Statics(paper_like(1, gravity=9.80665, tendon=made_of(1e4), payload=0.3))
    held = statics.solve(statics.chain.straight(), (0.0, 0.0), (True,))
    assert held.joint_angles == pytest.approx(0.0, abs=1e-9)
    assert not held.jumped


# Buckling between two taut tendons

@pytest.mark.parametrize(('pull', 'soft'), [
    (1e-6, (1, 1, 1)), (1e-5, (1, 0, 0)), (1e-4, (0, 1, 0)), (1e-3, (1, 1, 1)),
    (3e-3, (1, 0, 0)), (1e-2, (0, 1, 0)), (1e-2, (1, 1, 1))])
@pytest.mark.parametrize('stiffness', [np.inf, 5000.0])
def test_both_tendons_can_be_pulled_a_little_from_straight(pull, soft, stiffness):
    arm = paper_like(3, bodies=6, tendon=made_of(stiffness))
    statics, reference = Statics(arm), Reference(arm, tuple(not s for s in soft))
    state = statics.solve(statics.chain.straight(), (pull, pull), soft)
    assert state.jumped or (stiffness < np.inf and (pull < 1e-3 or soft != (1, 1, 1)))
    assert statics.commanded_pulls(state) == pytest.approx([pull, pull], abs=1e-9)
    assert reference.stable(state.joint_angles, state.tensions)
    again = statics.solve(state, (pull, pull), soft)
    assert not again.jumped
    assert again.joint_angles == pytest.approx(state.joint_angles, abs=1e-6)


NEARLY_SYMMETRIC = (((0.083, 0.0354, (0.012, 0.014)), (0.079, 0.0439, (0.017, 0.027))),
                    0.0, 0.0, (0.0046, 0.0134))
SAGGING = (((0.044, 0.0262, (0.024, 0.017)), (0.043, 0.0072, (0.021, 0.017))),
           9.80665, np.pi / 2, (0.0032, 0.0114))


@pytest.mark.parametrize(('kinds', 'gravity', 'mounting', 'asked'), [NEARLY_SYMMETRIC, SAGGING],
                         ids=['nearly symmetric', 'sagging'])
def test_a_long_step_on_two_taut_tendons_ends_where_short_ones_end(
        kinds, gravity, mounting, asked):
    lengths, stiffnesses, offsets = zip(*kinds, strict=True)
    statics = Statics(flat_arm(
        map(partial(Segment.leaf_spring, mass=0.05), lengths, stiffnesses), offsets,
        [Disc(0.02, 0.03)] * 3, made_of(5000.0), mounting, gravity))
    soft = (True, True)
    start = state = statics.solve(statics.chain.straight(), (0.0, 0.0), soft)
    at_once = statics.solve(start, asked, soft)
    assert at_once.tensions.min() > 1.0
    for part in np.linspace(0.0, 1.0, 61)[1:]:
        state = statics.solve(state, np.array(asked) * part, soft)
        assert not state.jumped
    assert at_once.joint_angles == pytest.approx(state.joint_angles, abs=1e-6)


# No jump where there is a way round

def test_a_hand_over_between_the_tendons_is_no_jump():
    # On the straight way from the paths both tendons are too short; slack first it is not so.
    statics = Statics(paper_like(3, bodies=12, gravity=9.80665, mounting_angle=np.pi))
    rng, soft = np.random.default_rng(0), (True,) * 3
    for _ in range(20):
        right, left = rng.uniform(0.002, 0.03, 2)
        spare = rng.uniform(1.0, 1.5, 2)
        start = statics.solve(statics.chain.straight(), (right, -spare[0] * right - 1e-3), soft)
        over = statics.solve(start, (-spare[1] * left - 1e-3, left), soft)
        assert not over.jumped
        direct = statics.solve(statics.chain.straight(), (SLACK, left), soft)
        assert over.joint_angles == pytest.approx(direct.joint_angles, abs=1e-7)


def test_a_hand_over_between_segments_is_no_jump_where_small_steps_make_none(
        paper_arm):
    # What the stiff segments carried cannot fade slowly here; let go at once, it comes to rest.
    statics = Statics(replace(paper_arm, gravity=mounted(np.pi)))
    pulls, later = np.array([0.0194, -0.0291]), np.array([-0.0014, 0.0012])
    for order in (slice(None), slice(None, None, -1)):
        start = statics.solve(statics.chain.straight(), pulls[order], (True, False, False))
        at_once = statics.solve(start, later[order], (False, True, True))
        state = start
        for part in np.linspace(0.0, 1.0, 201):
            state = statics.solve(
                state, (pulls + part * (later - pulls))[order], (False, True, True))
            assert not state.jumped
        assert not at_once.jumped
        assert at_once.joint_angles == pytest.approx(state.joint_angles, abs=1e-7)


# Failure is no proof

def test_tendons_are_called_too_short_only_where_they_are():
    statics = Statics(paper_like(3, bodies=12))
    straight, soft = statics.chain.straight(), (True, False, False)
    bent = statics.solve(straight, (0.02, SLACK), soft)
    failure = statics.continuation._failure
    target = statics.chain.straight_paths - np.array([0.02, -np.inf])
    at_bent = statics.continuation.point_of(bent)._replace(tension=np.array([5.0, 0.0]))
    problem = statics.problem(straight, soft, target)
    assert type(failure(at_bent, problem, target)) is StaticsError
    beyond = statics.chain.straight_paths - np.array([0.075, -np.inf])
    problem = statics.problem(straight, soft, beyond)
    assert type(failure(at_bent, problem, beyond)) is OverconstrainedError
