# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is known of a plan by tip before it runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from soft_continuum.sequencing.planner import ShapePlan


@dataclass(frozen=True, eq=False)
class PlannedStep:
    """
    One Move of a plan, as the model predicts it.

    states: from the one in which its segment becomes soft to the one that is stiffened, all in
    equilibrium with the pulls of the move.  clearance: m, the smallest on the way and between
    these states.  obstacle: the name of the nearest, empty for none.  tension: N, the largest.
    duration: s, of the motion and of softening and stiffening.
    """

    states: tuple[Any, ...]
    clearance: float
    obstacle: str
    tension: float
    duration: float


@dataclass(frozen=True, eq=False)
class Reach:
    """
    A plan by tip.

    plan: its moves and the state after them; None where nothing better than to stay is known.
    why: empty; or why the goal is not reached, and then the plan is to the nearest that is known.
    steps: one for each move; the last one also has the way on which the arm gives way when the
    vacuums of its shape are lowered.  tip_error: m from the tip to the goal in the end, of a path
    the largest distance of the tip from it on the way.  turn_error: rad, likewise.  blocked_by:
    the names of obstacles that stopped what was tried, the most frequent first, if there is no
    plan.  cut_short: whether time_limit ended the search, not what it had judged: with more time
    it may find another.
    """

    plan: ShapePlan | None
    why: str = ''
    steps: tuple[PlannedStep, ...] = ()
    tip_error: float = 0.0
    turn_error: float = 0.0
    blocked_by: tuple[str, ...] = ()
    cut_short: bool = False

    @property
    def softenings(self) -> int:
        """How often a segment is softened; of an arm without jamming, how often it moves."""
        return len(self.steps)

    @property
    def duration(self) -> float:
        """How long all steps take, s."""
        return sum(step.duration for step in self.steps)

    @property
    def tension(self) -> float:
        """The largest tension on the way, N."""
        return max((step.tension for step in self.steps), default=0.0)

    @property
    def clearance(self) -> tuple[float, str]:
        """The smallest distance to an obstacle on the way, m, and its name."""
        nearest = min(self.steps, key=lambda step: step.clearance, default=None)
        return (inf, '') if nearest is None else (nearest.clearance, nearest.obstacle)


def ways_of(steps: Sequence[PlannedStep]
            ) -> tuple[tuple[tuple[Any, ...], ...], tuple[float, ...]]:
    """Return the ways of a plan and how near to obstacles they were planned, as of ShapePlan."""
    return tuple(step.states for step in steps), tuple(step.clearance for step in steps)


def with_relaxing(steps: Sequence[PlannedStep], relaxing: PlannedStep) -> tuple[PlannedStep, ...]:
    """Return steps, of which the last one goes on with the way on which the arm gives way."""
    if not steps:
        return ()
    last = steps[-1]
    nearest = min(last, relaxing, key=lambda one: one.clearance)
    return (*steps[:-1], PlannedStep(
        last.states + relaxing.states, nearest.clearance, nearest.obstacle,
        max(last.tension, relaxing.tension), last.duration))
