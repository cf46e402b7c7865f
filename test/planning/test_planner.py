# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A plan sets one segment after the other and ends at the bending asked for, by the model."""

from dataclasses import replace
from itertools import permutations, product
from math import nan, pi, radians
from pathlib import Path
import re

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from soft_continuum.mechanics import Jam, LEFT, RIGHT, Statics
from soft_continuum.mechanics.arm import mounted, STANDARD_GRAVITY
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.nodes.shape_sequencer import shape_library
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.shapes import PAPER_SHAPES
from soft_continuum.planning.planner import monotone_cubic, Planner, PlanSettings, timed
from soft_continuum.planning.plans import PlanError, Shape, WHOLE_ARM
from soft_continuum.planning.shape_plans import plans_to
from soft_continuum.ros.description import load_arm, load_description
from support.flat_arm import made_of, of_segments
from support.spatial_arms import in_space

CONFIG = Path(__file__).resolve().parents[2] / 'config'
ARM = load_arm(CONFIG / 'manipulator.yaml')
LIBRARY = {name: Shape(name, angles) for name, angles in PAPER_SHAPES.items()}
C_FORM, UPRIGHT, S_FORM = LIBRARY.values()
STRAIGHT = Shape('straight', (0.0, 0.0, 0.0))
INVERTED = Shape('inverted C-form', tuple(-a for a in C_FORM.bending_angles))
SHAPES = (*LIBRARY.values(), STRAIGHT, INVERTED)
SETTINGS = PlanSettings()
ANGLE_ERROR = radians(0.05)
CO_CONTRACTION = 0.5  # N: what opposing tendons may carry at once while they change over
OPPOSING = {'manipulator': [[0, 1]], 'spatial_jamming': [[0, 1, 2]],
            'tendon_arm': [[0, 1, 2], [3, 4, 5], [6, 7, 8]]}


def coarse(turn=0.0, **changes):
    """An arm in space with fewer bodies, turned about its axis."""
    arm = load_arm(CONFIG / 'spatial_jamming.yaml')
    return replace(arm, bodies_per_segment=4, tendons=tuple(
        replace(tendon, angle=tendon.angle + turn) for tendon in arm.tendons), **changes)


def planned(*shapes, arm=ARM, pulls=None, **changes):
    """Plans of shapes one after the other from the straight arm, and the planner."""
    planner = Planner(arm, replace(SETTINGS, **changes))
    return plans_to(planner, shapes, pulls=pulls), planner


def moves_of(plans):
    return [move for plan in plans for move in plan.moves]


def soft(planner, move):
    return [move.segment in (i, WHOLE_ARM) for i in range(planner.statics.chain.segments)]


def followed(planner, plans):
    """The states of the model along the pulls: (move, states at all its points)."""
    state = planner.statics.chain.straight()
    statics = Statics(planner.statics.chain.arm)
    for move in moves_of(plans):
        states = [state]
        for pulls in move.pulls:
            states.append(statics.solve(states[-1], pulls, soft(planner, move)))
        yield move, states
        state = states[-1]


def wanted(plan):
    return bending_vectors(plan.state.chain.arm, plan.shape.bending_angles,
                           plan.shape.bending_directions)


def away(state, bending, segments=slice(None)):
    """By how much the worst of some segments is off, rad."""
    return np.linalg.norm((state.bending - bending)[segments], axis=1).max()


def check_arrives(planner, plans):
    """The pulls of the plans, followed by the model, set every segment to its bending."""
    for move, states in followed(planner, plans):
        assert away(states[-1], move.goal, soft(planner, move)) < ANGLE_ERROR
        assert not any(state.jumped for state in states)
    assert away(plans[-1].state, wanted(plans[-1])) < (
        ANGLE_ERROR + planner.settings.angle_tolerance)


def largest_speed_and_acceleration(times, pulls):
    """Of the fastest tendon, by finite differences, from rest to rest."""
    if len(times) < 2:
        return 0.0, 0.0
    speeds = np.diff(pulls, axis=0) / np.diff(times)[:, None]
    changes = np.diff(speeds, axis=0, prepend=0.0, append=0.0)
    return np.abs(speeds).max(), np.abs(changes).max() / np.diff(times).min()


def check_limits(times, pulls, speed=SETTINGS.speed, acceleration=SETTINGS.acceleration):
    fastest, hardest = largest_speed_and_acceleration(times, pulls)
    assert fastest <= speed * (1 + 1e-6)
    assert hardest <= acceleration * (1 + 1e-6)


class Described:
    """Plans of shapes that a description has, from straight, and the states on their way."""

    def __init__(self, name, *shapes):
        values = load_description(CONFIG / f'{name}.yaml', node='shape_sequencer')
        arm, self.settings = arm_from_parameters(values), PlanSettings.of(values)
        library = shape_library(values, arm) | {'straight': STRAIGHT}
        self.planner, self.shapes = Planner(arm, self.settings), [library[s] for s in shapes]
        self.plans = plans_to(self.planner, self.shapes)
        self.followed = list(followed(self.planner, self.plans))
        self.opposing = OPPOSING[name]


@pytest.fixture(scope='module')
def flat():
    """The paper's three shapes in a row."""
    return Described('manipulator', *LIBRARY)


@pytest.fixture(scope='module')
def jamming():
    """A helix from straight, and straight again, of an arm in space."""
    return Described('spatial_jamming', 'helix', 'straight')


@pytest.fixture(scope='module')
def tendon_arm():
    """The same of one without jamming."""
    return Described('tendon_arm', 'helix', 'straight')


@pytest.fixture(params=['flat', 'jamming', 'tendon_arm'])
def described(request):
    return request.getfixturevalue(request.param)


# Plans.


def test_the_pulls_of_a_plan_end_at_the_bending_that_was_asked_for(described):
    assert [plan.shape for plan in described.plans] == described.shapes
    ends = iter(described.followed)
    for plan in described.plans:
        for move, (*_, end) in (next(ends) for _ in plan.moves):
            assert away(end, move.goal, soft(described.planner, move)) < ANGLE_ERROR
        assert away(end, wanted(plan)) < ANGLE_ERROR + described.settings.angle_tolerance
        assert end.coordinates == pytest.approx(plan.state.coordinates, abs=1e-4)


def test_the_directions_of_a_helix_are_as_far_apart_as_its_file_has_them(jamming, tendon_arm):
    for described in (jamming, tendon_arm):
        turned = np.diff(np.unwrap(described.plans[0].state.bending_directions))
        assert np.degrees(turned) == pytest.approx([80.0, 80.0], abs=0.5)


def test_segments_are_set_from_the_base_to_the_tip_and_an_arm_without_jamming_at_once(
        flat, jamming, tendon_arm):
    assert [move.segment for move in flat.plans[0].moves] == [0, 1, 2]
    assert [move.segment for move in jamming.plans[0].moves] == [0, 1, 2]
    assert [move.segment for move in tendon_arm.plans[0].moves] == [WHOLE_ARM]


def test_bending_goes_straight_to_its_goal_and_all_other_segments_are_kept(described):
    for move, (before, *states) in described.followed:
        bending = np.array([state.bending for state in states])
        for s, is_soft in enumerate(soft(described.planner, move)):
            if is_soft:
                way = bending[-1, s] - bending[0, s]
                along = way / np.linalg.norm(way)
                aside = (bending[:, s] - bending[0, s]) @ np.array([-along[1], along[0]])
                assert np.abs(aside).max() < radians(1.0)
            else:
                kept = before.coordinates.reshape(3, -1)[s]
                for state in states:
                    assert state.coordinates.reshape(3, -1)[s] == pytest.approx(kept, abs=1e-12)


def test_pulls_are_continuous_from_move_to_move(described):
    at = np.zeros(len(described.plans[0].state.tensions))
    for move in moves_of(described.plans):
        assert move.pulls[0] == pytest.approx(at, abs=1e-12)
        at = move.pulls[-1]


def test_a_plan_starts_from_the_pulls_that_it_is_given():
    slack = (-0.001, -0.002)
    (plan,), _ = planned(C_FORM, pulls=slack)
    assert plan.moves[0].pulls[0] == pytest.approx(slack)


def test_nothing_jumps_and_the_largest_tension_of_a_move_is_what_the_model_predicts(described):
    for move, (_, *states) in described.followed:
        assert not any(state.jumped for state in states)
        assert max(s.tensions.max() for s in states) <= 1.01 * move.largest_tension + 0.01
        assert 0.5 < move.largest_tension <= described.settings.tension_limit  # it does carry


def test_opposing_tendons_do_not_pull_against_each_other(described):
    for _, (_, *states) in described.followed:
        tensions = np.array([state.tensions for state in states])
        for opposing in described.opposing:
            assert tensions[:, opposing].min(axis=1).max() < CO_CONTRACTION


def test_motions_are_within_speed_and_acceleration_and_pull_limits(described):
    settings = described.settings
    for move in moves_of(described.plans):
        check_limits(move.times, move.pulls, settings.speed, settings.acceleration)
        assert settings.pull_limits[0] <= move.pulls.min()
        assert move.pulls.max() <= settings.pull_limits[1]


def test_a_segment_that_is_at_its_angle_is_not_softened(flat):
    c_form, upright, s_form = flat.plans
    assert [move.segment for move in upright.moves] == [0]  # C-form: -36 instead of 36 degrees
    assert [move.segment for move in s_form.moves] == [0, 1]


def test_a_shape_that_is_set_already_takes_no_move():
    plans, _ = planned(C_FORM, C_FORM)
    assert plans[1].moves == ()


@pytest.mark.parametrize('degrees, moves', [(0.09, 0), (0.11, 1)])
def test_a_segment_within_the_tolerance_of_its_angle_is_left_alone(degrees, moves):
    plans, _ = planned(Shape('nearly straight', (0.0, radians(degrees), 0.0)))
    assert len(plans[0].moves) == moves


@pytest.mark.parametrize('slack', [0.0, 0.0005, 0.003])
def test_the_tendon_that_does_not_carry_keeps_its_slack(slack):
    plans, planner = planned(C_FORM, antagonist_slack=slack)
    for _, states in followed(planner, plans):
        carrying = int(np.argmax(states[-1].tensions))
        assert states[-1].slack[carrying] == 0.0
        assert states[-1].slack[1 - carrying] == pytest.approx(slack, abs=1e-9)
    check_arrives(planner, plans)


def test_in_the_c_form_under_gravity_the_antagonist_carries_segment_2(flat):
    move, states = flat.followed[1]
    assert move.segment == 1 and move.goal[1, 1] > 0.0
    assert states[-1].tensions[RIGHT] == 0.0 < states[-1].tensions[LEFT]
    assert states[-1].bending_angles[1] == pytest.approx(radians(36.0), abs=ANGLE_ERROR)


def test_without_gravity_the_tendon_on_the_inside_carries_every_segment():
    plans, planner = planned(C_FORM, arm=ARM.without_gravity())
    for _, states in followed(planner, plans):
        assert states[-1].tensions[LEFT] == 0.0 < states[-1].tensions[RIGHT]
    # docs/explanation/mechanics.md: pulls of 16.496, 14.191 and 11.890 mm.
    ends = [move.pulls[-1][RIGHT] for move in plans[0].moves]
    assert np.diff(ends, prepend=0.0) == pytest.approx([16.496e-3, 14.191e-3, 11.890e-3], abs=1e-6)


@pytest.mark.parametrize('shape', [C_FORM, UPRIGHT, S_FORM], ids=lambda s: s.name)
def test_a_mirrored_shape_takes_the_pulls_of_the_other_tendon(shape):
    mirrored = Shape('mirrored', tuple(-a for a in shape.bending_angles))
    (plan,), _ = planned(shape)
    (mirror,), _ = planned(mirrored)
    for move, other in zip(plan.moves, mirror.moves, strict=True):
        assert other.times == pytest.approx(move.times, rel=1e-6)
        assert other.pulls == pytest.approx(move.pulls[:, [LEFT, RIGHT]], abs=1e-9)


@pytest.mark.parametrize('first, then', list(permutations(SHAPES, 2)), ids=lambda s: s.name)
def test_every_shape_can_be_set_from_every_other(first, then):
    plans, planner = planned(first, then)
    check_arrives(planner, plans)


@pytest.mark.parametrize(('degrees', 'mounting_angle', 'gravity'), [
    *product([(36.0,), (36.0, 36.0)], [0.0, pi / 2, pi], [0.0, 9.80665]),
    ((30.0, -30.0, 30.0, -30.0, 30.0), 0.0, 1.0)])
def test_arms_with_fewer_or_more_segments_are_planned_alike(degrees, mounting_angle, gravity):
    segments = range(len(degrees))  # those of the paper over and over
    arm = of_segments(ARM, [i % 3 for i in segments], gravity=mounted(mounting_angle, gravity))
    plans, planner = planned(Shape('bow', tuple(np.radians(degrees))), arm=arm)
    assert [m.segment for m in plans[0].moves] == list(segments)
    check_arrives(planner, plans)


# Refusals.

BOW = Shape('bow', (0.6, 0.0, 0.0), 0.0, (1.0, 0.0, 0.0))
IN_SPACE = r'^bow: segment 1 to 34\.4 degrees in the direction 57\.3'


@pytest.mark.parametrize(('shapes', 'changes', 'words'), [
    ([C_FORM], {'pull_limits': (-0.02, 0.02)}, [  # and what it would need
        r'^c_form: segment 2 to 36\.0 degrees: ', r'pull_limits: -0\.02 to 0\.02 m', r'0\.0301']),
    ([C_FORM], {'pull_limits': (-0.01, 0.06)}, [
        r'c_form: segment 1 .*pull_limits: -0\.01 to 0\.06']),
    ([S_FORM], {'tension_limit': 2.0}, [r'^s_form: segment 1 .* N; tension_limit: 2 N']),
    ([C_FORM, UPRIGHT], {'tension_limit': 5.0}, [
        r'^upright_c_form: segment 1 .*tension_limit: 5 N']),
    # A segment that is too weak for its load is not folded.
    ([C_FORM], {'arm': replace(ARM, gravity=mounted(0.0, 5.0 * STANDARD_GRAVITY))}, [
        r'^c_form: segment \d to 36\.0 degrees: ']),
    *(([Shape('wrong', (0.5,) * n)], {}, ['wrong: .*3 segments']) for n in (1, 2, 4)),
    *(([Shape('wrong', (0.0, angle, 0.0))], {}, ['wrong: .*segment 2'])
      for angle in (nan, 1.2, -1.2)),
    ([BOW], {'arm': coarse(), 'tension_limit': 1.0}, [IN_SPACE, 'tension_limit: 1 N']),
    ([BOW], {'arm': coarse(), 'pull_limits': (-0.005, 0.06)}, [
        IN_SPACE, r'pull_limits: -0\.005 to 0\.06 m']),
    ([Shape('bow', (0.2, 0.2, 0.2))], {'arm': coarse(), 'jamming': False}, [
        '3 tendons cannot set 6 bendings']),
    # Nothing holds what is softened.
    ([Shape('bow', (0.2, 0.0, 0.0))], {'arm': coarse(payload=1.0), 'pulls': (-0.02,) * 3}, [
        'because its tendons do not hold it']),
])
def test_what_cannot_be_planned_is_refused_with_its_shape_and_what_stands_in_the_way(
        shapes, changes, words):
    with pytest.raises(PlanError) as refused:
        planned(*shapes, **changes)
    assert all(re.search(word, str(refused.value)) for word in words), refused.value


bends = st.tuples(*[st.floats(radians(-60.0), radians(60.0))] * 3)


@settings(deadline=None, derandomize=True, max_examples=12)
@given(bends, bends)
def test_any_two_shapes_are_refused_or_reached_within_the_limits(first, then):
    try:
        plans, planner = planned(Shape('first', first), Shape('then', then))
    except PlanError:
        return
    check_arrives(planner, plans)
    for move in moves_of(plans):
        check_limits(move.times, move.pulls)


def test_planning_does_not_depend_on_what_was_planned_before():
    fresh, _ = planned(S_FORM)
    planner = Planner(ARM, SETTINGS)
    plans_to(planner, [C_FORM, UPRIGHT])
    again = plans_to(planner, [S_FORM])
    for move, other in zip(moves_of(fresh), moves_of(again), strict=True):
        assert np.array_equal(move.pulls, other.pulls)


def test_a_state_found_by_its_joint_angles_can_be_planned_from(flat):
    """As the sequencer does it: from the joint angles that it received, without tensions."""
    plans = flat.plans
    received = Statics(ARM).chain.state(plans[0].state.joint_angles)
    plan, = plans_to(flat.planner, [UPRIGHT], received, plans[0].moves[-1].pulls[-1])
    assert plan.moves[0].pulls == pytest.approx(plans[1].moves[0].pulls, abs=1e-7)


def test_friction_at_the_guides_costs_tension():
    bend = Shape('bend', (0.5, 0.0, 0.0))
    smooth, rough = (moves_of(planned(bend, arm=ARM.with_tendons(**made_of(friction=mu)))[0])[0]
                     for mu in (0.0, 0.3))
    assert rough.largest_tension > 1.02 * smooth.largest_tension


# In space.


def test_a_turned_arm_and_shape_have_the_same_plan():
    directions, turn = np.array([0.3, 2.0, -1.0]), 0.7
    (one,), (other,) = (planned(Shape('s', (0.5, 0.4, -0.6), 0.0, tuple(directions + by)),
                                arm=coarse(by))[0] for by in (0.0, turn))
    for move, turned in zip(one.moves, other.moves, strict=True):
        assert turned.pulls == pytest.approx(move.pulls, abs=1e-8)
        assert turned.times == pytest.approx(move.times)
    assert np.abs(other.state.tip[:2] - one.state.tip[:2]).max() > 0.01
    assert np.hypot(*other.state.tip[:2]) == pytest.approx(np.hypot(*one.state.tip[:2]))


def test_a_planar_arm_described_in_space_ends_in_the_planned_shape_of_the_plane():
    shapes = [Shape(f'{a}', a) for a in ((0.6, -0.5, 0.4), (0.2, -0.5, -0.7))]
    for one, other in zip(planned(*shapes)[0], planned(*shapes, arm=in_space(ARM))[0],
                          strict=True):
        assert other.state.poses[:, :3] == pytest.approx(one.state.poses[:, :3], abs=2e-5)
        for move, there in zip(one.moves, other.moves, strict=True):
            assert move.segment == there.segment
            # Between the points of the plan both are interpolated, of their own paths.
            assert there.pulls[-1] == pytest.approx(move.pulls[-1], abs=2e-5)


def test_a_direction_turned_by_half_a_turn_is_a_negative_angle():
    (one,), (other,) = (
        planned(Shape('s', (angle, 0.0, 0.0), 0.0, (towards, 0.0, 0.0)), arm=coarse())[0]
        for angle, towards in ((0.4, 0.9 + pi), (-0.4, 0.9)))
    assert one.moves[0].pulls == pytest.approx(other.moves[0].pulls, abs=1e-9)


def test_an_upright_arm_may_lean_within_the_slack_of_its_tendons():
    planner = Planner(coarse(), SETTINGS)
    chain = planner.statics.chain
    turns = np.random.default_rng(0).normal(0.0, 1e-4, (chain.bodies, 3)) * [1.0, 1.0, 0.0]
    nearly = chain.state_of(turns, turns, (True,) * 3)  # as an arm that was straightened is
    assert planner.statics.solve(nearly, [-1e-4] * 3, [True, False, False]).jumped
    plan, = plans_to(planner, [Shape('bow', (0.5, 0.0, 0.0), 0.0, (2.0,) * 3)], nearly,
                     [-1e-4] * 3)
    assert plan.state.bending_angles == pytest.approx([0.5, 0.0, 0.0], abs=0.01)


def test_an_arm_that_nothing_bends_has_tendons_that_are_just_slack():
    bow = Shape('bow', (0.0, 0.4, 0.0), 0.0, (2.0,) * 3)
    plans, _ = planned(bow, STRAIGHT, arm=coarse())
    assert plans[1].moves[-1].pulls[-1] == pytest.approx(-1e-4)


def test_the_jams_of_a_plan_have_the_vacuum_that_they_have():
    arm = coarse()
    arm = replace(arm, segments=tuple(replace(s, jam=Jam(8.0)) for s in arm.segments))
    planner, part = Planner(arm, SETTINGS), (0.5,) * 3
    start = replace(planner.statics.chain.straight(), vacuum=part)
    goal = bending_vectors(arm, (0.0, 0.5, 0.0), (1.0,) * 3)
    move, end = planner.move(start, np.zeros(3), 1, goal)
    state = start
    for pulls in move.pulls:
        state = planner.statics.solve(state, pulls, (False, True, False), vacuum=part)
    assert state.bending == pytest.approx(end.bending, abs=1e-4)
    assert state.bending_angles[1] == pytest.approx(0.5, abs=ANGLE_ERROR)


def test_a_plan_that_is_not_wanted_any_more_ends():
    planner = Planner(coarse(), SETTINGS, lambda: True)
    with pytest.raises(PlanError, match='abandoned'):
        plans_to(planner, [Shape('bow', (0.2, 0.0, 0.0))])


# Timing of a motion.

CORNERS = {
    'straight on': [(0.0, 0.0), (0.02, -0.02)],
    'there and back': [(0.0, 0.0), (0.01, 0.0), (0.0, 0.0)],
    'one after the other': [(0.0, 0.0), (0.01, 0.0), (0.01, 0.01)],
    'slack taken up on the way': [(0.0, 0.0), (0.01, -0.01), (0.0095, -0.0105), (0.02, -0.021)],
    'a tiny hook': [(0.0, 0.0), (0.01, 0.0), (0.0099, 0.0), (0.02, 0.0)],
    'zigzag': [(0.0, 0.0), (0.002, 0.001), (0.0, 0.002), (0.002, 0.003), (0.0, 0.004)],
    'a point twice': [(0.0, 0.0), (0.01, 0.0), (0.01, 0.0), (0.02, 0.0)],
    'a nanometre': [(0.0, 0.0), (1e-9, 0.0)],
}


@pytest.mark.parametrize('points', CORNERS.values(), ids=CORNERS.keys())
def test_a_motion_around_corners_is_within_its_limits_and_begins_and_ends_exactly(points):
    times, pulls = timed(np.array(points), SETTINGS.speed, SETTINGS.acceleration)
    check_limits(times, pulls)
    assert times[0] == 0.0 and np.all(np.diff(times) > 0.0)
    assert pulls[0] == pytest.approx(points[0], abs=1e-15)
    assert pulls[-1] == pytest.approx(points[-1], abs=1e-15)


@pytest.mark.parametrize('count', [1, 2, 5])
def test_a_motion_of_no_length_is_one_point_in_no_time(count):
    points = np.full((count, 2), (0.01, -0.02))
    times, pulls = timed(points, SETTINGS.speed, SETTINGS.acceleration)
    assert times.tolist() == [0.0]
    assert pulls.tolist() == [[0.01, -0.02]]


def test_a_long_motion_is_as_fast_and_a_short_one_as_hard_as_its_limits_allow():
    for end, speed, acceleration, reached, most in (
            (0.05, 0.015, 10.0, 0, 0.015), (0.005, 10.0, 0.1, 1, 0.1)):
        times, pulls = timed(np.array([(0.0, 0.0), (end, -end)]), speed, acceleration,
                             interval=0.005)
        assert largest_speed_and_acceleration(times, pulls)[reached] == pytest.approx(
            most, rel=0.01)


coordinates = st.floats(-0.05, 0.05)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=5),
       st.floats(0.001, 0.1), st.floats(0.01, 1.0))
def test_any_motion_is_within_its_limits_and_goes_through_its_points_in_order(
        points, speed, acceleration):
    times, pulls = timed(np.array(points), speed, acceleration)
    check_limits(times, pulls, speed, acceleration)
    legs = list(zip(points, points[1:] or points, strict=False))
    for pull in pulls:
        while not between(pull, *legs[0]):
            del legs[0]
            assert legs, f'{pull} lies between no two points'


def between(pull, start, end):
    low, high = np.minimum(start, end), np.maximum(start, end)
    return np.all(pull >= low - 1e-12) and np.all(pull <= high + 1e-12)


@pytest.mark.parametrize('points', [2, 3, 9])
@pytest.mark.parametrize('kind', ['any', 'rising', 'level in places'])
def test_the_monotone_cubic_is_that_of_scipy(points, kind):
    random = np.random.default_rng(points)
    for _ in range(20):
        x = np.cumsum(random.uniform(1e-3, 2.0, points))
        y = random.normal(size=(points, 2))
        if kind != 'any':
            y = np.cumsum(np.abs(y), axis=0)
        if kind == 'level in places':
            y[1] = y[0]
        at = np.linspace(x[0], x[-1], 40)
        assert monotone_cubic(x, y)(at) == pytest.approx(PchipInterpolator(x, y)(at), abs=1e-12)
