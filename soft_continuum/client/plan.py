# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans to set shapes, as frozen values in SI units."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from soft_continuum.client.requests import PLANNING_TIMEOUT, Requests, TIP_TIMEOUT
from soft_continuum.client.sequence import goal, ShapeLike
from soft_continuum.client.state import Pose, pose_of
from soft_continuum.ros.names import SHAPE_SEQUENCER
from soft_continuum.text import MAX_ITEMS, MAX_NAME, printable
from soft_continuum_interfaces import msg
from soft_continuum_interfaces.srv import PlanShapes

MAX_STEPS, MAX_POSES = 1000, 10_000


@dataclass(frozen=True)
class PlanStep:
    """
    A step: one segment softened, bent and stiffened, or the whole arm bent without jamming.

    shape: its index, from 0.  segment: from 1 at the base; 0: the whole arm.  bending_angles: rad,
    of every segment at the end; bending_directions: rad, empty for planar arms.  duration: s of
    tendon motion.  tension: N, the maximum during the step.  clearance: m, the minimum distance to
    an obstacle, inf without any; obstacle: its name.  tip: path of the tip.
    """

    shape: int
    segment: int
    bending_angles: tuple[float, ...]
    bending_directions: tuple[float, ...]
    duration: float
    tension: float
    clearance: float
    obstacle: str
    tip: tuple[Pose, ...]


@dataclass(frozen=True)
class Plan:
    """
    A plan to set shapes.

    found: whether all can be set.  message: why not, else empty; steps then lead to the nearest
    reachable shape, if any.  tip_errors: m from the tip to each goal at the end, or the maximum on
    a path; 0 for shapes by angles.  planning_time: s.
    """

    found: bool
    message: str
    steps: tuple[PlanStep, ...]
    tip_errors: tuple[float, ...]
    planning_time: float

    @property
    def softenings(self) -> int:
        """Number of softenings; without jamming, number of motions."""
        return len(self.steps)

    @property
    def duration(self) -> float:
        """Duration of tendon motion, s."""
        return sum(step.duration for step in self.steps)

    @property
    def tension(self) -> float:
        """Maximum tension, N."""
        return max((step.tension for step in self.steps), default=0.0)

    @property
    def clearance(self) -> float:
        """Minimum clearance, m; inf without obstacles."""
        return min((step.clearance for step in self.steps), default=inf)


async def plan_shapes(requests: Requests, shapes: Sequence[ShapeLike], time_limit: float = 0.0,
                      states: int = 0) -> Plan:
    """
    Return the plan to set shapes from the present state; nothing moves.

    shapes: as for Arm.run.  time_limit: maximum duration of the search for each, s; 0: the
    parameter reach.time_limit.  states: number of states to evaluate in the search for a better
    plan for each; 0: as many as the action.  Raises ValueError for invalid arguments,
    NodesMissingError or NoAnswerError.
    """
    if not 0.0 <= time_limit < inf:
        raise ValueError(f'time_limit is {time_limit} s; allowed: 0 and more')
    if not 0 <= states < 2**32:
        raise ValueError(f'states is {states}; allowed: 0 to {2**32 - 1}')
    messages = goal(shapes, 0.0).shapes
    return plan_from_ros(await requests.call(
        PlanShapes, f'{SHAPE_SEQUENCER}/plan_shapes', shapes=messages, time_limit=time_limit,
        states=states, within=PLANNING_TIMEOUT + TIP_TIMEOUT * len(messages)
        + 2.0 * time_limit * len(messages)))


def plan_from_ros(response: PlanShapes.Response) -> Plan:
    """Return the response of plan_shapes, clipped."""
    return Plan(response.success, printable(response.message),
                tuple(map(_step, response.steps[:MAX_STEPS])),
                tuple(response.tip_errors[:MAX_ITEMS]), response.planning_time)


def _step(step: msg.PlanStep) -> PlanStep:
    return PlanStep(
        step.shape_index, step.segment, tuple(step.bending_angles[:MAX_ITEMS]),
        tuple(step.bending_directions[:MAX_ITEMS]), step.duration, step.largest_tension,
        step.smallest_clearance, printable(step.nearest_obstacle, MAX_NAME),
        tuple(map(pose_of, step.tip_path[:MAX_POSES])))
