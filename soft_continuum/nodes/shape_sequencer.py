# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The node that runs sequences of shapes, by the topics and services of the other three."""

from math import inf, isfinite
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time as RosTime
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from soft_continuum.mechanics.arm import TENDONS
from soft_continuum.mechanics.chain import Array, Equilibrium
from soft_continuum.nodes.markers import target_markers
from soft_continuum.nodes.support import (
    EmergencyStop,
    ERROR,
    load_model,
    NodeParameters,
    OK,
    Status,
)
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.nodes import NODE_PARAMETERS
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.parameters.shapes import angles_problem, SHAPE_PREFIX, shapes_from_parameters
from soft_continuum.ros.age import Age
from soft_continuum.ros.conversions import seconds, trajectory_to_ros
from soft_continuum.ros.qos import LATCHED, SENSOR, STREAM
from soft_continuum.sequencing.planner import PlanError, Planner, PlanSettings, Shape, ShapePlan
from soft_continuum.sequencing.runner import (
    Code,
    Observation,
    Outcome,
    Runner,
    RunnerSettings,
)
from soft_continuum_interfaces.action import RunShapeSequence

TICK = 0.05  # s
RESULT_TIMEOUT = 900  # s for which a client can still ask for a result


class ManualActionServer(ActionServer):
    """
    An action server whose goals end when ``finish`` is called.

    rclpy wants one callback that runs as long as the goal; a coroutine that waits would be polled
    by its executors with a whole core.
    """

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Leave the goal executing."""

    def finish(self, handle: Any, outcome: Outcome) -> None:
        """End a goal, in the state that its outcome calls for, and send the result."""

        def result(handle: Any) -> RunShapeSequence.Result:
            if outcome.code is Code.SUCCESSFUL:
                handle.succeed()
            elif outcome.code is Code.CANCELED and handle.is_cancel_requested:
                handle.canceled()
            else:
                handle.abort()
            return RunShapeSequence.Result(
                error_code=int(outcome.code), error_string=outcome.message,
                shapes_completed=outcome.shapes_completed)

        super().notify_execute(handle, result)


class ShapeSequencer(Node):
    """
    Sets shapes one segment at a time.

    Serves the action run_shape_sequence (soft_continuum_interfaces/RunShapeSequence).  Subscribes
    to tendon_states, joint_states, segment_N/stiff, segment_N/pressure, tendon_actuation/status,
    jamming_valves/status and emergency_stop; publishes tendon_actuation/joint_trajectory,
    target_markers (visualization_msgs/MarkerArray, latched), ~/status and /diagnostics; calls
    jamming_valves/segment_N/set_stiff.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters, topics and the action."""
        super().__init__('shape_sequencer', **options)
        self.parameters = NodeParameters(self, NODE_PARAMETERS['shape_sequencer'])
        for name in self.parameters['shape_names']:
            self.parameters.declare_angles(f'{SHAPE_PREFIX}{name}')
        self.status = Status(self, 'shape sequencer')
        self._arm = arm_from_parameters(self.parameters)
        self._library = shapes_from_parameters(self.parameters, self._arm)
        segments = len(self._arm.segments)
        self._stiff: list[bool | None] = [None] * segments
        self._vacuum = [0.0] * segments
        self._tendons: JointState | None = None
        self._shape: Equilibrium | None = None
        self._ages = {'tendon_actuation (tendon_states)': Age(),
                      'jamming_valves (segment_1/pressure)': Age(),
                      'kinematics (joint_states)': Age()}
        self._tendon_age, self._jamming_age, self._shape_age = self._ages.values()
        self._tendon_status: dict[str, str] = {}
        self._errors: dict[str, tuple[str, Age]] = {}  # by node: what it says, and for how long
        self._sent: set[str] = set()
        self._failed = ''
        self._runner: Runner | None = None
        self._handle: Any = None  # the goal that runs
        self._next: Any = None  # the goal that waits for it to be wound down
        self._targets: list[tuple[float, ...]] = []  # bending angles of the shapes of the goal
        self._target: tuple[float, ...] | None = None  # that is shown
        load_model(self)
        self._planner = Planner(self._arm, self._plan_settings())

        self._trajectory = self.create_publisher(
            JointTrajectory, 'tendon_actuation/joint_trajectory', STREAM)
        self._markers = self.create_publisher(MarkerArray, 'target_markers', LATCHED)
        self._set_stiff = [
            self.create_client(SetBool, f'jamming_valves/segment_{n}/set_stiff')
            for n in range(1, segments + 1)]
        self.create_subscription(JointState, 'tendon_states', self._on_tendons, SENSOR)
        self.create_subscription(JointState, 'joint_states', self._on_shape, SENSOR)
        self.create_subscription(
            DiagnosticStatus, 'tendon_actuation/status', self._on_tendon_status, LATCHED)
        self.create_subscription(
            DiagnosticStatus, 'jamming_valves/status',
            lambda message: self._on_status('jamming_valves', message), LATCHED)
        self._emergency = EmergencyStop(self)
        for i in range(segments):
            self.create_subscription(
                Bool, f'segment_{i + 1}/stiff',
                lambda message, i=i: self._on_stiff(i, message.data), LATCHED)
            self.create_subscription(
                FluidPressure, f'segment_{i + 1}/pressure',
                lambda message, i=i: self._on_pressure(i, message.fluid_pressure), SENSOR)
        self._server = ManualActionServer(
            self, RunShapeSequence, 'run_shape_sequence', lambda handle: None,
            goal_callback=self._on_goal, cancel_callback=self._on_cancel,
            handle_accepted_callback=self._on_accepted, result_timeout=RESULT_TIMEOUT)
        self._timer = self.create_timer(TICK, self._tick)
        self._rejected = ''  # why the newest goal was, as long as none is accepted
        self._last: dict[str, str] = {}
        self._say('idle')
        self._show_target(())  # one that ended before its goal did has left another

    def start(self) -> None:
        """Nothing to do: the node waits for goals."""

    def quit(self) -> None:
        """Hold the tendons before the process ends; segments stay as they are."""
        if self._runner is not None:
            self.hold()
        self._show_target(())

    def destroy_node(self) -> None:
        """Take down the action server before the node, as rclpy needs it."""
        self._server.destroy()
        super().destroy_node()

    # What is heard of the arm.

    def _on_tendons(self, message: JointState) -> None:
        if list(message.name) == list(TENDONS) and len(message.position) == len(TENDONS):
            self._tendons = message
            self._tendon_age.refresh()

    def _on_shape(self, message: JointState) -> None:
        if (len(message.position) == self._planner.statics.chain.joints
                and all(isfinite(angle) for angle in message.position)):
            self._shape = self._planner.statics.chain.state(message.position)
            self._shape_age.refresh()

    def _on_stiff(self, segment: int, stiff: bool) -> None:
        self._stiff[segment] = stiff

    def _on_pressure(self, segment: int, pressure: float) -> None:
        self._vacuum[segment] = self.parameters['ambient_pressure'] - pressure
        self._jamming_age.refresh()

    def _on_tendon_status(self, message: DiagnosticStatus) -> None:
        self._tendon_status = {pair.key: pair.value for pair in message.values}
        self._on_status('tendon_actuation', message)

    def _on_status(self, node: str, message: DiagnosticStatus) -> None:
        if message.level != ERROR:
            self._errors.pop(node, None)
            return
        _, age = self._errors.get(node, ('', Age()))
        if age.seconds == inf:
            age.refresh()
        self._errors[node] = message.message, age

    def _error(self) -> str:
        """Say which error lasts; a device may miss one answer."""
        timeout = self.parameters['silence_timeout']
        return '; '.join(f'{node}: {message}' for node, (message, age) in self._errors.items()
                         if age.seconds > timeout)

    def _stopped(self) -> str:
        if self._emergency.on:
            return 'emergency_stop is on'
        return self._tendon_status.get('stopped', '')

    def _silent(self) -> str:
        """Say which node is not heard; empty when all are."""
        timeout = self.parameters['silence_timeout']
        silent = [name for name, age in self._ages.items() if age.seconds > timeout]
        if None in self._stiff:
            silent.append('jamming_valves (segment_N/stiff)')
        return f'nothing heard for {timeout:g} s of {", ".join(silent)}' if silent else ''

    def _observe(self) -> Observation:
        tendons = self._tendons
        pulls = (tendons.position[0], tendons.position[1]) if tendons else (0.0, 0.0)
        refused = ''
        if self._tendon_status.get('refused_stamp') in self._sent:
            refused = self._tendon_status.get('refused', '') or self._tendon_status.get(
                'ended', '')
        return Observation(
            pulls=pulls, moving=bool(tendons and any(tendons.velocity)),
            stiff=tuple(bool(s) for s in self._stiff), vacuum=tuple(self._vacuum),
            stopped=self._stopped(),
            fault=self._error() or self._silent() or self._failed, refused=refused)

    # How the runner acts on the arm (ArmPort).

    def set_stiff(self, segment: int, stiff: bool) -> None:
        """Ask jamming_valves to evacuate or vent a segment (0-based)."""
        client = self._set_stiff[segment]
        future = client.call_async(SetBool.Request(data=stiff))

        def answered(future: Future) -> None:
            response = future.result()
            if response is not None and not response.success:
                self._failed = f'jamming_valves: {response.message}'

        future.add_done_callback(answered)

    def follow(self, start: float, times: Array, pulls: Array) -> None:
        """Send the next piece of the motion."""
        message = trajectory_to_ros(times, pulls)
        message.header.stamp = RosTime(nanoseconds=int(start * 1e9)).to_msg()
        self._sent.add(_stamp_text(message.header.stamp))
        self._trajectory.publish(message)

    def hold(self) -> None:
        """Tell the tendons to brake and hold: a trajectory without points."""
        self._trajectory.publish(JointTrajectory(joint_names=list(TENDONS)))

    # The action.

    def _on_goal(self, goal: RunShapeSequence.Goal) -> GoalResponse:
        try:
            shapes = self._shapes(goal)
            problem = self._error() or self._silent()
            if not problem and self._stopped():
                problem = (f'tendon motion is stopped ({self._stopped()}); '
                           'call tendon_actuation/resume first')
            if not problem and self._tendon_status.get('referenced') == 'false':
                problem = ('the position of the tendons is not referenced; straighten the arm and '
                           'call tendon_actuation/reference first')
            if problem:
                raise PlanError(problem)
            if self._runner is None and all(self._stiff):
                self._plan(shapes)  # a goal out of reach is refused before anything moves
        except (PlanError, ParameterError) as error:
            self.get_logger().error(f'goal rejected: {error}')
            self._rejected = str(error)
            self._say(self._activity())
            return GoalResponse.REJECT
        self._rejected = ''
        return GoalResponse.ACCEPT

    def _shapes(self, goal: RunShapeSequence.Goal) -> list[Shape]:
        """Return the shapes of a goal; raises PlanError for what is not allowed."""
        if not goal.shapes:
            raise PlanError('the sequence is empty; give at least one shape: '
                            + ', '.join(self._library))
        shapes = []
        for number, item in enumerate(goal.shapes, start=1):
            angles = tuple(item.bending_angles)
            if not angles:
                if item.name not in self._library:
                    raise PlanError(f'shape {number}: unknown shape {item.name!r}; known: '
                                    + ', '.join(self._library))
                angles = self._library[item.name]
            problem = angles_problem(angles, self._arm)
            hold = seconds(item.hold_time)
            if hold < 0.0:
                problem = f'hold_time is {hold:g} s; it must not be negative'
            if problem:
                raise PlanError(f'shape {number} ({item.name or "unnamed"}): {problem}')
            shapes.append(Shape(item.name or f'shape {number}', angles, hold))
        return shapes

    def _plan_settings(self) -> PlanSettings:
        low, high = self.parameters['pull_limits']
        return PlanSettings(
            pull_limits=(low, high), speed=self.parameters['tendon_speed'],
            acceleration=self.parameters['tendon_acceleration'],
            **{name: self.parameters[name] for name in (
                'tension_limit', 'antagonist_slack', 'angle_step', 'angle_tolerance')})

    def _plan(self, shapes: list[Shape]) -> list[ShapePlan]:
        if self._shape is None or self._tendons is None:
            raise PlanError('the shape of the arm is not known: no joint_states or tendon_states')
        self._planner.settings = self._plan_settings()
        return self._planner.plan(self._shape, self._tendons.position, shapes)

    def _on_accepted(self, handle: Any) -> None:
        """Run now, or when the present run has been wound down; only the newest goal waits."""
        handle.execute()
        if self._next is not None:
            self._server.finish(self._next, Outcome(
                Code.PREEMPTED, 'superseded by a newer goal before it started', 0))
        if self._runner is not None:
            self._runner.cancel(Code.PREEMPTED, 'superseded by a newer goal')
        self._next = handle

    def _on_cancel(self, handle: Any) -> CancelResponse:
        self.get_logger().info('cancel requested')
        return CancelResponse.ACCEPT

    def _tick(self) -> None:
        if self._next is not None and self._next.is_cancel_requested:
            self._server.finish(self._next, Outcome(
                Code.CANCELED, 'canceled by the client before it started', 0))
            self._next = None
        if self._runner is None and self._next is not None:
            self._begin(self._next)
            self._next = None
        if self._runner is not None:
            self._go_on(self._runner)

    def _begin(self, handle: Any) -> None:
        self._handle = handle
        self._failed, self._sent = '', set()
        shapes = self._shapes(handle.request)
        self._targets = [shape.bending_angles for shape in shapes]
        self._runner = Runner(
            shapes, lambda shape: self._plan([shape])[0], self,
            RunnerSettings(**{name: self.parameters[name] for name in (
                'jamming_timeout', 'settle_timeout', 'settle_tolerance', 'soft_vacuum')}))

    def _go_on(self, runner: Runner) -> None:
        if self._handle.is_cancel_requested:
            runner.cancel(Code.CANCELED, 'canceled by the client')
        runner.tick(self.get_clock().now().nanoseconds * 1e-9, self._observe())
        progress, outcome = runner.progress, runner.outcome
        self._handle.publish_feedback(RunShapeSequence.Feedback(
            shape_index=progress.shape_index, shape=progress.shape,
            segment=progress.segment, phase=progress.phase, progress=progress.fraction))
        self._show_target(() if outcome else self._targets[progress.shape_index])
        if outcome is None:
            self._say(self._activity(), phase=progress.phase, segment=progress.segment)
            return
        self._runner = None
        self._server.finish(self._handle, outcome)
        if outcome.code is Code.SUCCESSFUL:
            self.get_logger().info(f'sequence done, {outcome.shapes_completed} shapes')
        else:
            self.get_logger().warning(f'sequence ended: {outcome.code.name}: {outcome.message}')
        self._last = {'last': outcome.code.name, 'reason': outcome.message}
        self._say('idle')

    def _show_target(self, bending_angles: tuple[float, ...]) -> None:
        if bending_angles != self._target:
            self._target = bending_angles
            self._markers.publish(target_markers(
                self._planner.statics.chain, bending_angles, self.parameters['frame_id'],
                self.get_clock().now().to_msg()))

    def _say(self, text: str, **values: object) -> None:
        rejected = {'rejected': self._rejected} if self._rejected else {}
        self.status.set(OK, text, **values, **self._last, **rejected)

    def _activity(self) -> str:
        return f'running {self._runner.progress.shape}' if self._runner else 'idle'


def _stamp_text(stamp: Time) -> str:
    """Return a stamp as tendon_actuation's status shows it."""
    return f'{stamp.sec}.{stamp.nanosec:09d}'


