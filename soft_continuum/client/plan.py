# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What would be done to set shapes, as frozen values in SI units."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from soft_continuum.client.requests import PLANNING_TIMEOUT, Requests, TIP_TIMEOUT
from soft_continuum.client.sequence import goal, ShapeLike
from soft_continuum.client.state import Pose
from soft_continuum.ros.names import SHAPE_SEQUENCER
from soft_continuum.text import MAX_ITEMS, MAX_NAME, printable
from soft_continuum_interfaces import msg
from soft_continuum_interfaces.srv import PlanShapes

MAX_STEPS, MAX_POSES = 1000, 10_000


@dataclass(frozen=True)
class PlanStep:
    """
    A segment softened, bent and stiffened, or a whole arm without jamming bent.

    shape: which one, from 0.  segment: from 1 at the base; 0: the whole arm.  bending_angles: rad,
    of every segment at the end; bending_directions: rad, empty of a planar arm.  duration: s for
    which the tendons move.  tension: N, the largest on the way.  clearance: m, the smallest
    distance to an obstacle on the way, inf without any; obstacle: its name.  tip: on the way.
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
    How shapes would be set.

    found: whether all can be.  message: why not, else empty; then steps lead to the nearest that
    can be had, if anything can.  tip_errors: m from the tip to each goal in the end, or at worst
    on a path; 0 of shapes by angles.  planning_time: s.
    """

    found: bool
    message: str
    steps: tuple[PlanStep, ...]
    tip_errors: tuple[float, ...]
    planning_time: float

    @property
    def softenings(self) -> int:
        """How often a segment is softened; of an arm without jamming, how often it is moved."""
        return len(self.steps)

    @property
    def duration(self) -> float:
        """How long the tendons move, s."""
        return sum(step.duration for step in self.steps)

    @property
    def tension(self) -> float:
        """The largest on the way, N."""
        return max((step.tension for step in self.steps), default=0.0)

    @property
    def clearance(self) -> float:
        """The smallest on the way, m; inf without obstacles."""
        return min((step.clearance for step in self.steps), default=inf)


async def plan_shapes(requests: Requests, shapes: Sequence[ShapeLike], time_limit: float = 0.0,
                      states: int = 0) -> Plan:
    """
    Return how shapes would be set from where the arm is; nothing moves.

    shapes: as of Arm.run.  time_limit: s after which the search for each ends at the latest; 0: as
    the parameter reach.time_limit says.  states: of the arm to judge in search of a better plan of
    each; 0: as many as the action would.  Raises ValueError for what is none, NodesMissingError
    or NoAnswerError.
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
    """Return what plan_shapes answered, within bounds."""
    return Plan(response.success, printable(response.message),
                tuple(map(_step, response.steps[:MAX_STEPS])),
                tuple(response.tip_errors[:MAX_ITEMS]), response.planning_time)


def _step(step: msg.PlanStep) -> PlanStep:
    from soft_continuum.ros.conversions import pose_from_ros  # it loads mechanics
    poses = (pose_from_ros(pose) for pose in step.tip_path[:MAX_POSES])
    return PlanStep(
        step.shape_index, step.segment, tuple(step.bending_angles[:MAX_ITEMS]),
        tuple(step.bending_directions[:MAX_ITEMS]), step.duration, step.largest_tension,
        step.smallest_clearance, printable(step.nearest_obstacle, MAX_NAME),
        tuple(Pose(pose[:3], pose[3:]) for pose in poses))  # type: ignore[arg-type]
