# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans of shapes one after the other, given by angles or by the tip, among obstacles."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np

from soft_continuum.mechanics.either import bending_of
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.obstacles.surroundings import Surroundings
from soft_continuum.sequencing.planner import (
    Move,
    ObstructedError,
    PlanError,
    Shape,
    ShapePlan,
    ShapePlanner,
)
from soft_continuum.sequencing.reach import (
    follow,
    PlannedStep,
    Reach,
    reach,
    ReachSettings,
)
from soft_continuum.sequencing.reach.passage import BlockedError, Passages

STATES = 20
"""At most so many states on the way of a move where there are no obstacles."""
ORDERS = 24
"""Orders of segments that are tried among obstacles, the one from the base first."""


def plan_shapes(planner: ShapePlanner, state: Any, pulls: Sequence[float],
                shapes: Sequence[Shape], surroundings: Surroundings, settings: ReachSettings,
                first: bool = False) -> Iterator[Reach]:
    """
    Yield the plan of each shape, from where the one before it ends, up to the first that fails.

    state: with all segments stiff.  pulls: (tendons,) m of the motors.  first: take the first plan
    to a tip goal, and look for no better one.  The shape of each plan has the angles that it is
    planned to have.  Raises PlanError when the plans were abandoned.
    """
    for shape in shapes:
        try:
            if shape.vacuums and surroundings.obstacles:
                raise PlanError('shapes with vacuums are not planned among obstacles: when a '
                                'vacuum is lowered, the arm gives way')
            if shape.tips:
                found = _by_tip(planner, state, pulls, shape, surroundings, settings, first)
            elif surroundings.obstacles:
                found = _in_some_order(planner, state, pulls, shape, surroundings, settings)
            else:
                found = _from_base(planner, state, pulls, shape, settings)
        except PlanError as error:
            planner.check_wanted()
            found = Reach(None, str(error).removeprefix(f'{shape.name}: '))
        yield found
        if found.why or found.plan is None:
            return
        state, moves = found.plan.state, found.plan.moves
        pulls = moves[-1].pulls[-1].tolist() if moves else pulls
        if found.plan.stiff is not None:
            state = planner.jammed(state, pulls)


def plan_of(found: Reach, shape: Shape) -> ShapePlan:
    """Return the plan to a shape; raises PlanError, or ObstructedError, where there is none."""
    if found.plan is not None and not found.why:
        return found.plan
    raise (ObstructedError if found.blocked_by else PlanError)(f'{shape.name}: {found.why}')


def _by_tip(planner: ShapePlanner, state: Any, pulls: Sequence[float], shape: Shape,
            surroundings: Surroundings, settings: ReachSettings, first: bool) -> Reach:
    """Return the best plan to a goal of the tip, or along a path."""
    for found in (reach(planner, state, pulls, shape.tips[0], surroundings, settings)
                  if len(shape.tips) == 1 else
                  follow(planner, state, pulls, shape.tips, surroundings, settings)):
        if first and not found.why:
            break
    if found.plan is None:
        return found
    end = found.plan.state
    return replace(found, plan=ShapePlan(
        replace(shape, bending_angles=tuple(end.bending_angles.tolist()),
                bending_directions=tuple(end.bending_directions.tolist())),
        found.plan.moves, end, *_watched(found.steps)))


def _watched(steps: Sequence[PlannedStep]) -> tuple[tuple[Any, ...], tuple[float, ...]]:
    """Return the ways of a plan, and how near to obstacles they were planned."""
    return (tuple(step.states for step in steps), tuple(step.clearance for step in steps))


def _from_base(planner: ShapePlanner, state: Any, pulls: Sequence[float], shape: Shape,
               settings: ReachSettings) -> Reach:
    """Return the plan to angles from the base to the tip."""
    plan, = planner.plan(state, pulls, [shape])
    steps = []
    for move in plan.moves:
        steps.append(_step(planner, state, move, settings))
        state = steps[-1].states[-1]
    if plan.stiff is not None and steps:
        steps[-1] = replace(steps[-1], states=(*steps[-1].states, plan.state))
    return Reach(replace(plan, ways=tuple(step.states for step in steps)), '', tuple(steps))


def _step(planner: ShapePlanner, state: Any, move: Move, settings: ReachSettings) -> PlannedStep:
    """Return what is predicted of a move where nothing is in the way."""
    states = [state]
    rows = np.unique(np.linspace(0, len(move.pulls) - 1, STATES).round().astype(int))
    with suppress(StaticsError):  # it was planned without a look at each of them
        for row in rows.tolist():
            planner.check_wanted()
            states.append(planner.held(states[-1], move.pulls[row], move.segment, move.sliding))
    pause = settings.softening_time if planner.settings.jamming else 0.0
    return PlannedStep(tuple(states), np.inf, '', move.largest_tension, move.duration + pause)


def _in_some_order(planner: ShapePlanner, state: Any, pulls: Sequence[float], shape: Shape,
                   surroundings: Surroundings, settings: ReachSettings) -> Reach:
    """Return the plan to angles in the first order that is clear of obstacles."""
    passages = Passages(planner, surroundings, settings)
    arm, goals = planner.statics.chain.arm, planner.goals_of(shape)
    bending = bending_of(arm, shape.bending_angles, shape.bending_directions)
    start, why = passages.start(state, np.array(pulls, dtype=float)), ''
    blocked_by: tuple[str, ...] = ()
    for _, order in zip(range(ORDERS), permutations(goals), strict=False):
        node, at = start, ''
        try:
            for segment, goal, at in order:  # noqa: B007  (where it was blocked)
                if planner.away(node.state, segment, goal) > planner.settings.angle_tolerance:
                    node = passages.go(node, segment, bending)
        except BlockedError as error:
            why = why or f'{at}{error}'
            blocked_by += (error.obstacle,) if error.obstacle else ()
            continue
        return Reach(ShapePlan(shape, node.moves, node.state,
                               *_watched(node.steps)), '', node.steps)
    more = ', and no other order of the segments is free' if len(goals) > 1 else ''
    return Reach(None, f'{why}{more}', blocked_by=tuple(dict.fromkeys(blocked_by)))
