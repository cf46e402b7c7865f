# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The node that owns the tendon steppers."""

from typing import Any

from builtin_interfaces.msg import Time
import numpy as np
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from soft_continuum.hardware.drivers import make_driver, TENDON_DRIVERS
from soft_continuum.hardware.protocols import HardwareError, TendonDriver
from soft_continuum.hardware.tendon_controller import (
    MotionRefusedError,
    Reason,
    TendonController,
    TendonLimits,
)
from soft_continuum.mechanics.arm import TENDONS
from soft_continuum.mechanics.chain import Array, Equilibrium, LEFT, RIGHT
from soft_continuum.mechanics.statics import Statics, StaticsError
from soft_continuum.nodes.support import (
    EmergencyStop,
    ERROR,
    load_model,
    ManagedNode,
    OK,
    RETRY,
    SLACK_ALLOWANCE,
    WARN,
)
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.nodes import NODE_PARAMETERS
from soft_continuum.ros.age import Age
from soft_continuum.ros.conversions import seconds, trajectory_from_ros
from soft_continuum.ros.qos import LATCHED, SENSOR, STREAM

STRAIGHT = 0.02  # rad: largest bending angle of a segment that counts as straight
PREDICTION_STEP = 0.002  # m of pull between two predicted states


class TendonActuation(ManagedNode):
    """
    Moves both tendons along trajectories, as far as the arm may be moved.

    Subscribes to ~/joint_trajectory (trajectory_msgs/JointTrajectory), segment_N/stiff,
    segment_N/pressure, joint_states and emergency_stop (std_msgs/Bool).  Publishes tendon_states
    (sensor_msgs/JointState), ~/status and /diagnostics.  Serves ~/stop, ~/resume and ~/reference
    (std_srvs/Trigger).

    A device that fails counts as lost: it is connected to again as soon as it answers, and then
    nothing moves before ~/resume.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters, topics and services."""
        super().__init__('tendon_actuation', NODE_PARAMETERS['tendon_actuation'], **options)
        self._arm = arm_from_parameters(self.parameters)
        load_model(self)
        self._statics = Statics(self._arm)
        self._controller: TendonController | None = None
        self._driver: TendonDriver | None = None
        self._stopped_because = ''  # while there is no controller to keep it
        self._lost = ''  # why the device was lost
        self._connect_age = Age()  # since the last attempt to connect to it again
        self._refused = ''
        self._refused_stamp = Time()
        self._ended = ''
        self._stiff: list[bool | None] = [None] * len(self._arm.segments)
        self._stiff_at_start: list[bool | None] = []
        self._jamming_age = Age()
        self._shape: Equilibrium | None = None
        self._shape_age = Age()
        self._states = self.create_publisher(JointState, 'tendon_states', STREAM)
        self.create_subscription(
            JointTrajectory, '~/joint_trajectory', self._on_trajectory, STREAM)
        self.create_subscription(JointState, 'joint_states', self._on_shape, SENSOR)
        for i in range(len(self._arm.segments)):
            self.create_subscription(
                Bool, f'segment_{i + 1}/stiff',
                lambda message, i=i: self._on_stiff(i, message.data), LATCHED)
        self.create_subscription(
            FluidPressure, 'segment_1/pressure', lambda _: self._jamming_age.refresh(), SENSOR)
        self._emergency = EmergencyStop(self, self._on_emergency)
        self.create_service(Trigger, '~/stop', self._on_stop)
        self.create_service(Trigger, '~/resume', self._on_resume)
        self.create_service(Trigger, '~/reference', self._on_reference)
        self._interval = 1.0 / self.parameters['tendon_rate']
        self._timer = self.create_timer(self._interval, self._update)

    def hardware_id(self) -> str:
        """Name the driver."""
        return f'{self.parameters["tendon_driver"]} tendon steppers'

    def configure(self) -> None:
        """Connect and read; move nothing."""
        driver: TendonDriver = make_driver(
            TENDON_DRIVERS, self.parameters['tendon_driver'], self.parameters, self._seconds)
        driver.open()
        self._driver, self._controller = driver, TendonController(driver, self._limits())
        self._lost = ''
        if self._stopped_because:  # a stop outlasts a reconnection
            self._controller.stop(self._stopped_because)
        self.status.set(OK, 'connected')

    def deactivate(self) -> None:
        """Brake and hold."""
        if self._controller is not None:
            try:
                self._controller.hold()
            except HardwareError as error:
                self._lose(error)
                return
        self.status.set(OK, 'inactive')

    def clean_up(self) -> None:
        """Hold and disconnect."""
        self._disconnect()
        self._lost = ''

    def _disconnect(self) -> None:
        if self._controller is not None:
            self._stopped_because = self._controller.stopped_because
        if self._driver is not None:
            self._driver.close()
        self._driver = self._controller = None

    def _lose(self, error: HardwareError) -> None:
        """Disconnect from a device that failed; nothing moves before it is back and ~/resume."""
        self._disconnect()
        self._lost = str(error)
        self._stopped_because = self._stopped_because or f'the device failed: {error}'
        self._connect_age.refresh()
        self._say()

    def _connect_again(self) -> None:
        if self._connect_age.seconds < RETRY:
            return
        try:
            self.configure()
        except (HardwareError, ValueError) as error:
            self._lost = str(error)
        self._say()
        self._connect_age.refresh()

    def _limits(self) -> TendonLimits:
        low, high = self.parameters['pull_limits']
        return TendonLimits(TENDONS, (low, high), self.parameters['speed_limit'])

    def _seconds(self) -> float:
        return self.get_clock().now().nanoseconds * 1e-9

    def _on_stiff(self, segment: int, stiff: bool) -> None:
        self._stiff[segment] = stiff
        self._jamming_age.refresh()

    def _on_shape(self, message: JointState) -> None:
        if (len(message.position) != self._statics.chain.joints
                or not np.all(np.isfinite(message.position))):
            return
        self._shape = self._statics.chain.state(message.position)
        self._shape_age.refresh()

    def _on_trajectory(self, message: JointTrajectory) -> None:
        if not self.active or self._controller is None:
            self._refuse(message, self._lost or 'the node is not active')
            return
        try:
            if not message.points:
                self._controller.hold()
                return
            obstacle = self._obstacle()
            if obstacle:
                raise MotionRefusedError(Reason.ALL_STIFF, obstacle)
            now = self._seconds()
            times, pulls = trajectory_from_ros(message, now)
            begin = seconds(message.header.stamp) or now
            self._controller.accept(times, pulls, now, self._predict, begin)
            self._refused = self._ended = ''
            self._stiff_at_start = list(self._stiff)
        except MotionRefusedError as error:
            self._refuse(message, str(error))
        except HardwareError as error:
            self._lose(error)

    def _refuse(self, message: JointTrajectory, reason: str) -> None:
        self._refused, self._refused_stamp = reason, message.header.stamp
        self.get_logger().error(f'trajectory refused: {reason}')
        self._say()

    @property
    def _knows_stiffness(self) -> bool:
        return (None not in self._stiff
                and self._jamming_age.seconds <= self.parameters['silence_timeout'])

    @property
    def _known_shape(self) -> Equilibrium | None:
        fresh = self._shape_age.seconds <= self.parameters['silence_timeout']
        return self._shape if fresh else None

    def _obstacle(self) -> str:
        """Say why the arm must not be moved at all now; empty when nothing speaks against it."""
        silence = self.parameters['silence_timeout']
        if not self._knows_stiffness:
            return ('it is not known which segments are soft: nothing heard of jamming_valves '
                    f'for {silence:g} s')
        if all(self._stiff):
            return ('every segment is stiff; soften one first '
                    '(jamming_valves/segment_N/set_stiff)')
        if self._known_shape is None:
            return ('the shape of the arm is not known, so no tension can be predicted: no '
                    f'joint_states from kinematics for {silence:g} s')
        return ''

    def _homing_obstacle(self) -> str:
        """Say why tendons must not be let out to their switches now; empty when they may."""
        if not self._knows_stiffness:
            return 'it is not known whether the arm is stiff: nothing heard of jamming_valves'
        if not all(self._stiff):
            return 'homing lets the tendons out: stiffen every segment'
        if (shape := self._known_shape) is not None:
            bent = np.abs(self._statics.chain.bending_angles(shape.joint_angles)).max()
            if bent > STRAIGHT:
                return ('homing ends where the straight arm has its tendons just taut, but a '
                        f'segment is bent by {bent:.3f} rad: straighten the arm, and call '
                        'kinematics/reset if kinematics is wrong')
        return ''

    def _predict(self, pulls: Array) -> None:
        """Refuse pulls (k, 2) m in which the model sees too much tension, or no shape at all."""
        assert self._shape is not None
        limit = self.parameters['tension_limit']
        both_limit = self.parameters['co_contraction_limit']
        soft = [not stiff for stiff in self._stiff]
        state = self._shape
        try:
            for before, after in zip(pulls[:-1], pulls[1:], strict=True):
                steps = int(np.ceil(np.abs(after - before).max() / PREDICTION_STEP)) or 1
                for part in np.arange(1, steps + 1) / steps:
                    wanted = before + part * (after - before)
                    state = self._statics.solve(state, wanted - SLACK_ALLOWANCE, soft)
                    right, left = state.tensions
                    if max(right, left) > limit or min(right, left) > both_limit:
                        raise MotionRefusedError(
                            Reason.TENSION,
                            f'at pulls of right {wanted[RIGHT] * 1e3:.2f} mm, left '
                            f'{wanted[LEFT] * 1e3:.2f} mm the tension would be {right:.1f} and '
                            f'{left:.1f} N; tension_limit: {limit:g} N, co_contraction_limit '
                            f'(both at once): {both_limit:g} N')
        except StaticsError as error:
            raise MotionRefusedError(Reason.TENSION, str(error)) from None

    def _update(self) -> None:
        controller = self._controller
        if controller is None:
            if self._lost:
                self._connect_again()
            return
        try:
            if controller.busy:
                obstacle = self._homing_obstacle() if controller.homing else self._obstacle()
                if not obstacle and not controller.homing and self._stiff != self._stiff_at_start:
                    obstacle = 'a segment changed between soft and stiff during the motion'
                if obstacle and not self._ended:
                    controller.hold()
                    self._ended = f'motion ended: {obstacle}'
            reading = controller.update(self._seconds(), self._interval)
        except HardwareError as error:
            self._lose(error)
            return
        if not self.active:
            return
        if controller.homing and not reading.referenced:  # positions mean nothing meanwhile
            self._say()
            return
        message = JointState(name=list(TENDONS), position=list(reading.pulls),
                             velocity=list(reading.speeds), effort=list(reading.tensions or ()))
        message.header.stamp = self.get_clock().now().to_msg()
        self._states.publish(message)
        self._say()

    def _say(self) -> None:
        controller = self._controller
        if controller is None:
            self.status.set(ERROR if self._lost else OK, self._lost or 'not connected',
                            stopped=self._stopped_because, refused=self._refused)
            return
        if controller.homing:
            level, text = WARN, 'homing'
        elif controller.stopped:
            level, text = WARN, f'stopped: {controller.stopped_because}'
        elif not controller.reading.referenced:
            level, text = WARN, 'position not referenced'
        elif self._ended:
            level, text = WARN, self._ended
        else:
            level, text = OK, 'following' if controller.following else 'holding'
        self.status.set(
            level, text, stopped=controller.stopped_because, ended=self._ended,
            referenced=str(controller.reading.referenced).lower(), refused=self._refused,
            refused_stamp=f'{self._refused_stamp.sec}.{self._refused_stamp.nanosec:09d}')

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = self._stop('~/stop was called')
        return response

    def _on_emergency(self, on: bool) -> None:
        if on:
            self._stop('emergency_stop is on')
        else:
            self.get_logger().warning('emergency_stop is off; nothing moves before ~/resume')

    def _stop(self, reason: str) -> tuple[bool, str]:
        """Stop all motion; return whether the device was reached, and what to say."""
        if self._controller is None:
            self._stopped_because = reason
            self._say()
            if self._lost:
                return False, f'the stop did not reach the device: {self._lost}'
            return True, 'not connected; stopped all the same'
        try:
            self._controller.stop(reason)
        except HardwareError as error:
            self._lose(error)
            return False, f'the stop did not reach the device: {error}'
        self._say()
        return True, 'stopped, holding tension; nothing moves before ~/resume'

    def _on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._emergency.on:
            response.message = 'emergency_stop is on; it has to be published as false first'
            return response
        if not self.active or self._controller is None:
            response.message = self._lost or 'the node is not active'
            return response
        self._controller.resume()
        self._ended = ''
        self._say()
        response.success = True
        response.message = 'ready, from the present position'
        return response

    def _on_reference(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self.active or self._controller is None:
            response.message = self._lost or 'the node is not active'
            return response
        homes = self._driver is not None and self._driver.reference_moves
        if homes and (obstacle := self._homing_obstacle()):
            response.message = obstacle
            return response
        try:
            self._ended = ''
            self._controller.reference()
        except MotionRefusedError as error:
            response.message = str(error)
            return response
        except HardwareError as error:
            self._lose(error)
            response.message = str(error)
            return response
        self._say()
        response.success = True
        response.message = ('homing; the tendons are at zero pull when they rest' if homes else
                            'the present position counts as the straight arm; '
                            'call kinematics/reset if it was not known')
        return response
