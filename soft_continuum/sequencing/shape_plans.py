# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans of shapes one after the other, given by angles or by the tip, among obstacles."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

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
from soft_continuum.sequencing.reach import follow, PlannedStep, Reach, reach, ReachSettings

STATES = 20
"""At most so many states on the way of a move that was planned by angles, besides its ends."""


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
            found = (_by_tip if shape.tips else _by_angles)(
                planner, state, pulls, shape, surroundings, settings, first)
        except PlanError as error:
            planner.check_wanted()
            found = Reach(None, str(error))
        yield found
        if found.why or found.plan is None:
            return
        state, moves = found.plan.state, found.plan.moves
        pulls = moves[-1].pulls[-1].tolist() if moves else pulls


def plan_of(found: Reach, shape: Shape, surroundings: Surroundings) -> ShapePlan:
    """Return the plan to a shape; raises PlanError, or ObstructedError, where there is none."""
    if found.plan is not None and not found.why:
        return found.plan
    blocked = any(obstacle.name in found.why for obstacle in surroundings.obstacles)
    raise (ObstructedError if blocked else PlanError)(f'{shape.name}: {found.why}')


def _by_tip(planner: ShapePlanner, state: Any, pulls: Sequence[float], shape: Shape,
            surroundings: Surroundings, settings: ReachSettings, first: bool) -> Reach:
    """Return the best plan to a goal of the tip, or along a path."""
    plans = (reach(planner, state, pulls, shape.tips[0], surroundings, settings)
             if len(shape.tips) == 1 else
             follow(planner, state, pulls, shape.tips, surroundings, settings))
    for found in plans:
        if first and not found.why:
            break
    if found.plan is None:
        return found
    end = found.plan.state
    return replace(found, plan=ShapePlan(
        replace(shape, bending_angles=tuple(end.bending_angles.tolist()),
                bending_directions=tuple(end.bending_directions.tolist())),
        found.plan.moves, end, tuple(step.states for step in found.steps)))


def _by_angles(planner: ShapePlanner, state: Any, pulls: Sequence[float], shape: Shape,
               surroundings: Surroundings, settings: ReachSettings, _: bool) -> Reach:
    """Return the plan from the base to the tip, with what is in its way."""
    plan, = planner.plan(state, pulls, [shape])
    steps, why = [], ''
    for move in plan.moves:
        try:
            step = _step(planner, state, move, surroundings, settings)
        except StaticsError as error:
            raise PlanError(f'segment {move.segment + 1}: {error}') from None
        state = step.states[-1]
        steps.append(step)
        if step.clearance < settings.margin and not why:
            why = (f'while segment {move.segment + 1} is set, the arm comes to '
                   f'{1e3 * step.clearance:.1f} mm of {step.obstacle}; margin: '
                   f'{1e3 * settings.margin:.1f} mm')
    return Reach(replace(plan, ways=tuple(step.states for step in steps)), why, tuple(steps))


def _step(planner: ShapePlanner, state: Any, move: Move, surroundings: Surroundings,
          settings: ReachSettings) -> PlannedStep:
    """Return what is predicted of a move; raises StaticsError."""
    states = [planner.softened(state, move.pulls[0], move.segment)]
    rows = np.unique(np.linspace(0, len(move.pulls) - 1, STATES + 2).round().astype(int))[1:]
    for row in rows.tolist():
        planner.check_wanted()
        states.append(planner.softened(states[-1], move.pulls[row], move.segment))
    near = min(surroundings.clearances(states), key=lambda clearance: clearance.distance)
    return PlannedStep(tuple(states), near.distance, near.obstacle, move.largest_tension,
                       move.duration + settings.softening_time)
