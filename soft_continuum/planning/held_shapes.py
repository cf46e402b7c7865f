# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Plans of shapes that are held with less than the full vacuum.

They are set with every segment stiff; then the vacuum of one segment after the other is lowered,
and the arm relaxes under tendons and gravity by the law of its jams.  It is set with an offset so
that the wanted angles, or the wanted tip, hold after the relaxation, as far as possible.

The tip is planned with an offset for the relaxation: the error of the first plan after its vacuums
are lowered shifts the goal of the next one, which sets the same segments if possible.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.planning.planner import Planner
from soft_continuum.planning.plans import PlanError, PlanResult, Shape, TipGoal
from soft_continuum.planning.reach.arcs import TipResidual
from soft_continuum.planning.reach.candidates import Candidate
from soft_continuum.planning.reach.passage import BlockedError, MotionValidator, Node
from soft_continuum.planning.reach.search import AIM, Budget, check_goal, Search

PASSES = 6
"""Largest number of plans of a shape, each corrected by the error of the previous one."""
SHARE = 0.7
"""Share of the remaining budget for one search."""


def compensate_relaxation(planner: Planner, set_to: Callable[[Array | None], Node],
                          missed: Callable[[Any], Array], tolerance: float
                          ) -> tuple[Node, float]:
    """
    Return where the arm relaxes to a wanted state, and the remaining error.

    set_to: where it relaxes to from the goal moved by a shift, or None.  missed: errors of a
    state, (n, ...), as ``set_to`` takes them.  tolerance: of each of the n.
    If a limit prevents more, the best setting found is returned.  Raises exceptions of the first
    ``set_to``, and those for obstacles.
    """
    best: Node | None = None
    least, shift = np.inf, None
    for _ in range(PASSES):
        try:
            found = set_to(shift)
        except (BlockedError, PlanError) as error:
            planner.check_wanted()
            if best is None or isinstance(error, BlockedError) and error.obstacle:
                raise
            break
        misses = missed(found.state)
        off = float(np.linalg.norm(misses.reshape(len(misses), -1), axis=1).max())
        if off < least:
            best, least = found, off
        if off <= tolerance:
            break
        shift = misses if shift is None else shift + misses
    assert best is not None
    return best, least


def reach_held(validator: MotionValidator, start: Node, shape: Shape, first: bool = False
               ) -> PlanResult:
    """
    Return the plan to a goal of the tip of a shape with vacuums.

    first: as of plan_shapes.  Raises PlanError as ``reach``, and for a path.
    """
    if len(shape.tips) > 1:
        raise PlanError(f'{len(shape.tips)} tips and vacuums: a path is followed with every '
                        'segment stiff but one; give one tip, or leave the vacuums out')
    planner, search = validator.planner, _Search(validator, start, shape)
    goal, least = shape.tips[0], inf
    best: Node | None = None
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
        return PlanResult(None, why, blocked_by=search.blocked_by, cut_short=search.cut_short)
    away, turn = miss.errors(best.state)
    why = (f'with its vacuums the tip is {goal.text(away, turn)} from the goal at best'
           if least > 1.0 else '')
    return PlanResult(best.plan(shape.at(best.state)), why, away, turn,
                      search.blocked_by if why else (), search.cut_short)


class _Search:
    """Plans to a goal, and from each of them to goals that are moved."""

    def __init__(self, validator: MotionValidator, start: Node, shape: Shape) -> None:
        self.why, self.blocked_by, self.cut_short = '', tuple[str, ...](), False
        self._goal, self._vacuums, settings = shape.tips[0], shape.vacuums, validator.settings
        self.budget = Budget(settings.states, settings.time_limit)
        self._validator = validator.until(self.budget.judge)
        self._start = self._last = start

    def note(self, error: BlockedError) -> None:
        """Store why there is no plan."""
        self.why = self.why or str(error)
        self.blocked_by = tuple(dict.fromkeys(
            (*self.blocked_by, *([error.obstacle] if error.obstacle else []))))

    def plans(self, first: bool) -> Iterator[Node]:
        """Yield the end states of plans to the goal itself, the best first; or only the first."""
        each = self._reached(self._goal)
        yield from each if first else reversed(list(each))

    def to(self, begin: Node, shift: Array | None) -> Node:
        """Set the tip to the goal moved by (1 or 2, 3) of its tolerances; raises BlockedError."""
        found: Node | None = begin
        if shift is not None:
            goal = _moved(self._goal, shift)
            found = self._again(goal) or next(self._reached(goal), None)
        if found is None:
            raise BlockedError(self.why)
        self._last = found
        return self._validator.relaxed(found, self._vacuums)

    def _again(self, goal: TipGoal) -> Node | None:
        """Set the segments that were set last to another goal; None where that does not do."""
        last = self._last
        if not last.moves:
            return None
        try:
            return Search(self._validator, self._start, goal).planned(
                _candidate(self._start, last))
        except BlockedError:
            return None

    def _reached(self, goal: TipGoal) -> Iterator[Node]:
        """Yield where plans to a goal lead, or to what is nearest."""
        validator = self._validator
        check_goal(validator, goal)
        states, seconds = self.budget.left
        search = Search(validator.within(SHARE * states, SHARE * seconds), self._start, goal)
        for found in search.run():
            self.cut_short |= found.cut_short
            if found.plan is None:
                self.why, self.blocked_by = found.why, found.blocked_by
            else:
                yield search.last


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
