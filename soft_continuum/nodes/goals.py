# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The shapes that a goal of run_shape_sequence asks for, and why one is refused."""

from collections.abc import Mapping
from typing import Any

from soft_continuum.mechanics.either import AnyArm
from soft_continuum.parameters.shapes import (
    angles_problem,
    directions_from_parameters,
    shapes_from_parameters,
)
from soft_continuum.ros.conversions import seconds
from soft_continuum.ros.text import name_problem
from soft_continuum.sequencing.planner import PlanError, Shape
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Shape as ShapeMessage

MAX_SHAPES = 100
"""Shapes of one goal; to plan one takes some tens of milliseconds, in space some hundreds."""


def shape_library(parameters: Mapping[str, Any], arm: AnyArm) -> dict[str, Shape]:
    """Return the shapes that parameters describe, by name; raises ParameterError."""
    directions = directions_from_parameters(parameters)
    return {name: Shape(name, angles, 0.0, directions.get(name, ()))
            for name, angles in shapes_from_parameters(parameters, arm).items()}


def shapes_of(goal: RunShapeSequence.Goal, library: Mapping[str, Shape], arm: AnyArm
              ) -> list[Shape]:
    """Return the shapes of a goal; raises PlanError for what is not allowed."""
    if not goal.shapes:
        raise PlanError('the sequence is empty; give at least one shape: ' + ', '.join(library))
    if len(goal.shapes) > MAX_SHAPES:
        raise PlanError(f'{len(goal.shapes)} shapes; allowed: {MAX_SHAPES}; send them in '
                        'several goals')
    if goal.aim not in (goal.ANGLES, goal.TIP):
        raise PlanError(f'aim is {goal.aim}; allowed: {goal.ANGLES} (angles), {goal.TIP} (tip)')
    return [_shape(number, item, library, arm) for number, item in enumerate(goal.shapes, start=1)]


def _shape(number: int, item: ShapeMessage, library: Mapping[str, Shape], arm: AnyArm) -> Shape:
    if problem := name_problem(item.name):
        raise PlanError(f'shape {number}: its name is {problem}')
    if item.tips:
        raise PlanError(f'shape {number}: goals of the tip are not known yet; give angles')
    for what, values in (('angles', item.bending_angles), ('directions', item.bending_directions)):
        if len(values) > MAX_SHAPES:
            raise PlanError(f'shape {number}: {len(values)} bending {what}; needed: '
                            f'{len(arm.segments)}')
    angles, directions = tuple(item.bending_angles), tuple(item.bending_directions)
    if not angles:
        if directions:
            raise PlanError(f'shape {number}: bending_directions without bending_angles; give '
                            f'both, {len(arm.segments)} each, or a name alone')
        if item.name not in library:
            raise PlanError(f'shape {number}: unknown shape {item.name!r}; known: '
                            + ', '.join(library))
        known = library[item.name]
        angles, directions = known.bending_angles, known.bending_directions
    problem = angles_problem(angles, arm, directions)
    hold = seconds(item.hold_time)
    if hold < 0.0:
        problem = f'hold_time is {hold:g} s; it must not be negative'
    if problem:
        raise PlanError(f'shape {number} ({item.name or "unnamed"}): {problem}')
    return Shape(item.name or f'shape {number}', angles, hold, directions)
