# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans to the dragged goal of the tip: requests to shape_sequencer, and its answers."""

from dataclasses import dataclass
from math import isfinite, pi
from time import monotonic

from soft_continuum.client import ClientError, Plan, PlanStep, Tip
from soft_continuum.client.requests import PLAN_SHAPES, Requests
from soft_continuum.client.tasks import until
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Chain
from soft_continuum.ui.browser.meshes import Points, points_of
from soft_continuum_interfaces.srv import PlanShapes

WHILE_DRAGGED, AT_REST = 1000, 0  # states evaluated for a plan; 0: as many as for Go
LATE = 1.0  # s without an answer
AGAIN = 2.0  # s after which an unanswered request is repeated
MAX_PLACE = 100.0  # m, of what is drawn


@dataclass(frozen=True)
class Planned:
    """
    The answer for a goal: a plan, or the reason for none.

    points: along the backbone at the end of the plan, or of the nearest reachable shape.  path: of
    the tip.  quick: so few states were evaluated that more may find another plan.
    """

    goal: Tip
    plan: Plan | None
    problem: str = ''
    points: Points = ()
    path: Points = ()
    quick: bool = False

    @property
    def found(self) -> bool:
        """Whether there is a plan that reaches the goal."""
        return self.plan is not None and self.plan.found


class TipPlanning:
    """
    Requests plans, one at a time while the tip is dragged, the newest goal next.

    planned: the last answer, None before the first and when no goal is left.
    """

    def __init__(self, requests: Requests) -> None:
        """Start without a goal."""
        self._requests = requests
        requests.client(PlanShapes, PLAN_SHAPES)  # a new one's first answer may get lost
        self._wanted: tuple[Tip, Arm, int] | None = None
        self._asked: tuple[Tip, Arm, int] | None = None
        self._awaited: object = None  # a quick request without an answer
        self._answered = monotonic()  # when an answer was last available
        self.planned: Planned | None = None

    @property
    def goal(self) -> Tip | None:
        """Goal of the tip; None while it is not dragged."""
        return self._wanted[0] if self._wanted else None

    @property
    def found(self) -> bool:
        """Whether there is a plan to the goal."""
        return (self.planned is not None and self.planned.found
                and self.planned.goal == self.goal)

    @property
    def late(self) -> bool:
        """Whether the answer has been outdated for a while."""
        return ((self.planned is None or self.planned.goal != self.goal)
                and monotonic() - self._answered > LATE)

    @property
    def points(self) -> Points:
        """Points along the planned shape; none without a plan."""
        return self.planned.points if self.planned else ()

    def aim(self, goal: Tip, arm: Arm, dragged: bool = False) -> None:
        """Request a plan, from any thread; dragged: another goal may follow at once."""
        if self.planned is None or self.planned.goal == self.goal:
            self._answered = monotonic()
        self._wanted = goal, arm, WHILE_DRAGGED if dragged else AT_REST
        self._requests.start(self._ask())

    def leave(self) -> None:
        """Withdraw the goal."""
        self._wanted = self._asked = self.planned = None

    async def _ask(self) -> None:
        """Request until the goal has an answer; a newer request ends a long one."""
        while self._awaited is None and self._wanted is not None and (
                self._wanted is not self._asked):
            now = self._asked = self._wanted
            goal, arm, states = now
            if states == WHILE_DRAGGED:
                self._awaited = now
            try:
                plan = await self._requests.plan([goal], states=states)
                planned = _planned(goal, plan, arm, states == WHILE_DRAGGED)
            except ClientError as error:
                planned = Planned(goal, None, str(error))
            finally:
                if self._awaited is now:
                    self._awaited = None
            if self._asked is not now:
                return  # the goal has changed or was withdrawn
            self.planned, self._answered = planned, monotonic()
            if planned.plan is None:
                await until(lambda: self._wanted is not self._asked, AGAIN)
                if self._asked is now:
                    self._asked = None
            elif states == WHILE_DRAGGED and not planned.found and self._wanted is now:
                self._wanted = goal, arm, AT_REST  # the handle rests, so a longer search is useful


def _planned(goal: Tip, plan: Plan, arm: Arm, quick: bool) -> Planned:
    end = next((step for step in reversed(plan.steps) if _fits(step, arm)), None)
    path = tuple(pose.position for step in plan.steps for pose in step.tip
                 if all(abs(value) < MAX_PLACE for value in pose.position))
    return Planned(goal, plan, plan.message, () if end is None else points_of(
        Chain(arm), end.bending_angles, end.bending_directions), path, quick)


def _fits(step: PlanStep, arm: Arm) -> bool:
    """Whether the shape at the end of a step is one of this arm."""
    count, directions = len(arm.segments), step.bending_directions
    return (len(step.bending_angles) == count and all(abs(a) < 2 * pi for a in step.bending_angles)
            and len(directions) in ((0, count) if arm.bending_axes[:, 0].any() else (0,))
            and all(map(isfinite, directions)))
