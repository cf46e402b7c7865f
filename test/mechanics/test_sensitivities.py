# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Derivatives of an equilibrium against central differences of equilibria."""

from dataclasses import replace
from math import inf

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import SLACK, Statics
from soft_continuum.mechanics.laws import Jam, MomentCurvature
from soft_continuum.mechanics.sensitivity import Linearisation
from support.energy_reference import Reference
from support.flat_arm import made_of
from support.general_arms import arms, FEW, masks, paper_like, pulls
from support.sensitivity_rows import column, hinges, numbers

SOFT_TABLE = MomentCurvature((0.0, 3.0, 8.0), (0.0, 0.08, 0.15))
STIFF_TABLE = MomentCurvature((0.0, 3.0, 8.0), (0.0, 0.28, 0.65))
JAMS = st.sampled_from([Jam(), Jam(3.0), Jam(20.0), Jam(5.0, yield_moment=1e3)])


def difference(solve, step):
    """Return the fourth-order central difference of solve(0)."""
    low, high, lower, higher = (solve(s * step) for s in (-1, 1, -2, 2))
    return (8.0 * (high - low) - (higher - lower)) / (12.0 * step)


def with_stiffness(arm, segment, stiffness):
    """Return the arm with E I (N m^2) of one segment replaced."""
    return replace(arm, segments=tuple(
        replace(s, stiffness_y=stiffness) if i == segment else s
        for i, s in enumerate(arm.segments)))


def close(ours, expected):
    return ours == pytest.approx(expected, rel=1e-5, abs=1e-5 * max(1.0, np.abs(expected).max()))


@st.composite
def linearised(draw, stretch=True, jam=JAMS, segments=(1, 6)):
    """Return (statics, start, pulls, soft, equilibrium) away from where a tendon gets slack."""
    arm = draw(arms(jam=jam, stretch=stretch, segments=segments, bodies=(1, 4)))
    statics = Statics(arm)
    start = statics.chain.straight()
    before = draw(masks(arm))
    start = statics.solve(start, draw(pulls(arm, start, before, most=0.3)), before)
    soft = draw(masks(arm))
    asked = draw(pulls(arm, start, soft, most=0.3))
    state = statics.solve(start, asked, soft)
    if draw(st.booleans()):  # the other tendon is there as well: slack, or taut if it can stretch
        other = 1 if asked[0] > SLACK else 0
        both = list(asked)
        both[other] = float(state.pulls[other]) - 1e-3
        if arm.tendons[0].axial_stiffness < inf and draw(st.booleans()):
            both[other] += 1.2e-3
        asked = tuple(both)
        state = statics.solve(start, asked, soft)
    assume(not state.jumped)
    for tension, slack in zip(state.tensions, state.slack, strict=True):
        assume(tension > 1e-2 or slack > 1e-4)
    return statics, start, np.array(asked), soft, state


@FEW
@given(linearised())
def test_derivatives_by_the_pulls(case):
    statics, _, asked, soft, state = case
    found = Linearisation(statics, state).pulls()
    for t in (0, 1):
        def solve(change, t=t):
            moved = asked.copy()
            moved[t] += change
            return numbers(statics, statics.solve(state, moved, soft))

        if state.tensions[t] > 0.0:
            expected = difference(solve, 1e-6)
            assert close(column(found, t), expected)
        else:
            assert np.all(column(found, t) == 0.0)


@FEW
@given(linearised(), st.data())
def test_derivatives_by_the_bending_stiffness(case, data):
    statics, start, asked, soft, state = case
    arm = statics.chain.arm
    s = data.draw(st.integers(0, len(arm.segments) - 1))
    stiffness = arm.segments[s].stiffness_y

    def solve(change):
        other = Statics(with_stiffness(arm, s, stiffness * (1.0 + change)))
        return numbers(statics, other.solve(start, asked, soft))

    expected = difference(solve, 1e-4)
    found = Linearisation(statics, state).bending_stiffness()
    assert close(stiffness * column(found, s), expected)


def with_ratio(arm, segment, ratio):
    jam = replace(arm.segments[segment].jam, ratio=ratio)
    return replace(arm, segments=tuple(
        replace(g, jam=jam) if i == segment else g for i, g in enumerate(arm.segments)))


@FEW
@given(linearised(jam=st.sampled_from([Jam(3.0), Jam(20.0)])), st.data())
def test_derivatives_by_the_ratio_k(case, data):
    statics, start, asked, soft, state = case
    arm = statics.chain.arm
    s = data.draw(st.integers(0, len(arm.segments) - 1))
    ratio = arm.segments[s].jam.ratio

    def solve(change):
        return numbers(statics, Statics(with_ratio(arm, s, ratio * (1.0 + change))).solve(
            start, asked, soft))

    expected = difference(solve, 1e-4)
    assert close(ratio * column(Linearisation(statics, state).stiffness_ratio(), s), expected)


def test_rigid_and_soft_segments_have_no_ratio_to_depend_on():
    for jam, soft in ((Jam(), (True, False)), (Jam(5.0), (True, True))):
        statics = Statics(paper_like(2, jam))
        state = statics.solve(statics.chain.straight(), (0.01, SLACK), soft)
        found = Linearisation(statics, state).stiffness_ratio()
        assert np.all(found.turned == 0.0)
        assert np.all(found.tensions == 0.0)


def held(jam, soft_law=None, segments=1):
    """Return the statics of an arm stiffened bent, that state, and the one pulled further."""
    statics = Statics(paper_like(segments, jam, soft_law))
    start = statics.solve(statics.chain.straight(), (0.006, SLACK), (True,) * segments)
    soft = (False,) + (True,) * (segments - 1)
    return statics, start, soft, statics.solve(start, (0.012, SLACK), soft)


def test_the_ratio_k_of_a_table():
    statics, start, soft, state = held(Jam(4.0), SOFT_TABLE)

    def solve(change):
        other = Statics(with_ratio(statics.chain.arm, 0, 4.0 + change))
        return numbers(statics, other.solve(start, (0.012, SLACK), soft))

    expected = difference(solve, 1e-4)
    assert close(column(Linearisation(statics, state).stiffness_ratio(), 0), expected)


@pytest.mark.parametrize('jam', [Jam(law=STIFF_TABLE), Jam(5.0)])
def test_bending_stiffness_below_a_jam(jam):
    # The law of a stiff segment is that of jam and spring together: it stays as it was measured.
    statics, start, soft, state = held(jam, segments=2)
    arm = statics.chain.arm

    def solve(change):
        other = Statics(with_stiffness(arm, 0, 0.0265 * (1.0 + change)))
        return numbers(statics, other.solve(start, (0.012, SLACK), soft))

    expected = difference(solve, 1e-4)
    found = Linearisation(statics, state).bending_stiffness()
    assert close(0.0265 * column(found, 0), expected)


@FEW
@given(linearised())
def test_all_of_them_at_once_are_those_one_by_one(case):
    statics, _, _, _, state = case
    at = Linearisation(statics, state)
    each = [at.held_shape(), at.bending_stiffness(), at.stiffness_ratio(), at.pulls(),
            at.payload()]
    segments = statics.chain.arm.segments
    for part in ('turned', 'tensions', 'paths', 'tip'):
        held, stiffness, *others = (getattr(one, part) for one in each)
        factors = stiffness * [segment.stiffness_y for segment in segments]
        assert getattr(at.all(), part) == pytest.approx(
            np.concatenate([held, factors, *others], axis=-1), rel=1e-9, abs=1e-12)


def test_a_segment_with_a_table_has_no_bending_stiffness_to_derive_by():
    statics, _, _, state = held(Jam(4.0), SOFT_TABLE)
    with pytest.raises(ValueError, match='table'):
        Linearisation(statics, state).bending_stiffness()


@pytest.mark.parametrize('vacuum', [0.1, 0.5, 1.0])
def test_derivatives_are_those_under_the_vacuum_of_the_state(vacuum):
    statics = Statics(paper_like(2, Jam(5.0)))
    soft, under = (True, False), (vacuum, vacuum)
    state = statics.solve(statics.chain.straight(), (0.01, SLACK), soft, vacuum=under)

    def solve(change):
        return numbers(statics, statics.solve(
            state, (0.01 + change, SLACK), soft, vacuum=under))

    assert close(column(Linearisation(statics, state).pulls(), 0), difference(solve, 1e-6))


@pytest.mark.parametrize('tensions', [(0.0, 0.0), (3.0, 0.0)], ids=['slack', 'taut'])
def test_a_rigid_arm_does_not_move(tensions):
    statics = Statics(paper_like(2))
    state = statics.solve_tensions(statics.chain.uniform([0.3, -0.2]), tensions, (False, False))
    found = Linearisation(statics, state)
    for sensitivity in (found.pulls(), found.bending_stiffness(), found.stiffness_ratio()):
        assert np.all(sensitivity.turned == 0.0)
        assert np.all(sensitivity.tip == 0.0)


@FEW
@given(linearised(stretch=False))
def test_the_work_of_a_pull_is_its_tension(case):
    # Castigliano: dE/dpull = T, so the Jacobian turns the springs' and loads' moments into it.
    statics, _, _, _, state = case
    arm = Reference(statics.chain.arm, state.stiff, state.held)
    slope = arm.gradient(state.joint_angles) @ hinges(Linearisation(statics, state).pulls())
    assert slope == pytest.approx(state.tensions, rel=1e-7, abs=1e-7)


# Friction: the share of the tension that arrives at each span changes with the shape

@pytest.mark.parametrize('sliding', [(1, 0), (-1, 0), (0, 1), (1, -1)])
@pytest.mark.parametrize('stretch', [inf, 1e3])
def test_with_friction_the_derivative_is_that_of_the_solutions(sliding, stretch):
    statics = Statics(paper_like(3, tendon=made_of(stretch, 0.2, 0.3), gravity=9.80665,
                                 mounting_angle=2.5))
    soft, tendon = (True,) * 3, 0 if sliding[0] else 1
    asked = {0: np.array([0.02, SLACK]), 1: np.array([SLACK, 0.02])}[tendon]
    if all(sliding):  # both carry
        asked[1] = -0.012
    state = statics.solve(statics.chain.straight(), asked, soft, sliding=sliding)

    def solve(change):
        moved = asked.copy()
        moved[tendon] += change
        return numbers(statics, statics.solve(state, moved, soft, sliding=sliding))

    found = Linearisation(statics, state, sliding).pulls()
    assert close(column(found, tendon), difference(solve, 1e-5))


@pytest.mark.parametrize('pull', [0.005, 0.01, 0.02])
def test_where_jams_yield_the_derivative_is_that_of_loading_or_of_turning_back(pull):
    statics, step = Statics(paper_like(3, Jam(5.0, yield_moment=0.02), bodies=12)), 1e-6
    stiff = (False,) * 3
    state = statics.solve(statics.chain.straight(), (pull, SLACK), stiff)
    for loading, change in ((True, step), (False, -step)):
        there = statics.solve(state, (pull + change, SLACK), stiff)
        found = Linearisation(statics, state, loading=loading).pulls()
        expected = (numbers(statics, there) - numbers(statics, state)) / change
        assert column(found, 0) == pytest.approx(expected, rel=1e-2, abs=1e-2)
