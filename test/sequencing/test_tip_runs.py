# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans by tip and among obstacles while they run: watched, left, made again, measured."""

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from soft_continuum.mechanics.chain import Chain
from soft_continuum.planning.aiming import tip_aim
from soft_continuum.planning.obstacles import CollisionScene, Obstacle, Sphere
from soft_continuum.planning.plan_watch import PlanWatch
from soft_continuum.planning.planner import Planner
from soft_continuum.planning.plans import ObstructedError, PlanError, Shape, TipGoal
from soft_continuum.planning.reach import ReachSettings
from soft_continuum.planning.shape_plans import plan_shapes, plans_of
from soft_continuum.sequencing import Code
from support.measured_rig import MeasuredRig
from support.virtual_rig import (
    ARM,
    at_rest_and_stiff,
    one_soft_at_most_and_none_moved_stiff,
    PLAN_SETTINGS,
    TICK_STEPS,
)

MARGIN, MAX_DEVIATION = 0.005, 0.02  # m
PLACE = np.array([0.15, 0.0, 0.22])
SETTINGS = ReachSettings(margin=MARGIN, time_limit=np.inf)


def tip_shape(*places, tolerance=1e-3):
    return Shape('tip', (), tips=tuple(
        TipGoal(np.array(place), position_tolerance=tolerance) for place in places))


def ball(x, z, radius=0.02, name='ball'):
    return Obstacle(name, Sphere(radius), (float(x), 0.0, float(z)))


@dataclass
class TipRig(MeasuredRig):
    """A rig whose goals are of the tip, and whose plans are watched, as the nodes do it."""

    arm: object = replace(ARM, bodies_per_segment=4)
    watched: object = None

    def planned(self, shape):
        planner, state = self.estimated()
        around = CollisionScene(self.arm)
        found, = plan_shapes(
            planner, state, self.tendons.reading.pulls, [shape], around, SETTINGS, first=True)
        return plans_of([shape], [found])[0]

    def aim(self, shape):
        return tip_aim(shape, self.arm) if shape.tips else super().aim(shape)

    def observe(self):
        observation = super().observe()
        runner = getattr(self, 'runner', None)
        if runner is None or runner.plan is None or not runner.plan.steps:
            return observation
        if self.count % TICK_STEPS:  # it is for the runner
            return observation
        if self.watched is not runner.plan:
            self.watched, self.watch = runner.plan, PlanWatch(runner.plan, MARGIN, MAX_DEVIATION)
        watch, state = self.watch, self.estimator.state
        return replace(observation, obstructed=watch.obstructed(runner.move, state),
                       departed=watch.departed(runner.move, state))

    @property
    def miss(self):
        """How far the tip is from the goal, m."""
        return float(np.linalg.norm(self.state.backbone[-1] - PLACE))


# A plan that is watched.


@cache
def plan():
    """Return a plan of the described arm: segment 2, then segment 3."""
    return found_from_straight(tip_shape(PLACE), first=True).plan


def found_from_straight(shape, *obstacles, **options):
    """Return what is found for a shape of the straight arm."""
    found, = plan_shapes(Planner(ARM, PLAN_SETTINGS), Chain(ARM).straight(), (0.0, 0.0),
                         [shape], CollisionScene(ARM, obstacles), SETTINGS, **options)
    return found


def watch(*obstacles):
    watching = PlanWatch(plan(), MARGIN, MAX_DEVIATION)
    watching.look(CollisionScene(ARM, obstacles))
    return watching


def test_an_obstacle_is_in_the_way_until_the_arm_is_past_it():
    before, after = plan().steps[0].states[0], plan().steps[0].states[-1]
    side = before.backbone[-1] + [-0.04, 0.0, 0.0]  # beside the tip of the straight arm
    watching = watch(ball(side[0], side[2]))
    assert watching.obstructed(0, before).startswith('ball is ')
    assert 'where segment 2 is set' in watching.obstructed(0, before)
    assert watching.obstructed(0, after) == ''
    assert watching.obstructed(1, after) == ''


def test_an_obstacle_at_the_end_counts_to_the_end():
    end = plan().state.backbone[-1]
    watching = watch(ball(end[0], end[2] - 0.03))
    for move in (0, 1, 2):
        assert 'ball' in watching.obstructed(move, plan().steps[0].states[0])


def test_the_arm_may_depart_from_its_plan_by_what_obstacles_leave():
    state = plan().steps[0].states[5]

    def leaning(angle):
        """The arm as in that state, but for segment 1, which leans the other way."""
        joints = state.joint_angles.copy()
        per_segment = state.chain.joints_per_segment
        joints[:per_segment] -= angle / per_segment
        return state.chain.state(joints)

    def departed(angle):
        return min(np.linalg.norm(leaning(angle).backbone - one.backbone, axis=1).max()
                   for one in plan().steps[0].states)

    assert MARGIN < departed(0.15) < MAX_DEVIATION < departed(0.4)
    tip = state.backbone[-1]
    assert watch().departed(0, leaning(0.15)) == ''
    assert watch(ball(tip[0], tip[2] + 0.2)).departed(0, leaning(0.15)) == ''
    near = watch(ball(tip[0], tip[2] + 0.027))
    assert 'from where it was planned to be' in near.departed(0, leaning(0.15))
    assert 'allowed: 20.0 mm' in watch().departed(0, leaning(0.4))


def test_after_its_last_move_the_arm_may_be_as_far_from_its_plan_as_obstacles_leave():
    end, moves = plan().state, len(plan().moves)
    x, _, z = end.backbone[-1]
    straight = Chain(end.chain.arm).straight()
    assert watch().departed(moves, straight) == ''
    near = watch(ball(x, z - 0.05))
    assert near.departed(moves, end) == ''
    assert 'from where it was planned to be' in near.departed(moves, straight)


def test_what_fits_between_two_states_of_the_plan_is_in_the_way():
    first, second = plan().steps
    one, other = max(pairwise(first.states), key=lambda pair:
                     np.linalg.norm(pair[0].backbone[-1] - pair[1].backbone[-1]))
    coarse = replace(plan(), steps=(replace(first, states=(one, other)), second))
    middle = plan().state.chain.state((one.joint_angles + other.joint_angles) / 2)
    sideways = middle.rotations[-1, :, 2]

    def at(distance):
        x, _, z = middle.backbone[-1] + distance * sideways
        return CollisionScene(ARM, [ball(x, z, 0.001)])

    near = next(around for around in map(at, np.linspace(0.0, 0.05, 200))
                if around.clearance(middle).distance > 0.5 * MARGIN)
    assert near.clearance(middle).distance < MARGIN
    watching = PlanWatch(coarse, MARGIN, MAX_DEVIATION)
    watching.look(near)
    assert 'ball' in watching.obstructed(0, one)


def test_an_arm_that_is_nearer_than_the_margin_may_go_away():
    start = Chain(ARM).straight()
    side = start.backbone[-1]
    around = next(found for found in (CollisionScene(ARM, [ball(x, side[2])])
                                      for x in np.arange(-0.03, -0.08, -2e-4))
                  if found.clearance(start).distance > 0.4 * MARGIN)
    assert around.clearance(start).distance < MARGIN
    found = found_from_straight(tip_shape(PLACE), *around.obstacles, first=True)
    watching = PlanWatch(found.plan, MARGIN, MAX_DEVIATION)
    assert not watching.looked
    watching.look(around)
    assert watching.looked and watching.obstructed(0, start) == ''


# Angles among obstacles.


def test_angles_are_set_in_another_order_where_an_obstacle_is_in_the_way_of_the_first():
    shape = Shape('hook', tuple(np.radians([0.0, 41.2, 59.9])))
    free = found_from_straight(shape)
    assert [move.segment for move in free.plan.moves] == [1, 2]
    found = found_from_straight(shape, ball(0.09, 0.33))
    assert [move.segment for move in found.plan.moves] == [2, 1]
    assert found.clearance[0] >= MARGIN
    blocked = found_from_straight(shape, ball(0.15, 0.22))
    with pytest.raises(ObstructedError, match='ball is in the way.*no other order'):
        plans_of([shape], [blocked])


def test_what_is_out_of_reach_is_no_obstacle_s_fault():
    shape = tip_shape([0.5, 0.0, 0.5])
    found = found_from_straight(shape, ball(-0.2, 0.3))
    with pytest.raises(PlanError, match='tip: .*out of reach') as caught:
        plans_of([shape], [found])[0]
    assert not isinstance(caught.value, ObstructedError)


# Runs by measurements.


@pytest.mark.parametrize('open_loop', [False, True])
def test_measurements_bring_the_tip_to_its_goal(open_loop):
    rig = TipRig((tip_shape(PLACE),), open_loop=open_loop)
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert outcome.code is Code.SUCCESSFUL
    assert (rig.miss < 1.5e-3) == (not open_loop)
    at_rest_and_stiff(rig)


def test_a_path_is_followed_with_measurements():
    path = [[0.15, 0.0, 0.22], [0.148, 0.0, 0.235], [0.14, 0.0, 0.25]]
    rig = TipRig((tip_shape(*path, tolerance=3e-3),))
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert outcome.code is Code.SUCCESSFUL
    assert np.linalg.norm(rig.state.backbone[-1] - path[-1]) < 3e-3


def test_a_shape_is_planned_again_so_many_times_only():
    rig = TipRig((tip_shape(PLACE),))
    rig.settings = replace(rig.settings, max_replans=2)
    rig.runner = rig.run_of(rig.shapes)
    rig.observe_really, rig.observe = rig.observe, lambda: replace(
        rig.observe_really(), departed='gone astray' if rig.runner.plan else '')
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert (outcome.code, outcome.replans) == (Code.HARDWARE_FAULT, 2)
    assert outcome.message == 'gone astray; replanned 2 times'
    fractions = [p.fraction for p in rig.progress]
    assert fractions == sorted(fractions)
    at_rest_and_stiff(rig)


def test_a_segment_that_slips_is_noticed_and_the_rest_is_planned_again():
    rig = TipRig((tip_shape(PLACE),), shift={1: -0.3})
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert outcome.code is Code.SUCCESSFUL
    assert outcome.replans >= 1
    assert rig.miss < 4e-3  # 10 mm where it is not planned again


def test_nothing_is_softened_before_a_plan_was_compared_with_the_obstacles_of_now():
    rig = TipRig((tip_shape(PLACE),))
    rig.runner = rig.run_of(rig.shapes)
    ticks = []

    def observe():
        observation = rig.observe_really()
        if rig.runner.plan is None or len(ticks) > 20:
            return observation
        assert not [command for command in rig.commands if command[1] != 'hold']
        ticks.append(rig.now)
        return replace(observation, unseen=len(ticks) <= 20)

    rig.observe_really, rig.observe = rig.observe, observe
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert outcome.code is Code.SUCCESSFUL and len(ticks) == 21
