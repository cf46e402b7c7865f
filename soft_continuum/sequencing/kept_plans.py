# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Cache of plans that were shown: they are run if the arm is still at their start."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.sequencing.plans import PlanResult, Shape, ShapePlan


@dataclass(frozen=True, eq=False)
class _Kept:
    """A plan, the bending (rad) and the pulls (tendons,) m that it begins with, and its goal."""

    bending: Array
    pulls: Array
    wanted: object
    plan: ShapePlan


class KeptPlans:
    """
    The last plans of a sequence of shapes.

    A situation is everything else that must be equal: limits, obstacles and stops.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self._kept: tuple[object, list[_Kept]] = None, []

    def keep(self, situation: object, state: Any, pulls: Sequence[float],
             shapes: Sequence[Shape], found: Sequence[PlanResult]) -> None:
        """Store the plans of shapes, in place of earlier ones; state, pulls: their start."""
        kept, start = list[_Kept](), np.asarray(pulls)
        for shape, one in zip(shapes, found, strict=False):
            if one.plan is None or one.why:
                break
            kept.append(_Kept(state.bending, start, _wanted(shape), one.plan))
            state = one.plan.state if one.plan.stiff is None else one.plan.stiff
            start = one.plan.pulls(start)
        self._kept = situation, kept

    def find(self, situation: object, bending: Array, rests_at: Callable[[Array], bool],
             shapes: Sequence[Shape], tolerance: float, take: bool) -> list[ShapePlan]:
        """
        Return the plans of shapes from the present state; none unless all are stored.

        bending: of the arm, as State.bending.  rests_at: whether the tendons rest at pulls, m.
        tolerance: rad, of each segment from the start of the plan.  take: remove them, so that
        replanning a shape on its way gives another plan.
        """
        then, kept = self._kept
        for i, first in enumerate(kept):
            some = kept[i:i + len(shapes)]
            if (then == situation and [one.wanted for one in some] == list(map(_wanted, shapes))
                    and np.abs(bending - first.bending).max() <= tolerance
                    and rests_at(first.pulls)):
                if take:
                    self._kept = then, kept[:i] + kept[i + len(shapes):]
                return [replace(one.plan, shape=replace(
                    one.plan.shape, name=shape.name, hold_time=shape.hold_time))
                    for one, shape in zip(some, shapes, strict=True)]
        return []


def _wanted(shape: Shape) -> object:
    """Return what counts of a shape to plan it, so that it can be compared."""
    return shape.bending_angles, shape.bending_directions, shape.vacuums, tuple(
        (goal.kind, goal.position.tolist(), goal.position_tolerance, goal.angle_tolerance,
         None if goal.rotation is None else goal.rotation.tolist()) for goal in shape.tips)
