# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans of shapes one after the other, given by angles or by the tip, among obstacles."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import permutations
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.statics import StaticsError
from soft_continuum.parameters.shapes import angles_problem
from soft_continuum.planning.held_shapes import compensate_relaxation, reach_held
from soft_continuum.planning.obstacles import CollisionScene
from soft_continuum.planning.planner import Planner
from soft_continuum.planning.plans import (
    Move,
    ObstructedError,
    PlanError,
    PlannedStep,
    PlanResult,
    Shape,
    ShapePlan,
)
from soft_continuum.planning.reach import follow, MotionValidator, reach, ReachSettings
from soft_continuum.planning.reach.passage import BlockedError, Node

STATES = 20
"""Largest number of states on the path of a move without obstacles."""
ORDERS = 24
"""Number of segment orders tried among obstacles; the one from the base is first."""


def plan_shapes(planner: Planner, state: Any, pulls: Sequence[float] | Array,
                shapes: Sequence[Shape], scene: CollisionScene | None = None,
                settings: ReachSettings | None = None, first: bool = False
                ) -> Iterator[PlanResult]:
    """
    Yield the plan of each shape, from where the one before it ends, up to the first that fails.

    state: with all segments stiff.  pulls: (tendons,) m of the motors.  first: take the first plan
    to a tip goal, without looking for a better one.  The shape of each plan has the planned
    angles.  Raises PlanError when the plans were abandoned.
    """
    validator = MotionValidator(
        planner, scene or CollisionScene(planner.statics.chain.arm), settings or ReachSettings())
    for shape in shapes:
        try:
            start = validator.start(state, pulls)
            plan = next(plan for plan, suits in PLANNERS if suits(shape, validator.settings))
            found = plan(validator, start, shape, first)
        except PlanError as error:
            planner.check_wanted()
            found = PlanResult(None, str(error))
        yield found
        if found.why or found.plan is None:
            return
        state, pulls = found.plan.state, found.plan.pulls(start.pulls)
        if found.plan.stiff is not None:
            state = planner.jammed(state, pulls)


def plans_of(shapes: Sequence[Shape], found: Iterable[PlanResult]) -> list[ShapePlan]:
    """Return the plans of shapes; raises PlanError or ObstructedError if one has none."""
    plans = []
    for shape, one in zip(shapes, found, strict=False):
        if one.plan is None or one.why:
            raise (ObstructedError if one.blocked_by else PlanError)(f'{shape.name}: {one.why}')
        plans.append(one.plan)
    return plans


def plans_to(planner: Planner, shapes: Sequence[Shape], state: Any = None,
             pulls: Sequence[float] | Array | None = None) -> list[ShapePlan]:
    """
    Return the plans of shapes one after the other, without obstacles.

    state, pulls: as of plan_shapes; by default straight, with tendons at 0.  Raises PlanError.
    """
    chain = planner.statics.chain
    return plans_of(shapes, plan_shapes(
        planner, chain.straight() if state is None else state,
        np.zeros(len(chain.arm.tendon_names)) if pulls is None else pulls, shapes))


def _by_tip(validator: MotionValidator, start: Node, shape: Shape, first: bool) -> PlanResult:
    """Return the best plan to a goal of the tip, or along a path; the first can still go on."""
    search = (found if found.plan is None else replace(
        found, plan=replace(found.plan, shape=shape.at(found.plan.state)))
        for found in (reach(validator, start, shape.tips[0]) if len(shape.tips) == 1 else
                      follow(validator, start, shape.tips)))
    for found in search:
        if first and not found.why:
            return replace(found, better=search)
    return found


def _by_angles(validator: MotionValidator, start: Node, shape: Shape, _: bool) -> PlanResult:
    """Return the plan to angles from the base, or in the first order clear of obstacles."""
    planner = validator.planner
    arm, tolerance = planner.statics.chain.arm, planner.settings.angle_tolerance
    problem = angles_problem(shape.bending_angles, arm, shape.bending_directions)
    if problem:
        raise PlanError(problem)
    blocked_by: dict[str, None] = {}
    set_to = (partial(_in_some_order, validator, start, shape, blocked_by)
              if validator.scene.obstacles else partial(_from_base, validator, start, shape))
    try:
        if not shape.vacuums:
            return PlanResult(set_to(None).plan(shape))
        wanted = bending_vectors(arm, shape.bending_angles, shape.bending_directions)
        found, off = compensate_relaxation(
            planner, set_to, lambda state: wanted - state.bending, tolerance)
    except BlockedError as error:
        return PlanResult(None, str(error), blocked_by=tuple(blocked_by))
    return PlanResult(found.plan(shape, '' if off <= tolerance else (
        f'{shape.name} is predicted to be {np.degrees(off):.1f} degrees off with its vacuums')))


def _from_base(validator: MotionValidator, node: Node, shape: Shape, shift: Array | None) -> Node:
    """Return where the order from the base leads; shift: as of Planner.goals_of."""
    planner = validator.planner
    for segment, goal, at in planner.goals_of(shape, shift):
        if planner.away(node.state, segment, goal) <= planner.settings.angle_tolerance:
            continue
        try:
            move, end = planner.move(node.state, node.pulls, segment, goal)
        except (StaticsError, PlanError) as error:
            raise PlanError(f'{at}{error}') from None
        node = replace(node, state=end, pulls=move.pulls[-1], moves=(*node.moves, move),
                       steps=(*node.steps, _step(validator, node.state, move)))
    return validator.relaxed(node, shape.vacuums)


def _step(validator: MotionValidator, state: Any, move: Move) -> PlannedStep:
    """Return what is predicted of a move where nothing is in the way."""
    planner = validator.planner
    states = [state]
    rows = np.unique(np.linspace(0, len(move.pulls) - 1, STATES).round().astype(int))
    with suppress(StaticsError):  # it was planned without a look at each of them
        for row in rows.tolist():
            states.append(planner.held(states[-1], move.pulls[row], move.segment, move.sliding))
    pause = validator.settings.softening_time if planner.settings.jamming else 0.0
    return PlannedStep(tuple(states), np.inf, '', move.largest_tension, move.duration + pause)


def _in_some_order(validator: MotionValidator, start: Node, shape: Shape,
                   blocked_by: dict[str, None], shift: Array | None) -> Node:
    """
    Return where the first order of segments that is clear of obstacles leads.

    blocked_by: receives the obstacles that blocked orders.  shift: as of Planner.goals_of.  Raises
    BlockedError.
    """
    planner, why = validator.planner, ''
    goals = planner.goals_of(shape, shift)
    for _, order in zip(range(ORDERS), permutations(goals), strict=False):
        node, at = start, ''
        try:
            for segment, goal, at in order:  # noqa: B007  (where it was blocked)
                if planner.away(node.state, segment, goal) > planner.settings.angle_tolerance:
                    node, at = validator.go(node, segment, goal), ''
            return validator.relaxed(node, shape.vacuums)
        except BlockedError as error:
            why = why or f'{at}{error}'
            blocked_by |= dict.fromkeys([error.obstacle] if error.obstacle else [])
    more = ', and no other order of the segments is free' if len(goals) > 1 else ''
    raise BlockedError(f'{why}{more}', next(iter(blocked_by), ''))


PLANNERS: tuple[tuple[Callable[[MotionValidator, Node, Shape, bool], PlanResult],
                      Callable[[Shape, ReachSettings], bool]], ...] = (
    (_by_angles, lambda shape, _: not shape.tips),
    (reach_held, lambda shape, _: bool(shape.vacuums)),
    (_by_tip, lambda *_: True),
)
"""Planners, each with the shapes that it suits; the first one that does plans a shape."""
