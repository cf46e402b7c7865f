# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Plans of shapes that are held with less than the full vacuum.

They are set with every segment stiff; then the vacuum of one segment after the other is lowered,
and the arm relaxes under tendons and gravity by the law of its jams.  It is set with an offset so
that the wanted angles, or the wanted tip, hold after the relaxation, as far as possible.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.sequencing.moves import MovePlanner
from soft_continuum.sequencing.plans import PlanError, PlannedStep, Shape, ShapePlan
from soft_continuum.sequencing.reach.limits import Clear, NoObstacles, ReachSettings
from soft_continuum.sequencing.reach.passage import BlockedError, MotionValidator, Node

PASSES = 6
"""Largest number of plans of a shape, each corrected by the error of the previous one."""


@dataclass(frozen=True, eq=False)
class Held:
    """The state to which a shape with vacuums is set, and its relaxation."""

    node: Node
    relaxing: PlannedStep

    @property
    def end(self) -> Any:
        """The state with the vacuums lowered."""
        return self.relaxing.states[-1]


SetTo = Callable[[Array | None], Held]
"""Sets the goal, moved by a shift or None; raises PlanError or BlockedError."""


def held(validator: MotionValidator, node: Node, vacuums: Sequence[float]) -> Held:
    """Return the relaxation under vacuums (Pa) of every segment; raises BlockedError."""
    try:
        return Held(node, validator.relaxed(node, vacuums))
    except BlockedError as error:
        raise BlockedError(f'as the arm relaxes under its vacuums, {error}', error.obstacle,
                           error.limit) from None


def compensate_relaxation(planner: MovePlanner, set_to: SetTo, missed: Callable[[Any], Array],
                tolerance: float) -> tuple[Held, float]:
    """
    Return the setting for a wanted final state, and the remaining error.

    missed: errors of a state, (n, ...), as ``set_to`` takes them.  tolerance: of each of the n.
    If a limit prevents more, the best setting found is returned.  Raises exceptions of the first
    ``set_to``, and those for obstacles.
    """
    best: Held | None = None
    least, shift = np.inf, None
    for _ in range(PASSES):
        try:
            found = set_to(shift)
        except (BlockedError, PlanError) as error:
            planner.check_wanted()
            if best is None or isinstance(error, BlockedError) and error.obstacle:
                raise
            break
        misses = missed(found.end)
        off = float(np.linalg.norm(misses.reshape(len(misses), -1), axis=1).max())
        if off < least:
            best, least = found, off
        if off <= tolerance:
            break
        shift = misses if shift is None else shift + misses
    assert best is not None
    return best, least


def plan_held(planner: MovePlanner, shape: Shape, set_to: SetTo) -> tuple[ShapePlan, Held]:
    """
    Return the plan of a shape given by angles, without paths, and its setting.

    set_to: takes rad as State.bending.  Its exceptions are passed on.
    """
    tolerance = planner.settings.angle_tolerance
    wanted = bending_vectors(
        planner.statics.chain.arm, shape.bending_angles, shape.bending_directions)
    found, off = compensate_relaxation(
        planner, set_to, lambda state: wanted - state.bending, tolerance)
    warning = '' if off <= tolerance else (
        f'{shape.name} is predicted to be {np.degrees(off):.1f} degrees off with its vacuums')
    return ShapePlan(shape, found.node.moves, found.end, relaxing=found.relaxing,
                     warning=warning), found


def plan_held_from_base(planner: MovePlanner, state: Any, start: Array, shape: Shape
                        ) -> ShapePlan:
    """
    Return the plan of a shape with vacuums, from a state with every segment stiff.

    start: (tendons,) present pulls of the motors, m.  Raises PlanError.
    """
    validator = MotionValidator(planner, NoObstacles(), ReachSettings())

    def set_to(shift: Array | None) -> Held:
        moves, stiff = planner.moves(state, start, shape, shift)
        end = moves[-1].pulls[-1] if moves else start
        return held(validator, Node(stiff, end, Clear(), moves), shape.vacuums)

    try:
        return plan_held(planner, shape, set_to)[0]
    except BlockedError as error:
        raise PlanError(f'{shape.name}: {error}', error.limit) from None

