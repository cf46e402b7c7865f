# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Derivatives by held shapes, by the payload and by forces, against differences of states."""

from dataclasses import replace

import numpy as np
import pytest

from soft_continuum.mechanics import SLACK, Statics, Wrench
from soft_continuum.mechanics.arm import mounted
from soft_continuum.mechanics.laws import Jam, MomentCurvature
from soft_continuum.mechanics.sensitivity import Linearisation
from support.flat_arm import made_of
from support.general_arms import paper_like
from support.sensitivity_rows import column, hinges, numbers

ELASTIC = Jam(8.0)
TABLE = Jam(law=MomentCurvature((0.0, 3.0, 8.0), (0.0, 0.28, 0.65)))
ROPE = made_of(1e4, 0.3)
STIFF, ONE_SOFT = (False, False, False), (False, True, False)
STEP = 1e-5  # rad or kg


def close(ours, expected):
    return ours == pytest.approx(expected, rel=1e-4, abs=1e-4 * max(1e-3, np.abs(expected).max()))


def bent(jam=ELASTIC, soft=ONE_SOFT, tendon=ROPE, pulls=(0.009, -0.004), sliding=(0, 0)):
    """Return the statics of an arm that was stiffened bent, its state, and how to solve again."""
    statics = Statics(paper_like(3, jam, gravity=9.80665, mounting_angle=0.4, tendon=tendon,
                                 payload=0.05))
    before = statics.solve(statics.chain.straight(), (0.006, SLACK), (True,) * 3)
    state = statics.solve(before, pulls, soft, sliding=sliding)

    def again(other, start):
        return numbers(other, other.solve(start, pulls, soft, sliding=sliding))

    return statics, state, again


def with_held(state, segment, change):
    """Return a state whose jams hold one segment bent by ``change`` more, evenly."""
    per_segment = state.chain.joints_per_segment
    held = state.held.copy()
    held[segment * per_segment:(segment + 1) * per_segment] += change / per_segment
    return replace(state, held=held)


CASES = {
    'one soft': {},
    'all stiff and elastic': {'soft': STIFF},
    'a law by table': {'jam': TABLE},
    'all stiff by table': {'jam': TABLE, 'soft': STIFF},
    'both tendons taut': {'pulls': (0.009, -0.0035), 'soft': (True, False, True)},
    'slack tendons': {'pulls': (-0.03, -0.03)},
    'rigid rope': {'tendon': made_of()},
    'friction': {'tendon': ROPE | {'friction': 0.2}, 'sliding': (1, -1)},
}


@pytest.mark.parametrize('case', CASES.values(), ids=CASES)
def test_the_derivatives_by_the_held_shapes_are_those_of_the_solutions(case):
    statics, state, again = bent(**case)
    found = Linearisation(statics, state, case.get('sliding', (0, 0))).held_shape()
    assert np.abs(found.turned).max() > 1e-3
    for segment in range(3):
        low, high = (again(statics, with_held(state, segment, change)) for change in (-STEP, STEP))
        assert close(column(found, 2 * segment + 1), (high - low) / (2.0 * STEP))


@pytest.mark.parametrize('case', CASES.values(), ids=CASES)
def test_the_derivatives_by_the_payload_are_those_of_the_solutions(case):
    statics, state, again = bent(**case)
    found = Linearisation(statics, state, case.get('sliding', (0, 0))).payload()
    assert np.abs(found.turned).max() > 1e-3
    low, high = (again(Statics(replace(statics.chain.arm, payload=0.05 + change)), state)
                 for change in (-STEP, STEP))
    assert close(column(found, 0), (high - low) / (2.0 * STEP))


@pytest.mark.parametrize('case', CASES.values(), ids=CASES)
def test_the_derivatives_by_forces_are_those_of_the_solutions(case):
    statics, state, again = bent(**case)
    found = Linearisation(statics, state, case.get('sliding', (0, 0))).forces()
    for k, disc, x, z in ((3, 2, STEP, 0.0), (5, 2, 0.0, STEP)):
        low, high = (again(Statics(replace(statics.chain.arm, wrenches=(
            Wrench(disc, (sign * x, 0.0, sign * z)),))), state) for sign in (-1.0, 1.0))
        assert close(column(found, k), (high - low) / (2.0 * STEP))


def test_soft_and_rigid_segments_hold_no_shape():
    statics, state, _ = bent()
    assert np.all(Linearisation(statics, state).held_shape().turned[..., 3] == 0.0)
    rigid = Statics(paper_like(3))
    state = rigid.solve(rigid.chain.straight(), (0.006, SLACK), ONE_SOFT)
    assert np.all(Linearisation(rigid, state).held_shape().turned == 0.0)


def test_a_free_stiff_segment_turns_as_its_jam_does_but_for_its_own_spring():
    # Without loads a segment with K = 5 rests where (K - 1) (q - held) + q = 0.
    statics = Statics(paper_like(1, Jam(5.0)))
    state = statics.solve(statics.chain.straight(), (SLACK, SLACK), (False,))
    found = Linearisation(statics, state).held_shape()
    assert hinges(found).sum() == pytest.approx(0.8)


def test_without_gravity_a_payload_does_nothing():
    statics = Statics(paper_like(3, Jam(5.0)))
    state = statics.solve(statics.chain.straight(), (0.006, SLACK), ONE_SOFT)
    assert np.all(Linearisation(statics, state).payload().turned == 0.0)


def test_where_a_jam_yields_its_held_shape_counts_only_when_it_turns_back():
    statics = Statics(paper_like(1, Jam(5.0, yield_moment=0.02), bodies=12))
    pulls, soft = (0.01, SLACK), (False,)
    state = statics.solve(statics.chain.straight(), pulls, soft)
    assert np.any(state.held != 0.0)  # it crept
    per = {}
    for loading, change in ((True, -1e-6), (False, 1e-6)):
        there = statics.solve(with_held(state, 0, change), pulls, soft)
        per[loading] = (numbers(statics, there) - numbers(statics, state)) / change
        found = column(Linearisation(statics, state, loading=loading).held_shape(), 1)
        assert found == pytest.approx(per[loading], rel=1e-2, abs=1e-2)
    assert np.abs(per[True] - per[False]).max() > 0.1


@pytest.mark.parametrize('case', CASES.values(), ids=CASES)
def test_both_derivatives_are_mirror_images_of_those_of_the_mirrored_arm(case):
    statics, state, _ = bent(**case)
    other = Statics(replace(statics.chain.arm, gravity=mounted(-0.4)))
    image = replace(state, configuration=-state.joint_angles, held=-state.held,
                    tensions=state.tensions[::-1], pulls=state.pulls[::-1],
                    slack=state.slack[::-1], chain=other.chain)
    sliding = case.get('sliding', (0, 0))
    ours = Linearisation(statics, state, sliding)
    theirs = Linearisation(other, image, sliding[::-1])
    for one, back, sign in ((ours.held_shape(), theirs.held_shape(), 1.0),
                            (ours.payload(), theirs.payload(), -1.0)):
        assert back.turned == pytest.approx(sign * one.turned, abs=1e-9)
        assert back.tensions == pytest.approx(-sign * one.tensions[::-1], abs=1e-6)
        assert back.tip[[0, 2, 4]] == pytest.approx(
            sign * one.tip[[0, 2, 4]] * [[1.0], [-1.0], [1.0]], abs=1e-9)
