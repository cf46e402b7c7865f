# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Checks the running plan against new obstacles and deviations of the arm."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from soft_continuum.obstacles import CollisionScene
from soft_continuum.sequencing.plan_watch import PlanWatch
from soft_continuum.sequencing.plans import ShapePlan


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
