# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm observed over ROS: the latest message of every topic, and its age."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from math import dist, isfinite, nan
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import String

from soft_continuum.client.estimate import Anomaly, Estimate, LearnedParameter
from soft_continuum.client.sequence import sequence_result
from soft_continuum.client.state import (
    ArmState,
    NodeReport,
    Pose,
    pose_of,
    Progress,
    progress_of,
    SequenceResult,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.directions import bending_directions
from soft_continuum.mechanics.rotations import bending_between, matrices
from soft_continuum.ros import urdf
from soft_continuum.ros.conversions import (
    MAX_VARIANCE,
    measured_pose_from_ros,
    poses_from_ros,
    seconds,
)
from soft_continuum.ros.entries import EVERY_STATE, LATCHED, MAX_BYTES, SENSOR, subscribe_unguarded
from soft_continuum.ros.names import (
    JAMMING_VALVES,
    KINEMATICS,
    MEASURED_POSE,
    NODES,
    RECORDER,
    running_nodes,
    SENSORS,
    SHAPE_SEQUENCER,
    TELEOP,
    TENDON_ACTUATION,
)
from soft_continuum.ros.ros_time import Age
from soft_continuum.ros.urdf import are_of_an_arm, ROBOT_DESCRIPTION
from soft_continuum.text import MAX_ITEMS, MAX_NAME, printable
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Anomaly as AnomalyMessage
from soft_continuum_interfaces.msg import (
    JammingValvesState,
    KinematicsState,
    RecorderState,
    ShapeSequencerState,
    TeleopState,
    TendonActuationState,
)

STALE_AFTER = 3.0  # s: every node publishes /diagnostics once a second
LEVELS = {DiagnosticStatus.OK: 'ok', DiagnosticStatus.WARN: 'warn'}  # others: error
MAX_SEGMENTS = MAX_TENDONS = MAX_VALUES = 100  # shown, whatever is published
CAUSES = {getattr(AnomalyMessage, name): name.lower().replace('_', ' ') for name in (
    'UNKNOWN', 'TENDON_SLIPPED', 'STEPS_LOST', 'NOT_STIFF', 'NOT_SOFT', 'LOAD', 'SENSOR_MOVED',
    'CAMERA_MOVED')}
UNTURNED = 0.0, 0.0, 0.0, 1.0  # orientation of the base
FEEDBACK = 'run_shape_sequence/_action/feedback'
TENDON_STATE = f'{TENDON_ACTUATION}/state'
JAMMING_STATE = f'{JAMMING_VALVES}/state'
KINEMATICS_STATE = f'{KINEMATICS}/state'
JOINTS = 'joint_states'
PREDICTED_DISCS = 'predicted_disc_poses'
SEQUENCER_STATE = f'{SHAPE_SEQUENCER}/state'
RECORDER_STATE = f'{RECORDER}/state'
TELEOP_STATE = f'{TELEOP}/state'


@dataclass(frozen=True)
class ObservedTopic:
    """
    A topic that does not depend on the arm.

    source: the node that publishes it.  readers: of fields of ArmState, from the arm and a message
    that is not stale; without one the field has its default.  optional: whether an arm may lack
    it.
    """

    kind: Any
    qos: QoSProfile
    source: str
    readers: Mapping[str, Callable[['ObservedArm', Any], Any]] = field(default_factory=dict)
    optional: bool = False


def tendon_values(attribute: str
                  ) -> Callable[['ObservedArm', JointState], tuple[float, ...] | None]:
    """Return what reads values of a JointState in the order of ``ObservedArm.tendons``."""
    def read(arm: 'ObservedArm', message: JointState) -> tuple[float, ...] | None:
        values = dict(zip(message.name, getattr(message, attribute), strict=False))
        names = arm.tendons
        return tuple(float(values[n]) for n in names) if values.keys() >= set(names) else None
    return read


def all_poses(_: 'ObservedArm', message: PoseArray) -> tuple[Pose, ...]:
    """Return the poses of a message."""
    return tuple(map(pose_of, message.poses))


TOPICS = {
    'tendon_states': ObservedTopic(JointState, SENSOR, TENDON_ACTUATION, {
        'pulls': tendon_values('position'), 'speeds': tendon_values('velocity'),
        'measured_tensions': tendon_values('effort')}),
    TENDON_STATE: ObservedTopic(TendonActuationState, EVERY_STATE, TENDON_ACTUATION, {
        'emergency_stop': lambda _, message: message.emergency_stop,
        'referenced': lambda _, message: message.referenced}),
    JAMMING_STATE: ObservedTopic(JammingValvesState, EVERY_STATE, JAMMING_VALVES, {
        'set_vacuums': lambda _, message: tuple(message.vacuums[:MAX_SEGMENTS])}),
    JOINTS: ObservedTopic(JointState, SENSOR, KINEMATICS, {
        'joint_angles': lambda _, message: tuple(message.position)}),
    'segment_poses': ObservedTopic(PoseArray, SENSOR, KINEMATICS, {'segment_poses': all_poses}),
    'disc_poses': ObservedTopic(PoseArray, SENSOR, KINEMATICS, {'disc_poses': all_poses}),
    'tendon_tensions': ObservedTopic(JointState, SENSOR, KINEMATICS, {
        'tensions': tendon_values('effort')}),
    KINEMATICS_STATE: ObservedTopic(KinematicsState, SENSOR, KINEMATICS),
    PREDICTED_DISCS: ObservedTopic(PoseArray, SENSOR, KINEMATICS, {
        'predicted_disc_poses': all_poses}, optional=True),
    SEQUENCER_STATE: ObservedTopic(ShapeSequencerState, EVERY_STATE, SHAPE_SEQUENCER),
    ROBOT_DESCRIPTION: ObservedTopic(String, LATCHED, KINEMATICS, optional=True),
    RECORDER_STATE: ObservedTopic(RecorderState, EVERY_STATE, RECORDER, optional=True),
    TELEOP_STATE: ObservedTopic(TeleopState, EVERY_STATE, TELEOP, optional=True),
    FEEDBACK: ObservedTopic(
        RunShapeSequence.Impl.FeedbackMessage, SENSOR, SHAPE_SEQUENCER, optional=True),
    **{f'{node}/status': ObservedTopic(
        DiagnosticStatus, EVERY_STATE, node, optional=node in SENSORS)
       for node in (*NODES, *SENSORS)},
}
"""The topics that do not depend on the arm."""


class ObservedArm:
    """
    Stores the messages of the four nodes; has no thread and sends no requests.

    Callbacks are called on the thread that spins the node.  ``snapshot`` may be called from any
    thread.
    """

    def __init__(self, node: Node, *, feedback: bool = True) -> None:
        """
        Subscribe on ``node``, with relative names.

        feedback: also to that of sequences, and to the description of the robot.
        """
        self._node = node
        self._messages: dict[str, Any] = {}
        self._ages: dict[str, Age] = {}  # by topic and by node
        self._listeners: list[Callable[[str], object]] = []
        self._measured: dict[str, tuple[Age, Pose]] = {}  # by disc, the last measurement
        self._segments = self._jams = 0  # with poses; switched
        for topic, one in TOPICS.items():
            if feedback or topic not in (FEEDBACK, ROBOT_DESCRIPTION):
                self._subscribe(topic, one.kind, one.qos, one.source)
        subscribe_unguarded(node, DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)

    def _subscribe(self, topic: str, kind: Any, qos: Any, source: str) -> None:
        subscribe_unguarded(self._node, kind, topic, partial(self._on_message, topic, source), qos,
                            urdf.MAX_BYTES if topic == ROBOT_DESCRIPTION else MAX_BYTES)

    def on_change(self, listener: Callable[[str], object]) -> None:
        """Call ``listener`` with the name of the topic after every message."""
        self._listeners.append(listener)

    def _on_message(self, topic: str, source: str, message: Any) -> None:
        if topic == JOINTS and not are_of_an_arm(message.name):
            return  # of a base that carries the arm, for example
        self._messages[topic] = message
        for name in (topic, source):
            self._ages.setdefault(name, Age()).refresh()
        if topic in (JAMMING_STATE, 'segment_poses'):
            known, jams = len(self.disc_topics), topic == JAMMING_STATE
            count = min(len(message.stiffness if jams else message.poses), MAX_SEGMENTS)
            self._segments = max(self._segments, count)
            while jams and self._jams < count:
                self._jams += 1
                self._subscribe(f'segment_{self._jams}/pressure', FluidPressure, SENSOR,
                                JAMMING_VALVES)
            for disc in self.disc_topics[known:]:
                self._subscribe(disc, PoseWithCovarianceStamped, SENSOR, disc)
        if topic.endswith('/measured_pose'):
            self._on_measured(topic, message)
        for listener in self._listeners:
            listener(topic)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        space = self._node.get_namespace().strip('/')
        for status in message.status:
            before, _, node = status.name.rpartition('/')
            if before == space and node in (*NODES, *SENSORS):
                self._ages.setdefault(node, Age()).refresh()

    # Latest values.

    @property
    def recorder(self) -> RecorderState | None:
        """The latest state of a running recorder; None without one."""
        return self._fresh(RECORDER_STATE)

    @property
    def teleop(self) -> TeleopState | None:
        """The latest state of teleop; None while it does not run."""
        return self._fresh(TELEOP_STATE)

    def message(self, topic: str) -> Any:
        """Return the latest message of a topic; None before the first."""
        return self._messages.get(topic)

    def age(self, source: str) -> float:
        """Return the s since the last message of a topic or of a node; inf before the first."""
        return self._ages.get(source, Age()).seconds

    def _fresh(self, topic: str) -> Any:
        """Return the latest message unless it, or the node of a state, is stale."""
        one = TOPICS.get(topic)
        source = one.source if one is not None and one.qos is EVERY_STATE else topic
        return self.message(topic) if self.age(source) < STALE_AFTER else None

    @property
    def tendon_actuation(self) -> TendonActuationState | None:
        """State of tendon_actuation; None while that is stale."""
        return self._fresh(TENDON_STATE)

    @property
    def jamming_valves(self) -> JammingValvesState | None:
        """State of jamming_valves; None while that is stale."""
        return self._fresh(JAMMING_STATE)

    def stopped(self) -> str | None:
        """Return why motion is stopped, empty if it is not; None if unknown."""
        state = self.tendon_actuation
        if state is None or state.stopped == TendonActuationState.NOT_STOPPED:
            return None if state is None else ''
        return printable(state.stop_message) or 'no reason given'

    @property
    def shape_sequencer(self) -> ShapeSequencerState | None:
        """State of shape_sequencer; None while that is stale."""
        return self._fresh(SEQUENCER_STATE)

    @property
    def segments(self) -> int:
        """Number of segments; 0 while unknown."""
        return self._segments

    @property
    def disc_topics(self) -> tuple[str, ...]:
        """Topics of the measured poses of the discs, base first; empty without segments."""
        return tuple(MEASURED_POSE.format(n)
                     for n in range(self._segments + 1 if self._segments else 0))

    @property
    def tendons(self) -> tuple[str, ...]:
        """Names of the tendons; empty while unknown."""
        state = self.message(TENDON_STATE)
        message = self.message('tendon_states') or self.message('tendon_tensions')
        names = state.tendons if state else message.name if message else ()
        return tuple(printable(name, MAX_NAME) for name in names[:MAX_TENDONS])

    def stiff(self, segment: int) -> bool | None:
        """Return whether a segment (from 1) is stiff; None while unknown."""
        state = self.jamming_valves
        if (state is None or segment > len(state.stiffness)
                or state.stiffness[segment - 1] == JammingValvesState.UNKNOWN):
            return None
        return bool(state.stiffness[segment - 1] == JammingValvesState.STIFF)

    def pressure(self, segment: int) -> float | None:
        """Return the absolute pressure of a segment (from 1), Pa."""
        message = self._fresh(f'segment_{segment}/pressure')
        return None if message is None else float(message.fluid_pressure)

    def values(self, topic: str) -> dict[str, Any]:
        """Return the fields of ArmState that a topic has; empty while it is stale."""
        message = self._fresh(topic)
        return {} if message is None else {
            name: read(self, message) for name, read in TOPICS[topic].readers.items()}

    def pulls(self) -> tuple[float, ...] | None:
        """Return the pull of each tendon, m."""
        return self.values('tendon_states').get('pulls')

    def poses(self, topic: str) -> tuple[Pose, ...] | None:
        """Return the poses of segment_poses or disc_poses."""
        return self.values(topic).get(topic)

    @property
    def _pose_axes(self) -> NDArray[np.bool_]:
        """The pose_axes of the arm, by its joints or, before its shape is known, its URDF."""
        described, joints = self.message(ROBOT_DESCRIPTION), self.message(JOINTS)
        return urdf.pose_axes_of(joints.name if joints is not None else (
            urdf.first_joint(described.data) if described is not None else ()))

    def bending(self) -> Array | None:
        """Return the bending of each segment (segments, 2), rad; None if unknown."""
        joints, segments = self._fresh(JOINTS), self._fresh('segment_poses')
        if joints is None or segments is None or not segments.poses:
            return None
        if self._pose_axes.all():
            return bending_between(matrices(
                np.vstack([UNTURNED, poses_from_ros(segments)[:, 3:]])))
        each = len(joints.position) // len(segments.poses)
        return np.array([(0.0, sum(joints.position[i * each:(i + 1) * each]))
                         for i in range(len(segments.poses))])

    def _on_measured(self, topic: str, message: PoseWithCovarianceStamped) -> None:
        """Store the measurement of a disc; an angle alone does not replace a whole pose."""
        model = self.message('disc_poses')
        axes = self._pose_axes
        try:
            measured, covariance = measured_pose_from_ros(
                message, axes, model.header.frame_id if model is not None else '')
        except ValueError:
            return  # measure reports the reason
        known = (np.diag(covariance) < MAX_VARIANCE) | ~axes
        place, turn = np.split(known, [3])
        age, before = self._measured.get(topic, (Age(), None))
        if before is not None and age.seconds < STALE_AFTER and not known.all() and all(
                map(isfinite, (*before.position, *before.orientation))):
            return
        self._measured[topic] = Age.now(), Pose(
            tuple(measured[:3].tolist()) if place.all() else (nan,) * 3,
            tuple(measured[3:].tolist()) if turn.all() else (nan,) * 4)

    def _measured_discs(self) -> tuple[Pose | None, ...]:
        """Return the measured pose of each disc; empty while none is measured."""
        found = [self._measured.get(topic) for topic in self.disc_topics]
        poses = tuple(None if entry is None or entry[0].seconds >= STALE_AFTER else entry[1]
                      for entry in found)
        return poses if any(poses) else ()

    def progress(self) -> Progress | None:
        """Return the progress of the running sequence of any client; None if none runs."""
        state, message = self.shape_sequencer, self.message(FEEDBACK)
        if state is None or not state.running:
            return None
        if message is None or message.goal_id != state.goal_id:
            return progress_of(state, 0.0)
        return progress_of(state, float(message.feedback.progress), message.feedback)

    def estimate(self) -> Estimate | None:
        """Return the source and accuracy of the shape; None while that is stale."""
        message = self._fresh(KINEMATICS_STATE)
        if message is None:
            return None
        now = self.poses('disc_poses')
        alone = self.values(PREDICTED_DISCS).get('predicted_disc_poses')
        error = dist(now[-1].position, alone[-1].position) if now and alone else nan
        return estimate_of(message, self.age(KINEMATICS_STATE), error if isfinite(error) else None)

    def _last_result(self) -> SequenceResult | None:
        state = self.shape_sequencer
        if state is None or state.running or not any(state.goal_id.uuid):
            return None
        return sequence_result(state)

    def running(self) -> dict[str, bool]:
        """Return which of the four nodes are in the ROS graph."""
        return running_nodes(self._node)

    @property
    def complete(self) -> bool:
        """
        Whether every topic of an active arm, and of its sensors, has had a message.

        The ROS graph may still lack a node whose messages arrive.
        """
        expected = {topic for topic, one in TOPICS.items() if not one.optional} | {
            f'segment_{n}/pressure' for n in range(1, self._jams + 1)} | {
            topic for topic in self.disc_topics if self._node.count_publishers(topic)}
        if self._lacks_jamming:
            expected = {topic for topic in expected if not topic.startswith(JAMMING_VALVES)}
        return self._segments > 0 and self._messages.keys() >= expected and all(
            runs or self.message(f'{name}/status') is None
            for name, runs in self.running().items())

    @property
    def _lacks_jamming(self) -> bool:
        """Whether the arm has no jamming: kinematics then does not subscribe to valves."""
        if self.message(KINEMATICS_STATE) is None or self._messages.get(JAMMING_STATE):
            return False
        listeners = self._node.get_subscriptions_info_by_topic(
            self._node.resolve_topic_name(JAMMING_STATE))
        return all(one.node_name != KINEMATICS for one in listeners)

    def snapshot(self) -> ArmState:
        """Return the present state."""
        read = {name: value for topic in TOPICS for name, value in self.values(topic).items()}
        disc_poses, bending, towards = read.get('disc_poses'), self.bending(), list[float]()
        bends = None if bending is None else bending[:, 1].tolist()
        if bending is not None and self._pose_axes.all():
            bends = np.linalg.norm(bending, axis=1).tolist()
            towards = bending_directions(bending).tolist()
        numbers = range(1, self._jams + 1)
        running = self.running()
        nodes = [name for name in NODES if name != JAMMING_VALVES or running[name]
                 or not self._lacks_jamming]
        return ArmState(
            **read, tendons=self.tendons, stopped=self.stopped(),
            stiff=tuple(self.stiff(n) for n in numbers),
            pressures=tuple(self.pressure(n) for n in numbers),
            bending_angles=None if bends is None else tuple(bends),
            bending_directions=tuple(towards),
            tip=disc_poses[-1] if disc_poses else None, progress=self.progress(),
            measured_discs=self._measured_discs(),
            last_result=self._last_result(), estimate=self.estimate(),
            nodes=tuple(self._report(name, running[name]) for name in nodes),
            sensors=tuple(self._report(name, self.age(name) < STALE_AFTER)
                          for name in SENSORS if self.message(f'{name}/status')))

    def _report(self, name: str, running: bool) -> NodeReport:
        status, age = self.message(f'{name}/status'), self._ages.get(name)
        seconds = None if age is None else age.seconds
        return NodeReport(
            name, running, LEVELS.get(status.level, 'error') if status else None,
            printable(status.message) if status else '',
            {printable(pair.key, MAX_NAME): printable(pair.value)
             for pair in status.values[:MAX_VALUES]} if status else {},
            seconds, seconds is None or seconds >= STALE_AFTER)


def estimate_of(message: KinematicsState, received: float, predicted_tip_error: float | None
                ) -> Estimate:
    """
    Return the Estimate in kinematics/state.

    received: s since the message came.  predicted_tip_error: m, None if unknown.
    """
    measured = seconds(message.measured)
    return Estimate(
        message.source == KinematicsState.ESTIMATED,
        max(0.0, seconds(message.stamp) - measured) + received if measured > 0.0 else None,
        tuple(message.angle_stddevs[:MAX_ITEMS]), tuple(message.tip_covariance[:36]),
        predicted_tip_error,
        tuple(LearnedParameter(printable(p.name, MAX_NAME), float(p.value), float(p.stddev),
                               bool(p.determined), printable(p.problem))
              for p in message.parameters[:MAX_ITEMS]),
        tuple(map(anomaly_of, message.anomalies[:MAX_ITEMS])))


def anomaly_of(message: AnomalyMessage) -> Anomaly:
    """Return the Anomaly from its message."""
    return Anomaly(CAUSES.get(message.cause, CAUSES[AnomalyMessage.UNKNOWN]), message.segment,
                   message.disc, printable(message.tendon, MAX_NAME), float(message.size),
                   printable(message.message))
