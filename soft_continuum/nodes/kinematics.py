# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The node that computes the shape of the arm from tendons, stiffness, model and measurements.

With what it takes from sensors: poses of the discs, and tensions.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from functools import partial
from math import hypot, inf, isfinite, nan
import re
from time import monotonic
from typing import Any

from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import numpy as np
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from soft_continuum.estimation.measuring import (
    ActuatorState,
    DiscMeasurement,
    Innovation,
    JamVacuum,
    Measurement,
    TensionMeasurement,
)
from soft_continuum.estimation.shape import (
    ArmShape,
    PULL_RESOLUTION,
    ShapeError,
    UnknownShapeError,
)
from soft_continuum.estimation.unknowns import estimation_from_parameters
from soft_continuum.hardware.protocols import Accuracy
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.rotations import UNKNOWN
from soft_continuum.mechanics.statics import StaticsError
from soft_continuum.nodes.conflicts import Conflicts, SharedJoints
from soft_continuum.nodes.markers import alarm_marker, prediction_marker, shape_markers
from soft_continuum.nodes.reported_arm import bent
from soft_continuum.nodes.suite_node import ERROR, OK, SuiteNode, WARN
from soft_continuum.nodes.threads import load_model, loading
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.ros.conversions import (
    accuracy_from_ros,
    equilibrium_to_ros,
    measured_pose_from_ros,
    poses_to_ros,
    pulls_from_ros,
    seconds,
    Stiffness,
    stiffness_from_ros,
    tracked_pose_to_ros,
)
from soft_continuum.ros.entries import (
    Confirmation,
    EVERY_STATE,
    LATCHED,
    repeat,
    SENSOR,
    serve,
    STREAM,
    subscribe,
    wake,
)
from soft_continuum.ros.estimates import anomaly_to_ros, estimate_to_ros, parameters_to_ros
from soft_continuum.ros.motion_tracker import NOT_REFERENCED
from soft_continuum.ros.names import JAMMING_VALVES, KINEMATICS, MEASURED_POSE, TENDON_ACTUATION
from soft_continuum.ros.ros_time import FRESH
from soft_continuum.ros.urdf import arm_urdf, joint_names
from soft_continuum_interfaces.msg import (
    EstimatedParameter,
    JammingValvesState,
    KinematicsState,
    TendonActuationState,
)

MARKER_PERIOD = 0.05  # s
TENSION_PERIOD = 1.0  # s for which a tension that was wrong is shown
MIN_PERIOD = 0.005  # s between two shapes at least
ORDER_TIMEOUT = 0.5  # s for which a change of stiffness waits for the pulls at which it happened
CHECK_PERIOD = 0.02  # s after which what came sooner than that is followed
COVARIANCE_PERIOD = 0.1  # s between two covariances, which cost more than the shape
REFUSAL_PERIOD = 1.0  # s for which the reason for an unusable pose is shown
ACCURACY_PERIOD = 3.0  # s for which an unusable accuracy of a device is shown
UNUSED_PERIOD = 3.0  # s after the last measurement for which it is shown that most are not used
ESTIMATION = ('scipy.linalg', 'scipy.special')  # what the first measurement needs: 0.4 s
SYNC_WINDOW = 0.02  # s for which a pose waits for those of the other discs
MAX_WAITING = 20
"""Number of times with pending poses; beyond it, as in a burst, the oldest are dropped."""
MAX_RATE = 60.0
"""Rate at which poses are used: each takes some milliseconds."""
MAX_AT_ONCE = 4.0
"""Burst of times, as from several cameras."""
ANOTHER = 1e-6  # s by which the same time counts as another: the disc is seen by another camera
TENSION_INTERVAL = 0.1
"""Period of used tensions, s: each costs as much as a pose, and carries less information."""
UNCHECKED_TIME = 2.0
"""Time (s) for which the first tensions wait for their accuracy, published once a second."""
OUTLIER_SIGMA = 3.0  # deviations, beyond which a difference is not what the device does not know
REPORT_DELAY = 2.0  # s for which a difference lasts before it is reported
SLACK = 0.1  # of what the model has: with less, a tendon carries nothing
NUMBER = re.compile(r'[\d.]+')
REFUSAL_WEIGHT = 0.1  # of the last measurement in the share that is refused
MANY_REFUSED, FEW_REFUSED = 0.5, 0.2
"""Shares of refused measurements at which the report starts and ends."""


class Kinematics(SuiteNode):
    """
    Tracks the arm's shape by the rigid multibody model under gravity, and by measurements.

    Subscribes to tendon_states (sensor_msgs/JointState), tendon_actuation/state,
    jamming_valves/state, segment_N/pressure and disc_N/measured_pose (PoseWithCovarianceStamped).
    Publishes ~/state (soft_continuum_interfaces/KinematicsState), segment_poses, disc_poses and
    predicted_disc_poses (geometry_msgs/PoseArray), segment_N/pose
    (geometry_msgs/PoseWithCovarianceStamped), joint_states and tendon_tensions
    (sensor_msgs/JointState), shape_markers (visualization_msgs/MarkerArray),
    robot_description (std_msgs/String, latched), ~/status and /diagnostics.  Serves ~/reset
    (std_srvs/Trigger).

    The shape of a stiff segment depends on its history.  A node that starts on an arm with pulled
    tendons reports an unknown shape, and publishes none, until every disc is measured, or ~/reset.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters, topics and services."""
        super().__init__(KINEMATICS, 'rigid multibody model', **options)
        self._arm = arm_from_parameters(self.parameters)
        self._tendons = self._arm.tendon_names
        self._compiled = False
        self._shape = ArmShape(self._arm, self.parameters['straight_tolerance'],
                               estimation_from_parameters(self.parameters))
        segments = len(self._arm.segments)
        jamming = self.parameters['arm.jamming']
        self._stiff = Stiffness((None if jamming else False,) * segments)
        self._elastic = [not segment.jam.rigid for segment in self._arm.segments]
        self._vacuum = JamVacuum(self._elastic, self.parameters)
        self._pulls: Array | None = None
        self._next_pulls: Array | None = None  # not followed yet
        self._next_stiff = self._stiff
        self._stiff_changed = 0.0, 0.0  # when, s, and when that was heard, s (steady)
        self._followed = 0.0  # when, s (steady)
        self._sliding = np.zeros(len(self._tendons), dtype=int)
        self._time = self._told = 0.0  # of the next pulls and of the last tendon_states, s
        frame = self.parameters['frame_id']
        self._segment_message, self._disc_message = PoseArray(), PoseArray()
        self._joint_message = JointState(name=joint_names(self._shape.statics.chain))
        self._tension_message = JointState(name=list(self._tendons))
        self._predicted_message = PoseArray()
        for message in (self._segment_message, self._disc_message, self._predicted_message):
            message.header.frame_id = frame
        self._segment_poses = self.create_publisher(PoseArray, 'segment_poses', STREAM)
        self._disc_poses = self.create_publisher(PoseArray, 'disc_poses', STREAM)
        self._predicted_poses = self.create_publisher(PoseArray, 'predicted_disc_poses', STREAM)
        self._poses = [self.create_publisher(
            PoseWithCovarianceStamped, f'segment_{i + 1}/pose', STREAM) for i in range(segments)]
        self._joint_states = self.create_publisher(JointState, 'joint_states', STREAM)
        self._tensions = self.create_publisher(JointState, 'tendon_tensions', STREAM)
        self._markers = self.create_publisher(MarkerArray, 'shape_markers', STREAM)
        self._robot = self.create_publisher(String, 'robot_description', LATCHED)
        self._robot.publish(String(data=arm_urdf(self._arm, frame)))
        self._marked = 0.0
        self._converted: tuple[Any, KinematicsState] = None, KinematicsState()
        self._uncertainties: tuple[float, Array, list[EstimatedParameter]] = (
            -inf, np.zeros((0, 3, 3)), [])
        self._measured_tensions = MeasuredTensions(
            self._tendons, self.parameters, UNCHECKED_TIME)
        self._refused_poses, self._refused_tensions = Refusals('poses'), Refusals('tensions')
        self._follows = False  # whether the state is that of the last pulls
        self._unknown = ''  # why the pulls are unknown
        self._question = Confirmation()
        self._states = self.create_publisher(KinematicsState, '~/state', STREAM)
        subscribe(self, TendonActuationState, f'{TENDON_ACTUATION}/state',
                  self._on_tendon_actuation, EVERY_STATE)
        subscribe(self, JointState, 'tendon_states', self._on_tendons, SENSOR)
        if jamming:
            subscribe(self, JammingValvesState, f'{JAMMING_VALVES}/state',
                      self._on_jamming_valves, LATCHED)
        for i, elastic in enumerate(self._elastic):
            if jamming and elastic:
                subscribe(self, FluidPressure, f'segment_{i + 1}/pressure',
                          partial(self._on_pressure, i), SENSOR)
        self._without = UNKNOWN * np.diag(~self._arm.pose_axes)  # of what there is not
        self._measured = MeasuredPoses(self, self._arm, frame, self._wake)
        self.conflicts = Conflicts(self, segments)
        self._shared_joints = SharedJoints(self, self._joint_message.name, self.conflicts)
        self._timer = repeat(self, CHECK_PERIOD, self._check)  # only while something waits
        serve(self, Trigger, '~/reset', self._on_reset)
        self.status.set(OK, loading())

    def start(self) -> None:
        """Load the model; the node works once the others publish."""
        load_model(self, self._arm, self._on_model, ESTIMATION)

    def _on_model(self) -> None:
        self._compiled = True
        needed = ('tendon_states', *(
            ['jamming_valves/state'] if None in self._stiff.confirmed else ()))
        self.status.set(OK, f'waiting for {" and ".join(needed)}')
        self._publish()

    def _on_jamming_valves(self, state: JammingValvesState) -> None:
        # A segment of which nothing is known keeps its stiffness: the shape of the arm does not
        # change because a wire broke.
        stiff = stiffness_from_ros(state, self._next_stiff)
        if stiff != self._next_stiff:
            self._next_stiff = stiff
            self._stiff_changed = seconds(state.stamp), monotonic()
        self._follow()

    @property
    def _stiffness_due(self) -> bool:
        """
        Whether the stiffness changes now: the tendons have told where they were when it did.

        What a busy computer reads late it reads in any order, and a jam holds the shape that the
        arm has when it forms.
        """
        changed, heard = self._stiff_changed
        return self._next_stiff != self._stiff and (
            self._told >= changed or None in self._stiff.confirmed
            or monotonic() - heard > ORDER_TIMEOUT)

    def _on_pressure(self, segment: int, message: FluidPressure) -> None:
        """Follow the vacuum of a jam that is not rigid; it counts with the next pulls."""
        self._vacuum.follow(segment, message.fluid_pressure, self._next_stiff.setpoints)

    def _on_tendon_actuation(self, state: TendonActuationState) -> None:
        self._unknown = ''
        if state.connected and not state.referenced:
            self._lose_shape()
        elif not state.connected and self._pulls is not None:
            # It may be back with its position: then the arm is where it was.
            self._unknown = ('tendon_actuation has no device, so the arm may have changed its '
                             'shape unnoticed')
            self.status.set(WARN, self._unknown)
        try:
            self._measured_tensions.receive(state)
        except ValueError as error:
            self.status.alarm('accuracy', str(error), ACCURACY_PERIOD)

    def _lose_shape(self) -> None:
        """Discard the shape: the position of the tendons is lost, or counts from another zero."""
        self._shape.lose(bent(self._shape.state, self.parameters['arm.jamming']))
        self._pulls = self._next_pulls = None
        self._follows = False
        self._sliding[:] = 0
        self.status.set(WARN, f'the shape is unknown: {NOT_REFERENCED}')

    def _on_tendons(self, message: JointState) -> None:
        if message.name and not message.position:  # in one message with them, so never late
            self._lose_shape()
            return
        try:
            pulls = pulls_from_ros(message, self._tendons)
        except ValueError as error:
            self.status.set(WARN, str(error))
            return
        self._told = seconds(message.header.stamp) or seconds(self.get_clock().now().to_msg())
        if self._stiffness_due:  # pulls after a change are followed after it
            self._follow_now()
        self._next_pulls, self._time = pulls, self._told
        self._follow()
        self._check_alarms()
        if self._shape.state is not None and self._follows:
            measured = dict(zip(message.name, message.effort, strict=False))
            if measured and self._shape.settings.enabled:
                self._measured_tensions.put(self._time, measured)
                self._wake()
            # The estimate follows what is measured: only the prediction can differ for long.
            model = self._shape.predicted or self._shape.state
            self.status.alarm('tensions', self._measured_tensions.problem(
                monotonic(), measured, model.tensions.tolist()), TENSION_PERIOD)

    def _check(self) -> None:
        self._follow()
        if not self._compiled:
            return
        for time, discs in self._measured.take():
            self._measure(time, discs, self._refused_poses)
        for time, tensions in self._measured_tensions.take():
            self._measure(time, tensions, self._refused_tensions)
        self._check_alarms()
        if not self._measured.waits and self._next_pulls is None and (
                self._next_stiff == self._stiff):
            self._timer.cancel()

    def _wake(self) -> None:
        """Have what waits looked at within CHECK_PERIOD."""
        wake(self._timer)

    def _check_alarms(self) -> None:
        self.status.alarm('anomaly', '; '.join(one.message for one in self._shape.anomalies))
        if self._measured.refused:
            self.status.alarm('pose', f'a measured pose is not used: {self._measured.refused}',
                              REFUSAL_PERIOD)
            self._measured.refused = ''

    def _measure(self, time: float, measurements: Sequence[Measurement], refusals: 'Refusals'
                 ) -> None:
        """Correct the shape by measurements of ``time`` (s), if possible."""
        try:
            known, used = self._shape.state, self._shape.measure(time, measurements)
        except StaticsError as error:
            refused = f'no shape found that fits the measurements: {error}'
        else:
            refused = self._refusal(time, used)
            if known is None and used is not None:
                self.get_logger().info('the shape was found by measurements')
                self._publish()
        self.status.alarm(f'unused {refusals.what}', refusals.note(refused), UNUSED_PERIOD)

    def _refusal(self, time: float, used: Innovation | None) -> str:
        """Return why a measurement of that time was not used; empty if it was."""
        if used is None:
            return self._shape.refusal(time)
        return '' if used.used else (f'it disagrees with the model by {used.distance**0.5:.1f} '
                                     'times what their uncertainties explain')

    def _follow(self) -> None:
        """Follow the last reports, at most as often as the model can."""
        if monotonic() - self._followed >= MIN_PERIOD:
            self._follow_now()
        else:
            self._wake()

    def _follow_now(self) -> None:
        if self._next_pulls is not None:
            # The motion up to now counts for the stiffness up to now.
            pulls, self._next_pulls = self._next_pulls, None
            self._take_pulls(pulls)
            self._publish()
        if self._stiffness_due:
            self._stiff = self._next_stiff
            self._publish()
        if self._next_stiff != self._stiff:
            self._wake()
        self._followed = monotonic()

    def _take_pulls(self, pulls: Array) -> None:
        if self._pulls is not None:  # the last direction of motion is that of the friction
            change = pulls - self._pulls
            self._sliding = np.where(np.abs(change) > PULL_RESOLUTION, np.sign(change),
                                     self._sliding).astype(int)
        self._pulls = pulls

    def _publish(self) -> None:
        if not self._compiled or self._pulls is None or None in self._stiff.confirmed:
            return
        self._follows = self._update()
        state = self._shape.state
        if self._unknown:
            self.status.set(WARN, self._unknown)
        if not self._follows or state is None or self._unknown:
            return
        stamp = self.get_clock().now().to_msg()
        for message in (self._segment_message, self._disc_message, self._predicted_message,
                        self._joint_message, self._tension_message):
            message.header.stamp = stamp
        if state is not self._converted[0]:  # at rest it is the last one
            self._converted = state, equilibrium_to_ros(state)
            poses_to_ros(state.poses, self._disc_message)
            self._segment_message.poses = self._disc_message.poses[2::2]
            self._joint_message.position = state.joint_positions.tolist()
            self._tension_message.effort = state.tensions.tolist()
        self._segment_poses.publish(self._segment_message)
        self._disc_poses.publish(self._disc_message)
        self._shared_joints.sent(self._joint_message)
        self._joint_states.publish(self._joint_message)
        self._tensions.publish(self._tension_message)
        shape = copy(self._converted[1])
        shape.stamp = stamp
        if self._shape.estimate is not None:
            estimate_to_ros(self._shape.estimate, *self._uncertainty(stamp), shape)
            shape.anomalies = [anomaly_to_ros(one) for one in self._shape.anomalies]
            if self._shape.predicted is not None:
                self._predicted_poses.publish(poses_to_ros(
                    self._shape.predicted.poses, self._predicted_message))
        self._states.publish(shape)
        now = monotonic()
        if now - self._marked >= MARKER_PERIOD and self._markers.get_subscription_count():
            self._marked = now
            self._markers.publish(self._make_markers(state, stamp))

    def _make_markers(self, state: Equilibrium, stamp: Any) -> MarkerArray:
        frame, shape = self.parameters['frame_id'], self._shape
        found = shape_markers(state.chain, state, self._stiff.confirmed,
                              self.parameters['tension_limit'], frame, stamp)
        if shape.estimate is not None and shape.predicted is not None:
            found.markers.append(prediction_marker(shape.predicted, frame, stamp))
        if shape.anomalies:
            found.markers.append(alarm_marker([one.message for one in shape.anomalies],
                                              1.1 * self._arm.length, frame, stamp))
        return found

    def _uncertainty(self, stamp: Any) -> tuple[Array, list[EstimatedParameter]]:
        """Return covariances of the discs, which it publishes, and parameters."""
        estimator = self._shape.estimate
        assert estimator is not None
        made, found, parameters = self._uncertainties
        if monotonic() - made < COVARIANCE_PERIOD:
            return found, parameters
        found, parameters = estimator.pose_covariances(), parameters_to_ros(
            estimator, self.parameters['arm.jamming'])
        self._uncertainties = monotonic(), found, parameters
        poses = estimator.state.poses[::2]
        for publisher, pose, covariance in zip(self._poses, poses[1:], found[1:], strict=True):
            message = tracked_pose_to_ros(pose, covariance + self._without)
            message.header.stamp, message.header.frame_id = stamp, self.parameters['frame_id']
            publisher.publish(message)
        return found, parameters

    def _update(self) -> bool:
        """Update the shape; return False if there is none to publish."""
        assert self._pulls is not None
        jumped = self._shape.state is not None and self._shape.state.jumped
        try:
            jammed = tuple(bool(jam) for jam in self._stiff.jammed(self._elastic))
            self._shape.follow(ActuatorState(
                self._time, self._pulls, jammed,
                self._vacuum.parts, tuple(self._sliding.tolist()),
                jammed != self._stiff.confirmed))
        except UnknownShapeError as error:
            known = ('straighten the arm and call tendon_actuation/reference, or soften every '
                     'segment; then ' if self.parameters['arm.jamming'] else '')
            self.status.set(
                WARN, f'{error}; {known}call ~/reset; or let sensors measure every disc')
            return False
        except ShapeError as error:
            self.status.set(ERROR, str(error), **{
                key: value for name, each in error.values.items()
                for key, value in self._named(name, each).items()})
            return False
        except StaticsError as error:
            self.status.set(ERROR, f'no shape found: {error}')
            return False
        state = self._shape.state
        if state is None:
            return False
        if state.jumped and not jumped:
            self.get_logger().warning('a soft segment snapped to another equilibrium')
        self.status.set(
            OK, f'following the arm{self._source()}',
            soft=' '.join(str(n) for n, s in enumerate(self._stiff.confirmed, 1) if not s),
            **self._named('tension', state.tensions, digits=2),
            **self._named('slack', state.slack),
            **{} if (alone := self._shape.unpredicted) is None else {'prediction': alone})
        return True

    def _source(self) -> str:
        """Return the source of the shape, for the status."""
        estimator = self._shape.estimate
        if estimator is None:
            return ''
        if estimator.measured is None:
            return ', corrected by measured tensions'
        fresh = seconds(self.get_clock().now().to_msg()) - FRESH
        source = ', predicted since the last measurement'
        if hidden := estimator.hidden(fresh):
            source = ', measured without disc ' + ' '.join(map(str, hidden))
        elif estimator.measured > fresh:
            source = ', measured'
        return source + (
            '' if self._shape.unpredicted is None else '; the model alone finds no shape')

    def _named(self, quantity: str, values: Iterable[float], digits: int = 6) -> dict[str, str]:
        """Return values of the status, one for each tendon."""
        return {f'{quantity}_{name}': f'{value:.{digits}f}'
                for name, value in zip(self._tendons, values, strict=True)}

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._stiff_changed = 0.0, 0.0  # the answer is about what has come
        self._follow_now()
        if self._unknown:
            response.message = self._unknown
        elif self._pulls is None:
            response.message = ('no tendon_states with pulls: start tendon_actuation; if that '
                                f'runs, {NOT_REFERENCED}')
        elif not self._compiled:
            response.message = loading()
        elif not any(self._stiff.jammed(self._elastic)) and None not in self._stiff.confirmed:
            # Without a stiff segment the pulls alone make the shape.
            try:
                self._shape.set_soft(self._pulls)
            except StaticsError as error:
                response.message = f'no shape found for these pulls: {error}'
                return response
            response.success = True
            response.message = 'every segment is soft: the shape is that of the pulls'
            self._publish()
        elif np.abs(self._pulls).max() > self.parameters['straight_tolerance']:
            response.message = (
                f'pulls are {", ".join(f"{pull:.4f}" for pull in self._pulls)} m; straighten '
                'the arm and call tendon_actuation/reference first, or soften every segment')
        elif question := self._question.ask(
                self._shape.lost_bent or bent(self._shape.state, True), (
                    'the arm would be assumed straight, and every later shape would be off by '
                    'that bend; straighten it')):
            response.message = question
        else:
            self._shape.set_straight()
            response.success = True
            response.message = ('the arm is assumed straight: poses, tensions and plans follow '
                                'from that')
            self._publish()
        return response


class MeasuredPoses:
    """
    Collects disc_N/measured_pose of all discs.

    The base does not move: its pose shows whether the camera moved, but not the arm.
    """

    def __init__(self, node: Any, arm: Arm, frame: str, on_pose: Callable[[], None]) -> None:
        """
        Subscribe for ``node``; frame: required frame of poses.

        on_pose: called when poses are pending or were refused.
        """
        self._frame, self._axes, self._on_any = frame, arm.pose_axes, on_pose
        self._waiting: dict[float, tuple[float, dict[int, DiscMeasurement]]] = {}
        self._taken = -1.0  # s, the stamp that was used last
        self._allowed = MAX_AT_ONCE  # times that may be used now
        self.refused = ''
        """Why a pose was refused since this was last read."""
        for disc in range(len(arm.discs)):
            subscribe(node, PoseWithCovarianceStamped, MEASURED_POSE.format(disc),
                      partial(self._on_pose, disc), SENSOR)

    def _on_pose(self, disc: int, message: PoseWithCovarianceStamped) -> None:
        self._on_any()
        try:
            pose, covariance = measured_pose_from_ros(message, self._axes, self._frame)
        except ValueError as error:
            self.refused = f'{MEASURED_POSE.format(disc)} has {error}'
            return
        stamp = seconds(message.header.stamp)
        while disc in self._waiting.get(stamp, (0.0, {}))[1]:
            stamp += ANOTHER
        _, discs = self._waiting.setdefault(stamp, (monotonic(), {}))
        discs[disc] = DiscMeasurement(disc, pose, covariance)
        while len(self._waiting) > MAX_WAITING:
            del self._waiting[next(iter(self._waiting))]

    @property
    def waits(self) -> bool:
        """Whether poses are pending for ``take``."""
        return bool(self._waiting)

    def take(self) -> list[tuple[float, list[DiscMeasurement]]]:
        """Return the measurements that are complete: times in s, and their poses."""
        now = monotonic()
        ready = [stamp for stamp, (came, _) in self._waiting.items() if now - came >= SYNC_WINDOW]
        found = []
        for stamp in sorted(ready):
            _, discs = self._waiting.pop(stamp)
            if not any(discs):
                continue
            self._allowed = min(
                MAX_AT_ONCE, self._allowed + abs(stamp - self._taken) * MAX_RATE)
            self._taken = stamp
            if self._allowed >= 1.0:
                self._allowed -= 1.0
                found.append((stamp, list(discs.values())))
        return found


class MeasuredTensions:
    """
    Takes effort of tendon_states, which is only present if tensions are measured.

    Its accuracy is in tendon_actuation/state if the device reports it, otherwise in parameters.
    """

    def __init__(self, tendons: Sequence[str], parameters: Mapping[str, Any],
                 unchecked_time: float = 0.0) -> None:
        """
        tendons: their names.  parameters: of kinematics.

        unchecked_time: s for which the first tensions wait for their accuracy.
        """
        self._tendons, self._parameters = tendons, parameters
        self._check = TensionCheck(tendons)
        self._accuracy: Accuracy | None = None
        self._first, self._unchecked_time = inf, unchecked_time  # s, of the first tensions
        self._waiting: tuple[float, list[TensionMeasurement]] | None = None
        self._taken = -inf

    def receive(self, state: TendonActuationState) -> None:
        """Store the accuracy of tensions; raises ValueError, and keeps the earlier one."""
        if state.connected:  # its last accuracy remains valid after a reconnection
            self._accuracy = accuracy_from_ros(state, self._tendons)

    def _stddevs(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return deviations near 0 (N), and shares of the tension, of every tendon."""
        told, count = self._accuracy or Accuracy(), len(self._tendons)
        return (told.tension_stddevs
                or (self._parameters['estimation.tension_stddev'],) * count,
                told.tension_relative_stddevs
                or (self._parameters['estimation.tension_relative_stddev'],) * count)

    def put(self, time: float, tensions: Mapping[str, float]) -> None:
        """Store tensions (N, by tendon) measured at ``time`` (s), if they are due."""
        if abs(time - self._taken) < TENSION_INTERVAL:
            return
        self._first = min(self._first, time)
        if self._accuracy is None and time - self._first < self._unchecked_time:
            return
        found = [TensionMeasurement(t, tensions[name], stddev, relative)
                 for t, (name, stddev, relative) in enumerate(
                     zip(self._tendons, *self._stddevs(), strict=True))
                 if isfinite(tensions.get(name, inf))]
        if found:
            self._waiting, self._taken = (time, found), time

    def take(self) -> list[tuple[float, list[TensionMeasurement]]]:
        """Return the pending tensions, with times in s."""
        found = [] if self._waiting is None else [self._waiting]
        self._waiting = None
        return found

    def problem(self, now: float, tensions: Mapping[str, float], model: Sequence[float]) -> str:
        """Return which tensions (N, by tendon) contradict the model; see TensionCheck."""
        return self._check.problem(now, tensions, model, self._tolerances(tensions, model))

    def _tolerances(self, tensions: Mapping[str, float], model: Sequence[float]) -> list[float]:
        """
        Return tension_tolerance, or what the device does not know if that is more, N.

        Shares are of the lower tension: a tendon that is caught must not excuse itself.
        """
        least = self._parameters['tension_tolerance']
        if self._accuracy is None or not self._accuracy.tension_stddevs:
            return [least] * len(self._tendons)
        return [max(least, OUTLIER_SIGMA * hypot(
                    stddev, relative * min(tensions.get(name, 0.0), own)))
                for name, own, stddev, relative in zip(
                    self._tendons, model, *self._stddevs(), strict=True)]


class TensionCheck:
    """Finds tendons whose measured tension has long differed from the model."""

    def __init__(self, tendons: Sequence[str]) -> None:
        """tendons: their names."""
        self._tendons = tendons
        self._since: dict[str, float] = {}  # s, of those that differ
        self._said: dict[str, str] = {}

    def problem(self, now: float, measured: Mapping[str, float], model: Sequence[float],
                tolerances: Sequence[float]) -> str:
        """
        Return the problem, empty for none; the text only changes with the cause.

        now: s.  measured: N, by tendon, those that are.  model: N, one per tendon, nan where
        nothing determines it.  tolerances: N, one per tendon.
        """
        for name, expected, tolerance in zip(self._tendons, model, tolerances, strict=True):
            seen = measured.get(name, nan)
            if not abs(seen - expected) > tolerance:  # also what is not known
                self._since.pop(name, None)
                self._said.pop(name, None)
            elif now - self._since.setdefault(name, now) > REPORT_DELAY:
                cause = _cause(seen, expected, tolerance)
                if cause not in self._said.get(name, ''):
                    self._said[name] = (f'the tension of {name} is {seen:.1f} N, by the model '
                                        f'{expected:.1f} N; {cause}')
        return '; '.join(self._said.values())


def _cause(seen: float, expected: float, tolerance: float) -> str:
    if seen < -tolerance:
        return 'a tendon cannot push: is the sign or the zero of its load cell wrong?'
    if seen < SLACK * expected:
        return 'it is slack: off its guide, torn, or did its motor lose steps?'
    return 'friction, contact, another payload or stiffness, or a wrong zero of the load cell?'


class Refusals:
    """Keeps the share of refused measurements among about the last ten."""

    def __init__(self, what: str) -> None:
        """what: name of the measurement, for people."""
        self.what, self._share, self._text, self._reason = what, 0.0, '', ''

    def note(self, reason: str) -> str:
        """
        Note why a measurement was refused, or '' if it was used; return the report.

        It starts at MANY_REFUSED and ends at FEW_REFUSED; the text only changes with the reason,
        not with its numbers.
        """
        self._share += REFUSAL_WEIGHT * (bool(reason) - self._share)
        if self._share < FEW_REFUSED:
            self._text = ''
        elif reason and (self._share > MANY_REFUSED or self._text) and not (
                self._text and NUMBER.sub('', reason) == NUMBER.sub('', self._reason)):
            self._reason = reason
            self._text = f'most measured {self.what} are rejected, the last one because: {reason}'
        return self._text
