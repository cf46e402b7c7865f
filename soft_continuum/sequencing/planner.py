# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Plans: the order of softened segments, and the tendon motions.

``Planner`` sets shapes from the base to the tip; goals and parts of plans are here too.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from soft_continuum.parameters.shapes import angles_problem
from soft_continuum.sequencing.held_plan import plan_held_from_base
from soft_continuum.sequencing.moves import MovePlanner, PlanSettings
from soft_continuum.sequencing.plans import (
    Move,
    ObstructedError,
    PlanError,
    Shape,
    ShapePlan,
    WHOLE_ARM,
)

__all__ = ['Move', 'ObstructedError', 'PlanError', 'PlanSettings', 'Planner', 'Shape',
           'ShapePlan', 'WHOLE_ARM']


class Planner(MovePlanner):
    """Plans shapes of one arm, given by angles."""

    def plan(self, state: Any, pulls: Sequence[float], shapes: Sequence[Shape]
             ) -> list[ShapePlan]:
        """
        Return the plans of ``shapes`` one after the other, from a state with all segments stiff.

        pulls: (tendons,) at present, m.  Raises PlanError when a shape is out of reach, or when
        the plan was abandoned.
        """
        plans: list[ShapePlan] = []
        start = np.array(pulls, dtype=float)
        for shape in shapes:
            problem = angles_problem(
                shape.bending_angles, self.statics.chain.arm, shape.bending_directions)
            if problem:
                raise PlanError(f'{shape.name}: {problem}')
            if plans and plans[-1].stiff is not None:  # a shape is set with every segment stiff
                state = self.jammed(state, start)
            if shape.vacuums:
                plan = plan_held_from_base(self, state, start, shape)
            else:
                moves, state = self.moves(state, start, shape)
                plan = ShapePlan(shape, moves, state)
            plans.append(plan)
            state = plan.state
            start = plan.moves[-1].pulls[-1] if plan.moves else start
        return plans
