# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measured tables of moment over curvature, as laws of segments in the plane and in space."""

from dataclasses import replace
from math import inf, nan

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import _kernel, SLACK, Statics
from soft_continuum.mechanics.laws import Jam, LawError, linear, MomentCurvature
from soft_continuum.mechanics.space.sensitivity import SpaceLinearisation
from soft_continuum.mechanics.space.statics import SpaceStatics
from support import general_arms
from support.differences import assert_is_difference, changed, command
from support.energy_reference import density, Reference
from support.flat_arm import made_of
from support.general_arms import arms, between, FEW, masks, paper_like
from support.spatial_arms import three_segments

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
    asked = data.draw(general_arms.pulls(arm, straight, soft))
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


SOFT, STIFF = (True,) * 3, (False,) * 3
PULLS = np.array([0.008, -0.005, -0.006])


# In one plane: soft and bent, stiffened and pulled on, reversed, with some vacuum, and let go.

WAY = ((SOFT, (0.012, -0.02), None), (STIFF, (0.018, -0.03), (1.0, 1.0, 1.0)),
       ((False, True, False), (0.004, -0.012), (1.0, 1.0, 0.5)),
       (STIFF, (-0.006, 0.002), (0.4, 0.7, 1.0)), (STIFF, (SLACK, SLACK), (1.0, 1.0, 0.2)))


def steps(way):
    """Yield soft, pulls and vacuum in steps so small that jams yield on one way only."""
    before = np.zeros(2)
    for soft, pulls, vacuum in way:
        parts = np.linspace(0.0, 1.0, 9) if np.isfinite(pulls[0]) else [1.0]
        for part in parts:
            yield soft, before + part * np.subtract(pulls, before), vacuum
        before = np.array(pulls)


@pytest.mark.parametrize(('soft_law', 'jam', 'tendon'), [
    (SOFTENING, Jam(6.0), made_of()), (STIFFENING, Jam(law=JAMMED), made_of(2e3, 0.2)),
    (None, Jam(6.0, yield_moment=0.03), made_of()),
    (None, Jam(6.0, stiffness_exponent=0.5), made_of(5e3)),
    (STIFFENING, Jam(law=JAMMED, yield_moment=0.06, stiffness_exponent=0.7), made_of()),
    (None, Jam(6.0), made_of(friction=0.2)), (SOFTENING, Jam(6.0), made_of(3e3, 0.1, 0.2)),
], ids=['soft table', 'both tables, stretch', 'yield', 'vacuum', 'table that yields', 'friction',
        'friction, stretch, table'])
@pytest.mark.parametrize('discretisation', ['paper', 'second_order'])
def test_in_one_plane_every_law_does_what_it_does_in_the_plane(
        soft_law, jam, tendon, discretisation):
    flat = paper_like(3, jam, soft_law, bodies=4, gravity=9.80665, mounting_angle=2.6,
                      tendon=tendon, discretisation=discretisation)
    planar, solid = Statics(flat), SpaceStatics(flat)
    one, other = planar.chain.straight(), solid.chain.straight()
    for soft, pulls, vacuum in steps(WAY):
        ways = {'vacuum': vacuum, 'sliding': np.sign(np.subtract(pulls, one.pulls)).astype(int)}
        one, other = (statics.solve(state, pulls, soft, **ways)
                      for statics, state in ((planar, one), (solid, other)))
        assert not one.jumped
        assert other.points == pytest.approx(one.points, abs=1e-9)
        assert other.points[:, 1] == pytest.approx(0.0, abs=1e-12)
        assert other.tensions == pytest.approx(one.tensions, abs=1e-6)
        assert (other.stiff, other.vacuum) == (one.stiff, one.vacuum)
        stiff = np.repeat(one.stiff, 5)
        assert other.held[stiff, 1] == pytest.approx(one.held[stiff], abs=1e-8)


# In space, from the poses alone.


def laws(soft_law=SOFTENING, jam=None, friction=0.0, turn=0.0, **changes):
    """Return an arm whose segments have laws, all but one round, and tendons that may rub."""
    an_arm = three_segments(turn, jam or Jam(law=JAMMED, yield_moment=0.05), **changes)
    return replace(
        an_arm, segments=tuple(replace(s, soft_law=soft_law) for s in an_arm.segments),
        tendons=tuple(replace(t, friction=friction) for t in an_arm.tendons))


def oval(an_arm):
    """Return the arm with a last segment that is thrice as stiff about x."""
    *others, last = an_arm.segments
    return replace(an_arm, segments=(*others, replace(last, stiffness_x=3.0 * last.stiffness_y)))


def moved(an_arm, **more):
    """Return the states of an arm that is bent, stiffened, pulled on and to another side."""
    statics = SpaceStatics(an_arm)
    states = [statics.chain.straight()]
    for soft, pulls in ((SOFT, PULLS), (STIFF, 2.0 * PULLS), ((False, True, False), PULLS),
                        (STIFF, 1.5 * PULLS[[2, 0, 1]])):
        states.append(statics.solve(states[-1], pulls, soft, **more))
    return states[1:]


def bent(segment, angles, held=0.0):
    """Return how far joints (joints, 3) are bent, counted as about the softer axis, rad."""
    weights = np.array([segment.stiffness_x, segment.stiffness_y])
    return np.sqrt((weights / weights.min() * (angles - held)[..., :2]**2).sum(axis=-1))


def turns(rotations):
    """Return the rotation vectors of the joints, (joints, 3)."""
    before = np.concatenate([np.eye(3)[None], rotations[:-1]])
    return Rotation.from_matrix(before.transpose(0, 2, 1) @ rotations).as_rotvec()


def energy(state, rotations, held):
    """Return the energy of springs, jams and weights, J."""
    arm, per = state.chain.arm, state.chain.joints_per_segment
    angles, total = turns(rotations), 0.0
    for s, segment in enumerate(arm.segments):
        rows, part = slice(s * per, (s + 1) * per), segment.length / per
        least = min(segment.stiffness_x, segment.stiffness_y)
        first = least if segment.soft_law is None else (
            segment.soft_law.moments[1] / segment.soft_law.curvatures[1])

        def stored(bend, segment=segment, least=least):
            return (density(segment.soft_law, bend) if segment.soft_law is not None
                    else 0.5 * least * bend**2)

        twist = segment.torsional_stiffness
        total += (part * stored(bent(segment, angles[rows]) / part)).sum()
        total += (0.5 * twist / part * angles[rows, 2]**2).sum()
        if state.stiff[s]:
            away = bent(segment, angles[rows], held[rows]) / part
            if segment.jam.law is not None:
                law = segment.jam.law
                total += (part * (density(law, away) - stored(away))).sum()
                more = law.moments[1] / law.curvatures[1] / first - 1.0
            else:
                more = segment.jam.ratio - 1.0
                total += (part * more * stored(away)).sum()
            total += (0.5 * more * twist / part * (angles[rows] - held[rows])[:, 2]**2).sum()
    ends = state.chain.ends(rotations)
    middles = 0.5 * (ends[:-1] + ends[1:])
    return total - state.chain.body_masses @ middles @ np.array(arm.gravity)


def spans(state, rotations):
    """Return the lengths of every tendon's spans between two discs, m."""
    return [np.linalg.norm(np.diff(points, axis=0), axis=1)[::2]
            for points in replace(state, configuration=rotations).tendon_points]


def kept(state, friction, sliding):
    """Return the part of the tension at the base in each span, from where the guides are."""
    found = []
    for points, way in zip(state.tendon_points, sliding, strict=True):
        runs = np.concatenate([[[0.0, 0.0, 1.0]], np.diff(points, axis=0)])
        runs /= np.linalg.norm(runs, axis=1)[:, None]
        angles = np.arccos(np.clip((runs[1:] * runs[:-1]).sum(axis=1), -1.0, 1.0))
        found.append(np.exp(-friction * way * np.cumsum(angles))[::2])
    return found


def unbalanced(state, held, ratios, step=1e-5):
    """Return the largest moment that is left over on a body, N m, by differences of energies."""
    largest = 0.0
    for body in range(state.chain.bodies):
        for axis in np.eye(3):
            values = []
            for turn in (step, -step):
                rotations = state.rotations.copy()
                rotations[body] = rotations[body] @ Rotation.from_rotvec(turn * axis).as_matrix()
                values.append(energy(state, rotations, held) + sum(
                    tension * (part * lengths).sum() for tension, part, lengths in zip(
                        state.tensions, ratios, spans(state, rotations), strict=True)))
            largest = max(largest, abs(values[0] - values[1]) / (2.0 * step))
    return largest


@pytest.mark.parametrize('make', [
    lambda: laws(), lambda: laws(STIFFENING, Jam(9.0, yield_moment=0.05)),
    lambda: laws(None, Jam(9.0, yield_moment=0.05)), lambda: oval(laws()),
    lambda: laws(None, Jam(law=JAMMED), 0.2)],
    ids=['softening', 'stiffening', 'linear', 'oval', 'friction'])
def test_springs_jams_weights_and_tendons_balance_and_no_jam_bears_more_than_it_can(make):
    an_arm = make()
    friction, sliding = an_arm.tendons[0].friction, (1, -1, 1)
    yielded = 0
    for state in moved(an_arm, sliding=sliding):
        ratios = kept(state, friction, sliding)
        assert unbalanced(state, state.held, ratios) < 2e-8
        assert np.all(state.tensions >= 0.0)
        assert np.all(state.slack * state.tensions == 0.0)
        per = state.chain.joints_per_segment
        for s, segment in enumerate(an_arm.segments):
            if not (state.stiff[s] and segment.jam.yield_moment < inf):
                continue
            rows, part = slice(s * per, (s + 1) * per), segment.length / per
            least, soft = min(segment.stiffness_x, segment.stiffness_y), segment.soft_law
            away = bent(segment, turns(state.rotations)[rows], state.held[rows]) / part
            spring = [soft.moment(k) if soft else least * k for k in away]
            whole = [segment.jam.law.moment(k) if segment.jam.law else segment.jam.ratio * m
                     for k, m in zip(away, spring, strict=True)]
            borne = np.subtract(whole, spring)
            assert np.all(borne <= segment.jam.yield_moment * (1.0 + 1e-9))
            yielded += (borne > segment.jam.yield_moment * (1.0 - 1e-9)).sum()
    assert yielded > 5 or an_arm.segments[0].jam.yield_moment == inf


def test_a_tendon_that_rubs_bends_the_segments_near_its_motor_more():
    arms = (laws(None, Jam(9.0), friction, gravity=(0.0,) * 3) for friction in (0.0, 0.4))
    bends = [np.linalg.norm(moved(an_arm, sliding=(1, 0, 0))[0].bending, axis=1)
             for an_arm in arms]
    assert bends[1][0] > bends[0][0]
    assert bends[1][2] < bends[0][2]


def test_more_vacuum_on_a_bent_segment_moves_nothing():
    statics = SpaceStatics(laws(jam=Jam(law=JAMMED, stiffness_exponent=0.5)))
    bent_ = statics.solve(statics.chain.straight(), PULLS, SOFT)
    half = statics.solve(bent_, 1.5 * PULLS, STIFF, vacuum=(0.5,) * 3)
    more = statics.solve(half, np.zeros(3), STIFF, vacuum=(1.0, 0.8, 0.5), tensions=half.tensions)
    assert more.points == pytest.approx(half.points, abs=1e-9)
    assert not np.array_equal(more.held, half.held)


def test_without_compiled_functions_it_is_the_same(monkeypatch):
    # Truth values of numpy do not add up: an arm with two negative directions was lost.
    compiled = moved(laws(bodies_per_segment=2))[-1]
    monkeypatch.setattr(_kernel, 'functions', lambda: _kernel.SOURCE)
    assert moved(laws(bodies_per_segment=2))[-1].points == pytest.approx(
        compiled.points, abs=1e-10)


# Derivatives, and what is refused.


@pytest.mark.parametrize('make', [
    lambda: laws(), lambda: oval(laws(STIFFENING, Jam(9.0, yield_moment=0.05))),
    lambda: laws(jam=Jam(law=JAMMED))], ids=['softening', 'oval', 'elastic'])
def test_derivatives_are_those_of_solves_that_load_on(make):
    statics, state = yielded(make())
    found = SpaceLinearisation(statics, state).pulls().points @ PULLS
    more = statics.solve(state, (3.0 + 1e-4) * PULLS, STIFF)
    wanted = (more.points - state.points) / 1e-4
    assert found == pytest.approx(wanted, abs=1e-3 * np.abs(wanted).max())


def yielded(an_arm):
    """Return statics, and a state to which all joints were loaded on one way."""
    statics = SpaceStatics(replace(an_arm, gravity=(0.0,) * 3))
    return statics, statics.solve(statics.chain.straight(), 3.0 * PULLS, STIFF)


def test_derivatives_of_jams_that_turn_back_are_elastic():
    statics, state = yielded(laws())
    found = SpaceLinearisation(statics, state, loading=False).pulls().points @ PULLS
    less = statics.solve(state, (3.0 - 1e-4) * PULLS, STIFF)
    wanted = (state.points - less.points) / 1e-4
    assert found == pytest.approx(wanted, abs=1e-3 * np.abs(wanted).max())
    slopes = [(SpaceLinearisation(statics, state, loading=on).pulls().tensions @ PULLS)[0]
              for on in (True, False)]
    assert slopes[0] < 0.8 * slopes[1]


def test_derivatives_by_stiffness_and_held_shape_know_the_laws():
    state = moved(laws(jam=Jam(law=JAMMED)))[1]
    statics, arm = SpaceStatics(state.chain.arm), state.chain.arm
    linear, step = SpaceLinearisation(statics, state), 1e-5
    factors, held = linear.stiffness_factors(), linear.held_shape()

    def times(law, factor):
        return MomentCurvature(law.curvatures, tuple(factor * m for m in law.moments))

    def stiffer(factor):
        first, *others = arm.segments
        return replace(arm, segments=(replace(
            first, soft_law=times(first.soft_law, factor), jam=Jam(law=times(JAMMED, factor)),
            torsional_stiffness=factor * first.torsional_stiffness), *others))

    more, less = (start[0].solve(start[1], command(statics, state), STIFF) for start in (
        changed(state, stiffer(1.0 + d)) for d in (step, -step)))
    assert_is_difference(factors, 0, more, less, step)
    turn = np.zeros_like(state.held)
    per = state.chain.joints_per_segment
    turn[:per, 1] = 1.0 / per
    at = command(statics, state)
    more, less = (statics.solve(replace(state, held=state.held + d * turn), at, STIFF)
                  for d in (step, -step))
    assert_is_difference(held, 1, more, less, step)
