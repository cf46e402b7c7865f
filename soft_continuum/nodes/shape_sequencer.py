# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node that runs sequences of shapes, using the other three nodes, and its action server."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from math import nan
from typing import Any

from geometry_msgs.msg import PoseArray, PoseWithCovariance
import numpy as np
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from unique_identifier_msgs.msg import UUID

from soft_continuum.hardware.clock import STEADY
from soft_continuum.mechanics.arm import Arm
from soft_continuum.nodes.arm_commander import ArmCommander
from soft_continuum.nodes.markers import Ghost
from soft_continuum.nodes.obstacles import KnownObstacles
from soft_continuum.nodes.planning import Planning, PlanService
from soft_continuum.nodes.reported_arm import ArmObserver
from soft_continuum.nodes.suite_node import OK, StatePublisher, SuiteNode, WARN
from soft_continuum.nodes.threads import load_model
from soft_continuum.parameters.arm import arm_from_parameters, check_actuation
from soft_continuum.parameters.shapes import (
    angles_problem,
    direction_parameter,
    directions_from_parameters,
    shape_parameter,
    shapes_from_parameters,
    vacuum_parameter,
    vacuums_from_parameters,
    vacuums_problem,
)
from soft_continuum.planning import TIP_KINDS
from soft_continuum.planning.aiming import tip_aim
from soft_continuum.planning.plan_watch import PlanGuard
from soft_continuum.planning.plans import failure_text, PlanError, Shape, ShapePlan, TipGoal
from soft_continuum.planning.settings import (
    loop_from_parameters,
    reach_from_parameters,
    RunnerSettings,
)
from soft_continuum.ros.conversions import (
    MAX_QUATERNION_ERROR,
    pose_from_ros,
    poses_to_ros,
    seconds,
)
from soft_continuum.ros.entries import guarded, LOG_PERIOD, repeat, wake
from soft_continuum.ros.names import running_nodes, SHAPE_SEQUENCER
from soft_continuum.ros.ros_time import Age
from soft_continuum.sequencing import Code, Outcome
from soft_continuum.sequencing.closed_loop import ClosedLoopRunner
from soft_continuum.sequencing.runner import Runner
from soft_continuum.text import MAX_NAME, name_problem, printable
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import (
    Shape as ShapeMessage,
)
from soft_continuum_interfaces.msg import (
    ShapeSequencerState,
    TendonActuationState,
)
from soft_continuum_interfaces.msg import TipGoal as TipGoalMessage

TICK_PERIOD = 0.05  # s
PIECE_PERIOD = 0.15
"""Period of motion pieces, s: validating one with nine tendons takes 10 ms of a core."""
FIRST_MESSAGE_TIMEOUT = 5.0  # s that a goal waits for nodes that may have just been started
STARTING_TIMEOUT = 20.0  # s that it waits for nodes that run: on a slow computer they load longer
RESULT_TIMEOUT = 900  # s for which a client can still ask for a result
GOALS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""Queue length, so that each of many goals is answered; rclpy would keep only ten."""
MAX_SHAPES = 100
"""Shapes of one goal; planning one takes tens of ms, for spatial arms hundreds."""
MAX_TIPS = 200
"""Tip goals of one goal."""


@dataclass(frozen=True)
class GoalRequest:
    """A pending goal; ``answer(True)`` accepts it, ``answer(False)`` rejects it."""

    goal_id: UUID
    goal: RunShapeSequence.Goal
    answer: Callable[[bool], None]


@dataclass(frozen=True)
class FinalState:
    """Final state of the arm, as in the result of RunShapeSequence."""

    bending_angles: Sequence[float] = ()
    angle_stddevs: Sequence[float] = ()
    bending_directions: Sequence[float] = ()
    tip: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    tip_error: float = nan


def error_code(code: Code) -> int:
    """Return the error_code of RunShapeSequence for a code."""
    return int(getattr(RunShapeSequence.Result, code.name))


NOWHERE = FinalState()
"""Result of a goal that ends before the state of the arm is known."""


class SequenceServer(ActionServer):
    """
    An action server without callbacks that wait.

    rclpy expects the response to a goal when its callback returns, without the id of the goal, and
    one callback that runs as long as the goal; its executors would poll a waiting coroutine, which
    occupies a core.
    """

    def __init__(self, node: Node, on_request: Callable[[GoalRequest], None],
                 on_accepted: Callable[[Any], None]) -> None:
        """Hand each goal to ``on_request``, and its handle, once accepted, to ``on_accepted``."""
        self._on_request = on_request
        self._answer = GoalResponse.REJECT
        super().__init__(
            node, RunShapeSequence, 'run_shape_sequence', lambda handle: None,
            goal_callback=lambda goal: self._answer, handle_accepted_callback=on_accepted,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
            goal_service_qos_profile=GOALS, result_timeout=RESULT_TIMEOUT)

    async def _execute_goal_request(self, request: Any) -> None:
        """Leave the answer to the handler of the request."""
        message = request[1]
        try:
            self._on_request(GoalRequest(
                message.goal_id, message.goal, partial(self._send_answer, request)))
        except Exception:
            self._send_answer(request, False)
            raise

    def _send_answer(self, request: Any, accept: bool) -> None:
        self._answer = GoalResponse.ACCEPT if accept else GoalResponse.REJECT
        with suppress(StopIteration):  # it has nothing to wait for
            super()._execute_goal_request(request).send(None)

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Leave the goal executing until ``finish`` is called."""

    def finish(self, handle: Any, outcome: Outcome, reached: FinalState = NOWHERE) -> None:
        """End a goal in the state of its outcome, and send the result."""

        def result(handle: Any) -> RunShapeSequence.Result:
            if outcome.code is Code.SUCCESSFUL:
                handle.succeed()
            elif outcome.code is Code.CANCELED and handle.is_cancel_requested:
                handle.canceled()
            else:
                handle.abort()
            return RunShapeSequence.Result(
                error_code=error_code(outcome.code), error_string=outcome.message,
                shapes_completed=outcome.shapes_completed, corrections=outcome.corrections,
                replans=outcome.replans,
                source=(RunShapeSequence.Result.MEASURED if outcome.measured
                        else RunShapeSequence.Result.PREDICTED), **vars(reached))

        super().notify_execute(handle, result)


@dataclass
class PendingGoal:
    """
    A goal that is being planned before it is accepted.

    age: since it was received.  plans: None until the other nodes have reported.  stops: their
    number when it was received, None until tendon_actuation has reported.
    """

    request: GoalRequest
    shapes: Sequence[Shape]
    age: Age
    plans: 'Future[list[ShapePlan]] | None' = None
    stops: int | None = None


@dataclass(frozen=True)
class Goal:
    """An accepted goal; stops: their number before it."""

    handle: Any
    shapes: Sequence[Shape]
    stops: int


class ShapeSequencer(SuiteNode):
    """
    Sets the arm to one shape after another.

    Serves the action run_shape_sequence (soft_continuum_interfaces/RunShapeSequence) and the
    service ~/plan_shapes (soft_continuum_interfaces/PlanShapes).  Subscribes
    to tendon_states, segment_N/pressure, obstacles (visualization_msgs/MarkerArray) and the
    ~/state of the other three; publishes tendon_actuation/tendon_trajectory, target_markers and
    known_obstacles (visualization_msgs/MarkerArray, latched), ~/state, ~/status and /diagnostics;
    calls jamming_valves/segment_N/set_stiff and set_vacuum.

    Plans are made on a separate thread; all else runs on the thread that spins the node.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters, topics and the action."""
        super().__init__(SHAPE_SEQUENCER, 'shape sequencer', **options)
        for name in self.parameters['shape_names']:
            self.parameters.declare_numbers(shape_parameter(name))
            self.parameters.declare_numbers(direction_parameter(name))
            self.parameters.declare_numbers(vacuum_parameter(name))
        self._arm = arm_from_parameters(self.parameters)
        check_actuation(self._arm, self.parameters)
        self._library = shape_library(self.parameters, self._arm)
        self._check: PendingGoal | None = None
        self._accepted: Sequence[Shape] = ()  # of the goal that is accepted last
        self._next: Goal | None = None  # that waits for the running one to be wound down
        self._goal: Goal | None = None  # that runs, or ran last
        self._runner: Runner | None = None  # while it runs
        self._failed = False  # whether the goal that runs ends because a callback failed
        self._rejected = ''  # why the last goal was, until one is accepted
        self._last: dict[str, str] = {}  # how the last goal ended, for ~/status
        self._warning = ''  # what is not as it should be in the last shape
        self._state = ShapeSequencerState()
        jamming: bool = self.parameters['arm.jamming']
        self._commander = ArmCommander(self, self._arm, jamming)
        self._observed = ArmObserver(self, self._arm, self.parameters, self._on_tendon_state)
        self._ghost = Ghost(self, self._arm, self.parameters['frame_id'])
        self._states = StatePublisher(self, ShapeSequencerState)
        self._obstacles = KnownObstacles(self, self._arm, self.parameters, self._report)
        reach_from_parameters(self.parameters)  # raises for invalid weights
        self._planning = Planning(
            self._arm, self.parameters, self._observed, lambda: self._obstacles.scene,
            self.get_logger().warning)
        self._guard = PlanGuard(self.parameters, lambda: self._obstacles.scene)
        self._server = SequenceServer(
            self, guarded(self, self._on_request), guarded(self, self._on_accepted))
        self._service = PlanService(self, self._planning, self._busy, self._shapes_now)
        self._ticks = repeat(self, TICK_PERIOD, self._tick)  # only while there is a goal
        self._report()

    def start(self) -> None:
        """Load the model; goals are planned once that is done."""
        load_model(self, self._arm)

    def quit(self) -> None:
        """Hold the tendons before the process ends; segments stay as they are."""
        if self._runner is not None:
            self._commander.hold()
        self._planning.close()
        self._guard.close()
        self._ghost.show(None)

    def destroy_node(self) -> None:
        """Destroy the action server before the node, as rclpy requires."""
        self._server.destroy()
        super().destroy_node()

    def callback_failed(self, error: Exception) -> None:
        """Hold, end the goal and report what a callback raised."""
        super().callback_failed(error)
        text = f'shape_sequencer failed: {type(error).__name__}: {error}'
        self._commander.hold()
        if self._check is not None:
            check, self._check = self._check, None
            self._reject(check.request, text)
        goal, runner = self._goal, self._runner
        if goal is None or runner is None:
            return
        if not self._failed:  # wind down, which may fail as well
            self._failed = True
            runner.cancel(Code.HARDWARE_FAULT, text)
        else:
            self._runner = None
            self._commander.end()
            self._planning.abandon()
            self._end(goal, Outcome(Code.HARDWARE_FAULT, text, 0))

    # Goals before they run.

    def _on_request(self, request: GoalRequest) -> None:
        """Reject a goal, accept it, or have it planned first: out of reach it moves nothing."""
        if self._check is not None:
            self._reject(self._check.request, 'superseded by a newer goal before it was accepted')
            self._check = None
        try:
            check_aim(request.goal.aim)
            shapes = self._shapes_of(request.goal.shapes)
        except PlanError as error:
            self._reject(request, str(error))
            return
        self._check = PendingGoal(request, shapes, Age.now())
        wake(self._ticks)
        self._go_on_checking(self._check)

    def _go_on_checking(self, check: PendingGoal) -> None:
        observed = self._observed
        if check.stops is None and observed.tendons_heard:
            check.stops = observed.tendons.stops
        if check.plans is None and self._waits(check):
            self._report()
            return
        problem = (observed.interlock
                   or regulator_problem(check.shapes, observed.regulators))
        if not problem and observed.tendons.stops != check.stops:
            problem = 'the tendons were stopped and resumed before the goal was accepted'
        if not problem and check.plans is None and self._may_plan:
            check.plans = self._planning.plan(check.shapes, first=True)
        if not problem and check.plans is not None:
            if not check.plans.done():
                return
            if error := check.plans.exception():
                problem = failure_text(error)
        self._check = None
        if problem:
            self._planning.abandon()
            self._reject(check.request, problem)
        else:
            self._rejected, self._accepted = '', check.shapes
            check.request.answer(True)

    def _waits(self, check: PendingGoal) -> bool:
        """Whether nothing is wrong but that the other nodes have only been started."""
        observed, age = self._observed, check.age.seconds
        if not observed.missing_sources or observed.reported_fault or observed.stopped:
            return False
        if age < FIRST_MESSAGE_TIMEOUT:
            return True
        missing_sources = [one.partition(' ')[0] for one in observed.missing_sources]
        return age < STARTING_TIMEOUT and all(running_nodes(self, missing_sources).values())

    def _shapes_of(self, items: Sequence[ShapeMessage]) -> list[Shape]:
        return shapes_of(items, self._library, self._arm, self.parameters)

    def _shapes_now(self, items: Sequence[ShapeMessage]) -> list[Shape]:
        """Return the shapes of a request that is answered at once; raises PlanError."""
        shapes = self._shapes_of(items)
        if problem := regulator_problem(shapes, self._observed.regulators):
            raise PlanError(problem)
        return shapes

    def _busy(self) -> str:
        """Why plan_shapes has to wait; empty when it need not."""
        if self._check or self._next or self._runner:
            return 'a sequence runs, or is about to; wait for its end, or cancel it'
        if self._observed.fault:
            return self._observed.fault
        if not self._observed.all_stiff:
            return 'a segment is soft; a plan begins with every segment stiff: stiffen all first'
        return ''

    @property
    def _may_plan(self) -> bool:
        """Whether the arm is as it will be when a goal that came now begins."""
        return self._runner is None and self._next is None and self._observed.all_stiff

    def _reject(self, request: GoalRequest, reason: str) -> None:
        """Publish why, then answer: ROS 2 has no reason in its answer."""
        self.get_logger().error(f'goal rejected: {reason}', throttle_duration_sec=LOG_PERIOD)
        self._rejected = self._state.rejected = reason
        self._state.rejected_goal_id = request.goal_id
        self._report()
        request.answer(False)

    def _on_accepted(self, handle: Any) -> None:
        """Run now, or when the present run has been wound down; only the newest goal waits."""
        handle.execute()
        if self._next is not None:
            self._server.finish(self._next.handle, Outcome(
                Code.PREEMPTED, 'superseded by a newer goal before it started', 0))
        if self._runner is not None:
            self._runner.cancel(Code.PREEMPTED, 'superseded by a newer goal')
        self._next = Goal(handle, self._accepted, self._observed.tendons.stops)
        wake(self._ticks)

    # The goal that runs.

    def _on_tendon_state(self, state: TendonActuationState) -> None:
        """Act on a stop or the end of a motion at once, however soon it is followed by others."""
        self._commander.on_tendon_state(state)
        if self._observed.stopped or self._commander.motion_failure is not None:
            self._tick()

    def _tick(self) -> None:
        if self._check is not None:
            self._go_on_checking(self._check)
        if self._goal is not None and self._runner is not None:
            self._go_on(self._goal, self._runner)
        if self._next is not None:
            self._go_on_waiting(self._next)
        if self._check is None and self._runner is None and self._next is None:
            self._ticks.cancel()

    def _go_on_waiting(self, goal: Goal) -> None:
        outcome = None
        if goal.handle.is_cancel_requested:
            outcome = Outcome(Code.CANCELED, 'canceled by the client before it started', 0)
        elif self._observed.stopped:
            outcome = Outcome(Code.STOPPED, f'stopped: {self._observed.stopped}', 0)
        elif self._observed.tendons.stops != goal.stops:
            outcome = Outcome(
                Code.STOPPED, 'the tendons were stopped and resumed before it started', 0)
        elif self._runner is not None:
            return
        self._next = None
        if outcome is None:
            self._begin(goal)
        else:
            self._end(goal, outcome)

    def _begin(self, goal: Goal) -> None:
        self._goal, self._failed = goal, False
        self._commander.begin()
        settings = RunnerSettings(
            jamming=self.parameters['arm.jamming'],
            piece_period=PIECE_PERIOD,
            on_obstacle=self.parameters['obstacles.on_change'],
            max_replans=self.parameters['reach.max_replans'], **{
                name: self.parameters[name] for name in (
                    'jamming_timeout', 'settle_timeout', 'settle_tolerance', 'soft_vacuum',
                    'full_vacuum', 'vacuum_tolerance')})
        if self.parameters['closed_loop']:
            self._runner = ClosedLoopRunner(
                goal.shapes, self._planning.plan, self._planning.loop(goal.handle.request.aim),
                self._commander, settings, loop_from_parameters(self.parameters),
                self._arm.tendon_names)
        else:
            self._runner = Runner(goal.shapes, self._planning.plan, self._commander, settings,
                                  self._arm.tendon_names)
        self._state.goal_id = goal.handle.goal_id
        self._go_on(goal, self._runner)

    def _go_on(self, goal: Goal, runner: Runner) -> None:
        if goal.handle.is_cancel_requested:
            runner.cancel(Code.CANCELED, 'canceled by the client')
        if isinstance(runner, ClosedLoopRunner):
            runner.loop_settings = loop_from_parameters(self.parameters)
        obstructed, departed, unseen = self._guard.problems(
            runner.plan, runner.move, self._observed.shape)
        runner.tick(STEADY(), replace(self._observed.observation(
            self._commander.motion_failure, self._commander.switch_failure),
            obstructed=obstructed, departed=departed, unseen=unseen))
        progress, outcome, self._warning = runner.progress, runner.outcome, runner.warning
        shape = goal.shapes[progress.shape_index]
        aim = RunShapeSequence.Goal.TIP if shape.tips else goal.handle.request.aim
        goal.handle.publish_feedback(RunShapeSequence.Feedback(
            shape_index=progress.shape_index, shape=progress.shape,
            segment=progress.segment, phase=progress.phase, progress=progress.fraction,
            correction=progress.correction, aim=aim,
            error=nan if progress.error is None else progress.error))
        # The angles of a goal of the tip are known once it is planned.
        target = runner.plan.shape if runner.plan else None if shape.tips else shape
        self._ghost.show(None if outcome else target)
        if outcome is None:
            self._report()
            return
        self._runner = None
        self._commander.end()
        self._planning.abandon()
        self._end(goal, outcome, self._reached(runner, outcome))

    def _reached(self, runner: Runner, outcome: Outcome) -> FinalState:
        shape, known = self._observed.shape, self._observed.kinematics
        if shape is None:
            return NOWHERE
        stddevs: Sequence[float] = ()
        if outcome.measured or outcome.lost:  # it grows while nothing is measured
            stddevs = known.angle_stddevs or [nan] * len(shape.bending_angles)
        aim = runner.aim if isinstance(runner, ClosedLoopRunner) else None
        if aim is None and runner.plan is not None and runner.plan.shape.tips:
            aim = tip_aim(runner.plan.shape, self._arm)
        return FinalState(
            shape.bending_angles.tolist(), stddevs,
            shape.bending_directions.tolist(), PoseWithCovariance(
                pose=poses_to_ros(shape.poses[-1:], PoseArray()).poses[0],
                covariance=stddevs and known.tip_covariance or [0.0] * 36),
            aim.tip_error(shape) if aim is not None else nan)

    def _end(self, goal: Goal, outcome: Outcome, reached: FinalState = NOWHERE) -> None:
        if outcome.code is Code.SUCCESSFUL:
            self.get_logger().info(f'sequence done, {outcome.shapes_completed} shapes')
        else:
            self.get_logger().warning(f'sequence ended: {outcome.code.name}: {outcome.message}')
        self._last = {'last': outcome.code.name, 'reason': outcome.message}
        self._state.goal_id = goal.handle.goal_id
        self._state.error_code = error_code(outcome.code)
        self._state.error_string = outcome.message
        self._state.shapes_completed = outcome.shapes_completed
        self._report()
        self._server.finish(goal.handle, outcome, reached)

    # What is published.

    def _report(self) -> None:
        """Publish ~/state and ~/status, if they changed."""
        values = dict(self._last)
        text, state = 'idle', self._state
        state.running = self._runner is not None
        if self._runner is not None:
            progress = self._runner.progress
            state.shape_index, state.shape = progress.shape_index, progress.shape
            state.segment, state.phase = progress.segment, progress.phase
            text = f'running {progress.shape}'
            values = {'phase': progress.phase, 'segment': str(progress.segment), **values}
        else:
            state.shape_index, state.shape, state.segment, state.phase = 0, '', 0, ''
            if self._check is not None and self._check.plans is None:
                text = f'waiting for {", ".join(self._observed.missing_sources)}'
        values |= self._obstacles.report
        if self._rejected:
            values['rejected'] = self._rejected
        self._states.publish(copy(state))
        if self._warning:
            text += f'; {self._warning}'
        self.status.set(WARN if self._warning else OK, text, **values)


# What a goal asks for.


def shape_library(parameters: Mapping[str, Any], arm: Arm) -> dict[str, Shape]:
    """Return the shapes that parameters describe, by name; raises ParameterError."""
    directions = directions_from_parameters(parameters)
    vacuums = vacuums_from_parameters(parameters)
    return {name: Shape(name, angles, 0.0, directions.get(name, ()),
                        vacuums=vacuums.get(name, ()))
            for name, angles in shapes_from_parameters(parameters, arm).items()}


def check_aim(aim: int) -> None:
    """Raise PlanError for an invalid aim of RunShapeSequence."""
    angles, tip = RunShapeSequence.Goal.ANGLES, RunShapeSequence.Goal.TIP
    if aim not in (angles, tip):
        raise PlanError(f'aim is {aim}; allowed: {angles} (angles), {tip} (tip)')


def shapes_of(items: Sequence[ShapeMessage], library: Mapping[str, Shape], arm: Arm,
              parameters: Mapping[str, Any]) -> list[Shape]:
    """
    Return the shapes of a request; raises PlanError for an invalid one.

    parameters: with the default tolerances of tip goals.
    """
    if not items:
        raise PlanError('the sequence is empty; give at least one shape: ' + ', '.join(library))
    if len(items) > MAX_SHAPES:
        raise PlanError(f'{len(items)} shapes; allowed: {MAX_SHAPES}; send them in several goals')
    if (tips := sum(len(item.tips) for item in items)) > MAX_TIPS:
        raise PlanError(f'{tips} tips; allowed: {MAX_TIPS}; send them in several goals')
    return [_shape(number, item, library, arm, parameters)
            for number, item in enumerate(items, start=1)]


def _shape(number: int, item: ShapeMessage, library: Mapping[str, Shape], arm: Arm,
           parameters: Mapping[str, Any]) -> Shape:
    if problem := name_problem(item.name):
        raise PlanError(f'shape {number}: its name is {problem}')
    label, hold = f'shape {number} ({item.name or "unnamed"})', seconds(item.hold_time)
    if hold < 0.0:
        raise PlanError(f'{label}: hold_time is {hold:g} s; it must not be negative')
    for what, values in (('bending angles', item.bending_angles), ('vacuums', item.vacuums),
                         ('bending directions', item.bending_directions)):
        if len(values) > MAX_SHAPES:
            raise PlanError(f'shape {number}: {len(values)} {what}; needed: {len(arm.segments)}')
    angles, directions = tuple(item.bending_angles), tuple(item.bending_directions)
    vacuums, tips = tuple(item.vacuums), _tips(label, item, arm, parameters)
    if not (angles or tips):
        if directions:
            raise PlanError(f'shape {number}: bending_directions without bending_angles; give '
                            f'both, {len(arm.segments)} each, or a name alone')
        if item.name not in library:
            raise PlanError(f'shape {number}: unknown shape {item.name!r}; known: '
                            + ', '.join(library))
        known = library[item.name]
        angles, directions = known.bending_angles, known.bending_directions
        vacuums = vacuums or known.vacuums
    if not tips and (problem := angles_problem(angles, arm, directions)):
        raise PlanError(f'{label}: {problem}')
    if vacuums and len(tips) > 1:
        raise PlanError(f'{label}: {len(tips)} tips and vacuums: a path is followed with every '
                        'segment stiff but one; give one tip, or leave the vacuums out')
    if vacuums and (problem := vacuums_problem(
            vacuums, arm, parameters['full_vacuum'], parameters['soft_vacuum'],
            parameters['arm.jamming'])):
        raise PlanError(f'{label}: {problem}')
    name = item.name or (_tips_name(tips, arm) if tips else f'shape {number}')
    return Shape(name, angles, hold, directions, tips, vacuums)


def regulator_problem(shapes: Sequence[Shape], regulators: bool) -> str:
    """Return which shape has vacuums although the rig has valves; empty for none."""
    return next((f'{shape.name}: vacuums are given, but jamming_valves has valves, not '
                 'regulators; leave the vacuums out'
                 for shape in shapes if shape.vacuums and not regulators), '')


def _tips(label: str, item: ShapeMessage, arm: Arm, parameters: Mapping[str, Any]
          ) -> tuple[TipGoal, ...]:
    """Return the goals of the tip of a shape, none for angles; raises PlanError."""
    if not item.tips:
        return ()
    if len(item.bending_angles) or len(item.bending_directions):
        raise PlanError(f'{label}: tips and bending angles or directions; give only one of the '
                        'two')
    goals = []
    for number, tip in enumerate(item.tips, start=1):
        try:
            goals.append(_tip_goal(tip, parameters))
            goals[-1].check(arm)
        except PlanError as error:
            of = f'tip {number}: ' if len(item.tips) > 1 else ''
            raise PlanError(f'{label}: {of}{error}') from None
    return tuple(goals)


def _tips_name(tips: Sequence[TipGoal], arm: Arm) -> str:
    """Return what people know goals of the tip by."""
    if len(tips) > 1:
        return f'path through {len(tips)} points'
    place = 1e3 * tips[0].position[arm.pose_axes[:3]]
    return f'tip at ({", ".join(f"{value:.0f}" for value in place)}) mm'


def _tip_goal(tip: TipGoalMessage, parameters: Mapping[str, Any]) -> TipGoal:
    if tip.header.frame_id not in ('', frame := parameters['frame_id']):
        raise PlanError(f'the frame_id of the tip goal is '
                        f'{printable(repr(tip.header.frame_id), MAX_NAME)}; allowed: {frame!r}, '
                        'or empty. Transform the goal, for instance with tf2')
    if tip.kind >= len(TIP_KINDS):
        raise PlanError(f'the kind of the tip goal is {tip.kind}; allowed: '
                        + ', '.join(f'{n} ({kind})' for n, kind in enumerate(TIP_KINDS)))
    pose = np.array(pose_from_ros(tip.pose))
    rotation = None
    if tip.kind != TipGoalMessage.POSITION:
        quaternion = pose[3:]
        length = float(np.linalg.norm(quaternion))
        if not abs(length - 1.0) < MAX_QUATERNION_ERROR:
            raise PlanError(f'the orientation of the tip goal is a quaternion of length '
                            f'{length:.3g}; needed: 1')
        from scipy.spatial.transform import Rotation  # 0.1 s that a start need not wait for
        rotation = Rotation.from_quat(quaternion).as_matrix()
    tolerances = {}
    for name, given in (('position_tolerance', tip.position_tolerance),
                        ('angle_tolerance', tip.angle_tolerance)):
        tolerances[name] = given if given != 0.0 else parameters[f'reach.{name}']
    return TipGoal(pose[:3], rotation, TIP_KINDS[tip.kind], **tolerances)
