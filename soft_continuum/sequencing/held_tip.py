# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Plans to a goal of the tip that is held with less than the full vacuum.

The tip is planned with an offset for the relaxation: the error of the first plan after its vacuums
are lowered shifts the goal of the next one, which sets the same segments if possible.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.sequencing.held_plan import compensate_relaxation, Held, held
from soft_continuum.sequencing.moves import MovePlanner
from soft_continuum.sequencing.plans import (
    PlanError,
    Reach,
    Shape,
    ShapePlan,
    TipGoal,
    ways_of,
    with_relaxing,
)
from soft_continuum.sequencing.reach.arcs import TipResidual
from soft_continuum.sequencing.reach.budget import Budget
from soft_continuum.sequencing.reach.candidates import Candidate
from soft_continuum.sequencing.reach.limits import CollisionScene, ReachSettings
from soft_continuum.sequencing.reach.passage import BlockedError, MotionValidator, Node
from soft_continuum.sequencing.reach.search import AIM, as_shape, reach, Search

SHARE = 0.7
"""Share of the remaining budget for one search."""


def reach_held(planner: MovePlanner, state: Any, pulls: Sequence[float], shape: Shape,
               scene: CollisionScene, settings: ReachSettings, first: bool = False) -> Reach:
    """
    Return the plan to a goal of the tip of a shape with vacuums.

    The others are those of plan_shapes.  Raises PlanError as ``reach``, and for a path.
    """
    if len(shape.tips) > 1:
        raise PlanError(f'{len(shape.tips)} tips and vacuums: a path is followed with every '
                        'segment stiff but one; give one tip, or leave the vacuums out')
    search = _Search(planner, state, pulls, shape, scene, settings)
    goal, least = shape.tips[0], inf
    best: Held | None = None
    miss = TipResidual(goal)
    try:
        for begin in search.plans(first):
            try:
                found, off = compensate_relaxation(
                    planner, partial(search.to, begin),
                    lambda state: -miss.of_state(state).reshape(-1, 3), AIM)
            except BlockedError as error:
                search.note(error)
                continue
            if off < least:
                best, least = found, off
            if off <= 1.0:
                break
    except PlanError:
        planner.check_wanted()
        if not search.budget.over:
            raise
    if best is None:
        why = search.why or f'reach.states was too small{search.budget.ended_by_time}'
        return Reach(None, why, blocked_by=search.blocked_by, cut_short=search.cut_short)
    away, turn = miss.errors(best.end)
    left = f'{away * 1e3:.1f} mm' + (
        '' if goal.kind == 'position' else f' and {np.degrees(turn):.1f} degrees')
    why = f'with its vacuums the tip is {left} from the goal at best' if least > 1.0 else ''
    steps = (*best.node.steps, best.relaxing)
    return Reach(ShapePlan(replace(as_shape(best.end), name=shape.name, hold_time=shape.hold_time,
                                   tips=shape.tips, vacuums=shape.vacuums),
                           best.node.moves, best.end, *ways_of(steps), relaxing=best.relaxing),
                 why, with_relaxing(best.node.steps, best.relaxing), away, turn,
                 search.blocked_by if why else (), search.cut_short)


class _Search:
    """Plans to a goal, and from each of them to goals that are moved."""

    def __init__(self, planner: MovePlanner, state: Any, pulls: Sequence[float], shape: Shape,
                 scene: CollisionScene, settings: ReachSettings) -> None:
        self.why, self.blocked_by, self.cut_short = '', tuple[str, ...](), False
        self._goal, self._vacuums, self._settings = shape.tips[0], shape.vacuums, settings
        self.budget = Budget(settings.states, settings.time_limit)
        self._validator = MotionValidator(planner.until(self.budget.judge), scene, settings)
        self._start = self._last = self._validator.start(state, np.array(pulls, dtype=float))

    def note(self, error: BlockedError) -> None:
        """Store why there is no plan."""
        self.why = self.why or str(error)
        self.blocked_by = tuple(dict.fromkeys(
            (*self.blocked_by, *([error.obstacle] if error.obstacle else []))))

    def plans(self, first: bool) -> Iterator[Node]:
        """Yield the end states of plans to the goal itself, the best first; or only the first."""
        each = self._reached(self._goal)
        yield from each if first else reversed(list(each))

    def to(self, begin: Node, shift: Array | None) -> Held:
        """Set the tip to the goal moved by (1 or 2, 3) of its tolerances; raises BlockedError."""
        found: Node | None = begin
        if shift is not None:
            goal = _moved(self._goal, shift)
            found = self._again(goal) or next(self._reached(goal), None)
        if found is None:
            raise BlockedError(self.why)
        self._last = found
        return held(self._validator, found, self._vacuums)

    def _again(self, goal: TipGoal) -> Node | None:
        """Set the segments that were set last to another goal; None where that does not do."""
        last = self._last
        if not last.moves:
            return None
        validator = self._validator
        try:
            return Search(validator.planner, self._start, goal, validator.scene,
                          self._settings).planned(_candidate(self._start, last))
        except BlockedError:
            return None

    def _reached(self, goal: TipGoal) -> Iterator[Node]:
        """Yield where plans to a goal lead, or to what is nearest."""
        validator, start = self._validator, self._start
        states, seconds = self.budget.left
        settings = replace(
            self._settings, states=int(SHARE * states), time_limit=SHARE * seconds)
        for found in reach(validator.planner, start.state, start.pulls.tolist(), goal,
                           validator.scene, settings):
            self.cut_short |= found.cut_short
            if found.plan is None:
                self.why, self.blocked_by = found.why, found.blocked_by
                continue
            moves, end = found.plan.moves, found.plan.state
            yield Node(end, moves[-1].pulls[-1] if moves else start.pulls,
                       validator.scene.clearance(end), moves, found.steps,
                       frozenset(move.segment for move in moves))


def _moved(goal: TipGoal, shift: Array) -> TipGoal:
    """Return a goal moved, and turned, by parts of its tolerances."""
    rotation = goal.rotation
    if rotation is not None and len(shift) > 1:
        from scipy.spatial.transform import Rotation  # 0.1 s that a start need not wait for
        rotation = Rotation.from_rotvec(goal.angle_tolerance * shift[1]).as_matrix() @ rotation
    return replace(goal, position=goal.position + goal.position_tolerance * shift[0],
                   rotation=rotation)


def _candidate(start: Node, node: Node) -> Candidate:
    """Return the settings that lead to a node; the last ones, each of another segment, fitted."""
    movers = [move.segment for move in node.moves]
    fitted = 1
    while fitted < len(movers) and movers[-fitted - 1] not in movers[-fitted:]:
        fitted += 1
    shapes = [start.state.bending, *(step.states[-1].bending for step in node.steps)]
    return Candidate(tuple(movers), np.array(shapes), fitted, 0.0, 0.0)
