# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans to where the tip is dragged: what the page asks shape_sequencer for, and its answer."""

from dataclasses import dataclass
from math import isfinite, pi
from time import monotonic

from soft_continuum.browser.points import Points, points_of
from soft_continuum.client import ClientError, Tip
from soft_continuum.client.plan import Plan, plan_shapes, PlanStep
from soft_continuum.client.requests import Requests
from soft_continuum.client.tasks import until
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Chain

WHILE_DRAGGED, AT_REST = 1000, 0  # states that are judged for a plan; 0: as many as Go would
LATE = 1.0  # s without an answer
AGAIN = 2.0  # s after which what had no answer is asked again
MAX_PLACE = 100.0  # m, of what is drawn


@dataclass(frozen=True)
class Planned:
    """
    The answer for a goal: a plan, or why there is none.

    points: along the backbone in the end of the plan, of its nearest if it does not get there.
    path: of the tip.  quick: so few states were judged that more may find another.
    """

    goal: Tip
    plan: Plan | None
    problem: str = ''
    points: Points = ()
    path: Points = ()
    quick: bool = False

    @property
    def found(self) -> bool:
        """Whether there is a plan that gets there."""
        return self.plan is not None and self.plan.found


class TipPlanning:
    """
    Asks for plans, one while the tip is dragged, and the newest goal next.

    planned: the last answer, None before the first and when no goal is left.
    """

    def __init__(self, requests: Requests) -> None:
        """Begin without a goal."""
        self._requests = requests
        self._wanted: tuple[Tip, Arm, int] | None = None
        self._asked: tuple[Tip, Arm, int] | None = None
        self._awaited: object = None  # a quick request without an answer
        self._answered = monotonic()  # when something was known last
        self.planned: Planned | None = None

    @property
    def goal(self) -> Tip | None:
        """Where the tip shall be; None while it is not dragged."""
        return self._wanted[0] if self._wanted else None

    @property
    def found(self) -> bool:
        """Whether there is a plan to the goal."""
        return (self.planned is not None and self.planned.found
                and self.planned.goal == self.goal)

    @property
    def late(self) -> bool:
        """Whether what is known is of another goal, and has been for a while."""
        return ((self.planned is None or self.planned.goal != self.goal)
                and monotonic() - self._answered > LATE)

    @property
    def points(self) -> Points:
        """Points along the shape that is planned; none for no plan."""
        return self.planned.points if self.planned else ()

    def aim(self, goal: Tip, arm: Arm, dragged: bool = False) -> None:
        """Ask for a plan, from any thread; dragged: another goal may follow at once."""
        if self.planned is None or self.planned.goal == self.goal:
            self._answered = monotonic()
        self._wanted = goal, arm, WHILE_DRAGGED if dragged else AT_REST
        self._requests.start(self._ask())

    def leave(self) -> None:
        """Want nothing any more."""
        self._wanted = self._asked = self.planned = None

    async def _ask(self) -> None:
        """Ask until what is wanted has an answer; a newer request ends a long one."""
        while self._awaited is None and self._wanted is not None and (
                self._wanted is not self._asked):
            now = self._asked = self._wanted
            goal, arm, states = now
            if states == WHILE_DRAGGED:
                self._awaited = now
            try:
                planned = _planned(goal, await plan_shapes(
                    self._requests, [goal], states=states), arm,
                                   states == WHILE_DRAGGED)
            except ClientError as error:
                planned = Planned(goal, None, str(error))
            finally:
                if self._awaited is now:
                    self._awaited = None
            if self._asked is not now:
                return  # something else was asked for since, or nothing is wanted
            self.planned, self._answered = planned, monotonic()
            if planned.plan is None:
                await until(lambda: self._wanted is not self._asked, AGAIN)
                if self._asked is now:
                    self._asked = None
            elif states == WHILE_DRAGGED and not planned.found and self._wanted is now:
                self._wanted = goal, arm, AT_REST  # the handle rests where more is needed


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
