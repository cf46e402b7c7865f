# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans of shapes one after the other, given by angles or by the tip, among obstacles."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import permutations
from typing import Any, TypeVar

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.obstacles.collision_scene import CollisionScene
from soft_continuum.sequencing.held_plan import held, plan_held
from soft_continuum.sequencing.held_tip import reach_held
from soft_continuum.sequencing.planner import Planner
from soft_continuum.sequencing.plans import (
    Move,
    ObstructedError,
    PlanError,
    Shape,
    ShapePlan,
    ways_of,
    with_relaxing,
)
from soft_continuum.sequencing.reach import (
    follow,
    PlannedStep,
    Reach,
    reach,
    ReachSettings,
)
from soft_continuum.sequencing.reach.passage import BlockedError, MotionValidator, Node

Ended = TypeVar('Ended')

STATES = 20
"""Largest number of states on the path of a move without obstacles."""
ORDERS = 24
"""Number of segment orders tried among obstacles; the one from the base is first."""


def plan_shapes(planner: Planner, state: Any, pulls: Sequence[float],
                shapes: Sequence[Shape], scene: CollisionScene, settings: ReachSettings,
                first: bool = False) -> Iterator[Reach]:
    """
    Yield the plan of each shape, from where the one before it ends, up to the first that fails.

    state: with all segments stiff.  pulls: (tendons,) m of the motors.  first: take the first plan
    to a tip goal, without looking for a better one.  The shape of each plan has the planned
    angles.  Raises PlanError when the plans were abandoned.
    """
    for shape in shapes:
        try:
            if shape.tips and shape.vacuums:
                found = reach_held(
                    planner, state, pulls, shape, scene, settings, first)
            elif shape.tips:
                found = _by_tip(planner, state, pulls, shape, scene, settings, first)
            elif scene.obstacles:
                found = _in_some_order(planner, state, pulls, shape, scene, settings)
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
    """Return the plan to a shape; raises PlanError or ObstructedError if there is none."""
    if found.plan is not None and not found.why:
        return found.plan
    raise (ObstructedError if found.blocked_by else PlanError)(f'{shape.name}: {found.why}')


def _by_tip(planner: Planner, state: Any, pulls: Sequence[float], shape: Shape,
            scene: CollisionScene, settings: ReachSettings, first: bool) -> Reach:
    """Return the best plan to a goal of the tip, or along a path."""
    for found in (reach(planner, state, pulls, shape.tips[0], scene, settings)
                  if len(shape.tips) == 1 else
                  follow(planner, state, pulls, shape.tips, scene, settings)):
        if first and not found.why:
            break
    if found.plan is None:
        return found
    end = found.plan.state
    return replace(found, plan=ShapePlan(
        replace(shape, bending_angles=tuple(end.bending_angles.tolist()),
                bending_directions=tuple(end.bending_directions.tolist())),
        found.plan.moves, end, *ways_of(found.steps)))


def _from_base(planner: Planner, state: Any, pulls: Sequence[float], shape: Shape,
               settings: ReachSettings) -> Reach:
    """Return the plan to angles from the base to the tip."""
    plan, = planner.plan(state, pulls, [shape])
    steps = []
    for move in plan.moves:
        steps.append(_step(planner, state, move, settings))
        state = steps[-1].states[-1]
    if plan.relaxing is None:
        return Reach(replace(plan, ways=ways_of(steps)[0]), '', tuple(steps))
    return Reach(replace(plan, ways=ways_of((*steps, plan.relaxing))[0]), '',
                 with_relaxing(steps, plan.relaxing))


def _step(planner: Planner, state: Any, move: Move, settings: ReachSettings) -> PlannedStep:
    """Return what is predicted of a move where nothing is in the way."""
    states = [state]
    rows = np.unique(np.linspace(0, len(move.pulls) - 1, STATES).round().astype(int))
    with suppress(StaticsError):  # it was planned without a look at each of them
        for row in rows.tolist():
            states.append(planner.held(states[-1], move.pulls[row], move.segment, move.sliding))
    pause = settings.softening_time if planner.settings.jamming else 0.0
    return PlannedStep(tuple(states), np.inf, '', move.largest_tension, move.duration + pause)


def _in_some_order(planner: Planner, state: Any, pulls: Sequence[float], shape: Shape,
                   scene: CollisionScene, settings: ReachSettings) -> Reach:
    """Return the plan to angles in the first order that is clear of obstacles."""
    validator = MotionValidator(planner, scene, settings)
    start = validator.start(state, np.array(pulls, dtype=float))
    blocked_by: dict[str, None] = {}
    try:
        if not shape.vacuums:
            node = _ordered(validator, start, shape, blocked_by, lambda node: node)
            return Reach(ShapePlan(shape, node.moves, node.state,
                                   *ways_of(node.steps)), '', node.steps)
        plan, found = plan_held(planner, shape, lambda shift: _ordered(
            validator, start, shape, blocked_by, lambda node: held(validator, node, shape.vacuums),
            shift))
    except BlockedError as error:
        return Reach(None, str(error), blocked_by=tuple(blocked_by))
    ways, clearances = ways_of((*found.node.steps, found.relaxing))
    return Reach(replace(plan, ways=ways, clearances=clearances), '',
                 with_relaxing(found.node.steps, found.relaxing))


def _ordered(validator: MotionValidator, start: Node, shape: Shape, blocked_by: dict[str, None],
             ended: Callable[[Node], Ended], shift: Array | None = None) -> Ended:
    """
    Return what comes of the first order of segments that is clear of obstacles.

    blocked_by: receives the obstacles that blocked orders.  ended: of where an order leads; may
    raise BlockedError too.  shift: as of Planner.moves.  Raises BlockedError.
    """
    planner, why = validator.planner, ''
    goals = planner.goals_of(shape, shift)
    for _, order in zip(range(ORDERS), permutations(goals), strict=False):
        node, at = start, ''
        try:
            for segment, goal, at in order:  # noqa: B007  (where it was blocked)
                if planner.away(node.state, segment, goal) > planner.settings.angle_tolerance:
                    node, at = validator.go(node, segment, goal), ''
            return ended(node)
        except BlockedError as error:
            why = why or f'{at}{error}'
            blocked_by |= dict.fromkeys([error.obstacle] if error.obstacle else [])
    more = ', and no other order of the segments is free' if len(goals) > 1 else ''
    raise BlockedError(f'{why}{more}', next(iter(blocked_by), ''))
