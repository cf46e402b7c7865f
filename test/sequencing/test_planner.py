# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A plan sets one segment after the other and ends at the bending angles, by the model."""

from dataclasses import replace
from itertools import permutations
from math import nan, pi, radians
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import LEFT, RIGHT, Statics
from soft_continuum.mechanics.arm import mounted, STANDARD_GRAVITY
from soft_continuum.parameters.files import load_arm
from soft_continuum.parameters.shapes import PAPER_SHAPES
from soft_continuum.sequencing.planner import PlanError, Planner, PlanSettings, Shape
from soft_continuum.sequencing.timing import timed
from support.flat_arm import made_of, of_segments

DESCRIPTION = Path(__file__).resolve().parents[2] / 'config' / 'manipulator.yaml'
ARM = load_arm(DESCRIPTION)
LIBRARY = {name: Shape(name, angles) for name, angles in PAPER_SHAPES.items()}
C_FORM, UPRIGHT, S_FORM = LIBRARY.values()
STRAIGHT = Shape('straight', (0.0, 0.0, 0.0))
INVERTED = Shape('inverted C-form', tuple(-a for a in C_FORM.bending_angles))
SHAPES = (*LIBRARY.values(), STRAIGHT, INVERTED)
SETTINGS = PlanSettings()
ANGLE_ERROR = radians(0.05)


def arm_of(segments, **mounting):
    """An arm with the paper's segments over and over, from the base."""
    return of_segments(ARM, [i % 3 for i in range(segments)], gravity=mounted(**mounting))


def planned(*shapes, arm=ARM, **changes):
    """Plans of shapes one after the other from the straight arm, and the planner."""
    planner = Planner(arm, replace(SETTINGS, **changes))
    return planner.plan(planner.statics.chain.straight(), (0.0, 0.0), shapes), planner


def moves_of(plans):
    return [move for plan in plans for move in plan.moves]


def soft(planner, move):
    return [i == move.segment for i in range(planner.statics.chain.segments)]


def followed(planner, plans):
    """The states of the model along the pulls: (move, states at all its points)."""
    state = planner.statics.chain.straight()
    for move in moves_of(plans):
        states = [state]
        for pulls in move.pulls:
            states.append(planner.statics.solve(states[-1], pulls, soft(planner, move)))
        yield move, states
        state = states[-1]


def angles(planner, state):
    return state.bending_angles


def check_arrives(planner, plans):
    """The pulls of the plans, followed by the model, set every segment to its angle."""
    for move, states in followed(planner, plans):
        end = angles(planner, states[-1])[move.segment]
        assert abs(end - move.goal[move.segment, 1]) < ANGLE_ERROR
        assert not any(state.jumped for state in states)
    reached = angles(planner, plans[-1].state)
    assert reached == pytest.approx(
        plans[-1].shape.bending_angles, abs=ANGLE_ERROR + planner.settings.angle_tolerance)


def largest_speed_and_acceleration(times, pulls):
    """Of the faster tendon, by finite differences, from rest to rest."""
    if len(times) < 2:
        return 0.0, 0.0
    speeds = np.diff(pulls, axis=0) / np.diff(times)[:, None]
    changes = np.diff(speeds, axis=0, prepend=0.0, append=0.0)
    return np.abs(speeds).max(), np.abs(changes).max() / np.diff(times).min()


def check_limits(times, pulls, speed=SETTINGS.speed, acceleration=SETTINGS.acceleration):
    fastest, hardest = largest_speed_and_acceleration(times, pulls)
    assert fastest <= speed * (1 + 1e-6)
    assert hardest <= acceleration * (1 + 1e-6)


@pytest.fixture(scope='module')
def library():
    """The paper's three shapes in a row, and the planner."""
    return planned(C_FORM, UPRIGHT, S_FORM)


# Plans.


def test_the_three_shapes_of_the_paper_end_at_their_angles(library):
    plans, planner = library
    assert [plan.shape for plan in plans] == [C_FORM, UPRIGHT, S_FORM]
    check_arrives(planner, plans)


def test_segments_are_set_from_the_base_to_the_tip(library):
    assert [move.segment for move in library[0][0].moves] == [0, 1, 2]


def test_every_move_keeps_all_other_segments_as_they_are(library):
    plans, planner = library
    for move, states in followed(planner, plans):
        locked = [not s for s in soft(planner, move)]
        first, last = (s.joint_angles.reshape(3, -1)[locked] for s in (states[0], states[-1]))
        assert last == pytest.approx(first, abs=1e-12)


def test_pulls_are_continuous_from_move_to_move(library):
    at = np.zeros(2)
    for move in moves_of(library[0]):
        assert move.pulls[0] == pytest.approx(at, abs=1e-12)
        at = move.pulls[-1]


def test_a_plan_starts_from_the_pulls_that_it_is_given(library):
    _, planner = library
    slack = (-0.001, -0.002)
    plan, = planner.plan(planner.statics.chain.straight(), slack, [C_FORM])
    assert plan.moves[0].pulls[0] == pytest.approx(slack)


def test_the_state_of_a_plan_is_where_its_pulls_lead(library):
    plans, planner = library
    *_, (_, states) = followed(planner, plans)
    assert plans[-1].state.joint_angles == pytest.approx(states[-1].joint_angles, abs=1e-4)


def test_the_largest_tension_of_a_move_is_what_the_model_predicts(library):
    plans, planner = library
    for move, states in followed(planner, plans):
        assert max(s.tensions.max() for s in states[1:]) <= 1.01 * move.largest_tension + 0.01


def test_motions_are_within_speed_and_acceleration(library):
    for move in moves_of(library[0]):
        check_limits(move.times, move.pulls)


def test_a_segment_that_is_at_its_angle_is_not_softened(library):
    c_form, upright, s_form = library[0]
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


def test_in_the_c_form_under_gravity_the_antagonist_carries_segment_2(library):
    plans, planner = library
    move, states = list(followed(planner, plans[:1]))[1]
    assert move.segment == 1 and move.goal[1, 1] > 0.0
    assert states[-1].tensions[RIGHT] == 0.0 < states[-1].tensions[LEFT]
    assert angles(planner, states[-1])[1] == pytest.approx(radians(36.0), abs=ANGLE_ERROR)


def test_without_gravity_the_tendon_on_the_inside_carries_every_segment():
    plans, planner = planned(C_FORM, arm=ARM.without_gravity())
    for _, states in followed(planner, plans):
        assert states[-1].tensions[LEFT] == 0.0 < states[-1].tensions[RIGHT]
    # MECHANICS.md: pulls of 16.496, 14.191 and 11.890 mm.
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


@pytest.mark.parametrize('gravity', [0.0, 9.80665])
@pytest.mark.parametrize('mounting_angle', [0.0, pi / 2, pi], ids=['upright', 'lying', 'hanging'])
@pytest.mark.parametrize('segments', [1, 2])
def test_arms_with_fewer_segments_are_planned_alike(segments, mounting_angle, gravity):
    arm = arm_of(segments, angle=mounting_angle, gravity=gravity)
    shape = Shape('bow', (radians(36.0),) * segments)
    plans, planner = planned(shape, arm=arm)
    assert [m.segment for m in plans[0].moves] == list(range(segments))
    check_arrives(planner, plans)


def test_an_arm_with_five_segments_is_planned_alike():
    shape = Shape('snake', tuple(radians(a) for a in (30, -30, 30, -30, 30)))
    plans, planner = planned(shape, arm=arm_of(5, angle=0.0, gravity=1.0))
    assert [m.segment for m in plans[0].moves] == [0, 1, 2, 3, 4]
    check_arrives(planner, plans)


# Refusals.


def test_pulls_beyond_the_limits_are_refused_naming_shape_and_segment():
    with pytest.raises(PlanError) as refused:
        planned(C_FORM, pull_limits=(-0.02, 0.02))
    assert str(refused.value).startswith('c_form: segment 2 to 36.0 degrees: ')
    assert 'pull_limits: -0.02 to 0.02 m' in str(refused.value)
    assert '0.0301' in str(refused.value)  # what it would need


def test_paying_out_beyond_the_limits_is_refused():
    with pytest.raises(PlanError, match=r'c_form: segment 1 .*pull_limits: -0\.01 to 0\.06'):
        planned(C_FORM, pull_limits=(-0.01, 0.06))


def test_a_tension_beyond_the_limit_is_refused_naming_shape_and_segment():
    with pytest.raises(PlanError, match=r'^s_form: segment 1 .* N; tension_limit: 2 N'):
        planned(S_FORM, tension_limit=2.0)


def test_a_shape_later_in_the_sequence_is_refused_before_anything_is_planned_to_move():
    with pytest.raises(PlanError, match=r'^upright_c_form: segment 1 .*tension_limit: 5 N'):
        planned(C_FORM, UPRIGHT, tension_limit=5.0)


def test_a_segment_too_weak_for_its_load_is_refused_and_not_folded():
    heavy = replace(ARM, gravity=mounted(0.0, 5.0 * STANDARD_GRAVITY))
    with pytest.raises(PlanError, match=r'^c_form: segment \d to 36\.0 degrees: '):
        planned(C_FORM, arm=heavy)


@pytest.mark.parametrize('bending_angles', [(0.5,), (0.5, 0.5), (0.1, 0.1, 0.1, 0.1)], ids=len)
def test_the_wrong_number_of_angles_is_refused(bending_angles):
    with pytest.raises(PlanError, match='wrong: .*3 segments'):
        planned(Shape('wrong', bending_angles))


@pytest.mark.parametrize('angle', [nan, 1.2, -1.2])
def test_an_angle_that_the_arm_does_not_allow_is_refused(angle):
    with pytest.raises(PlanError, match='wrong: .*segment 2'):
        planned(Shape('wrong', (0.0, angle, 0.0)))


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
def test_a_motion_keeps_speed_and_acceleration_also_around_corners(points):
    times, pulls = timed(np.array(points), SETTINGS.speed, SETTINGS.acceleration)
    check_limits(times, pulls)


@pytest.mark.parametrize('points', CORNERS.values(), ids=CORNERS.keys())
def test_a_motion_starts_and_ends_exactly_where_it_should(points):
    times, pulls = timed(np.array(points), SETTINGS.speed, SETTINGS.acceleration)
    assert times[0] == 0.0 and np.all(np.diff(times) > 0.0)
    assert pulls[0] == pytest.approx(points[0], abs=1e-15)
    assert pulls[-1] == pytest.approx(points[-1], abs=1e-15)


@pytest.mark.parametrize('count', [1, 2, 5])
def test_a_motion_of_no_length_is_one_point_in_no_time(count):
    points = np.full((count, 2), (0.01, -0.02))
    times, pulls = timed(points, SETTINGS.speed, SETTINGS.acceleration)
    assert times.tolist() == [0.0]
    assert pulls.tolist() == [[0.01, -0.02]]


def test_a_long_motion_is_as_fast_as_its_speed_allows():
    times, pulls = timed(np.array([(0.0, 0.0), (0.05, -0.05)]), 0.015, 10.0)
    assert largest_speed_and_acceleration(times, pulls)[0] == pytest.approx(0.015, rel=0.01)


def test_a_short_motion_is_as_hard_as_its_acceleration_allows():
    times, pulls = timed(np.array([(0.0, 0.0), (0.005, -0.005)]), 10.0, 0.1, interval=0.005)
    assert largest_speed_and_acceleration(times, pulls)[1] == pytest.approx(0.1, rel=0.02)


coordinates = st.floats(-0.05, 0.05)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=5),
       st.floats(0.001, 0.1), st.floats(0.01, 1.0))
def test_any_motion_keeps_speed_and_acceleration(points, speed, acceleration):
    check_limits(*timed(np.array(points), speed, acceleration), speed, acceleration)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=5))
def test_a_motion_stays_between_its_points_and_goes_through_them_in_order(points):
    _, pulls = timed(np.array(points), SETTINGS.speed, SETTINGS.acceleration)
    leg = 0
    for pull in pulls:
        while not between(pull, points[leg], points[leg + 1]):
            leg += 1
            assert leg < len(points) - 1, f'{pull} lies between no two points'


def between(pull, start, end):
    low, high = np.minimum(start, end), np.maximum(start, end)
    return np.all(pull >= low - 1e-12) and np.all(pull <= high + 1e-12)


def test_planning_does_not_depend_on_what_was_planned_before():
    fresh, _ = planned(S_FORM)
    planner = Planner(ARM, SETTINGS)
    straight = planner.statics.chain.straight()
    planner.plan(straight, (0.0, 0.0), [C_FORM, UPRIGHT])
    again = planner.plan(straight, (0.0, 0.0), [S_FORM])
    for move, other in zip(moves_of(fresh), moves_of(again), strict=True):
        assert np.array_equal(move.pulls, other.pulls)


def test_a_state_found_by_its_joint_angles_can_be_planned_from(library):
    """As the sequencer does it: from the joint angles that it received, without tensions."""
    plans, planner = library
    received = Statics(ARM).chain.state(plans[0].state.joint_angles)
    plan, = planner.plan(received, plans[0].moves[-1].pulls[-1], [UPRIGHT])
    assert plan.moves[0].pulls == pytest.approx(plans[1].moves[0].pulls, abs=1e-7)


def test_friction_at_the_guides_costs_tension():
    bend = Shape('bend', (0.5, 0.0, 0.0))
    smooth, rough = (moves_of(planned(bend, arm=ARM.with_tendons(**made_of(friction=mu)))[0])[0]
                     for mu in (0.0, 0.3))
    assert rough.largest_tension > 1.02 * smooth.largest_tension
