# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Ways to bring the tip of a planar arm somewhere without the suite's own planner by tip."""

from collections.abc import Sequence
from time import process_time
from typing import Any

import numpy as np

from benchmarks.lab import Description
from benchmarks.queries import MARGIN, Query
from soft_continuum.mechanics import bending_for_tip, set_shape
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.statics import StaticsError
from soft_continuum.planning.obstacles import CollisionScene
from soft_continuum.planning.planner import Planner
from soft_continuum.planning.plans import Move, PlanError, Shape
from soft_continuum.planning.reach import ReachSettings
from soft_continuum.planning.shape_plans import plan_shapes, plans_to

UNLIMITED = 10**9  # states: contenders have the same time
STEP = 0.05  # rad between two states that OMPL has looked at


class NoPlanError(RuntimeError):
    """A contender found none."""


def ours(description: Description, query: Query, limit: float) -> Sequence[Move]:
    """Return the first plan of the suite."""
    found = next(plan_shapes(
        Planner(description.arm, description.settings), query.state, query.pulls,
        [Shape('goal', (), tips=(query.goal,))], CollisionScene(description.arm, query.obstacles),
        ReachSettings(margin=MARGIN, states=UNLIMITED, time_limit=limit), first=True))
    if found.why or found.plan is None:
        raise NoPlanError(found.why)
    return found.plan.moves


def base_to_tip(description: Description, query: Query, limit: float) -> Sequence[Move]:
    """Return the moves to angles for the tip, set base first; obstacles are not looked at."""
    planner = Planner(description.arm, description.settings)
    shapes = _goals(planner, query)
    if not shapes:
        raise NoPlanError('no angles for the tip')
    plan, = plans_to(planner, [Shape('tip', tuple(shapes[0].tolist()))], query.state, query.pulls)
    return plan.moves


def rrt_connect(description: Description, query: Query, limit: float) -> Sequence[Move]:
    """
    Return what OMPL's RRT-Connect finds over angles, each of its steps set base first.

    It looks at states alone: whether the arm, set to these angles, is clear by the margin.
    """
    from ompl import base, geometric, util
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(1)
    began = process_time()
    planner = Planner(description.arm, description.settings)
    around = CollisionScene(description.arm, query.obstacles)
    limits = description.arm.bending_angle_limits.tolist()
    space = base.RealVectorStateSpace(len(limits))
    bounds = base.RealVectorBounds(len(limits))
    for axis, most in enumerate(limits):
        bounds.setLow(axis, -most)
        bounds.setHigh(axis, most)
    space.setBounds(bounds)
    information = base.SpaceInformation(space)

    def free(state: Any) -> bool:
        angles = [state[axis] for axis in range(len(limits))]
        try:
            there = set_shape(planner.statics, angles)
        except StaticsError:
            return False
        return around.clearance(there).distance >= MARGIN

    information.setStateValidityChecker(free)
    information.setStateValidityCheckingResolution(STEP / float(space.getMaximumExtent()))
    information.setup()

    def state_of(angles: Array) -> Any:
        state = information.allocState()
        for axis, angle in enumerate(angles.tolist()):
            state[axis] = min(max(angle, -limits[axis]), limits[axis])
        return state

    problem = base.ProblemDefinition(information)
    problem.addStartState(state_of(np.array(query.state.bending_angles)))
    goals = base.GoalStates(information)
    shapes = _goals(planner, query)
    if not shapes:
        raise NoPlanError('no angles for the tip')
    for shape in shapes:
        goals.addState(state_of(shape))
    problem.setGoal(goals)
    search = geometric.RRTConnect(information)
    search.setProblemDefinition(problem)
    search.setup()
    left = limit - (process_time() - began)
    if left <= 0.0 or not search.solve(base.timedPlannerTerminationCondition(left)):
        raise NoPlanError('OMPL found none')
    path = problem.getSolutionPath()
    geometric.PathSimplifier(information).simplifyMax(path)
    steps = [tuple(path.getState(k)[axis] for axis in range(len(limits)))
             for k in range(1, path.getStateCount())]
    plans = plans_to(planner, [Shape(f'step {k}', step) for k, step in enumerate(steps)],
                     query.state, query.pulls)
    return [move for plan in plans for move in plan.moves]


def _goals(planner: Any, query: Query) -> list[Array]:
    """Return angles that bring the tip to the goal: from where the arm is, and from straight."""
    goal, found = query.goal, []
    for start in (query.state, planner.statics.chain.straight()):
        try:
            fit = bending_for_tip(planner.statics, goal.position, goal.rotation, start)
        except (StaticsError, PlanError):
            continue
        if fit.distance <= goal.position_tolerance:
            found.append(fit.state.bending_angles)
    return found
