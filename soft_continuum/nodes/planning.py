# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Plans from the present state of the arm, as reported by kinematics, on a separate thread.

Also the service that plans without motion.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from math import inf, isfinite
from time import monotonic
from typing import Any, TypeVar

from geometry_msgs.msg import PoseArray
import numpy as np
from rclpy.node import Node

from soft_continuum.mechanics.arm import Arm
from soft_continuum.nodes.reported_arm import ArmObserver
from soft_continuum.nodes.threads import on_ros_thread
from soft_continuum.planning.aiming import (
    Aim,
    aim_of,
    AimStep,
    next_step,
    segments_worth_correcting,
)
from soft_continuum.planning.obstacles import CollisionScene
from soft_continuum.planning.plan_watch import KeptPlan, KeptPlans
from soft_continuum.planning.planner import Planner, PlanSettings
from soft_continuum.planning.plans import (
    failure_text,
    Move,
    PlanError,
    PlannedStep,
    PlanResult,
    Shape,
    ShapePlan,
)
from soft_continuum.planning.settings import reach_from_parameters
from soft_continuum.planning.shape_plans import plan_shapes, plans_of
from soft_continuum.ros.conversions import poses_to_ros
from soft_continuum.ros.entries import serve_later
from soft_continuum.sequencing.closed_loop import Loop
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import PlanStep
from soft_continuum_interfaces.msg import Shape as ShapeMessage
from soft_continuum_interfaces.srv import PlanShapes

MAX_TIME_LIMIT = 600.0  # s
Result = TypeVar('Result')
Answer = Callable[[PlanShapes.Response], None]


class Planning:
    """Makes one plan at a time, the newest; an abandoned one ends after a few milliseconds."""

    def __init__(self, arm: Arm, parameters: Mapping[str, Any], observed: ArmObserver,
                 scene: Callable[[], CollisionScene], warn: Callable[[str], None]) -> None:
        """
        Plan for ``arm`` as ``observed``, within the limits of the parameters.

        warn: called when a search ended early, on the planning thread.
        """
        self._arm, self._parameters, self._observed = arm, parameters, observed
        self._scene, self._warn = scene, warn
        self._explained, self._checked = KeptPlans(), KeptPlans()
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix='planner')
        self._wanted: object = None  # the search that goes on

    def abandon(self) -> None:
        """End the present plan, if there is one, with a PlanError."""
        self._wanted = None

    def close(self) -> None:
        """Abandon the present plan and end the thread."""
        self.abandon()
        self._thread.shutdown()

    def plan(self, shapes: Sequence[Shape], first: bool = False) -> 'Future[list[ShapePlan]]':
        """
        Begin to plan shapes one after the other; the future raises PlanError if one has none.

        Plans of ``explain`` are reused while nothing has changed.  first: take the first plan
        found, to check a goal.  For its first shape, what is run is then the plan by angles, or
        the best that the search for the tip goes on to find; later ones are planned again, from
        where the arm has come to.
        """
        around, situation = self._scene(), self._situation
        kept = self._planned_before(situation, shapes, first)
        going_on = any(one.found.better for one in kept)

        def known() -> list[ShapePlan]:
            found = [one.found for one in kept]  # who was shown it was warned
            if going_on:
                found = list(self._warned(shapes, (one.best() for one in found)))
            return [replace(plan, shape=replace(
                plan.shape, name=shape.name, hold_time=shape.hold_time))
                for plan, shape in zip(plans_of(shapes, found), shapes, strict=True)]

        if going_on:
            self._wanted = kept[0].search
            return self._thread.submit(known)
        if kept:
            self.abandon()
            shown: Future[list[ShapePlan]] = Future()
            shown.set_result(known())
            return shown
        settings, search = reach_from_parameters(self._parameters), object()

        def planned(planner: Any, state: Any, pulls: tuple[float, ...]) -> list[ShapePlan]:
            results = self._warned(shapes, plan_shapes(
                planner, state, pulls, shapes, around, settings, first))
            # A search that is interrupted takes memory: only the first one goes on later.
            found = [one if number == 0 else replace(one, better=None)
                     for number, one in enumerate(results)]
            if first and (not shapes[0].tips or found[0].better):
                self._checked.keep(situation, state, pulls, shapes[:1], found, search)
            return plans_of(shapes, found)

        return self._start(planned, search)

    def explain(self, shapes: Sequence[Shape], time_limit: float, states: int
                ) -> 'Future[list[PlanResult]]':
        """Begin to plan shapes, up to the first that fails; time_limit, states: 0: as ``plan``."""
        situation, around = self._situation, self._scene()
        settings = reach_from_parameters(self._parameters)
        settings = replace(settings, time_limit=time_limit or settings.time_limit,
                           states=states or settings.states)

        def explained(planner: Any, state: Any, pulls: tuple[float, ...]) -> list[PlanResult]:
            found = list(self._warned(shapes, plan_shapes(
                planner, state, pulls, shapes, around, settings)))
            self._explained.keep(situation, state, pulls, shapes, found)
            return found

        return self._start(explained)

    @property
    def _situation(self) -> object:
        """What must be equal for a plan to hold, besides where the arm is."""
        return (self._observed.tendons.stops, self._scene(),
                PlanSettings.of(self._parameters), reach_from_parameters(self._parameters))

    def _planned_before(self, situation: object, shapes: Sequence[Shape], first: bool
                        ) -> list[KeptPlan]:
        """Return what ``explain`` or a check found for shapes; none if anything has changed."""
        state, observed = self._observed.shape, self._observed.observation(None, '')
        if state is None:
            return []
        for kept in (self._explained,) if first else (self._explained, self._checked):
            if plans := kept.find(
                    situation, state.bending,
                    lambda pulls: observed.rests_at(pulls, self._parameters['settle_tolerance']),
                    shapes, self._parameters['angle_tolerance'], take=not first):
                return plans
        return []

    def _warned(self, shapes: Sequence[Shape], results: Iterable[PlanResult]
                ) -> Iterator[PlanResult]:
        """Yield results of shapes; warn of searches that the time limit ended."""
        for shape, found in zip(shapes, results, strict=False):
            if found.cut_short:
                self._warn(f'{shape.name}: reach.time_limit ended the search for a plan; more '
                           'time may give a better one')
            yield found

    def loop(self, aim: int) -> Loop:
        """Return the planning functions of a run by measurements; aim: of RunShapeSequence."""
        return Loop(partial(self._aim, aim == RunShapeSequence.Goal.TIP), self._step, self._again,
                    lambda: self._observed.shape)

    def _aim(self, on_tip: bool, shape: Shape) -> 'Future[Aim]':
        settings, arm = PlanSettings.of(self._parameters), self._arm
        return self._start(lambda *_: aim_of(shape, on_tip, arm, settings))

    def _step(self, segments: Sequence[int], aim: Aim) -> 'Future[AimStep]':
        dead_band = self._parameters['loop.dead_band']
        return self._start(lambda planner, state, pulls: next_step(
            planner, state, pulls, segments, aim, dead_band))

    def _again(self, segments: Sequence[int], aim: Aim, release_limit: float
               ) -> 'Future[tuple[int, ...]]':
        jamming = self._parameters['arm.jamming']
        lock_in = self._parameters['loop.lock_in_stddev'] if jamming else 0.0
        # What is set again was not planned among obstacles: it must hardly move the arm.
        near = self._parameters['obstacles.margin'] if self._scene().obstacles else inf
        return self._start(lambda planner, state, pulls: segments_worth_correcting(
            planner, state, pulls, segments, aim, lock_in, min(release_limit, near)))

    def _start(self, work: Callable[[Any, Any, tuple[float, ...]], Result],
               search: object = None) -> 'Future[Result]':
        """Plan from the present state, in place of anything else; search: what is then wanted."""
        known, pulls = self._observed.shape_and_model, self._observed.pulls
        if known is None:
            failed: Future[Result] = Future()
            failed.set_exception(PlanError('the shape of the arm is no longer known'))
            return failed
        state, model = known
        settings = PlanSettings.of(self._parameters).with_slack_for(model.offset_stddevs)
        search = self._wanted = search or object()
        return self._thread.submit(lambda: work(
            Planner(model.chain.arm, settings, lambda: self._wanted is not search,
                    model.offsets.tolist()), state, pulls))


class PlanService:
    """Handles one request at a time: a newer one, or a goal of the action, aborts it."""

    def __init__(self, node: Node, planning: Planning, busy: Callable[[], str],
                 shapes_of: Callable[[Sequence[ShapeMessage]], list[Shape]]) -> None:
        """
        Create the service.

        busy: why nothing can be planned now, empty when it can.  shapes_of: reads a request,
        raises PlanError.
        """
        self._node, self._planning, self._busy, self._shapes_of = node, planning, busy, shapes_of
        serve_later(node, PlanShapes, '~/plan_shapes', self._on_request)

    def _on_request(self, request: PlanShapes.Request, answer: Answer) -> None:
        limit = request.time_limit
        problem = self._busy()
        if not (isfinite(limit) and 0.0 <= limit <= MAX_TIME_LIMIT):
            problem = (f'time_limit is {limit:g} s; allowed: 0 (use reach.time_limit) to '
                       f'{MAX_TIME_LIMIT:g} s')
        try:
            shapes = self._shapes_of(request.shapes)
        except PlanError as error:
            problem = str(error)
        if problem:
            answer(PlanShapes.Response(message=problem))
            return
        begin = monotonic()
        plan = self._planning.explain(shapes, limit, request.states)
        plan.add_done_callback(lambda _: on_ros_thread(
            self._node, self._reply, plan, shapes, begin, answer))

    def _reply(self, plan: 'Future[list[PlanResult]]', shapes: Sequence[Shape], begin: float,
               answer: Answer) -> None:
        error = plan.exception()
        if error is None:
            response = plans_to_ros(plan.result(), shapes)
        else:
            response = PlanShapes.Response(message=failure_text(error))
        response.planning_time = monotonic() - begin
        answer(response)


def plans_to_ros(found: Sequence[PlanResult], shapes: Sequence[Shape]) -> PlanShapes.Response:
    """Return the response of plan_shapes, without its time; found: up to the first failure."""
    problem, steps = found[-1].why, []
    for index, one in enumerate(found):
        if one.plan is not None:
            steps += [_step(index, move, step) for move, step in zip(
                one.plan.moves, one.steps, strict=True)]
    return PlanShapes.Response(
        success=not problem, steps=steps,
        message=f'{shapes[len(found) - 1].name}: {problem}' if problem else '',
        tip_errors=[one.tip_error if shape.tips else 0.0
                    for one, shape in zip(found, shapes, strict=False)])


def _step(index: int, move: Move, step: PlannedStep) -> PlanStep:
    end = step.states[-1]
    return PlanStep(
        shape_index=index, segment=move.segment + 1, bending_angles=end.bending_angles.tolist(),
        bending_directions=end.bending_directions.tolist(), duration=move.duration,
        largest_tension=step.tension, smallest_clearance=step.clearance,
        nearest_obstacle=step.obstacle, tip_path=poses_to_ros(
            np.array([state.poses[-1] for state in step.states]), PoseArray()).poses)
