# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Planning on a thread of its own, so that whoever needs a plan can go on meanwhile."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Event
from typing import Any, TypeVar

from soft_continuum.mechanics.arm import Arm
from soft_continuum.sequencing.planner import Planner, PlanSettings

Result = TypeVar('Result')


class PlanningThread:
    """Makes one plan at a time; a plan that is no longer wanted ends after a few milliseconds."""

    def __init__(self) -> None:
        """Start the thread."""
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix='planner')
        self._abandoned = Event()

    def start(self, work: Callable[[Any], Result], arm: Arm, offsets: Sequence[float],
              settings: PlanSettings) -> 'Future[Result]':
        """
        Abandon the present plan and begin the next one.

        work: what is to be done by a planner of ``arm``, whose tendons have ``offsets`` (tendons,)
        m.
        """
        self.abandon()
        abandoned = self._abandoned = Event()
        return self._thread.submit(
            lambda: work(Planner(arm, settings, abandoned.is_set, offsets)))

    def abandon(self) -> None:
        """End the present plan, if there is one, with a PlanError."""
        self._abandoned.set()

    def close(self) -> None:
        """Abandon the present plan and end the thread."""
        self.abandon()
        self._thread.shutdown()
