# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Nodes in this process on a ROS domain of their own, and an observer that talks to them over DDS.

Nodes spin on threads of their own, as they would in processes of their own, and so does the
observer.  A test waits for what it is told, with a deadline, and never for time to pass.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass, field
from functools import cache, partial
from inspect import signature
import threading
import time
import traceback
from typing import Any

from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soft_continuum.nodes.runtime import node_class
from soft_continuum.parameters.shapes import DIRECTION_PREFIX, SHAPE_PREFIX
from soft_continuum.ros.description import load_description
from soft_continuum.ros.entries import make_executor
from soft_continuum.ros.names import NODES
from soft_continuum.ros.parameter_table import NODE_PARAMETERS
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import (
    JammingValvesState,
    Shape,
    ShapeSequencerState,
    TendonActuationState,
    TendonTrajectory,
)

DEADLINE = 60.0  # s: for what takes a fraction of a second on an idle machine
ANSWER_TIMEOUT = 10.0  # s after which a service is asked again
POLL = 0.01  # s between two looks at a condition: to look at each message costs more than the arm
SEGMENTS = 3
TENDONS = ('right_tendon', 'left_tendon')
ALL = tuple(NODES)
AMBIENT = 101325.0  # Pa
STIFF_VACUUM = 50e3  # Pa

QUICK = {
    'simulated_jamming.evacuation_time': 0.03,
    'simulated_jamming.venting_time': 0.03,
    'simulated_jamming.valve_delay': 0.0,
    'jamming_rate': 25.0,  # half of what is usual, for half of the messages
    'tendon_rate': 25.0,
    'tendon_speed': 0.1,
    'tendon_acceleration': 5.0,
    'speed_limit': 1.0,  # so far above that a message may come late
    'acceleration_limit': 100.0,
    'stale_timeout': 10.0,
}
"""An arm that sets a segment in half a second, and nodes that wait for a busy machine."""
STREAM = QoSProfile(depth=5000, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)

# Each would be waited for beside every message.
NO_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)

STATES = {'tendon_actuation': TendonActuationState, 'jamming_valves': JammingValvesState,
          'shape_sequencer': ShapeSequencerState}
STATUS_NAMES = {
    GoalStatus.STATUS_SUCCEEDED: 'SUCCEEDED', GoalStatus.STATUS_CANCELED: 'CANCELED',
    GoalStatus.STATUS_ABORTED: 'ABORTED',
}


@cache
def _description() -> dict[str, Any]:
    """Return config/manipulator.yaml, which takes longer to read than a node to start."""
    return load_description(description_file())


def parameter_values(node: str, **changes: Any) -> list[Parameter]:
    """Return config/manipulator.yaml for a node, made quick; __ in a name stands for a dot."""
    named = {name.replace('__', '.'): value for name, value in changes.items()}
    values = {**_description(), **QUICK, **named}
    known = {p.name for p in NODE_PARAMETERS[node]}
    shapes = node == 'shape_sequencer'
    return [
        Parameter(name, value=list(value) if isinstance(value, tuple) else value)
        for name, value in values.items()
        if name in known or (shapes and name.startswith((SHAPE_PREFIX, DIRECTION_PREFIX)))]


def trajectory(points: Sequence[tuple[float, Sequence[float]]],
               names: Sequence[str] = TENDONS) -> JointTrajectory:
    """Return a trajectory that starts now through (time in s, positions in m)."""
    message = JointTrajectory(joint_names=list(names))
    for seconds, positions in points:
        whole = int(seconds // 1)
        message.points.append(JointTrajectoryPoint(
            positions=[float(p) for p in positions],
            time_from_start=Duration(sec=whole, nanosec=int((seconds - whole) * 1e9))))
    return message


@dataclass(frozen=True)
class Heard:
    """One message, and when its publisher wrote it, ns."""

    time: int
    message: Any


TWO = signature(lambda message, info: None)


@dataclass
class Recording:
    """All that was heard on one topic."""

    topic: str
    heard: list[Heard] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.heard)

    def __iter__(self) -> Iterator[Any]:
        return iter([h.message for h in self.heard])

    @property
    def last(self) -> Any:
        """The latest message, or None."""
        return self.heard[-1].message if self.heard else None


def make(name: str, **options: Any) -> Any:
    """Return a node under test; one that refuses its parameters leaves nothing behind."""
    kind: Any = node_class(name)
    node = kind.__new__(kind)
    try:
        node.__init__(**options)
    except BaseException:
        Node.destroy_node(node)  # its own may take down what is not there yet
        vars(node).pop('_state_machine', None)
        raise
    return node


def destroy(node: Any) -> None:
    """Take a node down, with all that rclpy keeps of it."""
    node.destroy_node()
    vars(node).pop('_state_machine', None)  # of a lifecycle node: rclpy leaves it


class Spinner:
    """An executor on a thread of its own; keeps what a callback raised."""

    def __init__(self, executor: Executor, nodes: Sequence[Any], context: Context) -> None:
        self.failure = ''
        self.nodes = list(nodes)
        self._names = ', '.join(node.get_name() for node in nodes)
        self._executor = executor
        self._context = context
        self._ended = False
        for node in nodes:
            executor.add_node(node)
        self._thread = threading.Thread(target=self._spin, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def _spin(self) -> None:
        try:
            while not self._ended and self._context.ok():
                self._executor.spin_once(timeout_sec=0.05)
        except BaseException:
            self.failure = f'{self._names} died of:\n{traceback.format_exc()}'

    def end(self) -> None:
        self._ended = True
        self._executor.wake()
        self._thread.join(DEADLINE)
        assert not self._thread.is_alive(), f'one of {self._names} hangs in a callback'
        # A task that is never done keeps its node, and with it the sockets of a domain, for ever.
        # The nodes are not taken away meanwhile: see Requests.destroy.
        tasks_before = self._executor.create_task(lambda: None)
        while not tasks_before.done():
            self._executor.spin_once(timeout_sec=0.0)
        for node in self.nodes:
            node.quit()
        self._executor.shutdown()
        for node in self.nodes:
            destroy(node)


class Observer(Node):
    """The node of the test."""

    def __init__(self, **options: Any) -> None:
        super().__init__('observer', **options)
        # Of an observer that comes late no feedback is dropped.
        self.action = ActionClient(
            self, RunShapeSequence, 'run_shape_sequence', feedback_sub_qos_profile=RELIABLE)

    def quit(self) -> None:
        """Take down action clients before the node, as rclpy needs it."""
        for each in [each for each in self.waitables if isinstance(each, ActionClient)]:
            each.destroy()


class Goal:
    """A goal that was sent: its feedback, and how it ended."""

    def __init__(self, rig: 'Rig', shapes: Sequence[Shape], aim: int = 0) -> None:
        self.feedback: list[tuple[float, Any]] = []  # s (steady), message
        self._rig = rig
        self._future = rig.on_ros_thread(
            rig.action.send_goal_async, RunShapeSequence.Goal(shapes=list(shapes), aim=aim),
            self._on_feedback)
        self._result: Any = None
        self.ended_time = 0  # ns, on the clock of Heard.time

    def _on_end(self, _: Any) -> None:
        self.ended_time = time.time_ns()

    def _on_feedback(self, message: Any) -> None:
        self.feedback.append((time.monotonic(), message.feedback))

    @property
    def accepted(self) -> bool:
        """Whether the goal was accepted."""
        handle = self._rig.wait_future(self._future, 'an answer to the goal')
        if handle.accepted and self._result is None:
            self._result = self._rig.on_ros_thread(handle.get_result_async)
            self._result.add_done_callback(self._on_end)
        return bool(handle.accepted)

    @property
    def goal_id(self) -> Any:
        """The identity of the goal, of a rejected one too."""
        return self._rig.wait_future(self._future, 'an answer to the goal').goal_id

    def result(self, within: float = DEADLINE) -> tuple[str, Any]:
        """Return the status and the result, once the goal has ended."""
        assert self.accepted, f'the goal was rejected: {self._rig.rejection(self)}'
        response = self._rig.wait_future(self._result, 'the result of the goal', within)
        self._rig.wait_for(lambda: self.ended_time, 'the end of the goal to be noted')
        return STATUS_NAMES.get(response.status, str(response.status)), response.result

    def assert_ended(self, status: str, *words: str, code: int | None = None) -> Any:
        """Claim how it ended, and that its reason has all of the words; return the result."""
        ended, result = self.result()
        assert ended == status, result.error_string
        assert code is None or result.error_code == code, result.error_string
        assert all(word in result.error_string for word in words), result.error_string
        assert ended != 'SUCCEEDED' or (result.error_code, result.error_string) == (0, '')
        return result

    def assert_rejected(self, *words: str) -> None:
        """Claim that it was not accepted, and that the reason has all of the words."""
        assert not self.accepted
        reason = self._rig.rejection(self)
        assert all(word in reason for word in words), reason

    @property
    def ended(self) -> bool:
        """Whether the result has come."""
        return self._result is not None and self._result.done()

    def cancel(self) -> None:
        """Ask for the goal to be canceled."""
        assert self.accepted, f'the goal was rejected: {self._rig.rejection(self)}'
        self._rig.wait_future(
            self._rig.on_ros_thread(self._future.result().cancel_goal_async),
            'an answer to the cancel request')

    def wait_for_phase(self, phase: str) -> 'Goal':
        """Return itself, once there is feedback in ``phase``."""
        assert self.accepted, f'the goal was rejected: {self._rig.rejection(self)}'

        def begun() -> bool:
            ended = self.ended  # before its feedback is looked at
            found = any(f.phase == phase for _, f in self.feedback)
            assert found or not ended, f'ended before {phase}: {self._result.result()}'
            return found
        self._rig.wait_for(begun, f'phase {phase}')
        return self

    @property
    def phases(self) -> list[tuple[str, int, str]]:
        """Shape, segment and phase in the order of the feedback, without repetitions."""
        seen = [(f.shape, f.segment, f.phase) for _, f in self.feedback]
        return [now for before, now in zip([None, *seen], seen, strict=False) if now != before]


class Rig:
    """Nodes under test, what they say, and ways to talk to them."""

    def __init__(self, domain: int, namespace: str = '/arm_under_test') -> None:
        self.domain, self.namespace = domain, namespace
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.observer = Observer(context=self.context, namespace=namespace)
        self._groups: list[Spinner] = []
        self._recordings: list[Recording] = []
        self._clients: dict[str, Any] = {}
        self._publishers: dict[str, Any] = {}
        self.action = self.observer.action
        self.statuses = {
            name: self.record(DiagnosticStatus, f'{name}/status', LATCHED) for name in ALL}
        self.states = {
            name: self.record(kind, f'{name}/state', LATCHED) for name, kind in STATES.items()}
        self.sequencer = self.states['shape_sequencer']
        self.tendons = self.record(JointState, 'tendon_states', RELIABLE)
        self.stiff = [self.record(Bool, f'segment_{n}/stiff', LATCHED)
                      for n in range(1, SEGMENTS + 1)]
        self.pressures = [self.record(FluidPressure, f'segment_{n}/pressure', RELIABLE)
                          for n in range(1, SEGMENTS + 1)]
        self.joints = self.record(JointState, 'joint_states', RELIABLE)
        self.segment_poses = self.record(PoseArray, 'segment_poses', RELIABLE)
        self.disc_poses = self.record(PoseArray, 'disc_poses', RELIABLE)
        self._observing = Spinner(
            make_executor(self.context), [self.observer], self.context)
        self._observing.start()

    # Nodes.

    def start(self, *names: str, ready: bool = True, remapped: tuple[str, str] = ('', ''),
              **parameters: Any) -> list[Any]:
        """Start nodes in this process, on one thread, and wait until they are heard."""
        rules = ['--ros-args', '-r', ':='.join(remapped)] if remapped[0] else None
        nodes = [
            make(name, context=self.context, namespace=self.namespace, cli_args=rules,
                 parameter_overrides=parameter_values(name, **parameters))
            for name in names]
        group = Spinner(make_executor(self.context), nodes, self.context)
        self._groups.append(group)
        for node in nodes:
            node.start()
        group.start()
        if ready:
            self.wait_until_ready(*names)
        return nodes

    def start_arm(self, **parameters: Any) -> list[Any]:
        """Start all four nodes and wait until they know of each other."""
        return self.start(*ALL, **parameters)

    def wait_until_ready(self, *names: str) -> None:
        """Wait until the named nodes say what they have to say."""
        heard = {
            'tendon_actuation': [self.tendons, self.states['tendon_actuation']],
            'jamming_valves': self.pressures,
            'kinematics': [],
            'shape_sequencer': [self.sequencer],
        }
        self.wait_for(lambda: all(all(map(len, [self.statuses[name], *heard[name]]))
                                  for name in names),
                      f'words from {", ".join(names)}')
        if 'jamming_valves' in names:
            state = self.states['jamming_valves']
            self.wait_for(
                lambda: state.last and state.last.connected and all(
                    len(flag) and flag.last.data == (stiffness == JammingValvesState.STIFF)
                    for flag, stiffness in zip(self.stiff, state.last.stiffness, strict=True)),
                'the state of the valves')
        if set(names) >= set(ALL):
            tendons = self.states['tendon_actuation']
            self.wait_for(lambda: len(self.joints) or not tendons.last.referenced, 'joint_states')
            if tendons.last.referenced:
                self.wait_for_shape()

    def wait_for_shape(self) -> None:
        """Wait until tendon_actuation has heard of a shape too: before, it moves nothing."""
        self.wait_for(lambda: len(self.joints) and all(
            node._arm.shape is not None for group in self._groups for node in group.nodes
            if node.get_name() == 'tendon_actuation'), 'a shape, in tendon_actuation too')

    def end(self, node: Any) -> None:
        """End the nodes that were started together with ``node``."""
        group = next(g for g in self._groups if node in g.nodes)
        self._groups.remove(group)
        group.end()

    @property
    def nodes(self) -> list[Any]:
        """The nodes under test that run in this process."""
        return [node for group in self._groups for node in group.nodes]

    def node(self, name: str) -> Any:
        """Return the node under test of that name, in this process."""
        return next(node for node in self.nodes if node.get_name() == name)

    def end_all(self) -> None:
        """End every node under test."""
        for group in list(self._groups):
            group.end()
            self._groups.remove(group)

    def close(self) -> None:
        """Take everything down; fails if a node raised anything."""
        with ExitStack() as ends:  # each, whatever becomes of the others
            ends.callback(self.check)
            ends.callback(self.context.try_shutdown)
            for group in [self._observing, *self._groups]:
                ends.callback(group.end)

    def check(self) -> None:
        """Fail if a node, or the observer, raised anything."""
        for group in [*self._groups, self._observing]:
            if group.failure:
                pytest.fail(group.failure)

    # Waiting.

    def wait_for(self, condition: Callable[[], Any], what: str, within: float = DEADLINE) -> Any:
        """Return what ``condition`` gives, as soon as that is true; fail after ``within`` s."""
        value = self.until(condition, within)
        if not value:
            said = {name: r.last and (r.last.message, pairs(r.last))
                    for name, r in self.statuses.items()}
            pytest.fail(f'not within {within:g} s: {what}\nlast said: {said}')
        return value

    def until(self, condition: Callable[[], Any], within: float) -> Any:
        """Return what ``condition`` gives, as soon as that is true or after ``within`` s."""
        deadline = time.monotonic() + within
        while True:
            value = condition()
            if value or time.monotonic() > deadline:
                return value
            time.sleep(POLL)
            self.check()

    def wait_future(self, future: Any, what: str, within: float = DEADLINE) -> Any:
        """Return the result of a future."""
        self.wait_for(future.done, what, within)
        return future.result()

    def on_ros_thread(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return what a call returns; an answer to rclpy's action client cannot come before it."""
        return self.wait_future(
            self.observer.executor.create_task(function, *arguments), f'a call of {function}')

    def wait_for_more(self, recording: Recording, count: int = 10) -> list[Any]:
        """
        Return ``count`` messages that were written after this call.

        What was written before may still be on its way, behind the news of other topics.
        """
        begin, before = time.time_ns(), len(recording)

        def written() -> list[Any]:
            found = [h.message for h in recording.heard[before:] if h.time > begin]
            return found if len(found) >= count else []

        found: list[Any] = self.wait_for(
            written, f'{count} more messages on {recording.topic}')
        return found

    # Topics, services, parameters.

    def record(self, kind: Any, topic: str, qos: QoSProfile) -> Recording:
        """Record a topic from now on."""
        recording = Recording(topic)
        self._recordings.append(recording)

        def note(*given: Any) -> None:
            # The executor of events gives both as one (rclpy 7.1).
            message, info = given if len(given) == 2 else given[0]
            recording.heard.append(Heard(info['source_timestamp'], message))

        note.__signature__ = TWO  # type: ignore[attr-defined]  # as rclpy asks what to give it
        self.observer.create_subscription(kind, topic, note, qos, event_callbacks=NO_EVENTS)
        return recording

    def clear(self) -> None:
        """Forget all messages but the last of each topic, between tests that share an arm."""
        for recording in self._recordings:
            del recording.heard[:-1]

    def publisher(self, kind: Any, topic: str, qos: QoSProfile = RELIABLE) -> Any:
        """Return a publisher whose subscribers have found it."""
        if topic not in self._publishers:
            publisher = self.observer.create_publisher(kind, topic, qos)
            self.wait_for(publisher.get_subscription_count, f'a subscriber of {topic}')
            self._publishers[topic] = publisher
        return self._publishers[topic]

    @contextmanager
    def stranger(self) -> Iterator[Node]:
        """Open a node that is none of the suite, whose executor is nobody's."""
        context = Context()
        rclpy.init(context=context, domain_id=self.domain)
        node = Node('stranger', context=context, namespace=self.namespace)
        yield node
        node.destroy_node()
        context.try_shutdown()
        self.wait_for(lambda: not any(
            recording.last and 'stranger' in recording.last.message
            for recording in self.statuses.values()), 'an end of the conflict')

    def send(self, message: JointTrajectory, motion: str = '') -> None:
        """Send a trajectory to the tendons, or a part of a motion with an id."""
        topic = 'tendon_actuation/tendon_trajectory' if motion else (
            'tendon_actuation/joint_trajectory')
        self.publisher(TendonTrajectory if motion else JointTrajectory, topic).publish(
            TendonTrajectory(id=motion, trajectory=message) if motion else message)

    def call(self, kind: Any, name: str, within: float = DEADLINE, **request: Any) -> Any:
        """
        Call a service and return its response.

        What may be asked twice is asked again: DDS drops the answer of a node that has not yet
        found who asks, which happens when one of both has just been started.
        """
        if name not in self._clients:
            self._clients[name] = self.observer.create_client(kind, name)
        client = self._clients[name]
        self.wait_for(client.service_is_ready, f'service {name}')
        future = client.call_async(kind.Request(**request))
        if kind is not ChangeState and not self.until(future.done, ANSWER_TIMEOUT):
            client.remove_pending_request(future)
            future = client.call_async(kind.Request(**request))
        return self.wait_future(future, f'an answer of {name}', within)

    def trigger(self, name: str) -> Any:
        """Call a std_srvs/Trigger service."""
        return self.call(Trigger, name)

    def set_stiff(self, segment: int, stiff: bool) -> Any:
        """Switch a segment (from 1), wait until it is confirmed, return the answer."""
        flags = self.stiff[segment - 1]
        before = len(flags)
        answer = self.call(SetBool, f'jamming_valves/segment_{segment}/set_stiff', data=stiff)
        if answer.success:
            # A sequence may have switched it back before this is looked at.
            self.wait_for(lambda: flags.last.data == stiff or any(
                m.data == stiff for m in list(flags)[before:]),
                f'segment {segment} {"stiff" if stiff else "soft"}')
        return answer

    def stiffen(self) -> None:
        """Make every segment stiff."""
        assert self.call(SetBool, 'jamming_valves/set_all_stiff', data=True).success
        self.wait_for(lambda: self.all_stiff, 'a stiff arm')

    def soften(self, segment: int) -> None:
        """Make a segment soft and wait until there is next to no vacuum left in it."""
        assert self.set_stiff(segment, False).success
        self.wait_for(
            lambda: AMBIENT - self.pressures[segment - 1].last.fluid_pressure < 5e3,
            f'air in segment {segment}')

    def transition(self, node: str, name: str) -> bool:
        """Ask for a lifecycle transition; return whether it succeeded."""
        number = getattr(Transition, f'TRANSITION_{name.upper()}')
        return bool(self.call(
            ChangeState, f'{node}/change_state', transition=Transition(id=number)).success)

    def transitions(self, node: str, *names: str) -> None:
        """Go through lifecycle transitions, each of which has to succeed."""
        for name in names:
            assert self.transition(node, name), name

    def lifecycle_state(self, node: str) -> str:
        """Return the lifecycle state of a node."""
        return str(self.call(GetState, f'{node}/get_state').current_state.label)

    def set_parameter(self, node: str, name: str, value: Any) -> Any:
        """Set one parameter; return the result."""
        return self.call(SetParameters, f'{node}/set_parameters', parameters=[
            Parameter(name, value=value).to_parameter_msg()]).results[0]

    def status_value(self, node: str, key: str) -> str:
        """Return one value of the latest ~/status of a node."""
        return pairs(self.statuses[node].last).get(key, '')

    def wait_for_status(self, node: str, key: str, text: str = '', after: int = 0) -> str:
        """Return a value of ~/status that contains ``text``, said after ``after`` statuses."""
        def found() -> str:
            for message in list(self.statuses[node])[after:]:
                value = pairs(message).get(key, '')
                if value and text in value:
                    return value
            return ''
        return str(self.wait_for(found, f'{node}/status with {key}: …{text}…'))

    # The action.

    def goal(self, *shapes: str | Sequence[float] | Shape, hold: float = 0.0,
             aim: int = 0) -> Goal:
        """Send shapes by name or by angles (rad)."""
        self.wait_for(self.action.server_is_ready, 'the action server')
        return Goal(self, [shape_message(shape, hold) for shape in shapes], aim)

    def goal_when_heard(self, *shapes: str | Sequence[float] | Shape, hold: float = 0.0) -> Goal:
        """Send shapes to a sequencer that may not have found all the others yet."""
        def accepted() -> Goal | None:
            goal = self.goal(*shapes, hold=hold)
            return goal if goal.accepted else None
        return self.wait_for(accepted, 'an accepted goal')  # type: ignore[no-any-return]

    def goal_in_motion(self, *shapes: str | Sequence[float] | Shape, hold: float = 600.0) -> Goal:
        """
        Return an accepted goal once it moves the tendons, of nodes that may only start.

        It is held, so that it has not ended before a late test does something to it.
        """
        def moving() -> Goal | None:
            goal = self.goal_when_heard(*shapes, hold=hold)
            self.wait_for(lambda: goal.ended or (self.moving and abs(self.pulls[0]) > 1e-4),
                          'a motion')
            if not goal.ended:
                return goal
            return None
        return self.wait_for(moving, 'a moving arm')  # type: ignore[no-any-return]

    def rejection(self, goal: Goal) -> str:
        """Return why ``goal`` was rejected, as the state of the sequencer says."""
        return str(self.wait_for(
            lambda: next((state.rejected for state in self.sequencer
                          if state.rejected_goal_id == goal.goal_id), ''),
            'the reason of the rejection'))

    # Claims about the arm.

    @property
    def moving(self) -> bool:
        """Whether a tendon moved when it was last heard."""
        return any(self.tendons.last.velocity)

    @property
    def at_rest(self) -> bool:
        """Whether no tendon moved, nor had still to, when they were last heard."""
        # Between two set-points of a busy computer a tendon may stand.
        return not (self.moving or self.states['tendon_actuation'].last.moving)

    @property
    def pulls(self) -> tuple[float, float]:
        """Pulls that were last heard, m."""
        return tuple(self.tendons.last.position)

    @property
    def all_stiff(self) -> bool:
        """Whether every segment was last said to be stiff."""
        return all(r.last is not None and r.last.data for r in self.stiff)

    def soft_segments(self) -> list[int]:
        """Return the segments (from 1) that were last said not to be stiff."""
        return [n for n, r in enumerate(self.stiff, start=1) if not r.last.data]

    def assert_rests(self, count: int = 4) -> None:
        """Claim that neither tendon moves, over some more messages."""
        states = self.wait_for_more(self.tendons, count)
        assert not any(any(s.velocity) for s in states), 'a tendon moves'
        assert len({tuple(s.position) for s in states}) == 1, 'a tendon changes its pull'

    def assert_bends(self, angles: Sequence[float]) -> None:
        """Claim that the arm, by the pulls it measured, has taken these bending angles, rad."""
        self.wait_for_more(self.joints, 3)
        joints = np.reshape(self.joints.last.position, (len(angles), -1))
        assert joints.sum(axis=1) == pytest.approx(angles, abs=np.radians(0.1))

    def come_to_rest(self) -> None:
        """Wait until no tendon moves, and claim that none does from then on."""
        self.wait_for(lambda: self.at_rest, 'rest')
        self.assert_rests()

    def wait_until_rests(self, count: int = 5) -> None:
        """Wait until the tendons stand for some messages in a row, and not only for a moment."""
        self.wait_for(lambda: len(self.tendons) >= count and len({
            (*m.position, any(m.velocity)) for m in [*self.tendons][-count:]}) == 1
            and self.at_rest, 'rest that lasts')

    def assert_rests_stiff(self, goal: Goal | None = None) -> None:
        """Claim that the arm rests with every segment stiff, at the latest when a goal ended."""
        self.assert_rests()
        self.assert_stiff_since(goal)

    def assert_stiff_since(self, goal: Goal | None = None) -> None:
        """Claim that every segment is stiff, at the latest since a goal ended."""
        # The last of the flags may still be on its way to the observer.
        self.wait_for(lambda: self.all_stiff, 'a stiff arm')
        if goal is not None:
            assert max(r.heard[-1].time for r in self.stiff) <= goal.ended_time, 'stiff too late'

    def assert_only_one_was_soft(self) -> None:
        """Claim that at no time more than one segment was soft, by flag and by pressure."""
        for recordings, is_soft in (
                (self.stiff, lambda m: not m.data),
                (self.pressures, lambda m: AMBIENT - m.fluid_pressure < STIFF_VACUUM * 0.7)):
            soft: set[int] = set()
            known: set[int] = set()  # a flag is also false before anything is known
            for _, segment, message in _merged(recordings):
                if not is_soft(message):
                    known.add(segment)
                    soft.discard(segment)
                elif segment in known:
                    soft.add(segment)
                assert len(soft) <= 1, f'segments {sorted(soft)} were soft at once'

    def assert_never_moved_all_stiff(self) -> None:
        """Claim that no tendon moved while every segment was stiff, by speed and by pull."""
        stiff: list[bool | None] = [None] * SEGMENTS
        rests_at: tuple[float, ...] | None = None
        checked = 0
        for _, index, message in _merged([*self.stiff, self.tendons]):
            if index < SEGMENTS:
                stiff[index] = message.data
                rests_at = None
            elif all(stiff):
                assert not any(message.velocity), 'a tendon moved while every segment was stiff'
                pulls = tuple(message.position) or None  # None while they are not referenced
                assert None in (pulls, rests_at) or pulls == rests_at, 'a stiff arm was pulled'
                rests_at = pulls
                checked += 1
        assert checked, 'the arm was never heard to be stiff'

    def assert_stiff_only_by_pressure(self) -> None:
        """Claim that no segment was said to be stiff before its pressure was."""
        for flags, pressures in zip(self.stiff, self.pressures, strict=True):
            vacuum = 0.0
            for _, index, message in _merged([pressures, flags]):
                if index == 0:
                    vacuum = AMBIENT - message.fluid_pressure
                elif message.data:
                    assert vacuum >= STIFF_VACUUM, f'said to be stiff at {vacuum:.0f} Pa'


def shape_message(shape: str | Sequence[float] | Shape, hold: float = 0.0) -> Shape:
    """Return a shape by name, by bending angles (rad), or as it is."""
    if isinstance(shape, Shape):
        return shape
    whole = int(hold // 1)
    message = Shape(hold_time=Duration(sec=whole, nanosec=int((hold - whole) * 1e9)))
    if isinstance(shape, str):
        message.name = shape
    else:
        message.bending_angles = [float(a) for a in shape]
    return message


def assert_declined(answer: Any, *reasons: str) -> None:
    """Claim that a service was not done, and that the answer has all of the reasons."""
    assert not answer.success
    for reason in reasons:
        assert reason in answer.message, answer.message


def set_in(message: Any, **fields: Any) -> None:
    """Set fields of a message: __ stands between the parts of a path, a number is an index."""
    for name, value in fields.items():
        part, (*path, last) = message, name.split('__')
        for step in path:
            part = getattr(part, step)
        if last.isdecimal():
            part[int(last)] = value
        else:
            setattr(part, last, value)


def spoil(**fields: Any) -> Callable[[Any], None]:
    """Return what sets these fields of a message, as set_in does."""
    return partial(set_in, **fields)


def pairs(status: DiagnosticStatus | None) -> dict[str, str]:
    """Return the values of a status by key."""
    return {pair.key: pair.value for pair in status.values} if status else {}


def _merged(recordings: Sequence[Recording]) -> list[tuple[int, int, Any]]:
    """Return (time, index of the recording, message) in the order they were written."""
    return sorted(
        ((h.time, i, h.message) for i, r in enumerate(recordings) for h in list(r.heard)),
        key=lambda item: item[0])
