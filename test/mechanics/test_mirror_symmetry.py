# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Left is right in a mirror: every call of the public interface gives mirror images."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import (
    bending_for_tip,
    Jam,
    Linearisation,
    set_shape,
    SLACK,
    solve_batch,
    Statics,
    StaticsError,
    workspace,
    Wrench,
)
from support import paper_arm as paper
from support.flat_arm import guides_of, made_of
from support.general_arms import arms, between, FEW, masks, paper_like

JAMS = st.sampled_from([Jam(), Jam(5.0), Jam(3.0, yield_moment=0.05)])


def mirrored(arm):
    """Return the arm seen from behind."""
    def across(vector):
        return -vector[0], 0.0, vector[2]
    return replace(arm, gravity=across(arm.gravity),
                   wrenches=tuple(Wrench(w.disc, across(w.force)) for w in arm.wrenches))


def image(state):
    """Return what describes a state seen from behind: angles, tensions, pulls, slack, jump."""
    return (-state.joint_angles, state.tensions[::-1], state.pulls[::-1], state.slack[::-1],
            state.jumped)


def outcome(call, *arguments, **more):
    """Return what a call returns, or the type of the error that it raises."""
    try:
        return call(*arguments, **more)
    except StaticsError as error:
        return type(error)


def assert_images(state, other):
    """Check that one state, or error, is the mirror image of another."""
    if isinstance(state, type) or isinstance(other, type):
        assert state == other
        return
    there = other.joint_angles, other.tensions, other.pulls, other.slack, other.jumped
    # Two taut tendons of nearly equal levers may share their tensions a little differently.
    for ours, theirs, rel in zip(image(state), there, (1e-6, 1e-3, 1e-6, 1e-6, 0.0), strict=True):
        assert ours == pytest.approx(theirs, abs=1e-6, rel=rel, nan_ok=True)


@FEW
@given(arms(jam=JAMS, segments=(1, 3), bodies=(1, 3), stretch=True, friction=True), st.data())
def test_statics_of_a_random_arm(arm, data):
    one, other = Statics(arm), Statics(mirrored(arm))
    states = one.chain.straight(), other.chain.straight()
    reach = sum(map(min, guides_of(arm)))
    for _ in range(2):
        soft = data.draw(masks(arm))
        # Without any pull two tendons are just taut: which of them carries is left to rounding, as
        # is the side to which an arm folds that both squeeze.
        pull = data.draw(between(0.001, 0.3)) * reach
        rest = data.draw(st.sampled_from([SLACK, -1.1 * pull, -1.5 * pull]))
        signs = data.draw(st.sampled_from([(0, 0), (1, 0), (-1, -1)]))
        segment = soft.index(True)
        for name, given_, back, more in (
                ('solve', (pull, rest), (rest, pull), {'sliding': signs}),
                ('solve_tensions', (pull, abs(pull)), (abs(pull), pull), {}),
                ('bend', 5.0 * pull, -5.0 * pull, {})):
            first = (segment, given_) if name == 'bend' else (given_,)
            second = (segment, back) if name == 'bend' else (back,)
            results = (outcome(getattr(one, name), states[0], *first, soft, **more),
                       outcome(getattr(other, name), states[1], *second, soft,
                               **{k: v[::-1] for k, v in more.items()}))
            assert_images(*results)
        if not isinstance(results[0], type):
            states = results
            lines = (Linearisation(model, state).pulls()
                     for model, state in zip((one, other), states, strict=True))
            ours, theirs = (line.turned[:, 1] for line in lines)
            assert ours == pytest.approx(-theirs[:, ::-1], rel=1e-3, abs=1e-3)


@pytest.mark.parametrize('mounting', [0.0, 2.0])
def test_both_tendons_pulled_from_straight(mounting):
    arm = paper.build(mounting_angle=mounting)
    one, other = Statics(arm), Statics(mirrored(arm))
    straight, soft = one.chain.straight(), (True,) * 3
    rng = np.random.default_rng(1)
    asked = np.concatenate([[(1e-3, 0.0), (1e-5, 0.0)], rng.uniform(-0.01, 0.01, (6, 2))])
    states = []
    for pulls in asked:
        states.append(outcome(one.solve, straight, pulls, soft))
        assert_images(states[-1], outcome(other.solve, straight, pulls[::-1], soft))
    assert not any(isinstance(state, type) for state in states)
    batch = solve_batch(other, straight, asked[:, ::-1], soft)
    assert batch.configurations == pytest.approx(-np.array([s.joint_angles for s in states]),
                                               abs=1e-6)


@pytest.mark.parametrize('mounting', [0.0, 0.5])
def test_the_inverse_problems(mounting):
    arm = paper_like(2, Jam(8.0), gravity=9.80665, mounting_angle=mounting)
    one, other = Statics(arm), Statics(mirrored(arm))
    for angles in ([0.4, -0.3],) if mounting else ([0.0, 0.3],):
        back = [-a for a in angles]
        assert_images(set_shape(one, angles), set_shape(other, back))
        there = set_shape(one, angles)
        x, _, z = there.poses[-1, :3]
        for turn in (None, there.rotations[-1]):
            ours = bending_for_tip(one, (x, 0.0, z), turn)
            theirs = bending_for_tip(other, (-x, 0.0, z), None if turn is None else turn.T)
            assert ours.bending == pytest.approx(-theirs.bending, abs=1e-4)
    ours, theirs = (np.degrees(workspace(model, 1)[1])[..., 1] for model in (one, other))
    assert sorted(ours.round(6).tolist()) == sorted((0.0 - theirs).round(6).tolist())


def test_an_angle_that_either_tendon_could_hold():
    arm = paper_like(1, tendon=made_of(5000.0))
    statics = Statics(arm)
    for start in (-0.4, 0.0, 0.4):
        for angle in (-0.3, 0.0, 0.3):
            assert_images(
                outcome(statics.bend, statics.chain.uniform([start]), 0, angle),
                outcome(statics.bend, statics.chain.uniform([-start]), 0, -angle))


def test_stretch_does_not_matter_to_a_given_angle():
    for stiffness in (1.0, 1000.0):
        statics = Statics(paper_like(1, tendon=made_of(stiffness)))
        hard = Statics(paper_like(1))
        for angle in (-0.3, 0.3):
            state = statics.bend(statics.chain.straight(), 0, angle)
            wanted = hard.bend(hard.chain.straight(), 0, angle)
            assert state.joint_angles == pytest.approx(wanted.joint_angles, abs=1e-9)
            assert state.iterations <= wanted.iterations + 1
