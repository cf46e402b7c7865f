# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A goal of the tip of an arm in space is reached, with jamming and without it."""

from math import cos, inf, radians, sin
from pathlib import Path

import numpy as np
import pytest

from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.obstacles import Obstacle, Sphere, Surroundings
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import load_description
from soft_continuum.sequencing.planner import Planner, PlanSettings, WHOLE_ARM
from soft_continuum.sequencing.reach import follow, reach, ReachSettings, TipGoal

CONFIG = Path(__file__).resolve().parents[2] / 'config'
PATIENT = ReachSettings(time_limit=inf)  # the machine's speed must not matter


def begun(name):
    values = load_description(CONFIG / f'{name}.yaml', node='shape_sequencer')
    arm = arm_from_parameters(values)
    planner = Planner(arm, PlanSettings.of(values))
    return planner, planner.statics.chain.straight(), [0.0] * len(arm.tendon_names)


def run(planner, start, found):
    """The states of new statics that follow the pulls of a plan, twice as densely."""
    statics = SpaceStatics(planner.statics.chain.arm)
    state, states = start, []
    for move in found.plan.moves:
        soft = [move.segment in (s, WHOLE_ARM) for s in range(statics.chain.segments)]
        for before, after in zip(move.pulls, move.pulls[1:], strict=False):
            for pulls in (before, 0.5 * (before + after), after):
                state = statics.solve(state, pulls, soft)
                states.append(state)
    return states


def test_segments_in_space_reach_around_what_stands_in_the_way():
    planner, start, pulls = begun('spatial_jamming')
    goal = TipGoal((0.1, 0.08, 0.27), position_tolerance=2e-3)
    ball = Surroundings(planner.statics.chain.arm, [
        Obstacle('ball', Sphere(0.02), (0.075, 0.05, 0.31))])
    found = next(reach(planner, start, pulls, goal, ball, PATIENT))
    assert not found.why
    assert found.softenings <= 3
    states = run(planner, start, found)
    assert np.linalg.norm(states[-1].tip - goal.position) <= goal.position_tolerance
    least = min(near.distance for near in ball.clearances(states))
    assert PATIENT.margin <= found.clearance[0] <= least
    assert not any(state.jumped for state in states)


@pytest.fixture(scope='module')
def tendon_arm():
    return begun('tendon_arm')


def test_an_arm_without_jamming_points_where_it_should_in_one_move(tendon_arm):
    planner, start, pulls = tendon_arm
    lean, towards = radians(40.0), radians(70.0)
    axis = np.array([sin(lean) * cos(towards), sin(lean) * sin(towards), cos(lean)])
    side = np.cross([0.0, 0.0, 1.0], axis) / sin(lean)
    goal = TipGoal((0.03, 0.07, 0.24), np.column_stack([side, np.cross(axis, side), axis]),
                   'direction')
    none = Surroundings(planner.statics.chain.arm)
    found = next(reach(planner, start, pulls, goal, none, PATIENT))
    assert not found.why
    assert [move.segment for move in found.plan.moves] == [WHOLE_ARM]
    end = run(planner, start, found)[-1]
    assert np.linalg.norm(end.tip - goal.position) <= goal.position_tolerance
    assert np.arccos(end.orientations[-1][:, 2] @ axis) <= goal.angle_tolerance


def test_an_arm_without_jamming_follows_a_line_within_what_it_says(tendon_arm):
    planner, start, pulls = tendon_arm
    line = np.linspace((0.05, 0.0, 0.245), (0.03, 0.05, 0.245), 4)
    goals = [TipGoal(place, position_tolerance=2e-3) for place in line]
    none = Surroundings(planner.statics.chain.arm)
    found = next(follow(planner, start, pulls, goals, none, PATIENT))
    assert not found.why
    assert found.softenings == 1
    tips = np.array([state.tip for state in run(planner, start, found)])
    nearest = np.array([np.linalg.norm(tips - place, axis=1).min() for place in line])
    assert nearest.max() <= 2e-3
    assert np.linalg.norm(tips[-1] - line[-1]) <= found.tip_error + 1e-6
    assert found.tip_error <= 2e-3
