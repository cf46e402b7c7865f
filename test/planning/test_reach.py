# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A goal of the tip is reached with few softenings, clear of obstacles, by the statics."""

from contextlib import suppress
from dataclasses import replace
from itertools import count, permutations, product
from math import cos, inf, nan, pi, radians, sin
from pathlib import Path

import numpy as np
import pytest

from soft_continuum.mechanics import Statics
from soft_continuum.mechanics.arm import mounted
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.planning.obstacles import Box, CollisionScene, Obstacle, Sphere
from soft_continuum.planning.planner import Planner, PlanSettings
from soft_continuum.planning.plans import PlanError, TipGoal, WHOLE_ARM
from soft_continuum.planning.reach import follow, reach, ReachSettings, search
from soft_continuum.planning.reach.passage import BlockedError, MotionValidator, moved
from soft_continuum.ros.description import load_arm, load_description
from support.flat_arm import of_segments

CONFIG = Path(__file__).resolve().parents[2] / 'config'
ARM = load_arm(CONFIG / 'manipulator.yaml')
HANGING = replace(ARM, gravity=mounted(pi))
TWO = of_segments(HANGING, range(2))
PATIENT = ReachSettings(time_limit=inf)  # the machine's speed must not matter
MARGIN = PATIENT.margin


class Query:
    """A search from the straight arm."""

    def __init__(self, goal, obstacles=(), arm=ARM, settings=PATIENT, limits=None, **changes):
        self.arm, self.goal, self.settings = arm, goal, settings
        self.limits = limits or PlanSettings(**changes)
        self.scene = CollisionScene(arm, obstacles)
        self.planner = Planner(arm, self.limits)
        self.start = self.planner.statics.chain.straight()
        self.pulls = [0.0] * len(arm.tendon_names)

    def all(self, function=reach):
        validator = MotionValidator(self.planner, self.scene, self.settings)
        return function(validator, validator.start(self.start, self.pulls), self.goal)

    def first(self):
        return next(self.all())

    def last(self, function=reach):
        *_, found = self.all(function)
        return found

    def run(self, found, between=4):
        """The states of new statics that follow the pulls of a plan, more densely than it did."""
        statics, state = Statics(self.arm), self.start
        states = []
        for move in found.plan.moves:
            soft = [move.segment in (s, WHOLE_ARM) for s in range(len(self.arm.segments))]
            parts = np.linspace(0.0, len(move.pulls) - 1, between * (len(move.pulls) - 1) + 1)
            for part in parts:
                pulls = [np.interp(part, range(len(move.pulls)), pull) for pull in move.pulls.T]
                state = statics.solve(state, pulls, soft)
                states.append(state)
        return states


def angles(found):
    return np.array([(move.segment, move.goal[move.segment, 1]) for move in found.plan.moves])


def at(x, z, **tolerances):
    return TipGoal((x, 0.0, z), **tolerances)


def wall(x, z, width=0.02, height=0.02, name='wall'):
    return Obstacle(name, Box((width, 0.2, height)), (x, 0.0, z))


BEHIND = [wall(0.17, 0.3, 0.02, 0.04, 'beam'), Obstacle('ball', Sphere(0.03), (0.12, 0.0, 0.36))]


@pytest.fixture(scope='module')
def behind():
    """A plan around a beam and a ball, without which another one would be taken."""
    query = Query(at(0.24, 0.16), BEHIND)
    return query, query.first()


def test_a_plan_ends_with_the_tip_at_the_goal_when_its_pulls_are_run(behind):
    query, found = behind
    end = query.run(found)[-1]
    assert not found.why
    assert np.linalg.norm(end.backbone[-1] - query.goal.position) <= query.goal.position_tolerance
    assert np.linalg.norm(end.backbone[-1] - query.goal.position) == pytest.approx(
        found.tip_error, abs=1e-6)
    assert end.bending_angles == pytest.approx(found.plan.state.bending_angles, abs=1e-5)
    assert found.plan.shape.bending_angles == pytest.approx(end.bending_angles, abs=1e-5)


def test_between_the_states_that_it_looked_at_the_arm_stays_as_clear_as_a_plan_says(behind):
    query, found = behind
    states = query.run(found)
    least = min(near.distance for near in query.scene.clearances(states))
    assert MARGIN <= found.clearance[0] <= least
    assert found.clearance[1] in ('beam', 'ball')
    assert not any(state.jumped for state in states)
    assert max(state.tensions.max() for state in states) <= found.tension + 0.05
    assert found.tension <= query.limits.tension_limit


def test_obstacles_change_the_plan_and_without_them_it_would_touch_them(behind):
    query, found = behind
    free = Query(query.goal).first()
    assert not np.array_equal(angles(free), angles(found))
    states = query.run(free)
    assert min(near.distance for near in query.scene.clearances(states)) < MARGIN


def test_a_mirrored_goal_among_mirrored_obstacles_has_the_mirrored_plan(behind):
    query, found = behind
    mirrored = Query(at(-0.24, 0.16), [
        replace(one, position=(-one.position[0], *one.position[1:])) for one in BEHIND]).first()
    assert angles(found) * (1, -1) == pytest.approx(angles(mirrored), abs=1e-4)


def test_gravity_from_the_other_side_is_the_mirror_image_too():
    one = Query(at(0.12, 0.26), arm=replace(ARM, gravity=mounted(1.2))).first()
    other = Query(at(-0.12, 0.26), arm=replace(ARM, gravity=mounted(-1.2))).first()
    upright = Query(at(0.12, 0.26)).first()
    assert angles(one) * (1, -1) == pytest.approx(angles(other), abs=1e-4)
    assert not np.array_equal(angles(upright).round(3), angles(one).round(3))


TWICE = [Obstacle(f'ball {k}', Sphere(radius), (x, 0.0, z)) for k, (x, z, radius) in enumerate((
    (0.1019, 0.1485, 0.0254), (-0.1781, 0.0673, 0.0239), (0.0817, 0.0972, 0.0108),
    (-0.1101, 0.2160, 0.0132), (-0.0762, 0.0176, 0.0142), (0.0711, 0.1886, 0.0117)))]


def test_a_segment_is_set_twice_where_no_two_settings_of_a_whole_grid_get_there():
    query = Query(at(-0.14174, 0.15564, position_tolerance=2e-3), TWICE, TWO)
    found = query.first()
    assert not found.why
    assert angles(found)[:, 0].tolist() == [1, 0, 1]
    validator = MotionValidator(query.planner, query.scene, query.settings)
    start = validator.start(query.start, np.zeros(2))
    grid = 0.9 * TWO.segments[0].bending_angle_limit * np.linspace(-1.0, 1.0, 5)
    ends = 0

    def about_y(angle):
        return np.array([[0.0, angle]] * 2)

    for first, second in permutations(range(2)):
        for one in grid:
            with suppress(BlockedError):
                node = validator.go(start, first, about_y(one))
                for other in grid:
                    with suppress(BlockedError):
                        end = validator.go(node, second, about_y(other)).state.backbone[-1]
                        away = np.linalg.norm(end - query.goal.position)
                        assert away > query.goal.position_tolerance
                        ends += 1
    assert ends > 10


def test_one_seed_has_one_plan_however_often_it_is_made():
    def plans(seed):
        query = Query(at(0.1, 0.28), BEHIND, settings=replace(PATIENT, seed=seed))
        return [(angles(found).tolist(), found.duration) for found in query.all()]

    assert plans(3) == plans(3)


def test_later_plans_are_better_than_those_before():
    found = list(Query(at(0.05, 0.31), [wall(0.1, 0.3, name='post')]).all())
    costs = [(one.softenings, round(one.duration / 0.1), one.tension) for one in found]
    assert costs == sorted(costs)
    assert all(not one.why for one in found)


def test_by_weights_less_tension_may_be_worth_another_softening():
    goal = at(0.14, 0.24)
    default = Query(goal).last()
    gentle = Query(goal, settings=replace(
        PATIENT, weights=(0.0, 0.0, 1.0), max_softenings=3)).last()
    assert gentle.tension < default.tension - 0.01
    assert gentle.softenings >= default.softenings


def test_a_tip_that_is_there_already_needs_no_move():
    found = Query(at(0.0, ARM.length)).last()
    assert found.plan.moves == ()
    assert not found.why


def test_what_is_out_of_reach_says_by_how_much():
    found = Query(at(0.0, ARM.length + 0.05)).last()
    assert found.why == ('the goal is out of reach: the nearest tip found is 50.0 mm from it')
    aside = Query(at(0.31, 0.1)).last()
    assert aside.plan is not None
    end = aside.plan.state.backbone[-1]
    assert np.linalg.norm(end - (0.31, 0.0, 0.1)) == pytest.approx(aside.tip_error)
    assert f'{aside.tip_error * 1e3:.1f} mm' in aside.why
    # No shape of a grid of evenly bent segments comes nearer by more than gravity bends them.
    chain = Statics(ARM).chain
    grid = np.linspace(-1.0, 1.0, 13) * ARM.segments[0].bending_angle_limit
    best = min(np.linalg.norm(chain.uniform(shape).backbone[-1] - (0.31, 0.0, 0.1))
               for shape in product(grid, repeat=3))
    assert aside.tip_error < best + 0.01


QUICK = replace(PATIENT, max_softenings=2)


def test_what_is_blocked_says_by_which_obstacle_and_comes_near():
    query = Query(at(0.15, 0.25), [Obstacle('lamp', Sphere(0.01), (0.165, 0.0, 0.26))],
                  settings=QUICK)
    found = query.last()
    assert 'lamp is in the way' in found.why
    assert found.blocked_by == ('lamp',)
    assert found.plan is not None
    states = query.run(found)
    assert min(near.distance for near in query.scene.clearances(states)) >= MARGIN
    end = np.linalg.norm(states[-1].backbone[-1] - query.goal.position)
    assert query.goal.position_tolerance < end < 0.08


@pytest.mark.parametrize(('name', 'value'), [('tension_limit', 0.5),
                                             ('pull_limits', (-0.004, 0.004))])
def test_what_a_limit_forbids_names_the_limit(name, value):
    assert f'{name} would be exceeded' in Query(at(0.2, 0.2), settings=QUICK, **{name: value}
                                              ).last().why


def test_a_direction_is_reached_as_well():
    turn = radians(50.0)
    rotation = np.array([[np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0],
                         [-np.sin(turn), 0.0, np.cos(turn)]])
    query = Query(at(0.15, 0.26, rotation=rotation, kind='direction'))
    found = query.first()
    assert not found.why
    end = query.run(found, 1)[-1]
    assert abs(end.bending_angles.sum() - turn) <= query.goal.angle_tolerance
    assert np.hypot(*(end.tip[::2] - (0.15, 0.26))) <= query.goal.position_tolerance


def refused(*words, **changes):
    with pytest.raises(PlanError) as refusal:
        Query(**changes).first()
    assert all(word in str(refusal.value) for word in words), refusal.value


def test_goals_that_are_none_are_refused_with_what_is_needed():
    for goal, word in (({'position': (nan, 0.0, 0.2)}, 'finite'),
                       ({'position': (0.1, 0.2)}, 'three'),
                       ({'position': (0.1, 0.0, 0.2), 'position_tolerance': 0.0}, 'allowed'),
                       ({'position': (0.1, 0.0, 0.2), 'angle_tolerance': inf}, 'allowed'),
                       ({'position': (0.1, 0.0, 0.2), 'kind': 'pose'}, 'needs a rotation'),
                       ({'position': (0.1, 0.0, 0.2), 'kind': 'pose',
                         'rotation': np.diag([1.0, 1.0, -1.0])}, 'rotation matrix'),
                       ({'position': (0.1, 0.0, 0.2), 'kind': 'place'}, 'position, direction')):
        with pytest.raises(PlanError, match=word):
            TipGoal(**goal)
    refused('y = 0.05', 'planar', goal=TipGoal((0.1, 0.05, 0.2)))
    aside = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    refused('out of the plane', goal=TipGoal((0.1, 0.0, 0.2), aside, 'direction'))


def test_a_start_or_a_goal_in_an_obstacle_is_refused_by_its_name():
    refused('touches beam', goal=at(0.1, 0.2), obstacles=[wall(0.0, 0.25, name='beam')])
    refused('is in beam', 'mm deep', goal=at(0.2, 0.2), obstacles=[wall(0.2, 0.2, name='beam')])


def test_a_plan_that_is_not_wanted_any_more_ends():
    query = Query(at(0.1, 0.28))
    query.planner = Planner(ARM, query.limits, abandoned=lambda: True)
    with pytest.raises(PlanError, match='abandoned'):
        query.first()


@pytest.mark.parametrize(('changes', 'why'), [
    ({'time_limit': 0.0}, 'reach.time_limit ended the search after 0 of 10000 states'),
    ({'states': 5}, 'reach.states was too small')])
def test_when_time_or_states_are_spent_what_is_known_is_the_answer_and_that_is_said(changes, why):
    found = Query(at(0.1, 0.28), settings=replace(PATIENT, **changes)).last()
    assert found.cut_short == ('time_limit' in changes)
    assert not found.cut_short or found.plan is None
    assert why in found.why


def test_more_states_find_no_worse_a_plan_few_are_kept_to_and_the_machine_s_speed_is_no_matter(
        monkeypatch):
    counted = []
    query = Query(at(0.15, 0.22), [wall(0.05, 0.32)])
    query.planner = Planner(ARM, query.limits, abandoned=lambda: bool(counted.append(0)))

    def plans(**changes):
        counted.clear()
        query.settings = replace(PATIENT, **changes)
        found = list(query.all())
        assert len(counted) < query.settings.states + 100
        return found

    few, many = plans(states=1300), plans(states=2600)
    assert angles(few[0]).tolist() == angles(many[0]).tolist()
    assert (many[-1].softenings, many[-1].duration) <= (few[-1].softenings, few[-1].duration)
    clock = count()  # a second or more passes between two looks at it
    monkeypatch.setattr(search, 'monotonic', lambda: float(next(clock)))
    assert angles(plans(states=1300)[-1]).tolist() == angles(few[-1]).tolist()
    assert plans(states=1300, time_limit=60.0)[-1].cut_short


def test_the_time_until_an_interrupted_search_goes_on_does_not_count(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(search, 'monotonic', lambda: now[0])
    budget = search.Budget(10, 5.0)
    with budget.paused():
        now[0] += 100.0
    assert not budget.over
    now[0] += 6.0
    assert budget.over and budget.late


def test_no_point_of_the_body_moves_farther_than_the_bound(behind):
    states = behind[0].run(behind[1], 1)
    draw = np.random.default_rng(0)
    radius = 0.03
    for one, other in zip(states, states[5:], strict=False):
        body = draw.integers(len(one.rotations))
        local = draw.normal(size=3)
        local *= radius / np.linalg.norm(local)
        places = [state.backbone[body + 1] + state.rotations[body] @ local
                  for state in (one, other)]
        assert np.linalg.norm(places[1] - places[0]) <= moved(one, other, radius) + 1e-12


def test_a_path_along_which_one_segment_leads_is_followed_with_it_alone():
    chain = Statics(ARM).chain
    tips = [chain.uniform([0.5, angle, 0.3]).backbone[-1] for angle in np.linspace(-0.3, 0.3, 4)]
    query = Query([TipGoal(tip, position_tolerance=4e-3) for tip in tips])
    found = next(one for one in query.all(follow) if not one.why)
    assert found.tip_error <= 4e-3
    assert found.softenings <= 3
    run = np.array([state.backbone[-1] for state in query.run(found, 2)])
    for tip in tips:
        assert np.linalg.norm(run - tip, axis=1).min() <= 4e-3
    assert np.linalg.norm(run[-1] - tips[-1]) <= 4e-3


def test_a_path_that_cannot_be_followed_so_exactly_says_how_far_off_it_will_be():
    line = [at(x, 0.25, position_tolerance=1e-4) for x in (0.1, 0.14, 0.18)]
    query = Query(line, settings=replace(PATIENT, max_softenings=4))
    found = next(query.all(follow))
    assert f'within {found.tip_error * 1e3:.1f} mm' in found.why
    assert 1e-4 < found.tip_error < 0.05
    with pytest.raises(PlanError, match='2 to 200'):
        next(Query(line[:1]).all(follow))


def test_turns_are_told_in_degrees():
    flat = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    found = Query(at(0.0, ARM.length, rotation=flat, kind='pose'), settings=QUICK).last()
    assert 'degrees' in found.why
    assert found.turn_error > radians(2.0)


# In space, with jamming and without it.


def described(name):
    """What a query takes of a description: the arm and its limits."""
    values = load_description(CONFIG / f'{name}.yaml', node='shape_sequencer')
    return {'arm': arm_from_parameters(values), 'limits': PlanSettings.of(values)}


def test_segments_in_space_reach_around_what_stands_in_the_way():
    query = Query(TipGoal((0.1, 0.08, 0.27), position_tolerance=2e-3),
                  [Obstacle('ball', Sphere(0.02), (0.075, 0.05, 0.31))],
                  **described('spatial_jamming'))
    found = query.first()
    assert not found.why
    assert found.softenings <= 3
    states = query.run(found, 2)
    assert np.linalg.norm(states[-1].tip - query.goal.position) <= query.goal.position_tolerance
    least = min(near.distance for near in query.scene.clearances(states))
    assert MARGIN <= found.clearance[0] <= least
    assert not any(state.jumped for state in states)


def test_an_arm_without_jamming_points_where_it_should_in_one_move():
    lean, towards = radians(40.0), radians(70.0)
    axis = np.array([sin(lean) * cos(towards), sin(lean) * sin(towards), cos(lean)])
    side = np.cross([0.0, 0.0, 1.0], axis) / sin(lean)
    query = Query(TipGoal((0.03, 0.07, 0.24), np.column_stack([side, np.cross(axis, side), axis]),
                          'direction'), **described('tendon_arm'))
    found = query.first()
    assert not found.why
    assert [move.segment for move in found.plan.moves] == [WHOLE_ARM]
    end = query.run(found, 2)[-1]
    assert np.linalg.norm(end.tip - query.goal.position) <= query.goal.position_tolerance
    assert np.arccos(end.orientations[-1][:, 2] @ axis) <= query.goal.angle_tolerance


def test_an_arm_without_jamming_follows_a_line_within_what_it_says():
    line = np.linspace((0.05, 0.0, 0.245), (0.03, 0.05, 0.245), 4)
    query = Query([TipGoal(place, position_tolerance=2e-3) for place in line],
                  **described('tendon_arm'))
    found = next(query.all(follow))
    assert not found.why
    assert found.softenings == 1
    tips = np.array([state.tip for state in query.run(found, 2)])
    nearest = np.array([np.linalg.norm(tips - place, axis=1).min() for place in line])
    assert nearest.max() <= 2e-3
    assert np.linalg.norm(tips[-1] - line[-1]) <= found.tip_error + 1e-6
    assert found.tip_error <= 2e-3
