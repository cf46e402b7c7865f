# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node that owns the motors of the tendons: its load cells, and the tensions it predicts."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from math import inf, nan
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.drivers import families, TENDON_DRIVERS
from soft_continuum.hardware.protocols import HardwareError, TendonDriver
from soft_continuum.hardware.tendon_controller import (
    MotionRefusedError,
    Reason,
    TendonController,
    TendonLimits,
)
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.statics import SLACK_ALLOWANCE, Statics, StaticsError
from soft_continuum.nodes.emergency_stop import EmergencyStop
from soft_continuum.nodes.managed_node import CLOSE_TIMEOUT, ManagedNode
from soft_continuum.nodes.reported_arm import ReportedArm
from soft_continuum.nodes.suite_node import ERROR, OK, StatePublisher, WARN
from soft_continuum.nodes.tendon_control import MAX_POINTS, Report, Request, TendonControl
from soft_continuum.nodes.threads import load_model, loading, Newest, Worker
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.conversions import Stiffness, trajectory_from_ros
from soft_continuum.ros.entries import (
    guarded,
    LOG_PERIOD,
    MAX_BYTES,
    SENSOR,
    serve,
    STREAM,
    subscribe,
)
from soft_continuum.ros.names import LOAD_CELLS, TENDON_ACTUATION
from soft_continuum.ros.ros_time import Age
from soft_continuum.text import name_problem, plain
from soft_continuum_interfaces.msg import TendonActuationState, TendonTrajectory

MAX_HOLD_BYTES = 1000
"""Size of a trajectory that is parsed at once, because it may request a hold."""
PAUSE = 4.0  # after the conversion of a long trajectory, over the time that it took
REFUSAL_PAUSE = 0.01  # s after a refusal: a flood of them would keep other threads waiting
AGREE_PERIOD = 0.01  # s between two looks whether kinematics has the segments stiff that are
UNREAD_GAP = 0.1  # s between two reports of trajectories that were refused unread
MAX_AHEAD = 60.0  # s from now to the start of a trajectory
PREDICTION_STEP = 0.002  # m of pull between two predicted states
MAX_STATES = 2000
"""States predicted for one trajectory; one takes some milliseconds."""

Kind = type[JointTrajectory] | type[TendonTrajectory]


class TendonActuation(ManagedNode):
    """
    Moves the tendons along trajectories, within limits and interlocks.

    Subscribes to ~/joint_trajectory (trajectory_msgs/JointTrajectory), ~/tendon_trajectory
    (TendonTrajectory: the same with an id), jamming_valves/state, segment_N/pressure,
    kinematics/state and emergency_stop (std_msgs/Bool).  Publishes
    tendon_states (sensor_msgs/JointState), ~/state (TendonActuationState, latched), ~/status and
    /diagnostics.  Serves ~/stop, ~/resume and ~/reference (std_srvs/Trigger).

    Four threads: those of a ManagedNode, with a TendonControl on the control thread, and one that
    validates trajectories, because the model is slow.  A stop during the validation wins.

    A device that fails counts as lost: the node reconnects as soon as it replies, and then nothing
    moves before ~/resume.
    """

    _control: TendonControl

    def __init__(self, **options: Any) -> None:
        """Declare parameters, topics and services."""
        super().__init__(TENDON_ACTUATION, '{tendon_driver} tendon motors', **options)
        arm = arm_from_parameters(self.parameters)
        self._tendons = arm.tendon_names
        self._prediction = TensionPrediction(arm)
        self._arm = ReportedArm(self, self._prediction.chain, self.parameters)
        self._load_cells = LoadCells(self, self._tendons, self.parameters)
        rate = self.parameters['tendon_rate']
        self._control = TendonControl(
            self._tendons, self._arm, 1.0 / rate, self.ros_time.jump,
            lambda: self.parameters['tension_limit'],
            Newest(self.on_ros_thread, self._publish).put, self._release)
        self.start_control(rate)
        self._unread_age = Age()  # since an unread trajectory was reported as refused
        self._holds = Newest(self._to_loop, lambda _: self._control.hold(
            Reason.HELD, 'a trajectory without points requested a hold'))
        self._refusals = Newest(self._to_loop, lambda refusal: self._control.refuse(*refusal))
        self._judging = Worker('trajectories', self._on_thread_failure)
        self._compiled = False
        self._report: Report | None = None  # that was published
        self._states = self.create_publisher(JointState, 'tendon_states', STREAM)
        self._state_publisher = StatePublisher(self, TendonActuationState)
        for kind, topic in ((JointTrajectory, '~/joint_trajectory'),
                            (TendonTrajectory, '~/tendon_trajectory')):
            self.create_subscription(
                kind, topic, guarded(self, partial(self._on_trajectory, kind)), STREAM, raw=True)
        self._emergency = EmergencyStop(self, self._on_emergency)
        self._action: Any = None
        if find_spec('control_msgs') is not None:
            from soft_continuum.nodes.follow_joint_trajectory import FollowServer
            self._action = FollowServer(
                self, self._tendons, partial(self._have_judged, TendonTrajectory),
                partial(self._holds.put, True),
                partial(self.loop.post, self._control.give_up))
        serve(self, Trigger, '~/stop', self._on_stop)
        serve(self, Trigger, '~/resume', self._on_resume)
        serve(self, Trigger, '~/reference', self._on_reference)

    def callback_failed(self, error: Exception) -> None:
        """Hold, and report what a callback raised."""
        super().callback_failed(error)
        self.loop.post(self._control.hold, Reason.PROGRAM,
                        f'a callback failed: {type(error).__name__}: {error}')

    def _to_loop(self, function: Callable[[], None]) -> bool:
        self.loop.post(function)
        return True

    # The device.

    def open_device(self) -> TendonController:
        """Connect and read; move nothing."""
        family = families(TENDON_DRIVERS)[self.parameters['tendon_driver']]
        driver: TendonDriver = family.make(self.parameters, STEADY, self)
        driver.open()
        low, high = self.parameters['pull_limits']
        limits = TendonLimits(self._tendons, (low, high), self.parameters['speed_limit'])
        try:
            return TendonController(driver, limits, self._load_cells.tensions)
        except HardwareError:  # at the first reading: its ports must be free for the next attempt
            driver.close()
            raise

    def start(self) -> None:
        """Load the model, then connect if ``autostart`` is set."""
        self.status.set(OK, loading())
        load_model(self, self._prediction.chain.arm, self._on_model)

    def _on_model(self) -> None:
        self._compiled = True
        super().start()

    def quit(self) -> None:
        """Hold and disconnect before the process ends."""
        super().quit()
        self._judging.close(CLOSE_TIMEOUT)

    def destroy_node(self) -> None:
        """Destroy the action server before the node, as rclpy requires."""
        if self._action is not None:
            self._action.destroy()
        super().destroy_node()

    # Trajectories.

    def _on_trajectory(self, kind: Kind, data: bytes) -> None:
        """Leave a trajectory to the thread that judges; one without points holds at once."""
        if len(data) <= MAX_HOLD_BYTES and not _read(kind, data)[1].points:
            self._holds.put(True)
        else:
            self._have_judged(kind, data)

    def _have_judged(self, kind: Kind, data: bytes, request_id: str = '') -> None:
        """Have a trajectory judged; request_id: only where each is to be answered, unread too."""
        if len(data) > MAX_BYTES:
            self._refuse_unread(request_id, MotionRefusedError(
                Reason.INVALID, f'a trajectory of {len(data)} bytes; allowed: {MAX_BYTES}; '
                'send it in parts'))
        elif not self._judging.submit(self._judge, kind, data, self._control.revocations):
            self._refuse_unread(request_id, MotionRefusedError(
                Reason.BUSY, 'too many trajectories wait for validation; send them more slowly'))

    def _refuse_unread(self, request_id: str, error: MotionRefusedError) -> None:
        """Report a refusal, but not each of a flood: that costs more than the refusal."""
        if request_id or self._unread_age.seconds > UNREAD_GAP:
            self._unread_age.refresh()
            self._refuse(request_id, error)

    def _request(self, request_id: str, message: JointTrajectory, revocations: int) -> Request:
        """Return a trajectory as numbers; raises MotionRefusedError when it cannot be one."""
        if not self._compiled:
            raise MotionRefusedError(Reason.INACTIVE, loading())
        if len(message.points) > MAX_POINTS:
            raise MotionRefusedError(
                Reason.INVALID, f'{len(message.points)} points; allowed: {MAX_POINTS}; '
                'send the trajectory in parts')
        try:
            times, pulls = trajectory_from_ros(message, self._tendons)
        except ValueError as error:
            raise MotionRefusedError(Reason.INVALID, str(error)) from None
        if problem := name_problem(request_id):
            raise MotionRefusedError(Reason.INVALID, f'the id is {problem}')
        start = self.ros_time.steady(message.header.stamp)
        if start is not None and start > STEADY() + MAX_AHEAD:
            raise MotionRefusedError(
                Reason.INVALID, f'it starts {start - STEADY():.1f} s from now; allowed: '
                f'{MAX_AHEAD:g} s; check header.stamp (zero: start now) and the clocks')
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        return Request(request_id, times, pulls, start, revocations, stamp)

    def _judge(self, kind: Kind, data: bytes, revocations: int) -> None:
        """Follow a trajectory if nothing forbids it; on a thread that may take long."""
        control, shown_id = self._control, ''
        try:
            begin = STEADY()
            request_id, message = _read(kind, data)
            if len(data) > MAX_HOLD_BYTES:  # nothing else in this process ran meanwhile
                STEADY.sleep(PAUSE * (STEADY() - begin))
            shown_id = plain(request_id)
            request = self._request(request_id, message, revocations)
            pulls = self.loop.call(control.prepare, request)
            stiffness = self._predict(
                pulls, begin, lambda: control.revocations != revocations)
            self.loop.call(control.follow, request, stiffness)
        except MotionRefusedError as error:
            self._refuse(shown_id, error)
            STEADY.sleep(REFUSAL_PAUSE)
        except Exception as error:
            self._refuse(shown_id, MotionRefusedError(
                Reason.INVALID, f'it could not be validated: {type(error).__name__}: {error}'))
            raise

    def _predict(self, pulls: Array, begin: float, revoked: Callable[[], bool]) -> Stiffness:
        """
        Return the stiffness with which pulls (k, tendons), m, keep the tension limits.

        On a busy computer the states of other nodes may arrive later than a trajectory that was
        planned from them.  So a shape from before ``begin``, s, does not refuse it: the prediction
        is repeated with the next shape, if one arrives.  Ends early once ``revoked``.  Raises
        MotionRefusedError.
        """
        arm, parameters = self._arm, self.parameters
        limits = TensionLimits(parameters['tension_limit'], parameters['co_contraction_limit'])
        while True:
            stiffness = arm.stiffness
            while not (arm.agreed or arm.motion_interlock() or revoked()):
                STEADY.sleep(AGREE_PERIOD)  # else its jams would not be where they formed
            known, time = arm.shape_and_model, self._shape_time
            if known is None:
                return stiffness  # follow() says why not
            try:
                self._prediction.check(
                    pulls + known[1].offsets, known[0],
                    [not jam for jam in arm.jammed(stiffness)], limits, revoked)
                return stiffness
            except MotionRefusedError:
                end = begin + arm.timeout
                while self._shape_time <= begin and STEADY() < end and not revoked():
                    STEADY.sleep(AGREE_PERIOD)
                if time > begin or self._shape_time <= begin:
                    raise

    @property
    def _shape_time(self) -> float:
        """Time of the last reported shape, s (steady); before all others without one."""
        time = self.ros_time.steady(self._arm.kinematics.stamp)
        return -inf if time is None else time

    def _refuse(self, request_id: str, error: MotionRefusedError) -> None:
        if error.reason is Reason.HELD:  # by its sender
            self.get_logger().info(f'trajectory refused: {error}',
                                   throttle_duration_sec=LOG_PERIOD)
        else:
            self.get_logger().error(f'trajectory refused: {error}',
                                    throttle_duration_sec=LOG_PERIOD)
        self._refusals.put((request_id, error.reason, str(error)))

    # What is reported.

    def _publish(self, report: Report) -> None:
        state, reading, last = report.state, report.reading, self._report
        self._report = report
        if state.connected and not state.referenced:
            self._arm.clear_shape()
        self._state_publisher.publish(state)
        if reading is not None and (last is None or reading is not last.reading):
            message = JointState(
                name=list(self._tendons),
                # Subscribers would take an invalid number for a pull.
                position=list(reading.pulls) if reading.referenced else [],
                velocity=list(reading.speeds), effort=list(reading.tensions or ()))
            message.header.stamp = self.ros_time.stamp(report.time)
            self._states.publish(message)
        self.status.set(*self._summary(report), stopped=state.stop_message, ended=report.ended,
                        referenced=str(state.referenced).lower(), refused=report.refused)
        if self._action is not None:  # last: whatever it raises, the state was told
            self._action.report(report)

    def _summary(self, report: Report) -> tuple[bytes, str]:
        """Return the level and the text of the status."""
        state = report.state
        if state.fault:
            return ERROR, state.fault
        if not state.connected:
            return OK, 'not connected'
        if not self.active:
            return OK, 'inactive'
        if not self._compiled:
            return WARN, loading()
        if state.homing:
            return WARN, 'homing'
        if state.stopped != TendonActuationState.NOT_STOPPED:
            return WARN, f'stopped: {state.stop_message}'
        if not state.referenced:
            why = report.reading.unreferenced if report.reading else ''
            return WARN, f'position not referenced{why and f": {why}"}'
        if report.unmeasured:
            return WARN, report.unmeasured
        if report.ended:
            return WARN, report.ended
        return OK, 'following' if state.moving else 'holding'

    # Services.

    def _answer(self, response: Trigger.Response, function: Callable[..., tuple[bool, str]],
                *arguments: Any) -> Trigger.Response:
        try:
            response.success, response.message = self.loop.call(function, *arguments)
        except TimeoutError:
            response.message = 'the control thread did not answer; see the log of this node'
        return response

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._answer(response, self._control.stop,
                            TendonActuationState.STOPPED_BY_SERVICE, '~/stop was called')

    def _on_emergency(self, on: bool) -> None:
        self.loop.post(self._control.emergency, on)
        if not on:
            self.get_logger().warning('emergency_stop is off; nothing moves before ~/resume')

    def _on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._answer(response, self._control.resume)

    def _on_reference(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._answer(response, self._control.reference)
        if response.success and self._report is not None:
            # Pulls before and after count from different zeros and must not be mixed.
            self._arm.clear_shape()
            state = copy(self._report.state)
            state.referenced = False
            self._state_publisher.publish(state)
            # Pulls from the new zero go out before the answer: who has that may ask for a shape.
            self._publish(self.loop.call(self._control.snapshot))
        return response


def _read(kind: Kind, data: bytes) -> tuple[str, JointTrajectory]:
    """Return the id and the trajectory of a message."""
    message = deserialize_message(data, kind)
    if isinstance(message, TendonTrajectory):
        return message.id, message.trajectory
    return '', message


class LoadCells:
    """
    Tensions from effort in load_cells (sensor_msgs/JointState), with the names of the tendons.

    They may share a message or have one each.  The ROS thread writes, any thread reads.
    """

    def __init__(self, node: Node, tendons: Sequence[str], parameters: Mapping[str, Any]) -> None:
        """Subscribe if load_cells.enabled is set; raises ParameterError."""
        self._tendons = tuple(tendons)
        self._enabled: bool = parameters['load_cells.enabled']
        self._parameters = parameters
        self._zeros, self._scales = (
            _per_tendon(name, parameters[name], tendons) if self._enabled else ()
            for name in ('load_cells.zeros', 'load_cells.scales'))
        self._last = {name: (nan, Age()) for name in tendons}  # N
        if 0.0 in self._scales:
            raise ParameterError('parameter load_cells.scales has a 0, which hides every tension; '
                                 'soft_continuum calibrate load_cells finds the scales')
        if self._enabled:
            subscribe(node, JointState, LOAD_CELLS, self._on_message, SENSOR)

    def _on_message(self, message: JointState) -> None:
        for name, effort in zip(message.name, message.effort, strict=False):
            if name in self._last:
                t = self._tendons.index(name)
                self._last[name] = self._scales[t] * (effort - self._zeros[t]), Age.now()

    def tensions(self) -> tuple[float, ...] | None:
        """Return the tension of each tendon, N, nan for a stale cell; None without load cells."""
        if not self._enabled:
            return None
        timeout = self._parameters['stale_timeout']
        return tuple(tension if age.seconds <= timeout else nan
                     for tension, age in map(self._last.__getitem__, self._tendons))


def _per_tendon(name: str, values: Sequence[float], tendons: Sequence[str]) -> tuple[float, ...]:
    if len(values) != len(tendons):
        raise ParameterError(f'parameter {name} has {len(values)} numbers; needed: one for each '
                             f'of {", ".join(tendons)}')
    return tuple(values)


@dataclass(frozen=True)
class TensionLimits:
    """
    Limits of predicted tension: of any tendon, and of opposing tendons at once, N.

    Tendons that end at one disc oppose each other if the backbone is between them: their common
    tension bends nothing.
    """

    any_tendon: float
    at_once: float


class TensionPrediction:
    """Predicts tensions along trajectories, and refuses those that exceed the limits."""

    def __init__(self, arm: Arm) -> None:
        """Prepare the model of ``arm``, which is compiled on first use."""
        self._statics: Statics = Statics(arm)
        self._tendons = arm.tendon_names
        self.opposing = arm.opposing_tendons
        """Numbers of the tendons that oppose each other, in groups."""
        self.chain = self._statics.chain

    @staticmethod
    def steps(pulls: Array) -> list[int]:
        """
        Return how many states are predicted between the points of pulls (k, tendons) in m.

        Raises MotionRefusedError when they are more than MAX_STATES.
        """
        moves = np.abs(np.diff(pulls, axis=0)).max(axis=1)
        steps: list[int] = np.maximum(1, np.ceil(moves / PREDICTION_STEP)).astype(int).tolist()
        if sum(steps) > MAX_STATES:
            raise MotionRefusedError(
                Reason.INVALID,
                f'{len(pulls)} points with {moves.sum():.3f} m of pull take {sum(steps)} '
                f'predicted states; allowed: {MAX_STATES}; send it in parts')
        return steps

    def check(self, pulls: Array, shape: Equilibrium, soft: Sequence[bool],
              limits: TensionLimits, revoked: Callable[[], bool]) -> None:
        """
        Refuse pulls (k, tendons) in m that exceed the tension limits or have no equilibrium.

        pulls: including the offsets of the tendons.  shape: best estimate of the initial shape.
        soft: per segment.  Ends early once ``revoked``.  Raises MotionRefusedError.
        """
        state, vacuum = shape, shape.vacuum or None
        if self._statics.chain.arm is not shape.chain.arm:
            self._statics = Statics(shape.chain.arm)
        try:
            for before, after, steps in zip(
                    pulls[:-1], pulls[1:], self.steps(pulls), strict=True):
                sliding = np.sign(after - before).astype(int).tolist()
                for part in np.arange(1, steps + 1) / steps:
                    if revoked():
                        return
                    wanted = before + part * (after - before)
                    state = self._statics.solve(
                        state, wanted - SLACK_ALLOWANCE, soft, vacuum=vacuum, sliding=sliding)
                    self._check(wanted, np.asarray(state.tensions), limits)
        except StaticsError as error:
            raise MotionRefusedError(Reason.TENSION, str(error)) from None

    def _check(self, pulls: Array, tensions: Array, limits: TensionLimits) -> None:
        at_once = max((tensions[which].min() for which in self.opposing), default=0.0)
        if tensions.max() > limits.any_tendon or at_once > limits.at_once:
            predicted = ', '.join(
                f'{name} {pull * 1e3:.2f} mm: {tension:.1f} N' for name, pull, tension
                in zip(self._tendons, pulls, tensions, strict=True))
            raise MotionRefusedError(
                Reason.TENSION,
                f'the motion would need excessive tensions, at {predicted}; tension_limit: '
                f'{limits.any_tendon:g} N, co_contraction_limit (opposing tendons at once): '
                f'{limits.at_once:g} N')
