# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Moment-curvature tables: what is refused, and what an arm with them does."""

from dataclasses import replace
from math import inf, nan

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import SLACK, Statics
from soft_continuum.mechanics.laws import Jam, LawError, linear, MomentCurvature
from support.energy_reference import Reference
from support.general_arms import arms, between, FEW, masks, paper_like, pulls

SOFTENING = MomentCurvature((0.0, 2.0, 6.0, 9.0), (0.0, 0.05, 0.10, 0.12))
STIFFENING = MomentCurvature((0.0, 1.5, 4.0), (0.0, 0.02, 0.12))
JAMMED = MomentCurvature((0.0, 0.5, 3.0), (0.0, 0.10, 0.35))


# Tables

@pytest.mark.parametrize(('curvatures', 'moments', 'named'), [
    ((0.0,), (0.0,), '1 curvatures and 1 moments'),
    ((), (), '0 curvatures and 0 moments'),
    ((0.0, 1.0, 2.0), (0.0, 1.0), '3 curvatures and 2 moments'),
    ((0.1, 1.0), (0.0, 1.0), 'row 1'),
    ((0.0, 1.0), (0.1, 1.0), 'row 1'),
    ((nan, 1.0), (0.0, 1.0), 'row 1'),
    ((0.0, 0.0), (0.0, 1.0), 'row 2'),
    ((0.0, -1.0), (0.0, 1.0), 'row 2'),
    ((0.0, 1.0, 2.0), (0.0, 1.0, 1.0), 'row 3'),
    ((0.0, 1.0, 2.0, 3.0), (0.0, 1.0, 2.0, 1.9), 'row 4'),
    ((0.0, 1.0, 1.0), (0.0, 1.0, 2.0), 'row 3'),
    ((0.0, 1.0, inf), (0.0, 1.0, 2.0), 'row 3'),
    ((0.0, 1.0, 2.0), (0.0, nan, 2.0), 'row 2'),
])
def test_a_table_that_is_no_law_is_refused_and_its_row_is_named(curvatures, moments, named):
    with pytest.raises(LawError, match=named):
        MomentCurvature(curvatures, moments)


@pytest.mark.parametrize(('given_', 'named'), [
    ({'ratio': 1.0}, 'above 1'), ({'ratio': 0.5}, 'above 1'), ({'ratio': nan}, 'above 1'),
    ({'ratio': 5.0, 'yield_moment': 0.0}, 'yield moment'),
    ({'ratio': 5.0, 'yield_moment': nan}, 'yield moment'),
    ({'yield_moment': 0.1}, 'rigid'), ({'ratio': 5.0, 'law': JAMMED}, 'not both'),
    ({'ratio': 5.0, 'stiffness_exponent': -0.1}, 'exponent'),
    ({'ratio': 5.0, 'stiffness_exponent': nan}, 'exponent')])
def test_a_jam_that_cannot_be_is_refused(given_, named):
    with pytest.raises(LawError, match=named):
        Jam(**given_)


def test_a_stiff_segment_that_is_weaker_than_the_soft_one_is_refused_and_says_so():
    # The row of the table that was given, and what is wrong: not a row of their difference.
    table = MomentCurvature((0.0, 1.0, 2.0, 3.0), (0.0, 0.05, 0.06, 0.2))  # E I is 0.0265 N m^2
    with pytest.raises(ValueError, match='row 3.*soft'):
        Statics(paper_like(1, Jam(law=table)))


@FEW
@given(st.lists(st.tuples(between(0.1, 3.0), between(0.01, 1.0)), min_size=1, max_size=6),
       between(-20.0, 20.0))
def test_a_table_is_odd_joins_its_rows_by_straight_lines_and_goes_on(steps, curvature):
    k, m = np.cumsum([(0.0, 0.0), *steps], axis=0).T
    law = MomentCurvature(tuple(k), tuple(m))
    assert law.moment(-curvature) == -law.moment(curvature)
    assert [law.moment(x) for x in k] == pytest.approx(m)
    row = min(int(np.searchsorted(k, abs(curvature), side='right')), len(k) - 1)
    slope = (m[row] - m[row - 1]) / (k[row] - k[row - 1])
    expected = m[row] + slope * (abs(curvature) - k[row])
    assert law.moment(abs(curvature)) == pytest.approx(expected, abs=1e-12)


@FEW
@given(between(-12.0, 12.0))
def test_what_a_jam_adds_makes_up_the_stiff_law_at_every_curvature(curvature):
    extra = JAMMED.minus(STIFFENING)
    whole = STIFFENING.moment(curvature) + extra.moment(curvature)
    assert whole == pytest.approx(JAMMED.moment(curvature), abs=1e-12)


# A straight line as a table

@FEW
@given(arms(load=(0.0, 1.0)), st.data())
def test_a_table_on_a_straight_line_is_the_linear_law(arm, data):
    points = np.cumsum([0.0, *data.draw(st.lists(between(0.1, 4.0), min_size=1, max_size=5))])
    tabled = Statics(replace(arm, segments=tuple(
        replace(s, stiffness_y=1.0, soft_law=MomentCurvature(
            tuple(points), tuple(s.stiffness_y * points))) for s in arm.segments)))
    plain = Statics(arm)
    soft = data.draw(masks(arm))
    straight = plain.chain.straight()
    asked = data.draw(pulls(arm, straight, soft))
    one, other = (statics.solve(straight, asked, soft) for statics in (tabled, plain))
    assert one.joint_angles == pytest.approx(other.joint_angles, abs=1e-12)
    assert one.tensions == pytest.approx(other.tensions, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize('soft_law', [None, linear(0.0265), STIFFENING])
def test_a_jam_of_k_times_the_soft_law_is_the_ratio_k(soft_law):
    table = soft_law or linear(0.0265)
    times = MomentCurvature(table.curvatures, tuple(5.0 * m for m in table.moments))
    shapes = []
    for jam in (Jam(5.0), Jam(law=times)):
        statics = Statics(paper_like(1, jam, soft_law))
        state = statics.solve(statics.chain.straight(), (0.006, SLACK), (True,))
        state = statics.solve(state, (0.009, SLACK), (False,))
        shapes.append(np.append(state.joint_angles, state.tensions))
    assert shapes[0] == pytest.approx(shapes[1], abs=1e-11)


# Against scipy

@pytest.mark.parametrize('law', [SOFTENING, STIFFENING], ids=['softening', 'stiffening'])
@pytest.mark.parametrize(('tension', 'gravity'), [(0.5, 0.0), (6.0, 0.0), (6.0, 9.80665)])
def test_the_shape_is_the_one_of_least_energy(law, tension, gravity):
    statics = Statics(paper_like(1, soft_law=law, gravity=gravity, mounting_angle=2.5))
    state = statics.solve_tensions(statics.chain.straight(), (tension, 0.0), (True,))
    arm = Reference(statics.chain.arm)
    expected = arm.rest(np.full(6, 0.01), (tension, 0.0))
    assert state.joint_angles == pytest.approx(expected, abs=1e-6)
    if tension == 6.0:  # rows of the table are passed
        curvatures = state.joint_angles / statics.chain.joint_lengths
        assert np.abs(curvatures).max() > law.curvatures[2]


@FEW
@given(between(0.001, 0.02), between(0.001, 0.02), st.sampled_from([SOFTENING, STIFFENING]),
       st.sampled_from([Jam(3.0), Jam(law=JAMMED), Jam(3.0, yield_moment=0.03),
                        Jam(law=JAMMED, yield_moment=0.08)]))
def test_arms_with_tables_are_in_balance(first, second, law, jam):
    if jam.law is not None and law is SOFTENING:
        law = STIFFENING  # the jam must be the stiffer one
    statics = Statics(paper_like(2, jam, law))
    state = statics.solve(statics.chain.straight(), (first, SLACK), (True, True))
    state = statics.solve(state, (SLACK, second), (True, False))
    arm = Reference(statics.chain.arm, state.stiff, state.held)
    assert arm.unbalanced(state.joint_angles, state.tensions) < 1e-9
    assert arm.stable(state.joint_angles, state.tensions)
    limit = jam.yield_moment * (1 + 1e-9)
    assert np.abs(arm.jam_moments(state.joint_angles)).max() <= limit


def test_a_table_of_a_thousand_rows_does_not_disturb_a_short_one_that_yields():
    curvatures = np.linspace(0.0, 20.0, 1300)
    measured = MomentCurvature(tuple(curvatures), tuple(0.0265 * curvatures))
    jam = Jam(law=MomentCurvature((0.0, 1.0, 8.0), (0.0, 0.1, 0.9)), yield_moment=0.03)
    crept = []
    for law in (None, measured):
        arm = paper_like(2)
        statics = Statics(replace(arm, segments=(
            replace(arm.segments[0], soft_law=law), replace(arm.segments[1], jam=jam))))
        state = statics.solve(statics.chain.straight(), (0.02, SLACK), (True, False))
        crept.append(state.held)
    assert crept[0].max() > 1e-3
    assert crept[1] == pytest.approx(crept[0], abs=1e-9)


def test_the_chains_energy_is_the_work_of_its_tables():
    arm = paper_like(1, soft_law=SOFTENING)
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), (0.02, SLACK), (True,))
    assert statics.chain.energy(state.joint_angles) == pytest.approx(
        Reference(arm).energy(state.joint_angles), rel=1e-12)
