# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node that runs sequences of shapes, using the other three nodes."""

from collections.abc import Sequence
from concurrent.futures import Future
from copy import copy
from dataclasses import dataclass, replace
from math import nan
from typing import Any

from geometry_msgs.msg import PoseArray, PoseWithCovariance

from soft_continuum.hardware.clock import STEADY
from soft_continuum.nodes.arm_commander import ArmCommander
from soft_continuum.nodes.arm_observer import ArmObserver
from soft_continuum.nodes.goals import check_aim, regulator_problem, shape_library, shapes_of
from soft_continuum.nodes.markers import Ghost
from soft_continuum.nodes.obstacles import KnownObstacles
from soft_continuum.nodes.planning import (
    PlanGuard,
    Planning,
    PlanService,
    tip_aim,
)
from soft_continuum.nodes.sequence_server import (
    error_code,
    FinalState,
    GoalRequest,
    NOWHERE,
    SequenceServer,
)
from soft_continuum.nodes.suite_node import OK, StatePublisher, SuiteNode, WARN
from soft_continuum.nodes.threads import load_model
from soft_continuum.parameters.arm import arm_from_parameters, check_actuation
from soft_continuum.parameters.shapes import direction_parameter, shape_parameter, vacuum_parameter
from soft_continuum.planning.plans import failure_text, PlanError, Shape, ShapePlan
from soft_continuum.planning.settings import (
    loop_from_parameters,
    reach_from_parameters,
    RunnerSettings,
)
from soft_continuum.ros.conversions import poses_to_ros
from soft_continuum.ros.entries import guarded, LOG_PERIOD, repeat, wake
from soft_continuum.ros.names import running_nodes, SHAPE_SEQUENCER
from soft_continuum.ros.ros_time import Age
from soft_continuum.sequencing.closed_loop import ClosedLoopRunner
from soft_continuum.sequencing.progress import Code, Outcome
from soft_continuum.sequencing.runner import Runner
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import (
    Shape as ShapeMessage,
)
from soft_continuum_interfaces.msg import (
    ShapeSequencerState,
    TendonActuationState,
)

TICK_PERIOD = 0.05  # s
PIECE_PERIOD = 0.15
"""Period of motion pieces, s: validating one with nine tendons takes 10 ms of a core."""
FIRST_MESSAGE_TIMEOUT = 5.0  # s that a goal waits for nodes that may have just been started
STARTING_TIMEOUT = 20.0  # s that it waits for nodes that run: on a slow computer they load longer


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
        self._next: Any = None  # the goal that waits for the running one to be wound down
        self._next_shapes: Sequence[Shape] = ()
        self._next_stops = 0  # how many stops there had been before it
        self._handle: Any = None  # the goal that runs
        self._runner: Runner | None = None
        self._shapes: Sequence[Shape] = ()  # of the goal that runs
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
        runner = self._runner
        if runner is None:
            return
        if not self._failed:  # wind down, which may fail as well
            self._failed = True
            runner.cancel(Code.HARDWARE_FAULT, text)
        else:
            self._runner = None
            self._commander.end()
            self._planning.abandon()
            self._end(self._handle, Outcome(Code.HARDWARE_FAULT, text, 0))

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
            self._server.finish(self._next, Outcome(
                Code.PREEMPTED, 'superseded by a newer goal before it started', 0))
        if self._runner is not None:
            self._runner.cancel(Code.PREEMPTED, 'superseded by a newer goal')
        self._next, self._next_shapes = handle, self._accepted
        self._next_stops = self._observed.tendons.stops
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
        if self._runner is not None:
            self._go_on(self._runner)
        if self._next is not None:
            self._go_on_waiting(self._next)
        if self._check is None and self._runner is None and self._next is None:
            self._ticks.cancel()

    def _go_on_waiting(self, handle: Any) -> None:
        outcome = None
        if handle.is_cancel_requested:
            outcome = Outcome(Code.CANCELED, 'canceled by the client before it started', 0)
        elif self._observed.stopped:
            outcome = Outcome(Code.STOPPED, f'stopped: {self._observed.stopped}', 0)
        elif self._observed.tendons.stops != self._next_stops:
            outcome = Outcome(
                Code.STOPPED, 'the tendons were stopped and resumed before it started', 0)
        elif self._runner is not None:
            return
        self._next = None
        if outcome is None:
            self._begin(handle)
        else:
            self._end(handle, outcome)

    def _begin(self, handle: Any) -> None:
        self._handle, self._failed = handle, False
        self._commander.begin()
        shapes = self._shapes = self._next_shapes
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
                shapes, self._planning.plan, self._planning.loop(handle.request.aim),
                self._commander, settings, loop_from_parameters(self.parameters),
                self._arm.tendon_names)
        else:
            self._runner = Runner(shapes, self._planning.plan, self._commander, settings,
                                  self._arm.tendon_names)
        self._state.goal_id = handle.goal_id
        self._go_on(self._runner)

    def _go_on(self, runner: Runner) -> None:
        if self._handle.is_cancel_requested:
            runner.cancel(Code.CANCELED, 'canceled by the client')
        if isinstance(runner, ClosedLoopRunner):
            runner.loop_settings = loop_from_parameters(self.parameters)
        obstructed, departed, unseen = self._guard.problems(
            runner.plan, runner.move, self._observed.shape)
        runner.tick(STEADY(), replace(self._observed.observation(
            self._commander.motion_failure, self._commander.switch_failure),
            obstructed=obstructed, departed=departed, unseen=unseen))
        progress, outcome, self._warning = runner.progress, runner.outcome, runner.warning
        shape = self._shapes[progress.shape_index]
        aim = RunShapeSequence.Goal.TIP if shape.tips else self._handle.request.aim
        self._handle.publish_feedback(RunShapeSequence.Feedback(
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
        self._end(self._handle, outcome, self._reached(runner, outcome))

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

    def _end(self, handle: Any, outcome: Outcome, reached: FinalState = NOWHERE) -> None:
        if outcome.code is Code.SUCCESSFUL:
            self.get_logger().info(f'sequence done, {outcome.shapes_completed} shapes')
        else:
            self.get_logger().warning(f'sequence ended: {outcome.code.name}: {outcome.message}')
        self._last = {'last': outcome.code.name, 'reason': outcome.message}
        self._state.goal_id = handle.goal_id
        self._state.error_code = error_code(outcome.code)
        self._state.error_string = outcome.message
        self._state.shapes_completed = outcome.shapes_completed
        self._report()
        self._server.finish(handle, outcome, reached)

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
