# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans as messages."""

from collections.abc import Sequence

from geometry_msgs.msg import Point, Pose, Quaternion

from soft_continuum.sequencing.plans import Move, PlannedStep, Reach, Shape
from soft_continuum_interfaces.msg import PlanStep
from soft_continuum_interfaces.srv import PlanShapes


def plans_to_ros(found: Sequence[Reach], shapes: Sequence[Shape]) -> PlanShapes.Response:
    """Return the response of plan_shapes, without its time; found: up to the first failure."""
    problem, steps = found[-1].why, []
    for index, one in enumerate(found):
        if one.plan is not None:
            steps += [_step(index, move, step) for move, step in zip(
                one.plan.moves, one.steps, strict=True)]
    return PlanShapes.Response(
        success=not problem, steps=steps,
        message=f'{shapes[len(found) - 1].name}: {problem}' if problem else '',
        tip_errors=[one.tip_error if shape.tips else 0.0
                    for one, shape in zip(found, shapes, strict=False)])


def _step(index: int, move: Move, step: PlannedStep) -> PlanStep:
    end = step.states[-1]
    return PlanStep(
        shape_index=index, segment=move.segment + 1, bending_angles=end.bending_angles.tolist(),
        bending_directions=end.bending_directions.tolist(), duration=move.duration,
        largest_tension=step.tension, smallest_clearance=step.clearance,
        nearest_obstacle=step.obstacle, tip_path=[_pose(state.poses[-1].tolist())
                                                  for state in step.states])


def _pose(row: Sequence[float]) -> Pose:
    x, y, z, *quaternion = row
    turned = dict(zip('xyzw', quaternion, strict=True))
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(**turned))
