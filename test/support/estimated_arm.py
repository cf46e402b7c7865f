# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Stand-ins of the four nodes, over DDS: they publish an estimate that a test makes up."""

from collections.abc import Sequence
from math import cos, sin
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, Pose, PoseArray, PoseWithCovariance, Quaternion
import numpy as np
import rclpy
from rclpy.action import ActionServer
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from rclpy.time import Duration
from sensor_msgs.msg import FluidPressure, JointState

from soft_continuum.mechanics.chain import Chain
from soft_continuum.mechanics.rotations import full_poses
from soft_continuum.ros.conversions import poses_to_ros
from soft_continuum.ros.description import load_arm
from soft_continuum.ros.entries import make_executor
from soft_continuum.ros.names import NODES
from soft_continuum.ros.urdf import joint_names
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import (
    EstimatedParameter,
    JammingValvesState,
    KinematicsState,
    ShapeSequencerState,
    TendonActuationState,
)
from soft_continuum_interfaces.srv import PlanShapes
from support.ros_rig import AMBIENT, LATCHED, parameter_values, Spinner, STREAM, TENDONS

PERIOD = 0.1  # s
ARM = load_arm(description_file())
CHAIN = Chain(ARM)


class StandIn(Node):
    """A node of the suite by its name and its parameters."""

    def __init__(self, name: str, **options: Any) -> None:
        parameters = parameter_values(name)
        if name == 'shape_sequencer' and 'closed_loop' not in {p.name for p in parameters}:
            parameters.append(Parameter('closed_loop', value=True))
        super().__init__(name, parameter_overrides=parameters,
                         automatically_declare_parameters_from_overrides=True, **options)

    def quit(self) -> None:
        """Nothing to do."""


def joint_angles(bending_angles: Sequence[float]) -> Any:
    """Return the joint angles of constant curvature, rad."""
    each = CHAIN.bodies // len(bending_angles)
    return np.repeat(np.array(bending_angles) / each, each)


class EstimatedArm:
    """
    An arm that rests, all stiff, and what is estimated of it.

    state: the KinematicsState that is published; its stamps are added.  angles, predicted: bending
    angles (rad) of the shape, and of the prediction or None.  age: s since the last measurement,
    None for no measurement.  goals: those that were sent.  closed_loop: the parameter.  plan: what
    plan_shapes answers; planned: what it was asked for.
    """

    def __init__(self, domain: int, namespace: str = '/arm_under_test') -> None:
        self.state = KinematicsState()
        self.angles: Sequence[float] = (0.3, 0.2, -0.3)
        self.predicted: Sequence[float] | None = None
        self.age: float | None = None
        self.goals: list[RunShapeSequence.Goal] = []
        self.plan = PlanShapes.Response()
        self.planned: list[PlanShapes.Request] = []
        self._end: Any = None
        self._feedback: RunShapeSequence.Feedback | None = None
        self._running = ShapeSequencerState()
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._nodes = [StandIn(name, context=self._context, namespace=namespace)
                       for name in NODES]
        node = self._nodes[0]
        self._streams = {name: node.create_publisher(kind, name, STREAM) for name, kind in (
            ('tendon_states', JointState), ('joint_states', JointState),
            ('tendon_tensions', JointState), ('segment_poses', PoseArray),
            ('disc_poses', PoseArray), ('predicted_disc_poses', PoseArray),
            ('kinematics/state', KinematicsState),
            *((f'segment_{n}/pressure', FluidPressure) for n in (1, 2, 3)))}
        self._states: dict[str, Any] = {name: node.create_publisher(kind, f'{name}/state', LATCHED)
                        for name, kind in (('tendon_actuation', TendonActuationState),
                                           ('jamming_valves', JammingValvesState),
                                           ('shape_sequencer', ShapeSequencerState))}
        self._states |= {f'{name}/status': node.create_publisher(
            DiagnosticStatus, f'{name}/status', LATCHED) for name in NODES}
        for name in NODES:
            self._states[f'{name}/status'].publish(DiagnosticStatus(message='a stand-in'))
        self._action = ActionServer(
            node, RunShapeSequence, 'run_shape_sequence', self._execute,
            cancel_callback=lambda _: rclpy.action.CancelResponse.ACCEPT)
        self._nodes[-1].create_service(PlanShapes, '~/plan_shapes', self._plan)
        node.create_timer(PERIOD, self._publish)
        self._spinner = Spinner(
            make_executor(self._context), self._nodes, self._context)
        self._spinner.start()

    def close(self) -> None:
        """End the stand-ins."""
        self._nodes[0].quit = self._action.destroy  # when nothing spins any more
        self._spinner.end()
        self._context.try_shutdown()
        assert not self._spinner.failure, self._spinner.failure

    @property
    def closed_loop(self) -> bool:
        """The parameter of shape_sequencer."""
        return bool(self._nodes[-1].get_parameter('closed_loop').value)

    def set_closed_loop(self, closed: bool) -> None:
        """Set it, as another client would."""
        self._nodes[-1].set_parameters([Parameter('closed_loop', value=closed)])

    def _plan(self, request: PlanShapes.Request, _: Any) -> PlanShapes.Response:
        self.planned.append(request)
        return self.plan

    # A goal, which runs until the test ends it.

    async def _execute(self, handle: Any) -> RunShapeSequence.Result:
        self.goals.append(handle.request)
        self._running.running, self._running.goal_id = True, handle.goal_id
        self._running.shape, self._running.phase = handle.request.shapes[0].name, 'measuring'
        self._running.segment = 2
        self._end, self._handle = Future(executor=self._nodes[0].executor), handle
        result = await self._end
        self._running.running = False
        handle.succeed()
        return result

    def feed_back(self, **feedback: Any) -> None:
        """Publish feedback of the goal that runs, again and again as shape_sequencer does."""
        self._feedback = RunShapeSequence.Feedback(
            shape=self._running.shape, segment=2, phase='measuring',
            aim=self.goals[-1].aim, **feedback)

    def end_goal(self, **result: Any) -> None:
        """End the goal that runs."""
        self._feedback = None
        self._end.set_result(RunShapeSequence.Result(**result))

    # What is published.

    def _publish(self) -> None:
        now = self._nodes[0].get_clock().now()
        stamp = now.to_msg()
        joints, points = joint_angles(self.angles), CHAIN.plane_points(joint_angles(self.angles))
        state = self.state
        state.stamp = stamp
        state.measured = Time() if self.age is None else (
            now - Duration(seconds=self.age)).to_msg()
        state.joint_angles = state.held_angles = joints.tolist()
        state.stiff, state.vacuum = [True] * 3, [1.0] * 3
        poses = full_poses(points)
        streams = {
            'tendon_states': JointState(name=list(TENDONS), position=[0.001, -0.001],
                                        velocity=[0.0, 0.0]),
            'tendon_tensions': JointState(name=list(TENDONS), effort=[0.0, 4.0]),
            'joint_states': JointState(name=joint_names(CHAIN), position=joints.tolist()),
            'disc_poses': poses_to_ros(poses, PoseArray()),
            'segment_poses': poses_to_ros(poses[2::2], PoseArray()),
            'kinematics/state': state,
            **{f'segment_{n}/pressure': FluidPressure(fluid_pressure=AMBIENT - 70e3)
               for n in (1, 2, 3)}}
        if self.predicted is not None:
            streams['predicted_disc_poses'] = poses_to_ros(
                full_poses(CHAIN.plane_points(joint_angles(self.predicted))), PoseArray())
        for name, message in streams.items():
            self._streams[name].publish(message)
        if self._feedback is not None and self._running.running:
            self._handle.publish_feedback(self._feedback)
        self._states['tendon_actuation'].publish(TendonActuationState(
            tendons=list(TENDONS), connected=True, referenced=True))
        self._states['jamming_valves'].publish(JammingValvesState(
            connected=True, stiffness=[JammingValvesState.STIFF] * 3))
        self._states['shape_sequencer'].publish(self._running)


def tip_covariance(x: float, z: float, angle: float) -> list[float]:
    """Return the covariance of a tip in the plane, of deviations in m and rad."""
    return [float(v) for v in np.diag(np.square([x, 0.0, z, 0.0, angle, 0.0])).ravel()]


def tip(x: float, z: float, angle: float) -> PoseWithCovariance:
    """Return a measured tip in the plane, m and rad."""
    pose = Pose(position=Point(x=x, z=z),
                orientation=Quaternion(y=sin(angle / 2), w=cos(angle / 2)))
    return PoseWithCovariance(pose=pose, covariance=tip_covariance(3e-4, 4e-4, 0.01))


def learned(name: str, value: float, stddev: float, determined: bool = True,
            problem: str = '') -> EstimatedParameter:
    """Return a parameter as kinematics publishes it."""
    return EstimatedParameter(name=name, value=value, stddev=stddev, determined=determined,
                              problem=problem)
