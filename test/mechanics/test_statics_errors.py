# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What cannot be solved is refused, says why, and carries the last good state."""

from contextlib import nullcontext
from dataclasses import replace
from math import inf, nan, pi, radians

import numpy as np
import pytest

from soft_continuum.mechanics import (
    _kernel,
    Arm,
    ArmError,
    bending_directions,
    bending_for_tip,
    bending_vectors,
    Chain,
    constant_curvature,
    Disc,
    exceeds_pi,
    Jam,
    LawError,
    LEFT,
    Linearisation,
    MomentCurvature,
    OverconstrainedError,
    RIGHT,
    Segment,
    self_intersections,
    set_shape,
    SLACK,
    solve_batch,
    solve_path,
    Statics,
    StaticsError,
    Tendon,
    Wrench,
)
from soft_continuum.mechanics.arm import tendon_pair
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import description_file
from support import paper_arm as paper
from support.energy_reference import Reference
from support.flat_arm import flat_arm
from support.spatial_arms import three_segments

FIRST = paper.only(0)
STIFF = (False, False, False)
ALL = (True, True, True)
PLANE, SPACE = Statics(paper.build()), Statics(three_segments())
BOTH = pytest.mark.parametrize('statics', [PLANE, SPACE], ids=['plane', 'space'])
SEGMENTS, DISCS = (Segment.leaf_spring(0.07, 0.02),), (Disc(0.03), Disc(0.03))
PAIR = tendon_pair(0.02, 1)


# Input

@BOTH
@pytest.mark.parametrize(('given', 'words'), [
    *(({'pulls': pulls}, 'pulls must be finite numbers .m., or SLACK') for pulls in (
        (0.0, np.nan, 0.0), (0.0, np.inf, 0.0), (), None, 'abc', (True, True, True),
        (1j, 0.0, 0.0), ((0.0,), 0.0, 0.0), 0.0)),
    *(({'soft': soft}, 'soft must have a true or false for each of the 3 segments') for soft in (
        'abc', (0.5, np.nan, 'x'), (True,), (True,) * 4, None, 1, (None,) * 3,
        np.ones((3, 1)))),
    *(({'start': start}, 'the start must be an Equilibrium') for start in (None, 0, 'a')),
    *(({'vacuum': vacuum}, 'vacuum must be one number from 0 to 1') for vacuum in (
        (0.5,), (2.0, 0.0, 0.0), (-0.1, 1.0, 1.0), (np.nan, 1.0, 1.0), 0.5, 'abc', (True,) * 3)),
    *(({'sliding': sliding}, 'sliding must be 1, 0 or -1') for sliding in (
        (2, 0, 0), (1,), ('a', 0, 0), None, (True, False, True))),
    *(({'tensions': tensions}, 'tensions must be finite numbers of 0 N or more') for tensions in (
        (1.0, -1.0, 0.0), (np.inf, 0.0, 0.0), (True,) * 3, 'abc', (1j, 0.0, 0.0), (1.0,)))])
def test_what_is_no_command_is_refused_alike_in_plane_and_space(statics, given, words):
    tendons = len(statics.chain.arm.tendon_names)

    def fit(values):
        """As many as there are tendons, of three."""
        return values[:tendons] if isinstance(values, tuple) and len(values) == 3 else values

    given = {name: fit(value) if name in ('pulls', 'sliding', 'tensions') else value
             for name, value in given.items()}
    call = statics.solve
    if 'tensions' in given and statics is PLANE:
        call = statics.solve_tensions
    else:
        given = {'pulls': (0.0,) * tendons} | given
    with pytest.raises(ValueError, match=words):
        call(**{'start': statics.chain.straight(), 'soft': (True,) * 3} | given)


BENT = np.full((3, 2), (0.0, 0.1))


@BOTH
@pytest.mark.parametrize(('call', 'words'), [
    *((lambda s, given=given: s.hold(s.chain.straight(), BENT, FIRST, pretensions=given), words)
      for given, words in (
          ((), 'one number .N. or more'), (0.0, 'one number .N. or more'), (None, 'one number'),
          ((0.0, -1.0), '0 N or more'), ((nan,), '0 N or more'), ('a', '0 N or more'))),
    *((lambda s, given=given: s.sliding_towards(given), 'two numbers .rad.')
      for given in ((), BENT[:2], BENT[:, :1])),
    *((lambda s, given=given: bending_vectors(s.chain.arm, *given), 'for each of the 3 segments')
      for given in (((), ()), ((0.1,), ()), ((0.1,) * 3, (1.0,)), ((0.1,) * 4, ()))),
    (lambda _: bending_directions(np.zeros((3, 3))), 'two numbers .rad.'),
    (lambda _: bending_directions([]), 'two numbers .rad.'),
    *((lambda s, call=call: call(s, None), 'the state must be an Equilibrium') for call in (
        Linearisation, lambda _, state: self_intersections(state, 0.01),
        lambda _, state: exceeds_pi(state), lambda s, state: s.stretch_rates(state, ()),
        lambda s, state: s.commanded_pulls(state))),
    (lambda s: s.stretch_rates(s.chain.straight(), (1,)), 'sliding must be 1, 0 or -1'),
    (lambda s: Linearisation(s, s.chain.straight(), None), 'sliding must be 1, 0 or -1'),
    (lambda _: Statics(None), 'an Arm is needed'), (lambda _: Chain('arm'), 'an Arm is needed'),
    *((lambda s, given=given: s.chain.arm.with_force(1, given), 'x, y and z in N')
      for given in ((), 1.0, None, (1.0, 2.0))),
    (lambda s: s.chain.arm.with_compliant_tendons(0.0), 'stretch is 0 m/N'),
    (lambda s: s.chain.arm.segments[0].with_stiffness_factor(()), 'factor is'),
    *((lambda s, call=call: call(s.chain.arm, [1j] * 3), 'bending must be') for call in (
        constant_curvature.poses, constant_curvature.tips, constant_curvature.pulls)),
    *((lambda _, given=given: constant_curvature.bending_angle(PLANE.chain.arm, *given),
       'a segment, 0 to 2, and a number') for given in ((3, 0.0), (-1, 0.0), (0, ()), ((), 0.0)))])
def test_arguments_of_other_sizes_or_kinds_are_refused_alike_in_plane_and_space(
        statics, call, words):
    with pytest.raises(ValueError, match=words):
        call(statics)


@BOTH
@pytest.mark.parametrize('wrong', [nan, inf])
@pytest.mark.parametrize('tendon', [0, 1])
def test_tensions_that_are_not_finite_are_refused(statics, wrong, tendon):
    tensions = np.zeros(len(statics.compliance))
    tensions[tendon] = wrong
    with pytest.raises(ValueError, match='tensions must be finite numbers of 0 N or more'):
        statics.solve_tensions(statics.chain.straight(), tensions, FIRST)


BENT = np.array([[0.0, 0.1]] * 3)


@BOTH
@pytest.mark.parametrize(('call', 'words'), [
    *((lambda s, order=order: set_shape(s, BENT, order=order), 'order must name segments, 0 to 2')
      for order in (1, np.int64(1), 0.5, '', {}, [[0]], [3])),
    *((lambda s, pretension=pretension: set_shape(s, 0 * BENT, pretension=pretension),
       'the pretension must be a number of 0 N or more') for pretension in (nan, -1.0, 'x', None)),
    *((lambda s, soft=soft: s.hold(s.chain.straight(), BENT, soft),
       'soft must have a true or false for each of the 3 segments')
      for soft in ((False, True), (False, True, False, False), (0.5, 1, 0), ('a', True, 0), None)),
    (lambda s: s.hold(s.chain.straight(), BENT, STIFF), 'one segment or more must be soft'),
    (lambda s: s.hold(None, BENT, ALL), 'the start must be an Equilibrium'),
    *((lambda s, bending=bending: s.hold(s.chain.straight(), bending, ALL), 'bending must be')
      for bending in ('x', BENT[:2], BENT[:, 1], BENT + inf)),
    *((lambda s, sliding=sliding, call=call: call(s, sliding), 'sliding must be 1, 0 or -1')
      for sliding in (5, 'ab', (2, 2, 2), (1,)) for call in (
          lambda s, sliding: s.hold(s.chain.straight(), BENT, FIRST, sliding=sliding),
          lambda s, sliding: s.bend(s.chain.straight(), 0, 0.1, sliding=sliding),
          lambda s, sliding: s.commanded_pulls(s.chain.straight(), sliding))),
    (lambda s: s.commanded_pulls(None), 'the state must be an Equilibrium'),
    *((lambda s, at=at: s.chain.at(at), 'joint positions must be .* finite numbers .rad.; given')
      for at in ('x', None, 0.0, BENT * 1j, [inf] * 18, ['a'] * 18)),
])
def test_what_is_no_argument_is_refused_in_the_same_words_everywhere(statics, call, words):
    with pytest.raises(ValueError, match=words):
        call(statics)


@pytest.mark.parametrize('start', [None, 0, (0.0, 0.0)])
@BOTH
def test_a_start_that_is_no_state_is_refused(statics, start):
    rest = [0.0] * len(statics.compliance)
    for call in (lambda: statics.solve_tensions(start, rest, FIRST),
                 lambda: statics.bend(start, 0, 0.1),
                 lambda: solve_path(statics, start, rest, FIRST),
                 *(() if start is None else (
                     lambda: set_shape(statics, np.zeros((3, 2)), start),
                     lambda: bending_for_tip(statics, (0.0, 0.0, 0.2), start=start)))):
        with pytest.raises(ValueError, match='Equilibrium'):
            call()


@pytest.mark.parametrize('make', [
    lambda value: Arm(SEGMENTS, DISCS, PAIR, wrenches=(Wrench(1, (value, 0.0, 0.0)),)),
    lambda value: Arm(SEGMENTS, DISCS, PAIR, wrenches=(Wrench(value, (0.0, 0.0, 0.0)),)),
    lambda value: Arm(SEGMENTS, DISCS, PAIR, payload=value),
    lambda value: Arm(SEGMENTS, DISCS, value),
    lambda value: Arm(SEGMENTS, DISCS, PAIR, wrenches=value),
    lambda value: Arm(value, DISCS, PAIR),
    lambda value: Arm(SEGMENTS, value, PAIR),
    lambda value: Segment(value, 0.02, 0.02),
    Jam,
    lambda value: Jam(3.0, yield_moment=value),
    lambda value: Jam(3.0, stiffness_exponent=value),
    lambda value: MomentCurvature((0.0, value), (0.0, 1.0)),
    lambda value: MomentCurvature(value, (0.0, 1.0)),
    lambda value: tendon_pair(value, 1),
    lambda value: Tendon('right', value, 0.02, 1),
    lambda value: tendon_pair(0.02, 1, friction=value),
    lambda value: Disc(0.03, value),
    lambda value: Segment.leaf_spring(0.07, 0.02, value),
])
@pytest.mark.parametrize('value', ['7', None, 1j, nan])
def test_what_is_no_number_is_refused_by_every_part_of_an_arm(make, value):
    with pytest.raises((ArmError, LawError), match='give|allowed|row|discs are|must be'):
        make(value)


@BOTH
@pytest.mark.parametrize('bodies', [5, 6, 20])
def test_a_start_state_of_another_arm_is_refused(statics, bodies):
    # Unnoticed, more joints make the compiled loops write outside their arrays.
    other = Statics(statics.chain.arm.with_bodies(bodies))
    with pytest.raises(ValueError, match='another arm|this arm has 39 in 3'):
        statics.solve(other.chain.straight(), [0.0] * len(statics.compliance), FIRST)


def test_a_start_state_of_as_many_joints_in_fewer_segments_is_refused(statics):
    three, arm = Statics(statics.chain.arm.with_bodies(3)), statics.chain.arm
    two = Statics(flat_arm(arm.segments[:2], 0.02, arm.discs[:3], bodies_per_segment=5))
    with pytest.raises(ValueError, match='12 joints in 2 segments'):
        three.solve(two.chain.uniform([0.5, 0.0]), (0.0, 0.0), FIRST)


@pytest.mark.parametrize('segment', [-1, 3, 1, 1.5])
def test_bending_a_segment_that_is_not_soft_is_refused(statics, segment):
    with pytest.raises(ValueError, match='segment'):
        statics.bend(statics.chain.straight(), segment, 0.1, FIRST)


@pytest.mark.parametrize('soft', [True, (), (True,), (True,) * 4])
def test_bending_with_a_mask_of_the_wrong_length_is_refused(statics, soft):
    with pytest.raises(ValueError, match='each of the 3 segments'):
        statics.bend(statics.chain.straight(), 0, 0.1, soft)


@pytest.mark.parametrize('angle', [nan, inf, -inf, None, '1', 1j])
def test_bending_to_no_number_is_refused(statics, angle):
    with pytest.raises(ValueError, match='finite'):
        statics.bend(statics.chain.straight(), 0, angle)


# All stiff

@BOTH
def test_a_locked_arm_cannot_be_pulled_but_its_tendons_can_be_let_out(statics):
    state = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    count = len(state.pulls)
    for tendon in range(count):
        asked = np.where(np.arange(count) == tendon, state.pulls + 1e-4, SLACK)
        with pytest.raises(OverconstrainedError, match='passes is stiff .* cannot be pulled in'
                           ) as caught:
            statics.solve(state, asked, STIFF)
        assert np.array_equal(caught.value.state.configuration, state.configuration)
    let_out = 1e-3 * np.arange(1, count + 1)
    out = statics.solve(state, state.pulls - let_out, STIFF)
    assert np.array_equal(out.configuration, state.configuration)
    assert out.slack == pytest.approx(let_out)
    assert not out.tensions.any()


@BOTH
def test_nothing_determines_what_a_tendon_carries_along_a_locked_arm(statics):
    state = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    asked = np.where(state.tensions > 0.0, state.pulls, SLACK)
    held = statics.solve(state, asked, STIFF)
    assert np.isnan(held.tensions[asked > SLACK]).all()
    assert not held.tensions[asked == SLACK].any()
    assert np.all(held.slack[asked == SLACK] == inf)
    again = statics.solve(held, asked, FIRST)
    assert again.points == pytest.approx(state.points, abs=1e-9)


@BOTH
@pytest.mark.parametrize('soft', [ALL, STIFF], ids=['soft', 'locked'])
def test_a_tendon_that_never_carries_has_slack_without_end_and_one_by_force_has_none(
        statics, soft):
    start, count = statics.chain.straight(), len(statics.compliance)
    pulls = np.where(np.arange(count) == LEFT, SLACK, 0.0)
    never = statics.solve(start, pulls, soft)
    assert np.array_equal(np.isinf(never.slack), pulls == SLACK)
    together = solve_batch(statics, start, [pulls, pulls], soft)
    assert np.array_equal(together.slack[0], never.slack)
    by_force = statics.solve(start, pulls, soft, tensions=np.where(pulls == SLACK, 0.0, nan))
    assert by_force.slack[LEFT] == 0.0
    assert np.isfinite(statics.solve(never, np.zeros(count), soft).slack).all()


def test_tendons_that_stretch_carry_in_a_locked_arm_what_they_are_stretched_by():
    compliance, pulls = 1e-4, np.array((0.006, -0.004, -0.003))
    statics = Statics(SPACE.chain.arm.with_compliant_tendons(compliance))
    bent = statics.solve(statics.chain.straight(), pulls, ALL)
    locked = statics.solve(bent, pulls, STIFF)  # where the motors stand
    assert locked.tensions == pytest.approx(bent.tensions, abs=1e-8)
    stretch = compliance * bent.tensions[0]
    eased = statics.solve(bent, pulls - 2.0 * stretch, STIFF)
    assert eased.tensions[0] == 0.0
    assert eased.slack[0] == pytest.approx(stretch, abs=1e-9)
    forced = statics.solve_tensions(bent, (1.0, 2.0, 3.0), STIFF)
    assert forced.tensions == pytest.approx([1.0, 2.0, 3.0])


def test_a_tendon_that_passes_rigid_segments_only_cannot_be_pulled():
    arm = SPACE.chain.arm
    short = Statics(replace(arm, tendons=(*arm.tendons, Tendon('low', 0.0, 0.02, 1))))
    with pytest.raises(OverconstrainedError, match='low passes'):
        short.solve(short.chain.straight(), (0.0, 0.0, 0.0, 0.002), (False, True, True))


# Too short

def test_two_tendons_cannot_both_shorten_a_segment_of_one_body():
    # Every shape of its two joints, tried out: none has both tendons that short.
    arm = flat_arm(SEGMENTS, 0.02, DISCS, bodies_per_segment=1)
    each = np.radians(np.arange(-170.0, 171.0, 2.0))
    angles = np.stack(np.meshgrid(each, each), axis=-1).reshape(-1, 2)
    assert Reference(arm).spans(angles).sum(axis=-1).max(axis=-1).min() > 0.07 - 1e-12
    statics = Statics(arm)
    with pytest.raises(OverconstrainedError, match='pay out a tendon') as caught:
        statics.solve(statics.chain.straight(), (0.002, 0.002), (True,))
    assert isinstance(caught.value, StaticsError)


@BOTH
def test_a_tendon_that_is_pulled_by_more_than_its_path_fits_no_shape(statics):
    others = (0.0,) * (len(statics.chain.arm.tendon_names) - 1)
    for pulls in ((1.0, *others), (*others, 1.0)):
        with pytest.raises(OverconstrainedError, match='no shape .* has tendons as short as'):
            statics.solve(statics.chain.straight(), pulls, (True,) * 3)


@pytest.mark.parametrize('asked', [(0.075, SLACK), (0.075, 0.0), (0.075, 0.075)])
def test_the_error_carries_an_equilibrium_on_the_path(statics, asked):
    # A span of 70 mm cannot become 75 mm shorter.
    with pytest.raises(OverconstrainedError, match='pay out a tendon') as caught:
        statics.solve(statics.chain.straight(), asked, FIRST)
    state = caught.value.state
    assert np.all(np.isfinite(state.joint_angles))
    assert np.all(state.tensions >= 0.0)
    for tendon in (0, 1):
        if asked[tendon] != SLACK:
            assert state.pulls[tendon] <= asked[tendon] + 1e-9
    arm = Reference(statics.chain.arm, state.stiff, state.held)
    assert arm.unbalanced(state.joint_angles, state.tensions) < 1e-6


def test_the_error_names_the_pulls_that_were_asked_for_and_how_far_they_got(statics):
    asked = r'right_tendon 200\.00 mm, left_tendon slack; .* ends at'
    with pytest.raises(OverconstrainedError, match=asked):
        statics.solve(statics.chain.straight(), (0.2, SLACK), FIRST)


@pytest.mark.parametrize(('asked', 'soft', 'outcome'), [
    ((0.03, SLACK), ALL, nullcontext()),
    ((0.075, 0.075), FIRST, pytest.raises(StaticsError))], ids=['solved', 'failed'])
def test_a_solve_leaves_the_start_as_it_was(statics, asked, soft, outcome):
    state = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    before = [v.copy() for v in (state.joint_angles, state.tensions, state.pulls)]
    with outcome:
        statics.solve(state, asked, soft)
    for was, now in zip(before, (state.joint_angles, state.tensions, state.pulls), strict=True):
        assert np.array_equal(now, was)


@pytest.mark.parametrize(('name', 'pulls', 'words'), [
    ('spatial_jamming', (0.03, 0.03, 0.03), 'no shape .* has tendons as short as'),
    ('tendon_arm', (0.1, 0.0, 0.0) * 3, 'loses its equilibrium after')])
def test_an_arm_that_is_pulled_beyond_every_equilibrium_is_soon_given_up(
        name, pulls, words, monkeypatch):
    functions, iterations = _kernel.functions(), []

    def follow(*arguments):
        found = functions.spatial_follow(*arguments)
        iterations.append(found[1])
        return found

    counting = functions._replace(spatial_follow=follow)
    monkeypatch.setattr(_kernel, 'functions', lambda: counting)
    statics = Statics(load_arm(description_file().with_name(f'{name}.yaml')))
    with pytest.raises(StaticsError, match=f'{words} .* pay out a tendon'):
        statics.solve(statics.chain.straight(), pulls, ALL)
    assert sum(iterations) < 4000  # hence less than a second


def test_where_the_search_for_first_tensions_does_not_end_others_do(monkeypatch):
    def endless(*_):
        raise RuntimeError('Maximum number of iterations reached.')

    start = SPACE.solve(SPACE.chain.straight(), (0.006, -0.004, -0.003), ALL)
    given = start, (0.006, -0.002, -0.005), (False, True, False)
    there = SPACE.solve(*given)
    monkeypatch.setattr('scipy.optimize.nnls', endless)
    assert SPACE.solve(*given).points == pytest.approx(there.points, abs=1e-9)


# Whatever the arm's description allows can be solved

@pytest.mark.parametrize(('bodies', 'bending_stiffness'), [
    (1, 1e-6), (1, 0.02), (1, 1e3), (12, 1e-6), (12, 1e3), (300, 0.02), (300, 200.0)])
@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_a_pull_of_16_mm_bends_the_softest_and_the_stiffest_arm(
        bodies, bending_stiffness, gravity):
    # What a stiffness of 1e3 N m^2 leaves to rounding is far above 1e-10 N m.
    masses = min(0.05, bending_stiffness)
    arm = flat_arm([Segment.leaf_spring(0.07, bending_stiffness, masses)] * 3, 0.02,
                   [Disc(0.03, masses)] * 4, bodies_per_segment=bodies, gravity=gravity)
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), (0.0165, SLACK), FIRST)
    assert state.pulls[RIGHT] == pytest.approx(0.0165, abs=1e-9)
    assert 35.0 < paper.degrees_of(statics, state)[0] < 55.0


def test_an_arm_of_six_segments_with_300_bodies_each():
    arm = flat_arm([Segment.leaf_spring(0.05, 0.05, 0.01)] * 6, 0.02, [Disc(0.02, 0.01)] * 7,
                   bodies_per_segment=300, mounting_angle=pi)
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), (0.05, SLACK), (True,) * 6)
    assert state.residual < 1e-9
    assert np.all(paper.degrees_of(statics, state) > 5.0)


def test_letting_out_one_tendon_and_pulling_the_other_is_not_overconstrained():
    # On the straight way between two such pairs the tendons are too short, at its end they fit.
    arm = flat_arm(SEGMENTS, 0.02, DISCS, gravity=0.0)
    statics = Statics(arm)
    for degrees in (20.0, 40.0, 60.0, 80.0, 100.0):
        there = statics.bend(statics.chain.straight(), 0, radians(degrees))
        asked = there.pulls - np.array([0.0, 1e-6])
        state = statics.solve(statics.chain.straight(), asked, (True,))
        assert state.joint_angles == pytest.approx(there.joint_angles, abs=1e-8)
        over = statics.solve(there, asked[::-1], (True,))
        assert over.joint_angles == pytest.approx(-there.joint_angles, abs=1e-8)
