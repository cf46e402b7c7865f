# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of a goal of run_shape_sequence, and their validation."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Arm
from soft_continuum.parameters.shapes import (
    angles_problem,
    directions_from_parameters,
    shapes_from_parameters,
    vacuums_from_parameters,
    vacuums_problem,
)
from soft_continuum.planning import TIP_KINDS
from soft_continuum.planning.plans import PlanError, Shape, TipGoal
from soft_continuum.ros.conversions import MAX_QUATERNION_ERROR, pose_from_ros, seconds
from soft_continuum.text import MAX_NAME, name_problem, printable
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Shape as ShapeMessage
from soft_continuum_interfaces.msg import TipGoal as TipGoalMessage

MAX_SHAPES = 100
"""Shapes of one goal; planning one takes tens of ms, for spatial arms hundreds."""
MAX_TIPS = 200
"""Tip goals of one goal."""


def shape_library(parameters: Mapping[str, Any], arm: Arm) -> dict[str, Shape]:
    """Return the shapes that parameters describe, by name; raises ParameterError."""
    directions = directions_from_parameters(parameters)
    vacuums = vacuums_from_parameters(parameters)
    return {name: Shape(name, angles, 0.0, directions.get(name, ()),
                        vacuums=vacuums.get(name, ()))
            for name, angles in shapes_from_parameters(parameters, arm).items()}


def check_aim(aim: int) -> None:
    """Raise PlanError for an invalid aim of RunShapeSequence."""
    angles, tip = RunShapeSequence.Goal.ANGLES, RunShapeSequence.Goal.TIP
    if aim not in (angles, tip):
        raise PlanError(f'aim is {aim}; allowed: {angles} (angles), {tip} (tip)')


def shapes_of(items: Sequence[ShapeMessage], library: Mapping[str, Shape], arm: Arm,
              parameters: Mapping[str, Any]) -> list[Shape]:
    """
    Return the shapes of a request; raises PlanError for an invalid one.

    parameters: with the default tolerances of tip goals.
    """
    if not items:
        raise PlanError('the sequence is empty; give at least one shape: ' + ', '.join(library))
    if len(items) > MAX_SHAPES:
        raise PlanError(f'{len(items)} shapes; allowed: {MAX_SHAPES}; send them in several goals')
    if (tips := sum(len(item.tips) for item in items)) > MAX_TIPS:
        raise PlanError(f'{tips} tips; allowed: {MAX_TIPS}; send them in several goals')
    return [_shape(number, item, library, arm, parameters)
            for number, item in enumerate(items, start=1)]


def _shape(number: int, item: ShapeMessage, library: Mapping[str, Shape], arm: Arm,
           parameters: Mapping[str, Any]) -> Shape:
    if problem := name_problem(item.name):
        raise PlanError(f'shape {number}: its name is {problem}')
    label, hold = f'shape {number} ({item.name or "unnamed"})', seconds(item.hold_time)
    if hold < 0.0:
        raise PlanError(f'{label}: hold_time is {hold:g} s; it must not be negative')
    for what, values in (('bending angles', item.bending_angles), ('vacuums', item.vacuums),
                         ('bending directions', item.bending_directions)):
        if len(values) > MAX_SHAPES:
            raise PlanError(f'shape {number}: {len(values)} {what}; needed: {len(arm.segments)}')
    angles, directions = tuple(item.bending_angles), tuple(item.bending_directions)
    vacuums, tips = tuple(item.vacuums), _tips(label, item, arm, parameters)
    if not (angles or tips):
        if directions:
            raise PlanError(f'shape {number}: bending_directions without bending_angles; give '
                            f'both, {len(arm.segments)} each, or a name alone')
        if item.name not in library:
            raise PlanError(f'shape {number}: unknown shape {item.name!r}; known: '
                            + ', '.join(library))
        known = library[item.name]
        angles, directions = known.bending_angles, known.bending_directions
        vacuums = vacuums or known.vacuums
    if not tips and (problem := angles_problem(angles, arm, directions)):
        raise PlanError(f'{label}: {problem}')
    if vacuums and len(tips) > 1:
        raise PlanError(f'{label}: {len(tips)} tips and vacuums: a path is followed with every '
                        'segment stiff but one; give one tip, or leave the vacuums out')
    if vacuums and (problem := vacuums_problem(
            vacuums, arm, parameters['full_vacuum'], parameters['soft_vacuum'],
            parameters['arm.jamming'])):
        raise PlanError(f'{label}: {problem}')
    name = item.name or (_tips_name(tips, arm) if tips else f'shape {number}')
    return Shape(name, angles, hold, directions, tips, vacuums)


def regulator_problem(shapes: Sequence[Shape], regulators: bool) -> str:
    """Return which shape has vacuums although the rig has valves; empty for none."""
    return next((f'{shape.name}: vacuums are given, but jamming_valves has valves, not '
                 'regulators; leave the vacuums out'
                 for shape in shapes if shape.vacuums and not regulators), '')


def _tips(label: str, item: ShapeMessage, arm: Arm, parameters: Mapping[str, Any]
          ) -> tuple[TipGoal, ...]:
    """Return the goals of the tip of a shape, none for angles; raises PlanError."""
    if not item.tips:
        return ()
    if len(item.bending_angles) or len(item.bending_directions):
        raise PlanError(f'{label}: tips and bending angles or directions; give only one of the '
                        'two')
    goals = []
    for number, tip in enumerate(item.tips, start=1):
        try:
            goals.append(_tip_goal(tip, parameters))
            goals[-1].check(arm)
        except PlanError as error:
            of = f'tip {number}: ' if len(item.tips) > 1 else ''
            raise PlanError(f'{label}: {of}{error}') from None
    return tuple(goals)


def _tips_name(tips: Sequence[TipGoal], arm: Arm) -> str:
    """Return what people know goals of the tip by."""
    if len(tips) > 1:
        return f'path through {len(tips)} points'
    place = 1e3 * tips[0].position[arm.pose_axes[:3]]
    return f'tip at ({", ".join(f"{value:.0f}" for value in place)}) mm'


def _tip_goal(tip: TipGoalMessage, parameters: Mapping[str, Any]) -> TipGoal:
    if tip.header.frame_id not in ('', frame := parameters['frame_id']):
        raise PlanError(f'the frame_id of the tip goal is '
                        f'{printable(repr(tip.header.frame_id), MAX_NAME)}; allowed: {frame!r}, '
                        'or empty. Transform the goal, for instance with tf2')
    if tip.kind >= len(TIP_KINDS):
        raise PlanError(f'the kind of the tip goal is {tip.kind}; allowed: '
                        + ', '.join(f'{n} ({kind})' for n, kind in enumerate(TIP_KINDS)))
    pose = np.array(pose_from_ros(tip.pose))
    rotation = None
    if tip.kind != TipGoalMessage.POSITION:
        quaternion = pose[3:]
        length = float(np.linalg.norm(quaternion))
        if not abs(length - 1.0) < MAX_QUATERNION_ERROR:
            raise PlanError(f'the orientation of the tip goal is a quaternion of length '
                            f'{length:.3g}; needed: 1')
        from scipy.spatial.transform import Rotation  # 0.1 s that a start need not wait for
        rotation = Rotation.from_quat(quaternion).as_matrix()
    tolerances = {}
    for name, given in (('position_tolerance', tip.position_tolerance),
                        ('angle_tolerance', tip.angle_tolerance)):
        tolerances[name] = given if given != 0.0 else parameters[f'reach.{name}']
    return TipGoal(pose[:3], rotation, TIP_KINDS[tip.kind], **tolerances)
