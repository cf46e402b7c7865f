# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A stiff segment: rigid, elastic about the shape it was stiffened in, or yielding; its vacuum."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import SLACK, Statics, StaticsError, Wrench
from soft_continuum.mechanics.laws import Jam, LawError, linear, MomentCurvature
from support.energy_reference import Reference
from support.flat_arm import made_of
from support.general_arms import arms, FEW, masks, paper_like, pulls, STIFFNESS
from support.paper_arm import only
from support.spatial_arms import three_segments

BOTH_SLACK = (SLACK, SLACK)
TABLE = MomentCurvature((0.0, 2.0, 6.0), (0.0, 400.0, 800.0))  # stiffer than any random segment


# Stiffening

def test_a_rigid_arm_keeps_the_tension_of_a_tendon_that_stretches():
    # Not overconstrained: the tendon is as long as it was a moment ago, and as taut.
    statics = Statics(paper_like(2, tendon=made_of(1e4)))
    state = statics.solve(statics.chain.straight(), (0.01, SLACK), (True, True))
    held = statics.solve(state, (0.01, SLACK), (False, False))
    assert np.array_equal(held.joint_angles, state.joint_angles)
    assert held.tensions == pytest.approx(state.tensions, rel=1e-9)


def test_given_tensions_on_a_rigid_arm_are_its_tensions_and_all_of_it_is_stiff():
    statics = Statics(paper_like(2))
    state = statics.solve(statics.chain.straight(), (0.01, SLACK), (True, True))
    held = statics.solve_tensions(state, (3.0, 1.0), (False, False))
    assert held.tensions == pytest.approx([3.0, 1.0])
    assert held.stiff == (True, True)
    assert np.array_equal(held.slack, [0.0, 0.0])
    assert np.array_equal(held.held, state.joint_angles)


@pytest.mark.parametrize('exponent', [0.0, 0.5, 1.0])
def test_more_vacuum_on_a_bent_segment_moves_nothing(exponent):
    # What is stiffened at rest bears nothing yet; what was borne before is borne as before.
    statics = Statics(paper_like(1, Jam(5.0, stiffness_exponent=exponent)))
    start = statics.solve(statics.chain.straight(), (0.005, SLACK), (True,))
    bent = statics.solve_tensions(start, (10.0, 0.0), (False,), vacuum=(0.5,))
    more = statics.solve_tensions(bent, (10.0, 0.0), (False,), vacuum=(1.0,))
    assert more.joint_angles == pytest.approx(bent.joint_angles, abs=1e-9)


def test_a_segment_bent_without_vacuum_is_held_where_it_is_when_the_vacuum_comes():
    statics = Statics(paper_like(1, Jam(5.0)))
    free = statics.solve(statics.chain.straight(), (0.01, SLACK), (False,), vacuum=(0.0,))
    held = statics.solve_tensions(free, free.tensions, (False,), vacuum=(1.0,))
    assert held.joint_angles == pytest.approx(free.joint_angles, abs=1e-9)


# Elastic, with ratio K

@FEW
@given(arms(jam=Jam(7.0), segments=(2, 4)), st.data())
def test_weight_apart_every_released_joint_springs_back_by_one_part_in_k(arm, data):
    statics = Statics(arm.without_gravity())
    straight = statics.chain.straight()
    soft = (True,) * len(arm.segments)
    bent = statics.solve(straight, data.draw(pulls(arm, straight, soft)), soft)
    held = statics.solve(bent, BOTH_SLACK, (False,) * len(arm.segments))
    assert held.joint_angles == pytest.approx(6 / 7 * bent.joint_angles, abs=1e-9)


def elastic_and_rigid(ratio, gravity):
    """Return the arm with segment 2 bent, then 1: with ratio K, and with a rigid segment 2."""
    shapes = []
    for jam in (Jam(ratio), Jam()):
        statics = Statics(paper_like(2, jam, gravity=gravity))
        state = statics.solve(statics.chain.straight(), (0.01, SLACK), only(1, 2))
        state = statics.solve(state, (0.03, SLACK), only(0, 2))
        shapes.append(state.joint_angles)
    return shapes


@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_the_stiffer_the_jam_the_closer_to_the_rigid_segment(gravity):
    apart = [np.abs(np.subtract(*elastic_and_rigid(ratio, gravity))).max()
             for ratio in (1e3, 1e4, 1e5)]
    assert apart[0] < 5e-3
    assert apart[0] / apart[1] == pytest.approx(10.0, rel=0.02)
    assert apart[1] / apart[2] == pytest.approx(10.0, rel=0.02)


@FEW
@given(arms(jam=Jam(4.0)), st.data())
def test_a_segment_stiffened_straight_is_one_of_k_times_the_stiffness(arm, data):
    stiff = Statics(arm)
    soft = data.draw(masks(arm))
    firm = Statics(replace(arm, segments=tuple(
        replace(s, stiffness_y=s.stiffness_y * (1.0 if free else 4.0))
        for s, free in zip(arm.segments, soft, strict=True))))
    straight = stiff.chain.straight()
    asked = data.draw(pulls(arm, straight, soft))
    one, other = stiff.solve(straight, asked, soft), firm.solve(
        straight, asked, (True,) * len(soft))
    assert one.joint_angles == pytest.approx(other.joint_angles, abs=1e-10)
    assert one.tensions == pytest.approx(other.tensions, abs=1e-8)


@pytest.mark.parametrize('mounting', np.linspace(-2.4, -0.6, 10))
def test_jams_that_yield_back_and_forth_on_a_long_way_are_in_balance_at_its_end(mounting):
    # From straight, weight and tendon turn the arm so far that it is followed in small steps.
    statics = Statics(paper_like(2, Jam(23.0, yield_moment=0.1), bodies=2, gravity=9.80665,
                                 mounting_angle=mounting))
    state = statics.solve(statics.chain.straight(), (0.01, SLACK), (False, False))
    arm = Reference(statics.chain.arm, state.stiff, state.held)
    assert arm.unbalanced(state.joint_angles, state.tensions) < 1e-9


# Elastic with yield

def yielding(limit=0.05, angle=0.2):
    """Return the statics of one segment with a jam of K = 6 that yields, and its start, bent."""
    statics = Statics(paper_like(1, Jam(6.0, yield_moment=limit), bodies=6))
    return statics, statics.bend(statics.chain.straight(), 0, angle)


def jam_moments(statics, state, **more):
    return Reference(statics.chain.arm, state.stiff, state.held, **more).jam_moments(
        state.joint_angles)


def test_below_its_limit_the_jam_does_not_creep():
    statics, start = yielding()
    held = statics.solve_tensions(start, start.tensions, (False,))
    state = statics.solve_tensions(held, start.tensions + [1.0, 0.0], (False,))
    assert 0.0 < np.abs(jam_moments(statics, state)).max() < 0.05
    assert np.array_equal(state.held, held.held)
    back = statics.solve_tensions(state, start.tensions, (False,))
    assert back.joint_angles == pytest.approx(start.joint_angles, abs=1e-9)


def test_above_its_limit_the_held_shape_creeps_and_the_jam_bears_just_the_limit():
    statics, start = yielding()
    state = statics.solve_tensions(start, (12.0, 0.0), (False,))
    moments = jam_moments(statics, state)
    crept = state.held - start.joint_angles
    assert np.all(crept > 1e-3)
    assert moments == pytest.approx(0.05, rel=1e-12)


def test_unloading_after_yield_is_elastic_and_the_set_remains():
    statics, start = yielding(angle=0.05)
    loaded = statics.solve_tensions(start, (3.4, 0.0), (False,))
    free = statics.solve(loaded, BOTH_SLACK, (False,))
    # The jam gives way back to where springs and jam balance about the crept shape.
    jam = 5.0 * statics.chain.joint_stiffness
    set_ = loaded.joint_angles - 0.05 / jam
    assert np.all(set_ > start.joint_angles)
    assert np.abs(jam_moments(statics, free)).max() < 0.05  # no yield on the way back
    assert loaded.held == pytest.approx(set_, abs=1e-12)
    assert np.array_equal(free.held, loaded.held)
    assert free.joint_angles == pytest.approx(5.0 / 6.0 * set_, abs=1e-10)
    again = statics.solve_tensions(free, (3.4, 0.0), (False,))
    assert again.joint_angles == pytest.approx(loaded.joint_angles, abs=1e-9)


def test_a_spring_too_strong_for_the_jam_unbends_it_until_both_bear_the_limit():
    statics, start = yielding(limit=0.004)
    free = statics.solve(start, BOTH_SLACK, (False,))
    springs = statics.chain.joint_stiffness * free.joint_angles
    assert springs == pytest.approx(0.004, rel=1e-9)
    assert jam_moments(statics, free) == pytest.approx(-0.004, rel=1e-9)


@pytest.mark.parametrize('segments', [1, 2])
@pytest.mark.parametrize('ratio', [1.5, 6.0, 30.0])
def test_loading_in_one_step_or_in_many_ends_the_same(segments, ratio):
    statics = Statics(paper_like(segments, Jam(ratio, yield_moment=0.03)))
    stiff = (False,) * segments
    start = statics.solve(statics.chain.straight(), (0.004, SLACK), (True,) * segments)
    ends = []
    for steps in (1, 3, 40):
        state = start
        for part in np.linspace(0.0, 1.0, steps + 1)[1:]:
            state = statics.solve(state, (0.004 + 0.01 * segments * part, SLACK), stiff)
        ends.append(state)
    assert np.abs(ends[0].held - start.joint_angles).max() > 0.01
    for other in ends[1:]:
        assert other.joint_angles == pytest.approx(ends[0].joint_angles, abs=1e-8)
        assert other.held == pytest.approx(ends[0].held, abs=1e-8)
        assert other.tensions == pytest.approx(ends[0].tensions, abs=1e-6)


def test_reversed_in_one_step_or_in_many_it_ends_the_same():
    statics = Statics(paper_like(1, Jam(6.0, yield_moment=0.03)))
    there = statics.solve(statics.chain.straight(), (0.012, SLACK), (False,))
    ends = []
    for steps in (1, 40):
        state = there
        for part in np.linspace(0.0, 1.0, steps + 1)[1:]:
            state = statics.solve(state, (SLACK, -0.012 + 0.024 * part), (False,))
        ends.append(state)
    assert jam_moments(statics, there) == pytest.approx(0.03)
    assert jam_moments(statics, ends[0]) == pytest.approx(-0.03)
    assert ends[1].joint_angles == pytest.approx(ends[0].joint_angles, abs=1e-8)
    # Yielded just as far both ways, it is the mirror image of the first peak.
    assert ends[0].joint_angles == pytest.approx(-there.joint_angles, abs=1e-8)


def test_a_large_step_of_an_arm_whose_jams_all_yield_settles():
    # Newton's full steps go back and forth between the limits of jams much stiffer than springs.
    statics = Statics(paper_like(
        3, Jam(43.956797141672844, yield_moment=0.019499607063983192), gravity=9.8,
        mounting_angle=-0.21004619894713672))
    stiff = (False,) * 3
    start = statics.solve(statics.chain.straight(), (0.0, SLACK), stiff)
    state = statics.solve(start, (0.03669398006422326, SLACK), stiff)
    arm = Reference(statics.chain.arm, state.stiff, state.held)
    assert arm.unbalanced(state.joint_angles, state.tensions) < 1e-9


# Softening

@pytest.mark.parametrize('jam', [Jam(), Jam(20.0)])
def test_bending_one_segment_after_another_does_not_depend_on_what_they_carried(jam):
    # The tension that held segment 1 is more than segment 3 could stand without folding up.
    statics = Statics(paper_like(3, jam, bodies=4))
    state = statics.bend(statics.chain.straight(), 0, 1.33427729)
    at_once = statics.bend(state, 2, 1.38609749512505)
    for angle in np.linspace(0.0, 1.38609749512505, 15)[1:]:
        state = statics.bend(state, 2, angle)
    assert at_once.tensions == pytest.approx(state.tensions, abs=1e-8)
    assert at_once.joint_angles == pytest.approx(state.joint_angles, abs=1e-8)


@pytest.mark.parametrize('bodies', [2, 3, 4, 5, 12])
def test_a_segment_can_be_bent_whatever_was_bent_before(bodies):
    statics = Statics(paper_like(3, bodies=bodies))
    for before in (1.2, 1.35, 1.5):
        for angle in (-1.4, -0.7, 0.4, 1.2, 1.5):
            state = statics.bend(statics.chain.straight(), 0, before)
            try:
                state = statics.bend(state, 2, angle)
            except StaticsError as error:
                pytest.fail(f'{before}, {angle}: {error}')
            joints = state.joint_angles[-bodies - 1:]
            assert np.all(joints * np.sign(angle) > 0.0)  # bent one way, not folded


@pytest.mark.parametrize('ratio', [1e6, 1e12])
@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_a_very_stiff_jam_is_as_good_as_rigid(ratio, gravity):
    shapes = []
    for jam in (Jam(ratio), Jam()):
        statics = Statics(paper_like(3, jam, bodies=12, gravity=gravity, mounting_angle=1.0))
        state = statics.bend(statics.chain.straight(), 0, 0.6)
        shapes.append(statics.solve(state, (state.pulls[0] + 0.005, SLACK), (False, True, False)))
    assert shapes[0].joint_angles == pytest.approx(shapes[1].joint_angles, abs=1e-6)


def test_a_jam_that_rounding_cannot_tell_from_rigid_is_refused():
    with pytest.raises(LawError, match='or inf'):
        Jam(1e15)


# What part of full vacuum does to the stiffness and the limit of a jam.


@pytest.mark.parametrize('exponent', [0.5, 1.0, 2.0])
@pytest.mark.parametrize('vacuum', [0.2, 0.7])
def test_the_jams_stiffness_grows_with_vacuum_to_its_power(exponent, vacuum):
    part = Statics(paper_like(1, Jam(5.0, stiffness_exponent=exponent)))
    full = Statics(paper_like(1, Jam(1.0 + 4.0 * vacuum**exponent)))
    straight = part.chain.straight()
    one = part.solve(straight, (0.01, SLACK), (False,), vacuum=(vacuum,))
    other = full.solve(straight, (0.01, SLACK), (False,))
    assert one.joint_angles == pytest.approx(other.joint_angles, abs=1e-12)
    assert one.tensions == pytest.approx(other.tensions, rel=1e-12)


@pytest.mark.parametrize('exponent', [0.0, 0.5, 1.0])
@pytest.mark.parametrize('vacuum', [0.1, 0.5, 1.0])
def test_the_limit_is_proportional_to_vacuum(exponent, vacuum):
    statics = Statics(paper_like(1, Jam(6.0, yield_moment=0.05, stiffness_exponent=exponent)))
    state = statics.solve(statics.chain.straight(), (0.014, SLACK), (False,), vacuum=(vacuum,))
    moments = Reference(statics.chain.arm, state.stiff, state.held,
                        vacuum=(vacuum,)).jam_moments(state.joint_angles)
    assert moments == pytest.approx(0.05 * vacuum, rel=1e-9)


@pytest.mark.parametrize('jam', [
    Jam(), Jam(5.0), Jam(5.0, yield_moment=0.1), Jam(law=linear(1.0)),
    Jam(5.0, stiffness_exponent=0.0), Jam(5.0, yield_moment=0.1, stiffness_exponent=0.0)])
def test_without_vacuum_a_jam_holds_nothing(jam):
    statics = Statics(paper_like(2, jam, gravity=9.80665, mounting_angle=2.0))
    straight = statics.chain.straight()
    stiff = statics.solve(straight, (0.01, SLACK), (True, False), vacuum=(0.0, 0.0))
    soft = statics.solve(straight, (0.01, SLACK), (True, True))
    assert stiff.joint_angles == pytest.approx(soft.joint_angles, abs=1e-10)


@pytest.mark.parametrize('arm', [paper_like(3), three_segments()], ids=['plane', 'space'])
def test_a_rigid_jam_has_all_its_vacuum_or_none(arm):
    statics = Statics(arm)
    with pytest.raises(ValueError, match='vacuum of segment 2 is 0.3; its jam is rigid'):
        statics.solve(statics.chain.straight(), [0.0] * len(arm.tendons), (True, False, True),
                      vacuum=(0.3, 0.3, 0.3))


def test_more_vacuum_moves_nothing_beyond_the_last_row_of_a_table():
    soft_law = MomentCurvature((0.0, 5.0), (0.0, 0.05))
    statics = Statics(paper_like(1, Jam(5.0), soft_law))
    some = statics.solve(statics.chain.straight(), (0.012, SLACK), (False,), vacuum=(0.3,))
    assert some.joint_angles.max() > 1.2 * 5.0 * statics.chain.joint_lengths[0]
    full = statics.solve(some, (0.012, SLACK), (False,))
    assert full.joint_angles == pytest.approx(some.joint_angles, abs=1e-9)
    assert full.tensions == pytest.approx(some.tensions, abs=1e-6)


def test_bending_keeps_the_vacuum_unless_another_is_given():
    statics = Statics(paper_like(3, Jam(5.0)))
    start = statics.solve(
        statics.chain.straight(), (0.005, SLACK), (False, True, False), vacuum=(0.3, 1.0, 1.0))
    assert statics.bend(start, 1, 0.3).vacuum == (0.3, 1.0, 1.0)
    assert statics.bend(start, 1, 0.3, vacuum=(0.5, 1.0, 1.0)).vacuum == (0.5, 1.0, 1.0)


@pytest.mark.parametrize('vacuum', [1.0, 0.4, 0.1, 0.01])
def test_a_segment_turns_by_the_moments_of_a_load_over_the_stiffness_at_its_vacuum(vacuum):
    """By hand: each of the n + 1 joints turns by F lever / (c (1 + (K - 1) v^a)), c (5)."""
    force, length, height, bodies, bending = 0.02, 0.07, 0.03, 12, STIFFNESS[0]
    statics = Statics(paper_like(1, Jam(9.0, stiffness_exponent=0.7), bodies=bodies,
                                 wrenches=(Wrench(1, (force, 0.0, 0.0)),)))
    stiff = statics.solve(statics.chain.straight(), (SLACK, SLACK), (False,), vacuum=(1.0,))
    state = statics.solve(stiff, (SLACK, SLACK), (False,), vacuum=(vacuum,))
    levers = height / 2 + length * np.arange(bodies + 1) / bodies
    joint = (bodies + 1) * bending / length * (1.0 + 8.0 * vacuum**0.7)
    assert state.bending_angles[0] == pytest.approx(force * levers.sum() / joint, rel=2e-3)
    # More vacuum holds the shape that is there.
    more = statics.solve(state, (SLACK, SLACK), (False,), vacuum=(1.0,))
    assert more.bending_angles == pytest.approx(state.bending_angles, rel=1e-9)
