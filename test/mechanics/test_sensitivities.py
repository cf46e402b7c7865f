# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Derivatives of equilibria, in the plane and in space, are those of solves."""

from dataclasses import replace
from math import inf

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import Jam, Linearisation, MomentCurvature, SLACK, Statics
from support.differences import assert_are_differences, assert_is_difference, command
from support.flat_arm import made_of
from support.general_arms import arms, FEW, masks, paper_like, pulls
from support.paper_arm import plane_points
from support.spatial_arms import in_space, random_state, stretching, three_segments

SOFT_TABLE = MomentCurvature((0.0, 3.0, 8.0), (0.0, 0.08, 0.15))
STIFF_TABLE = Jam(law=MomentCurvature((0.0, 3.0, 8.0), (0.0, 0.28, 0.65)))
JAMS = st.sampled_from([Jam(), Jam(3.0), Jam(20.0), Jam(5.0, yield_moment=1e3)])
JAM, ROPE, RUBS = Jam(8.0), made_of(1e4, 0.3), made_of(1e4, 0.3, 0.2)
SEEDS = range(6)


@st.composite
def linearised(draw):
    """Return (statics, equilibrium, soft) away from where a tendon gets slack."""
    arm = replace(draw(arms(jam=JAMS, stretch=True, bodies=(1, 4))), payload=0.01)
    statics = Statics(arm)
    straight, before = statics.chain.straight(), draw(masks(arm))
    start = statics.solve(straight, draw(pulls(arm, straight, before, most=0.3)), before)
    soft = draw(masks(arm))
    asked = draw(pulls(arm, start, soft, most=0.3))
    state = statics.solve(start, asked, soft)
    if draw(st.booleans()):  # the other tendon is there as well: slack, or taut if it can stretch
        other = 1 if asked[0] > SLACK else 0
        both = list(asked)
        both[other] = float(state.pulls[other]) - 1e-3
        if arm.tendons[0].axial_stiffness < inf and draw(st.booleans()):
            both[other] += 1.2e-3
        state = statics.solve(start, both, soft)
    assume(not state.jumped)
    for tension, slack in zip(state.tensions, state.slack, strict=True):
        assume(tension > 1e-2 or slack > 1e-4)
    return statics, state, soft


@FEW
@given(linearised())
def test_derivatives_of_a_random_planar_arm(case):
    assert_are_differences(*case)


@pytest.mark.parametrize('seed', SEEDS)
def test_derivatives_of_a_random_spatial_arm(seed):
    assert_are_differences(*random_state(seed))


def bent(jam=JAM, soft=(False, True, False), tendon=ROPE, pulls=(0.009, -0.004),
         sliding=(0, 0), vacuum=None, **more):
    """Return the statics of an arm that was stiffened bent, what is soft, its state, sliding."""
    statics = Statics(paper_like(3, jam, gravity=9.80665, mounting_angle=0.4, tendon=tendon,
                                 payload=0.05, **more))
    before = statics.solve(statics.chain.straight(), (0.006, SLACK), (True,) * 3)
    state = statics.solve(before, pulls, soft, sliding=sliding, vacuum=vacuum)
    return statics, state, soft, sliding


STIFF = (False, False, False)
BOTH_TAUT = {'pulls': (0.032, -0.006), 'soft': (True, False, True)}
TAUT = {'both tendons taut': 2, 'friction, both taut': 2, 'vacuum': 2, 'all stiff by table': 2,
        'slack tendons': 0}  # else one
CASES = {
    'one soft': {},
    'all stiff and elastic': {'soft': STIFF},
    'a law by table': {'jam': STIFF_TABLE},
    'all stiff by table': {'jam': STIFF_TABLE, 'soft': STIFF},
    'the ratio of a table': {'jam': Jam(4.0), 'soft_law': SOFT_TABLE},
    'both tendons taut': BOTH_TAUT,
    'slack tendons': {'pulls': (-0.1, -0.1)},
    'rigid rope': {'tendon': made_of()},
    'vacuum': {'vacuum': (0.1, 1.0, 0.5)},
    'friction': {'tendon': RUBS, 'sliding': (1, -1)},
    'friction, both taut': BOTH_TAUT | {'tendon': RUBS, 'sliding': (1, -1)},
    'friction, left': {'tendon': RUBS, 'sliding': (0, 1), 'pulls': (-0.03, 0.009)},
    'friction, right paid out': {'tendon': made_of(friction=0.3), 'sliding': (-1, 1),
                                 'pulls': (0.06, SLACK)},
}


@pytest.mark.parametrize('name', CASES)
def test_derivatives_of_a_planar_arm_that_was_stiffened_bent(name):
    case = bent(**CASES[name])
    assert np.count_nonzero(case[1].tensions) == TAUT.get(name, 1)
    assert_are_differences(*case)


def test_derivatives_of_an_arm_in_space_whose_joints_are_hinges():
    arm, soft = in_space(paper_like(2, JAM, gravity=9.80665, payload=0.05)), (False, True)
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), (0.006, SLACK), soft)
    assert not arm.planar and not arm.bending_axes[:, 0].any() and state.tensions[0] > 0.0
    assert_are_differences(statics, state, soft)


@pytest.mark.parametrize(('stretch', 'sliding'), [(np.inf, (1, -1, 1)), (2000.0, (-1, 0, 1))])
def test_derivatives_where_tendons_rub_in_space(stretch, sliding):
    arm = three_segments(payload=0.05)
    arm = replace(arm, tendons=tuple(replace(
        tendon, friction=0.3, axial_stiffness=stretch, twist=3.0) for tendon in arm.tendons))
    statics, soft = Statics(arm), (True, False, True)
    state = statics.solve(statics.chain.straight(), (0.012, -0.003, 0.008), soft, sliding=sliding)
    assert_are_differences(statics, state, soft, sliding)
    line, without = (Linearisation(statics, state, way).pulls().tensions for way in (sliding, ()))
    assert np.abs(line - without).max() > 0.05 * np.abs(without).max()  # it counts


@pytest.mark.parametrize('jam', [Jam(), Jam(5.0)], ids=['rigid', 'elastic'])
@pytest.mark.parametrize('soft', [(True,) * 3, (False,) * 3])
def test_tendons_that_move_without_friction_have_the_derivatives_of_those_at_rest(jam, soft):
    statics = Statics(three_segments(jam=jam))
    pulls = (0.006, -0.004, -0.003) if soft[0] else (-0.001,) * 3
    state = statics.solve(statics.chain.straight(), pulls, soft)
    moving, resting = (Linearisation(statics, state, way).all() for way in ((1, -1, -1), ()))
    assert moving.points == pytest.approx(resting.points, abs=1e-12)
    assert moving.tensions == pytest.approx(resting.tensions, abs=1e-9)


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('which', ['all', 'first'])
def test_by_tensions(seed, which):
    statics, state, soft = random_state(seed)
    given = state.tensions + 0.1
    if which == 'first':
        given[1:] = np.nan
    state = statics.solve(state, command(statics, state), soft, tensions=given)
    at = command(statics, state)
    found, step = Linearisation(statics, state, tensions=given).tensions(), 1e-3
    for t in np.flatnonzero(np.isfinite(given)):
        more, less = (statics.solve(state, at, soft, tensions=given + change * np.eye(4)[t])
                      for change in (step, -step))
        assert_is_difference(found, t, more, less, step)
    assert not found.points[..., np.isnan(given)].any()


def numbers(state):
    """Return joint angles, tensions and the tip in one row."""
    return np.concatenate([state.joint_angles, state.tensions, plane_points(state)[-1]])


def column(found, k):
    """Return the derivatives of ``numbers`` by parameter k."""
    return np.concatenate([np.diff(found.turned[:, 1, k], prepend=0.0), found.tensions[:, k],
                           found.tip[[0, 2, 4], k]])


@pytest.mark.parametrize('pull', [0.005, 0.01, 0.02])
def test_where_jams_yield_the_derivative_is_that_of_loading_or_of_turning_back(pull):
    statics, step = Statics(paper_like(3, Jam(5.0, yield_moment=0.02), bodies=12)), 1e-6
    state = statics.solve(statics.chain.straight(), (pull, SLACK), STIFF)
    for loading, change in ((True, step), (False, -step)):
        there = statics.solve(state, (pull + change, SLACK), STIFF)
        found = Linearisation(statics, state, loading=loading).pulls()
        assert column(found, 0) == pytest.approx(
            (numbers(there) - numbers(state)) / change, rel=1e-2, abs=1e-2)


def test_where_a_jam_yields_its_held_shape_counts_only_when_it_turns_back():
    statics = Statics(paper_like(1, Jam(5.0, yield_moment=0.02), bodies=12))
    pulls, soft = (0.01, SLACK), (False,)
    state = statics.solve(statics.chain.straight(), pulls, soft)
    assert np.any(state.held != 0.0)  # it crept
    per = {}
    for loading, change in ((True, -1e-6), (False, 1e-6)):
        start = state.with_held(state.chain, np.array([[0.0, change]]))
        per[loading] = (numbers(statics.solve(start, pulls, soft)) - numbers(state)) / change
        found = column(Linearisation(statics, state, loading=loading).held_shape(), 1)
        assert found == pytest.approx(per[loading], rel=1e-2, abs=1e-2)
    assert np.abs(per[True] - per[False]).max() > 0.1


def test_a_free_stiff_segment_turns_as_its_jam_does_but_for_its_own_spring():
    # Without loads a segment with K = 5 rests where (K - 1) (q - held) + q = 0.
    statics = Statics(paper_like(1, Jam(5.0)))
    state = statics.solve(statics.chain.straight(), (SLACK, SLACK), (False,))
    assert Linearisation(statics, state).held_shape().bending[0, 1, 1] == pytest.approx(0.8)


def test_a_load_cell_and_a_motor_are_reciprocal():
    """The tension of one tendon by the pull of another is that of the other by the one."""
    statics = Statics(three_segments(gravity=(3.0, 0.0, 9.0)))
    state = statics.solve(statics.chain.straight(), (0.006, 0.0045, -0.002), (True,) * 3)
    found = Linearisation(statics, state).pulls().tensions
    assert np.count_nonzero(state.tensions) >= 2
    assert found == pytest.approx(found.T, rel=1e-7)


def test_where_all_is_rigid_only_tendons_that_stretch_answer():
    statics = Statics(stretching(three_segments(gravity=(0.0, 0.0, 0.0)), (1e-4, 1e-4, 0.0)))
    state = statics.solve(statics.chain.straight(), (0.001, 0.002, -0.001), STIFF)
    found = Linearisation(statics, state).pulls()
    assert found.tensions == pytest.approx(np.diag([1e4, 1e4, 0.0]))
    assert not found.points.any()


@pytest.mark.parametrize('tensions', [(0.0, 0.0), (3.0, 0.0)], ids=['slack', 'taut'])
def test_a_rigid_planar_arm_does_not_move(tensions):
    statics = Statics(paper_like(2))
    state = statics.solve_tensions(statics.chain.uniform([0.3, -0.2]), tensions, (False, False))
    found = Linearisation(statics, state)
    for sensitivity in (found.pulls(), found.bending_stiffness(), found.stiffness_ratio()):
        assert not sensitivity.turned.any()
        assert not sensitivity.tip.any()


def test_what_has_no_derivatives_is_refused():
    flat = Statics(paper_like(1, soft_law=SOFT_TABLE))
    with pytest.raises(ValueError, match='table'):
        Linearisation(flat, flat.chain.straight()).bending_stiffness()
    statics, arm = Statics(three_segments()), three_segments()
    with pytest.raises(ValueError, match='another arm'):
        Linearisation(statics, Statics(three_segments(turn=1.0)).chain.straight())
    with pytest.raises(ValueError, match='each of the 3 tendons'):
        Linearisation(statics, statics.chain.straight(), tensions=(1.0,))
    rubs = Statics(replace(arm, segments=(
        replace(arm.segments[0], friction=0.01), *arm.segments[1:])))
    with pytest.raises(ValueError, match='exclude friction'):
        Linearisation(rubs, rubs.chain.straight())
