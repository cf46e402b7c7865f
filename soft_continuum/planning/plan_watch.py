# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a plan still holds: one that was shown, until it is run, and one that runs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.planning.obstacles import Clearance, CollisionScene
from soft_continuum.planning.plans import PlanResult, Shape, ShapePlan
from soft_continuum.planning.reach.passage import between, body_radius

ROUNDING = 1e-9  # m


@dataclass(frozen=True, eq=False)
class KeptPlan:
    """
    A plan, the bending (rad) and the pulls (tendons,) m that it begins with, and its goal.

    search: that of an interrupted one, as given to ``keep``.
    """

    bending: Array
    pulls: Array
    wanted: object
    found: PlanResult
    search: object


class KeptPlans:
    """
    The last plans of a sequence of shapes.

    A situation is everything else that must be equal: limits, obstacles and stops.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self._kept: tuple[object, list[KeptPlan]] = None, []

    def keep(self, situation: object, state: Any, pulls: Sequence[float],
             shapes: Sequence[Shape], found: Sequence[PlanResult], search: object = None) -> None:
        """
        Store the plans of shapes, in place of earlier ones.

        state, pulls: their start.  search: what the caller knows theirs by.
        """
        kept, start = list[KeptPlan](), np.asarray(pulls)
        for shape, one in zip(shapes, found, strict=False):
            if one.plan is None or one.why:
                break
            kept.append(KeptPlan(state.bending, start, _wanted(shape), one, search))
            state = one.plan.state if one.plan.stiff is None else one.plan.stiff
            start = one.plan.pulls(start)
        self._kept = situation, kept

    def find(self, situation: object, bending: Array, rests_at: Callable[[Array], bool],
             shapes: Sequence[Shape], tolerance: float, take: bool) -> list[KeptPlan]:
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
                return some
        return []


def _wanted(shape: Shape) -> object:
    """Return what counts of a shape to plan it, so that it can be compared."""
    return shape.bending_angles, shape.bending_directions, shape.vacuums, tuple(
        (goal.kind, goal.position.tolist(), goal.position_tolerance, goal.angle_tolerance,
         None if goal.rotation is None else goal.rotation.tolist()) for goal in shape.tips)


class PlanWatch:
    """
    Watches a plan with the states on its paths.

    ``look`` takes some ms per state and may run on another thread; the rest costs little.
    """

    def __init__(self, plan: ShapePlan, margin: float, max_deviation: float) -> None:
        """
        Watch ``plan``.

        margin: m that the arm has to stay away from obstacles; a move that starts closer to one
        may be as close as planned.  max_deviation: m by which the arm may deviate from the plan
        away from obstacles.
        """
        self._plan, self._margin, self._max_deviation = plan, margin, max_deviation
        self._least = [min(margin, path.clearance) - ROUNDING for path in plan.paths]
        self._radius = body_radius(plan.state.chain)
        self._points = [np.array([state.backbone for state in path.states])
                        for path in plan.paths]
        # Of every state, and from it to the next one; before ``look`` of none.
        self._clear: list[list[tuple[Clearance, Clearance]]] = []

    @property
    def looked(self) -> bool:
        """Whether the plan was checked against obstacles yet."""
        return bool(self._clear)

    def look(self, scene: CollisionScene) -> None:
        """Compute the distances of the states, and of the motion between them, to obstacles."""
        self._clear = [list(zip(clear, self._onward(way, clear), strict=True)) for way, clear in (
            (path.states, scene.clearances(path.states)) for path in self._plan.paths)]

    def _onward(self, way: Sequence[Any], clear: Sequence[Clearance]) -> Iterator[Clearance]:
        """Yield the clearance between each state and the next, and at the last one."""
        for (one, near), (other, there) in pairwise(zip(way, clear, strict=True)):
            yield between(one, near, other, there, self._radius)[0]
        yield clear[-1]

    def obstructed(self, move: int, state: Any) -> str:
        """
        Return which obstacle blocks the rest of the plan, and where; empty for none.

        move: the present or next path (0-based): a move, or lowering the vacuums at the end.
        state: of the arm, None if unknown.
        """
        if not self._clear:
            return ''
        if move == len(self._clear):  # all is done but to rest there
            move, first = move - 1, len(self._clear[-1]) - 1
        else:
            first = 0 if state is None else int(self._away(move, state).argmin())
        left = [(clear.distance - self._least[number], number, i, clear)
                for number in range(move, len(self._clear))
                for i, (_, clear) in enumerate(self._clear[number])
                if number > move or i >= first]
        short, number, i, worst = min(left, key=lambda one: one[0])
        if short >= 0.0:
            return ''
        tip = 1e3 * self._points[number][i][-1]
        where = (f'segment {self._plan.moves[number].segment + 1} is set'
                 if number < len(self._plan.moves) else 'the vacuums are lowered')
        return (f'{worst.obstacle} is {_millimetres(worst.distance)} from the rest of the motion, '
                f'where {where} and the tip is at '
                f'({", ".join(f"{value:.0f}" for value in tip)}) mm; margin: '
                f'{_millimetres(self._margin)}')

    def departed(self, move: int, state: Any) -> str:
        """
        Return the deviation of the arm from the plan, if it is too large; empty otherwise.

        It may always deviate by the margin; and more, up to ``max_deviation``, if that leaves the
        margin to every obstacle.  After the last move, when segments may be set again or vacuums
        are lowered, only obstacles limit the deviation.
        """
        if state is None:
            return ''
        done = move == len(self._points)
        most = self._max_deviation if move < len(self._plan.moves) else inf
        move -= done
        far = self._away(move, state)
        i = len(far) - 1 if done else int(far.argmin())
        away = float(far[i])
        clear = self._clear[move][i][0].distance if self._clear else inf
        allowed = max(self._margin, min(most, clear - self._margin))
        if away <= allowed:
            return ''
        return (f'the arm is {_millimetres(away)} from where it was planned to be; allowed: '
                f'{_millimetres(allowed)}')

    def _away(self, move: int, state: Any) -> Array:
        """Return the deviation of the arm from each state of a move, m."""
        away: Array = np.linalg.norm(self._points[move] - state.backbone, axis=2).max(axis=1)
        return away


class PlanGuard:
    """Watches one plan at a time; distances are computed on a separate thread."""

    def __init__(self, parameters: Mapping[str, Any], scene: Callable[[], CollisionScene]
                 ) -> None:
        """Start the thread; scene: as they are known now."""
        self._parameters, self._scene = parameters, scene
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix='plan_guard')
        self._plan: ShapePlan | None = None
        self._watch: PlanWatch | None = None
        self._seen: CollisionScene | None = None
        self._look: Future[None] | None = None
        self.close = self._thread.shutdown

    def problems(self, plan: ShapePlan | None, move: int, state: Any) -> tuple[str, str, bool]:
        """
        Return the fields obstructed, departed and unseen of an Observation.

        move: the present or next path (0-based).  state: of the arm, None if unknown.  Without
        obstacles, plans by angles do not limit the deviation of the arm.
        """
        if plan is not self._plan:
            self._plan, self._watch, self._seen, self._look = plan, None, None, None
            if plan is not None and plan.paths:
                self._watch = PlanWatch(plan, self._parameters['obstacles.margin'],
                                        self._parameters['reach.max_deviation'])
        watch, around = self._watch, self._scene()
        if watch is None:
            return '', '', False
        if self._look is not None and self._look.done():
            look, self._look = self._look, None
            look.result()  # its exception ends the run, and is not raised again meanwhile
        if around is not self._seen and self._look is None:
            self._seen, self._look = around, self._thread.submit(watch.look, around)
        planned = bool(plan and plan.shape.tips) or bool(around.obstacles)
        return (watch.obstructed(move, state), watch.departed(move, state) if planned else '',
                not watch.looked)


def _millimetres(length: float) -> str:
    return f'{1e3 * length:.1f} mm'
