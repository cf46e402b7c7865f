# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The node that knows the shape of the arm from tendons, stiffness and the model."""

from collections.abc import Iterable
from functools import partial
from math import isfinite
from typing import Any

from geometry_msgs.msg import PoseArray
import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from soft_continuum.hardware.clock import STEADY
from soft_continuum.mechanics.chain import Array, Equilibrium
from soft_continuum.mechanics.statics import Statics, StaticsError
from soft_continuum.nodes.conflicts import Conflicts
from soft_continuum.nodes.entries import repeat, serve, subscribe
from soft_continuum.nodes.markers import shape_markers
from soft_continuum.nodes.model import load_model, loading, SLACK_ALLOWANCE
from soft_continuum.nodes.node_parameters import NodeParameters
from soft_continuum.nodes.status import ERROR, FAILURE_PERIOD, OK, Status, WARN
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.nodes import NODE_PARAMETERS
from soft_continuum.ros.conversions import (
    equilibrium_to_ros,
    full_poses,
    poses_to_ros,
    pulls_from_ros,
    stiffness_from_ros,
)
from soft_continuum.ros.names import JAMMING_VALVES
from soft_continuum.ros.qos import LATCHED, SENSOR, STREAM
from soft_continuum.urdf import arm_urdf, joint_names
from soft_continuum_interfaces.msg import JammingValvesState, KinematicsState

MARKER_PERIOD = 0.05  # s
MIN_PERIOD = 0.005  # s between two shapes at least
CHECK_PERIOD = 0.02  # s after which what came sooner than that is followed
MIN_VACUUM = 0.01  # part of the full vacuum that a stiff segment has at least
PULL_RESOLUTION = 1e-9  # m: a smaller change of pull changes nothing
# m: pulls of an arm that is still where it was referenced.  The pulls of opposite bends cancel.
STRAIGHT_PULLS = 1e-5


class Kinematics(Node):
    """
    Follows the arm's shape by the rigid multibody model under gravity.

    Subscribes to tendon_states (sensor_msgs/JointState), jamming_valves/state and
    segment_N/pressure.  Publishes ~/state (soft_continuum_interfaces/KinematicsState),
    segment_poses and disc_poses (geometry_msgs/PoseArray), joint_states and tendon_tensions
    (sensor_msgs/JointState), shape_markers (visualization_msgs/MarkerArray),
    robot_description (std_msgs/String, latched), ~/status and /diagnostics.  Serves ~/reset
    (std_srvs/Trigger).

    The shape of a stiff segment is known only by having followed it.  A node that starts on an
    arm with pulled tendons says that the shape is unknown, and publishes none, until ~/reset.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters, topics and services."""
        super().__init__('kinematics', **options)
        self.parameters = NodeParameters(self, NODE_PARAMETERS['kinematics'])
        self.status = Status(self, 'rigid multibody model')
        self._arm = arm_from_parameters(self.parameters)
        self._tendons = self._arm.tendon_names
        self._compiled = False
        self._statics = Statics(self._arm)
        segments = len(self._arm.segments)
        self._stiff: tuple[bool | None, ...] = (None,) * segments
        self._vacuum = np.ones(segments)  # parts of the full vacuum
        self._elastic = [i for i, s in enumerate(self._arm.segments) if not s.jam.rigid]
        self._pulls: Array | None = None
        self._next_pulls: Array | None = None  # not followed yet
        self._next_stiff: tuple[bool | None, ...] = self._stiff
        self._followed = 0.0  # when, s (steady)
        self._sliding = np.zeros(len(self._tendons), dtype=int)
        self._state: Equilibrium | None = None
        self._solved: tuple[Any, ...] = ()
        frame = self.parameters['frame_id']
        self._segment_message, self._disc_message = PoseArray(), PoseArray()
        self._joint_message = JointState(name=joint_names(self._statics.chain))
        self._tension_message = JointState(name=list(self._tendons))
        for message in (self._segment_message, self._disc_message):
            message.header.frame_id = frame
        self._segment_poses = self.create_publisher(PoseArray, 'segment_poses', STREAM)
        self._disc_poses = self.create_publisher(PoseArray, 'disc_poses', STREAM)
        self._joint_states = self.create_publisher(JointState, 'joint_states', STREAM)
        self._tensions = self.create_publisher(JointState, 'tendon_tensions', STREAM)
        self._markers = self.create_publisher(MarkerArray, 'shape_markers', STREAM)
        self._robot = self.create_publisher(String, 'robot_description', LATCHED)
        self._robot.publish(String(data=arm_urdf(self._arm, frame)))
        self._marked = 0.0
        self._states = self.create_publisher(KinematicsState, '~/state', STREAM)
        subscribe(self, JointState, 'tendon_states', self._on_tendons, SENSOR)
        subscribe(self, JammingValvesState, f'{JAMMING_VALVES}/state', self._on_jamming_valves,
                  LATCHED)
        for i in range(segments):
            subscribe(self, FluidPressure, f'segment_{i + 1}/pressure',
                      partial(self._on_pressure, i), SENSOR)
        self.conflicts = Conflicts(self, segments)
        repeat(self, CHECK_PERIOD, self._follow)
        serve(self, Trigger, '~/reset', self._on_reset)
        self.status.set(OK, loading())

    def callback_failed(self, error: Exception) -> None:
        """Report what a callback raised."""
        self.status.alarm('callback', f'{type(error).__name__}: {error}', FAILURE_PERIOD)

    def quit(self) -> None:
        """Nothing to do: this node moves nothing."""

    def start(self) -> None:
        """Load the model; then the node works as soon as the others publish."""
        load_model(self, self._on_model)

    def _on_model(self) -> None:
        self._compiled = True
        self.status.set(OK, 'waiting for tendon_states and jamming_valves/state')
        self._publish()

    def _on_jamming_valves(self, state: JammingValvesState) -> None:
        # A segment of which nothing is known keeps its stiffness: the shape of the arm does not
        # change because a wire broke.
        self._next_stiff = stiffness_from_ros(state, self._next_stiff)
        self._follow()

    def _on_pressure(self, segment: int, message: FluidPressure) -> None:
        """Follow the vacuum of a jam, which counts with the next pulls if it is not rigid."""
        vacuum = self.parameters['ambient_pressure'] - message.fluid_pressure
        if isfinite(vacuum) and segment in self._elastic:
            part = round(vacuum / self.parameters['full_vacuum'], 2)
            self._vacuum[segment] = min(1.0, max(MIN_VACUUM, part))

    def _on_tendons(self, message: JointState) -> None:
        try:
            pulls = pulls_from_ros(message, self._tendons)
        except ValueError as error:
            self.status.set(WARN, str(error))
            return
        if self._next_stiff != self._stiff:  # pulls after a change are followed after it
            self._follow_now()
        self._next_pulls = pulls
        self._follow()

    def _follow(self) -> None:
        """Follow what was reported last, but not more often than the model can."""
        if STEADY() - self._followed >= MIN_PERIOD:  # else the timer will
            self._follow_now()

    def _follow_now(self) -> None:
        if self._next_pulls is not None:
            # The motion up to now counts for the stiffness up to now.
            pulls, self._next_pulls = self._next_pulls, None
            self._take_pulls(pulls)
            self._publish()
        if self._next_stiff != self._stiff:
            self._stiff = self._next_stiff
            self._publish()
        self._followed = STEADY()

    def _take_pulls(self, pulls: Array) -> None:
        if self._pulls is not None:  # the last direction of motion is that of the friction
            change = pulls - self._pulls
            self._sliding = np.where(np.abs(change) > PULL_RESOLUTION, np.sign(change),
                                     self._sliding).astype(int)
        self._pulls = pulls

    def _publish(self) -> None:
        if not self._compiled or self._pulls is None or None in self._stiff:
            return
        if self._state is None and np.abs(self._pulls).max() <= STRAIGHT_PULLS:
            self._state = self._statics.chain.straight()
        if self._state is None:
            self.status.set(
                WARN, 'the shape is unknown: the tendons were pulled before this node started; '
                'straighten the arm and call tendon_actuation/reference, or soften every segment; '
                'then call ~/reset')
            return
        if not self._solve():
            return
        stamp = self.get_clock().now().to_msg()
        chain, state = self._statics.chain, self._state
        poses = full_poses(state.points)
        for message in (self._segment_message, self._disc_message, self._joint_message,
                        self._tension_message):
            message.header.stamp = stamp
        self._segment_poses.publish(poses_to_ros(poses[2::2], self._segment_message))
        self._disc_poses.publish(poses_to_ros(poses, self._disc_message))
        self._joint_message.position = state.joint_angles.tolist()
        self._joint_states.publish(self._joint_message)
        shape = equilibrium_to_ros(state)
        shape.stamp = stamp
        self._states.publish(shape)
        self._tension_message.effort = state.tensions.tolist()
        self._tensions.publish(self._tension_message)
        now = STEADY()
        if now - self._marked >= MARKER_PERIOD and self._markers.get_subscription_count():
            self._marked = now
            self._markers.publish(shape_markers(
                chain, state, self._stiff, self.parameters['tension_limit'],
                self.parameters['frame_id'], stamp))

    def _solve(self) -> bool:
        """Bring the state up to date; False when there is none that can be published."""
        assert self._pulls is not None and self._state is not None
        key = (*np.round(self._pulls / PULL_RESOLUTION), *self._stiff, *self._vacuum)
        if key == self._solved:
            return True
        soft = [not stiff for stiff in self._stiff]
        short = self._pulls - np.asarray(self._state.pulls)
        if not any(soft) and short.max() > self.parameters['straight_tolerance']:
            self.status.set(ERROR, 'the tendons do not fit the stiff arm: its shape is unknown',
                            **self._named('short', short))
            return False
        # A locked arm does not yield to the last step of a stepper.
        pulls = self._pulls if any(soft) else np.minimum(self._pulls, self._state.pulls)
        try:
            state = self._equilibrium(pulls, soft)
        except StaticsError as error:
            self.status.set(ERROR, f'no shape found: {error}')
            return False
        self._state, self._solved = state, key
        if state.jumped:
            self.get_logger().warning('a soft segment folded over to another equilibrium')
        self.status.set(
            OK, 'following the arm', soft=' '.join(str(i + 1) for i, s in enumerate(soft) if s),
            **self._named('tension', state.tensions, digits=2),
            **self._named('slack', state.slack))
        return True

    def _named(self, quantity: str, values: Iterable[float], digits: int = 6) -> dict[str, str]:
        """Return values of the status, one for each tendon."""
        return {f'{quantity}_{name}': f'{value:.{digits}f}'
                for name, value in zip(self._tendons, values, strict=True)}

    def _equilibrium(self, pulls: Array, soft: list[bool]) -> Equilibrium:
        """
        Return the state for pulls (2,) m; raises StaticsError.

        The tendons of the model do not give: with all of them a micrometre too short, as steppers
        round, the arm would buckle.  Up to SLACK_ALLOWANCE one is slackened, if possible the one
        that carries least.
        """
        assert self._state is not None
        sliding = self._sliding.tolist()
        vacuum = self._vacuum.tolist() if self._elastic else None
        state = self._statics.solve(self._state, pulls, soft, vacuum=vacuum, sliding=sliding)
        if all(state.taut):
            for tendon in np.argsort(state.tensions):
                eased = np.array(pulls)
                eased[tendon] -= SLACK_ALLOWANCE
                other = self._statics.solve(
                    self._state, eased, soft, vacuum=vacuum, sliding=sliding)
                if not other.taut[tendon]:
                    return other
        return state

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._pulls is None:
            response.message = 'no tendon_states yet; start tendon_actuation'
        elif not self._compiled:
            response.message = loading()
        elif True not in self._stiff and None not in self._stiff:
            # Without a stiff segment the pulls alone make the shape.
            try:
                self._state = self._statics.solve(
                    self._statics.chain.straight(), self._pulls, [True] * len(self._stiff))
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
        else:
            self._state, self._solved = self._statics.chain.straight(), ()
            response.success = True
            response.message = 'the arm is taken to be straight'
            self._publish()
        return response
