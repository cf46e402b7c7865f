# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A sequence of shapes: its goal, its plan, while it runs, and its result."""

from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from math import inf
import threading
from typing import Any

from geometry_msgs.msg import Point, Quaternion
from geometry_msgs.msg import Pose as PoseMessage

from soft_continuum.client.errors import NoAnswerError
from soft_continuum.client.state import (
    Pose,
    pose_of,
    Progress,
    progress_of,
    Reached,
    SequenceResult,
)
from soft_continuum.client.tip import Tip
from soft_continuum.planning import TIP_KINDS
from soft_continuum.ros.ros_time import duration_to_ros
from soft_continuum.sequencing import AIMS, Code
from soft_continuum.text import MAX_ITEMS, MAX_NAME, printable
from soft_continuum_interfaces import msg
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Shape, ShapeSequencerState, TipGoal
from soft_continuum_interfaces.srv import PlanShapes

MAX_HOLD = 86400.0  # s
MAX_STEPS, MAX_POSES = 1000, 10_000  # of a plan
OUTCOMES = {getattr(RunShapeSequence.Result, code.name): code.name for code in Code}

Bending = float | tuple[float, float]
"""Bending of a segment: its angle, or angle and direction, rad."""


@dataclass(frozen=True)
class Held:
    """
    A shape held at other vacuums than the full one, for rigs with regulators.

    shape: its name, the bending of each segment, or a goal of the tip.  vacuums: of each segment,
    Pa below ambient.
    """

    shape: 'str | Sequence[Bending] | Tip'
    vacuums: tuple[float, ...]


ShapeLike = str | Sequence[Bending] | Tip | Sequence[Tip] | Held
"""A shape: its name in the library, the bending of each segment, or a goal of the tip."""


def goal(shapes: Sequence[ShapeLike], hold: float | Sequence[float], aim: str = AIMS[0]
         ) -> RunShapeSequence.Goal:
    """
    Return the goal for shapes, with one hold time (s) for all or one for each.

    aim: one of AIMS.  Raises ValueError for an invalid hold time or aim; the shape_sequencer
    checks the shapes.
    """
    if aim not in AIMS:
        raise ValueError(f'aim is {aim!r}; allowed: {" or ".join(map(repr, AIMS))}')
    holds = [hold] * len(shapes) if isinstance(hold, int | float) else hold
    for time in holds:
        if not 0.0 <= time <= MAX_HOLD:
            raise ValueError(f'hold is {time} s; allowed: 0 to {MAX_HOLD:g} s')
    return RunShapeSequence.Goal(aim=AIMS.index(aim), shapes=[
        Shape(hold_time=duration_to_ros(time), **fields_of(shape))
        for shape, time in zip(shapes, holds, strict=True)])


def fields_of(shape: ShapeLike) -> dict[str, Any]:
    """Return a shape as a Shape message; raises ValueError for an invalid one."""
    if isinstance(shape, Held):
        return fields_of(shape.shape) | {'vacuums': [float(v) for v in shape.vacuums]}
    if isinstance(shape, str):
        return {'name': shape}
    tips = [shape] if isinstance(shape, Tip) else list(shape)
    if not tips:
        raise ValueError(f'{shape!r} given as a shape or path; allowed: one value or more')
    if all(isinstance(tip, Tip) for tip in tips):
        return {'tips': [tip_goal(tip) for tip in tips]}  # type: ignore[arg-type]
    return angles_and_directions(tips)  # type: ignore[arg-type]


def tip_goal(tip: Tip) -> TipGoal:
    """Return a goal of the tip as a message for the shape_sequencer."""
    (x, y, z), turn = tip.place, dict(zip('xyzw', tip.quaternion, strict=True))
    return TipGoal(
        kind=TIP_KINDS.index(tip.kind), position_tolerance=float(tip.tolerance),
        angle_tolerance=float(tip.angle_tolerance),
        pose=PoseMessage(position=Point(x=x, y=y, z=z), orientation=Quaternion(**turn)))


def angles_and_directions(shape: Sequence[Bending]) -> dict[str, list[float]]:
    """Return the angles of a shape and its directions, if any is given, as in Shape."""
    angles, directions, directed = [], [], False
    for bend in shape:
        try:
            angle, direction = float(bend), 0.0  # type: ignore[arg-type]
        except TypeError:
            try:
                angle, direction = map(float, bend)  # type: ignore[arg-type]
            except (TypeError, ValueError):
                raise ValueError(f'{bend!r} given for a segment; allowed: its bending angle, or '
                                 'its angle and direction (rad)') from None
            directed = True
        angles.append(angle)
        directions.append(direction)
    return {'bending_angles': angles} | ({'bending_directions': directions} if directed else {})


def sequence_result(message: RunShapeSequence.Result | ShapeSequencerState) -> SequenceResult:
    """Return the result of a goal, or of the last one in the state of the sequencer."""
    outcome = OUTCOMES.get(message.error_code, f'error_code {message.error_code}')
    reached = _reached(message) if isinstance(message, RunShapeSequence.Result) else None
    return SequenceResult(
        outcome, printable(message.error_string), message.shapes_completed, reached)


def _reached(message: RunShapeSequence.Result) -> Reached | None:
    """Return the last shape in a result; None if it has none."""
    angles = tuple(message.bending_angles[:MAX_ITEMS])
    if not angles:
        return None
    measured = message.source == RunShapeSequence.Result.MEASURED
    stddevs = tuple(message.angle_stddevs[:MAX_ITEMS])
    return Reached(measured, angles, pose_of(message.tip.pose), stddevs,
                   tuple(message.tip.covariance) if measured or stddevs else (),
                   float(message.tip_error),
                   message.corrections, tuple(message.bending_directions[:MAX_ITEMS]),
                   message.replans)


class RunningSequence:
    """
    An accepted sequence; returned by ``Arm.start``.

    Wait with ``result()``, or with ``await`` in asyncio.
    """

    def __init__(self) -> None:
        """Wait for ``begin``."""
        self._progress: Progress | None = None
        self._changed = threading.Condition()
        self._cancel: Callable[[], object] = lambda: None
        self._end: Future[SequenceResult] = Future()

    def begin(self, cancel: Callable[[], object], end: Future[SequenceResult]) -> None:
        """Set its cancel function and the future of its result."""
        self._cancel, self._end = cancel, end
        end.add_done_callback(lambda _: self._notify())

    def on_feedback(self, message: Any) -> None:
        """Store the progress of the goal."""
        feedback = message.feedback
        self._progress = progress_of(feedback, float(feedback.progress), feedback)
        self._notify()

    def _notify(self) -> None:
        with self._changed:
            self._changed.notify_all()

    @property
    def progress(self) -> Progress | None:
        """Its progress; None before the first feedback."""
        return self._progress

    @property
    def done(self) -> bool:
        """Whether it has ended, with any outcome."""
        return self._end.done()

    def updates(self) -> Iterator[Progress]:
        """Yield its progress at every change, until it has ended."""
        before: Progress | None = None
        while True:
            with self._changed:
                while not self.done and self._progress == before:
                    self._changed.wait()
            done, now = self.done, self._progress
            if now is not None and now != before:
                before = now
                yield now
            if done:
                return

    def result(self, timeout: float | None = None) -> SequenceResult:
        """
        Wait for the end, at most ``timeout`` s; return the result.

        Raises SequenceError if not every shape was reached and held, NoAnswerError when it still
        runs after ``timeout``, LostError when the shape_sequencer stops reporting.
        """
        try:
            return self._end.result(timeout)
        except TimeoutError:
            if self.done:
                raise
            raise NoAnswerError(f'the sequence still runs after {timeout:g} s; '
                                'wait longer or cancel() it') from None

    def __await__(self) -> Generator[Any, None, SequenceResult]:
        """Wait like ``result()``, without blocking the event loop."""
        import asyncio  # saves a stop 0.04 s
        return asyncio.wrap_future(self._end).__await__()

    def cancel(self) -> None:
        """
        Request cancellation: the tendons come to rest, the soft segment is stiffened.

        Returns at once; ``result()`` then raises SequenceError with outcome CANCELED.
        """
        self._cancel()


# Plans.


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
