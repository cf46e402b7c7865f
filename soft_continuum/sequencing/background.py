# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Planning on a thread of its own, so that whoever needs a plan can go on meanwhile."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Event

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.sequencing.planner import Planner, PlanSettings, Shape, ShapePlan


class PlanningThread:
    """Makes one plan at a time; a plan that is no longer wanted ends after a few milliseconds."""

    def __init__(self, arm: Arm) -> None:
        """Plan for ``arm``."""
        self._arm = arm
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix='planner')
        self._abandoned = Event()

    def start(self, state: Equilibrium, pulls: Sequence[float], shapes: Sequence[Shape],
              settings: PlanSettings) -> 'Future[list[ShapePlan]]':
        """Abandon the present plan and begin the next one; arguments as for ``Planner.plan``."""
        self.abandon()
        self._abandoned = Event()
        planner = Planner(self._arm, settings, self._abandoned.is_set)
        return self._thread.submit(planner.plan, state, pulls, shapes)

    def abandon(self) -> None:
        """End the present plan, if there is one, with a PlanError."""
        self._abandoned.set()

    def close(self) -> None:
        """Abandon the present plan and end the thread."""
        self.abandon()
        self._thread.shutdown()
