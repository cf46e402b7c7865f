# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS side of the view: hears the arm and asks it for things, like any other client."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import isnan, nan
from time import monotonic, strftime
from typing import Any

from action_msgs.srv import CancelGoal
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.duration import Duration as RosDuration
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from soft_continuum.browser.state import ArmState, Description, Notice, Progress, Report
from soft_continuum.mechanics.arm import TENDONS
from soft_continuum.nodes.runtime import NODES
from soft_continuum.parameters.arm import arm_from_parameters, ARM_PARAMETERS
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.parameters.shapes import SHAPE_PREFIX, shapes_from_parameters
from soft_continuum.ros.conversions import trajectory_to_ros
from soft_continuum.ros.qos import LATCHED, SENSOR, STREAM
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Shape

ANSWER_TIMEOUT = 5.0  # s for a service; a rig's board answers within a fraction of one
JOG_SPEED = 0.01  # m/s
JOG_LEAD = 0.05  # s from sending a jog to its start
SEQUENCE_HOLD = 1.0  # s
REASON_DELAY = 0.3  # s
NOTICES = 50
HOW_TO_START = 'start it with `./run up` or `ros2 launch soft_continuum bringup.launch.py`'


@dataclass(frozen=True)
class Pending:
    """A request that was not answered yet, and until when it may be, s."""

    deadline: float
    title: str
    client: Any
    future: Any


class Browser(Node):  # type: ignore[misc]  # rclpy is not typed
    """
    Knows the arm's ``state`` and ``description``, and passes on what a browser asks for.

    Subscribes to ~/status of the four nodes, /diagnostics, joint_states, tendon_states,
    tendon_tensions, target_markers, segment_N/stiff, segment_N/pressure and the feedback of
    run_shape_sequence.
    Publishes tendon_actuation/joint_trajectory.  Calls the services of tendon_actuation,
    jamming_valves and kinematics, the action, and get_parameters of kinematics and
    shape_sequencer.  All of it in the thread that spins: others go through ``soon``.
    """

    def __init__(self, **options: Any) -> None:
        """Subscribe to what does not depend on the arm."""
        super().__init__('browser', **options)
        self.state = ArmState()
        self.description: Description | None = None
        self.notices: deque[Notice] = deque(maxlen=NOTICES)
        self._notice_count = 0
        self._pending: list[Pending] = []
        self._later: list[tuple[float, Callable[[], None]]] = []
        self._segments: list[Any] = []  # subscriptions and clients of the segments
        self._set_stiff: list[Any] = []
        self._triggers: dict[str, Any] = {}
        self._jog: tuple[float, list[float]] = 0.0, []  # s until when it moves, target pulls in m
        self._jog_stamps: deque[str] = deque(maxlen=20)
        self._open = True
        for name in NODES:
            self.create_subscription(
                DiagnosticStatus, f'{name}/status', partial(self._on_status, name), LATCHED)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self.create_subscription(JointState, 'joint_states', self._on_joints, SENSOR)
        self.create_subscription(JointState, 'tendon_states', self._on_tendons, SENSOR)
        self.create_subscription(JointState, 'tendon_tensions', self._on_tensions, SENSOR)
        self.create_subscription(
            RunShapeSequence.Impl.FeedbackMessage, 'run_shape_sequence/_action/feedback',
            self._on_feedback, SENSOR)
        self.create_subscription(MarkerArray, 'target_markers', self._on_target, LATCHED)
        self._trajectory = self.create_publisher(
            JointTrajectory, 'tendon_actuation/joint_trajectory', STREAM)
        self._set_all = self.create_client(SetBool, 'jamming_valves/set_all_stiff')
        for name in ('tendon_actuation/stop', 'tendon_actuation/resume',
                     'tendon_actuation/reference', 'kinematics/reset'):
            self._triggers[name] = self.create_client(Trigger, name)
        self._describers = {name: self.create_client(GetParameters, f'{name}/get_parameters')
                            for name in ('kinematics', 'shape_sequencer')}
        self._cancel = self.create_client(CancelGoal, 'run_shape_sequence/_action/cancel_goal')
        self._action = ActionClient(self, RunShapeSequence, 'run_shape_sequence')

    def quit(self) -> None:
        """Take no more requests; what the arm does is not changed by the end of a view."""
        self._open = False

    def destroy_node(self) -> None:
        """Take down the action client before the node, as rclpy needs it."""
        self._action.destroy()
        super().destroy_node()

    def soon(self, work: Callable[[], None]) -> None:
        """Do ``work`` in the thread that spins."""
        if self._open and self.executor is not None:
            self.executor.create_task(work)

    def look_after(self) -> None:
        """Give up on answers that do not come; to be called now and then."""
        now = monotonic()
        for pending in [p for p in self._pending if now > p.deadline]:
            self._pending.remove(pending)
            pending.client.remove_pending_request(pending.future)
            if pending.title:
                self.say(pending.title, f'no answer within {ANSWER_TIMEOUT:g} s', refused=True)
        due = [work for time, work in self._later if now > time]
        self._later = [item for item in self._later if now <= item[0]]
        for work in due:
            work()

    def say(self, title: str, text: str, *, refused: bool = False) -> None:
        """Add a notice."""
        self._notice_count += 1
        self.notices.append(Notice(self._notice_count, strftime('%H:%M:%S'), title, text, refused))

    # What is heard.

    def _on_status(self, name: str, message: DiagnosticStatus) -> None:
        before = self.state.reports.get(name)
        values = {pair.key: pair.value for pair in message.values}
        self.state.reports[name] = Report(message.level[0], message.message, values, monotonic())
        if name == 'tendon_actuation' and before is not None:
            if values.get('stopped') or values.get('ended'):
                self._jog = 0.0, []
            stamp = values.get('refused_stamp', '')
            if values.get('refused') and stamp in self._jog_stamps:
                self._jog_stamps.remove(stamp)
                self._jog = 0.0, []
                self.say('Jog refused', values['refused'], refused=True)
            ended = values.get('ended', '')
            if ended and ended != before.values.get('ended'):
                self.say('Motion ended', ended, refused=True)
        if name == 'shape_sequencer' and 'phase' not in values:
            self.state.progress = None

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        space = self.get_namespace().strip('/')
        for status in message.status:
            before, _, name = status.name.rpartition('/')
            if before == space and name in self.state.reports:
                self.state.reports[name] = replace(self.state.reports[name], time=monotonic())

    def _on_joints(self, message: JointState) -> None:
        self.state.joint_angles = tuple(message.position)

    def _on_tendons(self, message: JointState) -> None:
        if list(message.name) == list(TENDONS) and len(message.position) == len(TENDONS):
            self.state.pulls = message.position[0], message.position[1]
            self.state.moving = any(message.velocity)

    def _on_tensions(self, message: JointState) -> None:
        if len(message.effort) == len(TENDONS):
            self.state.tensions = message.effort[0], message.effort[1]

    def _on_target(self, message: MarkerArray) -> None:
        self.state.target = tuple((p.x, p.z) for m in message.markers for p in m.points)

    def _on_feedback(self, message: Any) -> None:
        feedback = message.feedback
        self.state.progress = Progress(
            feedback.shape_index, feedback.shape, feedback.segment, feedback.phase,
            feedback.progress, monotonic())

    def _on_stiff(self, segment: int, message: Bool) -> None:
        self.state.stiff[segment] = message.data

    def _on_pressure(self, segment: int, message: FluidPressure) -> None:
        assert self.description is not None
        self.state.vacuum[segment] = self.description.ambient_pressure - message.fluid_pressure

    # What the nodes were started with.

    def learn(self) -> None:
        """Ask for the description of the arm; it may be another one after a restart."""
        self._ask('kinematics', [p.name for p in ARM_PARAMETERS], self._learn_shapes)

    def _ask(self, node: str, names: Sequence[str],
             then: Callable[[dict[str, Any]], None]) -> None:
        client = self._describers[node]
        if client.service_is_ready():
            def answered(answer: Any) -> None:
                values = map(parameter_value_to_python, answer.values)
                then(dict(zip(names, values, strict=False)))
            self._call(client, GetParameters.Request(names=names), '', answered)

    def _learn_shapes(self, values: dict[str, Any]) -> None:
        if len(values) < len(ARM_PARAMETERS):  # of another version: do not draw a default arm
            self.say('The arm is not known', 'kinematics lacks parameters of an arm; run nodes '
                     'and view from the same version', refused=True)
            return
        try:
            arm = arm_from_parameters(values)
        except ParameterError as error:
            self.say('The arm is not known', str(error), refused=True)
            return
        if self.description is None or self.description.arm != arm:
            self._describe(Description(arm))
        self._ask('shape_sequencer', ['shape_names', 'ambient_pressure', 'tension_limit'],
                  self._learn_angles)

    def _learn_angles(self, values: dict[str, Any]) -> None:
        names = values.get('shape_names')
        if not names:
            return
        found = dict(values)
        left = len(names)

        def add(angles: dict[str, Any]) -> None:
            nonlocal left
            found.update(angles)
            left -= 1
            if left or self.description is None:
                return
            arm = self.description.arm
            try:
                shapes = shapes_from_parameters(found, arm)
            except ParameterError as error:
                self.say('The shapes are not known', str(error), refused=True)
                return
            self._describe(Description(
                arm, shapes, found['ambient_pressure'], found['tension_limit']))

        for name in names:  # one by one: a node that lacks one parameter gives none
            self._ask('shape_sequencer', [SHAPE_PREFIX + name], add)

    def _describe(self, description: Description) -> None:
        before, self.description = self.description, description
        if before is not None and before.arm == description.arm:
            return
        for entity in self._segments:
            self.destroy_subscription(entity)
        for client in self._set_stiff:
            self.destroy_client(client)
        count = len(description.arm.segments)
        self.state.joint_angles = ()
        self.state.stiff, self.state.vacuum = [None] * count, [nan] * count
        self._segments, self._set_stiff = [], []
        for i in range(count):
            name = f'segment_{i + 1}'
            self._segments += [
                self.create_subscription(
                    Bool, f'{name}/stiff', partial(self._on_stiff, i), LATCHED),
                self.create_subscription(
                    FluidPressure, f'{name}/pressure', partial(self._on_pressure, i), SENSOR)]
            self._set_stiff.append(
                self.create_client(SetBool, f'jamming_valves/{name}/set_stiff'))

    # What is asked for.

    def stop(self) -> None:
        """Stop the tendons."""
        self._trigger('tendon_actuation/stop', 'Stop')

    def resume(self) -> None:
        """Allow motion again."""
        self._trigger('tendon_actuation/resume', 'Resume')

    def reference(self) -> None:
        """Take the present position of the tendons as that of the straight arm."""
        self._trigger('tendon_actuation/reference', 'Reference')

    def reset(self) -> None:
        """Take the arm to be straight."""
        self._trigger('kinematics/reset', 'Reset')

    def _trigger(self, service: str, title: str) -> None:
        self._jog = 0.0, []
        self._call(self._triggers[service], Trigger.Request(), title,
                   lambda answer: self.say(title, answer.message, refused=not answer.success))

    def set_stiff(self, segment: int, stiff: bool) -> None:
        """Evacuate or vent a segment (0-based)."""
        if segment < len(self._set_stiff):  # another arm may have come since the click
            self._switch(self._set_stiff[segment], f'Segment {segment + 1}', stiff)

    def stiffen_all(self) -> None:
        """Evacuate every segment."""
        self._switch(self._set_all, 'All segments', True)

    def _switch(self, client: Any, name: str, stiff: bool) -> None:
        title = f'{name} {"stiff" if stiff else "soft"}'
        if self._is_busy(title):
            return

        def answered(answer: Any) -> None:
            if not answer.success:
                self.say(f'{title}: refused', answer.message, refused=True)

        self._call(client, SetBool.Request(data=stiff), title, answered)

    def jog(self, tendon: int, step: float) -> None:
        """Pull a tendon (0: right, 1: left) by ``step`` m, or let it out."""
        if not self.state.hears('tendon_actuation') or isnan(sum(self.state.pulls)):
            self.say('Jog refused', f'tendon_actuation is not heard; {HOW_TO_START}', refused=True)
            return
        if self._is_busy('Jog'):
            return
        now = monotonic()
        until, target = self._jog
        if now > until or not target:  # a click while it moves goes on from where it will be
            target = list(self.state.pulls)
        target[tendon] += step
        duration = max(abs(t - p) for t, p in zip(target, self.state.pulls, strict=True))
        duration = max(0.2, duration / JOG_SPEED)
        self._jog = now + JOG_LEAD + duration + 0.2, target
        message = trajectory_to_ros(np.array([duration]), np.array([target]))
        start = self.get_clock().now() + RosDuration(seconds=JOG_LEAD)
        message.header.stamp = start.to_msg()
        stamp = message.header.stamp
        self._jog_stamps.append(f'{stamp.sec}.{stamp.nanosec:09d}')
        self._trajectory.publish(message)

    def _is_busy(self, title: str) -> bool:
        """Refuse what would come between a sequence and the arm."""
        if self.state.running is None:
            return False
        self.say(f'{title}: refused', 'a sequence is running; cancel or stop it first',
                 refused=True)
        return True

    def run(self, names: Sequence[str]) -> None:
        """Send shapes of the library to the shape_sequencer."""
        if not self._action.server_is_ready():
            self.say('Sequence', f'shape_sequencer does not run; {HOW_TO_START}', refused=True)
            return
        goal = RunShapeSequence.Goal(shapes=[
            Shape(name=name, hold_time=Duration(sec=int(SEQUENCE_HOLD))) for name in names])
        self._action.send_goal_async(goal).add_done_callback(self._on_answer)

    def _on_answer(self, future: Future) -> None:
        handle = future.result()
        if handle.accepted:
            handle.get_result_async().add_done_callback(self._on_result)
        else:  # the reason is on ~/status, which may come after the answer
            self._later.append((monotonic() + REASON_DELAY, lambda: self.say(
                'Sequence refused', self.state.value('shape_sequencer', 'rejected')
                or 'shape_sequencer did not say why', refused=True)))

    def _on_result(self, future: Future) -> None:
        result = future.result().result
        if result.error_code == RunShapeSequence.Result.SUCCESSFUL:
            self.say('Sequence done', f'shapes reached: {result.shapes_completed}')
        else:
            self.say('Sequence ended', result.error_string, refused=True)

    def cancel(self) -> None:
        """Cancel every running sequence, whoever started it."""
        self._call(self._cancel, CancelGoal.Request(), 'Cancel', lambda answer: None)

    def _call(self, client: Any, request: Any, title: str,
              then: Callable[[Any], None]) -> None:
        """Call a service; ``title`` names it in a notice if it cannot be, empty: no notice."""
        if not client.service_is_ready():
            path = client.srv_name.split('/')
            node = next((part for part in path if part in NODES), 'shape_sequencer')
            self.say(title, f'{node} does not run; {HOW_TO_START}', refused=True)
            return
        future = client.call_async(request)
        pending = Pending(monotonic() + ANSWER_TIMEOUT, title, client, future)
        self._pending.append(pending)

        def done(future: Future) -> None:
            if pending in self._pending:
                self._pending.remove(pending)
                then(future.result())

        future.add_done_callback(done)
