# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm in teleop: one segment, by targets of the servo."""

from collections.abc import Coroutine, Mapping
from concurrent.futures import Future
from math import inf
from time import monotonic
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped, Vector3
import numpy as np
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from std_msgs.msg import Bool, Empty
from std_srvs.srv import SetBool, Trigger

from soft_continuum.client import (
    ClientError,
    NoAnswerError,
    NodesMissingError,
    RefusedError,
)
from soft_continuum.client.requests import Requests
from soft_continuum.client.tasks import ATTEMPTS, until
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.constant_curvature import fully_actuated
from soft_continuum.nodes.emergency_stop import TOPIC as EMERGENCY_STOP
from soft_continuum.ros.entries import EVERY_STATE, LATCHED, STREAM, subscribe
from soft_continuum.ros.names import (
    JAMMING_VALVES,
    running_nodes,
    SERVO,
    SHAPE_SEQUENCER,
    TENDON_ACTUATION,
)
from soft_continuum.text import plain
from soft_continuum.ui.teleop.joystick import MOVE
from soft_continuum_interfaces.msg import TeleopState

PREPARING = 'the servo is being prepared'
NO_SERVO = ('servo does not run: start the nodes with `up --teleop`, or it alone with: ros2 run '
            'soft_continuum servo')
ANSWER_TIMEOUT, DISCOVERY_TIMEOUT = 5.0, 0.5  # s
ENABLING_TIMEOUT = 10.0  # s for a servo in space to find what its segment can be bent to
RETRY = 1.0  # s from the end of an attempt to enable the servo to the next
LEAD_TIME = 0.5
"""Lead (s at full speed) of a target over the arm, which limits the motion after it sticks."""
OFF_TIME = 1.0  # s for which it is said that the emergency stop is off
MAX_STEP = 0.1  # s of motion that one message counts for
BENDING, TIP = TeleopState.BENDING, TeleopState.TIP


class SteeredArm:
    """
    Steers one segment, or the tip with it, through the nodes of the arm.

    segment: chosen one, from 1, 0 for none.  mode: of TeleopState.  doing: action in progress.
    note: how the last action ended.  Everything runs on the ROS thread.
    """

    def __init__(self, node: Node, parameters: Mapping[str, Any]) -> None:
        """Create publishers and clients on a node with the parameters of teleop."""
        self.segment, self.mode = 0, BENDING
        self.doing = self.note = ''
        self._node, self._parameters = node, parameters
        self._requests = Requests(node, ANSWER_TIMEOUT, DISCOVERY_TIMEOUT)
        self._requests.hears_feedback = False  # that a sequence runs is all that is asked
        self._observed = self._requests.observed
        self._arm: Arm | None = None
        self._actuated = False  # fully, by its tendons alone
        self._jamming = True
        self._describing: Future[None] | None = None
        self._enabled = self._ready = False  # the servo: by anybody; by this, for this segment
        self._interrupted = False  # something else disabled the servo
        self._asked = 0  # the segment for which the servo was asked to be enabled, until it is
        self._retry_time = 0.0  # s (steady)
        self._servo_status = DiagnosticStatus()
        self._target: Array | None = None  # (3,) rad or m, while the arm is moved
        self._target_time = 0.0  # s (steady)
        self._emergency = False  # turned on here
        self._silent_time = inf  # s (steady), when nothing more is said of the emergency stop
        self._bendings = node.create_publisher(Vector3, f'{SERVO}/target_bending', STREAM)
        self._tips = node.create_publisher(PointStamped, f'{SERVO}/target_tip', STREAM)
        self._hold = node.create_publisher(Empty, f'{SERVO}/hold', STREAM)
        self._emergency_stop = node.create_publisher(Bool, EMERGENCY_STOP, LATCHED)
        subscribe(node, Bool, f'{SERVO}/enabled', self._on_enabled, EVERY_STATE)
        subscribe(node, DiagnosticStatus, f'{SERVO}/status', self._on_servo_status, EVERY_STATE)

    def _on_enabled(self, message: Bool) -> None:
        self._enabled = message.data
        if not message.data:
            self._interrupted = self._interrupted or self._ready
            self._ready, self._target = False, None

    def _on_servo_status(self, message: DiagnosticStatus) -> None:
        self._servo_status = message

    def follow_description(self) -> None:
        """Request the description again; it may change when the nodes restart."""
        if self._describing is None or self._describing.done():
            self._describing = self._requests.start(self._describe())

    async def _describe(self) -> None:
        try:
            self._arm = await self._requests.description()
            self._actuated = fully_actuated(self._arm)
            self._jamming = await self._requests.has_jamming()
        except ClientError:
            return  # known values stay; problem() reports missing nodes
        for name in (f'{SERVO}/enable', *(
                f'{JAMMING_VALVES}/segment_{n}/set_stiff'
                for n in range(1, self.segments * self._jamming + 1))):
            self._requests.client(SetBool, name)
        self._requests.client(Trigger, f'{TENDON_ACTUATION}/resume')
        self._requests.client(SetParameters, f'{SERVO}/set_parameters')
        self._requests.client(GetParameters, f'{SHAPE_SEQUENCER}/get_parameters')

    # What may be done.

    @property
    def segments(self) -> int:
        """Number of segments; 0 while the arm is unknown."""
        return 0 if self._arm is None else len(self._arm.segments)

    @property
    def moving(self) -> bool:
        """Whether the arm is being moved."""
        return self._target is not None

    @property
    def stopped(self) -> bool:
        """Whether motion is stopped, by any node."""
        return bool(self._observed.stopped())

    @property
    def servo_text(self) -> str:
        """Status of the servo, empty for OK."""
        status = self._servo_status
        return '' if status.level == DiagnosticStatus.OK else f'{SERVO}: {plain(status.message)}'

    def choose(self) -> None:
        """If none is chosen, choose the soft segment or, without jamming, the last one."""
        if self.segment > self.segments:
            self.segment = 0
        if self.segment == 0 and self._arm is not None:
            soft = self._soft
            self.segment = self.segments if not self._jamming else soft[0] if len(soft) == 1 else 0

    @property
    def _soft(self) -> list[int]:
        return [n for n in range(1, self.segments + 1) if self._observed.stiff(n) is False]

    def problem(self) -> str:
        """Return why the arm cannot be moved now, with the remedy; empty if it can."""
        tendons = self._observed.tendon_actuation
        if self._arm is None or tendons is None:
            return 'no arm found: its nodes do not run, or have not answered yet'
        if not (self._jamming or self._actuated):
            return ('without jamming the tendons of this arm do not bend segments independently: '
                    'it cannot be steered')
        if self._emergency:
            return self._other_stops() or 'the emergency stop is on: reset turns it off'
        if tendons.emergency_stop:
            return 'an emergency stop is on: the program that turned it on must turn it off'
        if self.stopped:
            return f'motion is stopped ({plain(tendons.stop_message)}): reset resumes it'
        if self._observed.progress() is not None:
            return 'a sequence runs: wait for its end, or cancel it'
        if self.doing not in ('', PREPARING):
            return self.doing
        if self._jamming and (problem := self._softness_problem()):
            return problem
        if not running_nodes(self._node, [SERVO])[SERVO]:
            return NO_SERVO
        return ''

    def interruption(self) -> str:
        """Return, once, why another node disabled the servo; empty if none has."""
        was, self._interrupted = self._interrupted, False
        return (self.servo_text or 'something disabled the servo') if was else ''

    def _softness_problem(self) -> str:
        if not self.segment:
            return 'no segment is chosen: choose one, then soften it'
        soft = self._soft
        if self.segment not in soft:
            return f'segment {self.segment} is not soft: soften it first'
        others = ', '.join(str(n) for n in soft if n != self.segment)
        return f'also soft: segment {others}; soften {self.segment} again to stiffen it' * (
            bool(others))

    # Motion.

    def move(self, stick: tuple[float, float, float]) -> None:
        """Move by the stick once the servo is ready; each component -1 to 1."""
        arm = self._arm
        assert arm is not None  # else problem() says so
        velocity = self._velocity(arm, stick)
        if not self._ready:
            self._prepare()
        elif not velocity.any():
            self.rest()
        elif (present := self._present()) is None:
            self.rest()
            self.note = 'kinematics reports no shape of the arm: see its status'
        else:
            self._advance(arm, present, velocity)

    def _velocity(self, arm: Arm, stick: tuple[float, float, float]) -> Array:
        """Return the velocity of the target (3,), rad/s of bending or m/s of the tip."""
        x, y, z = stick
        along = arm.pose_axes[:3]
        if self.mode == BENDING:
            return float(self._parameters['teleop.bending_speed']) * along * [x, y, 0.0]
        if not along[1]:  # then the axis that it would move along y moves it up and down
            y, z = 0.0, y
        return float(self._parameters['teleop.tip_speed']) * np.array([x, y, z])

    def _present(self) -> Array | None:
        """Return the bending of the segment (x, y, 0), rad, or the tip, m; None if not known."""
        if self.mode == TIP:
            poses = self._observed.poses('disc_poses')
            return np.array(poses[-1].position) if poses else None
        bending = self._observed.bending()
        if bending is None or self.segment > len(bending):
            return None
        about_x, about_y = bending[self.segment - 1]
        return np.array([about_y, -about_x, 0.0])

    def _advance(self, arm: Arm, present: Array, velocity: Array) -> None:
        """Publish a target that goes on at this velocity, not too far ahead of the arm."""
        now = monotonic()
        if self._target is None:
            self._target, self._target_time, self.note = present, now, ''
        step, self._target_time = min(now - self._target_time, MAX_STEP), now
        bends = self.mode == BENDING
        speed = self._parameters['teleop.bending_speed' if bends else 'teleop.tip_speed']
        target = present + _limited(
            self._target + velocity * step - present, LEAD_TIME * speed)
        if bends:
            target = _limited(target, arm.segments[self.segment - 1].bending_angle_limit)
        self._target = target
        x, y, z = target.tolist()
        if bends:
            self._bendings.publish(Vector3(x=x, y=y))
            return
        message = PointStamped()
        message.header.frame_id = self._observed.message('disc_poses').header.frame_id
        message.point.x, message.point.y, message.point.z = x, y, z
        self._tips.publish(message)

    def rest(self) -> None:
        """Let the arm come to rest if it moves; the servo stays ready."""
        if self._target is not None:
            self._target = None
            self._hold.publish(Empty())

    def release(self) -> None:
        """Let the arm come to rest, and disable the servo if it was enabled from here."""
        self.rest()
        if self._ready or self._asked:
            self._ready, self._asked = False, 0
            self._requests.start(self._disable())

    # What takes a while.

    def _do(self, doing: str, work: Coroutine[Any, None, str]) -> None:
        """Begin something, unless something else is being done; note how it ends."""
        if self.doing:
            work.close()
            return

        def ended(future: Future[str]) -> None:
            self.doing = ''
            try:
                self.note = future.result() or self.note  # which came meanwhile
            except ClientError as error:
                failed = isinstance(error, NoAnswerError)
                self.note = f'{"failed" if failed else "refused"}: {error}'

        self.doing, self.note = doing, ''
        self._requests.start(work).add_done_callback(ended)

    def _prepare(self) -> None:
        if monotonic() >= self._retry_time:
            self._do(PREPARING, self._prepared())

    async def _prepared(self) -> str:
        try:
            return await self._enable()
        finally:
            self._retry_time = monotonic() + RETRY  # for so long it is seen why it failed

    async def _disable(self) -> None:
        await self._requests.call(SetBool, f'{SERVO}/enable', attempts=ATTEMPTS, data=False)

    async def _enable(self) -> str:
        """
        Enable the servo for the chosen segment, and wait until it follows targets.

        A slow computer needs more than one attempt: none may end what the servo has begun.
        """
        requests, segment = self._requests, self.segment
        if not running_nodes(self._node, [SERVO])[SERVO]:
            raise NodesMissingError('servo does not run')
        if self._asked != segment:
            self._asked = 0
            await self._disable()
            if not await until(lambda: not self._enabled, ANSWER_TIMEOUT):
                raise NoAnswerError(f'{SERVO}/enabled is still true {ANSWER_TIMEOUT:g} s after '
                                    'the servo was disabled')
        if not self._jamming:
            await requests.set_parameter(SERVO, 'servo.segment', segment)
        self._asked = segment
        answer = await requests.call(SetBool, f'{SERVO}/enable', attempts=ATTEMPTS, data=True)
        if not answer.success:
            self._asked = 0
            raise RefusedError(answer.message)
        if not await until(lambda: self._enabled or not self._asked, ENABLING_TIMEOUT):
            raise NoAnswerError(self.servo_text or (
                f'the servo has not found the bending range of segment {segment} within '
                f'{ENABLING_TIMEOUT:g} s'))
        self._ready = self._enabled and self._asked == self.segment  # until() looks now and then
        self._asked = 0
        return ''

    def soften(self) -> None:
        """Stiffen the other segments, then soften the chosen one."""
        if not self._jamming:
            self.note = 'this arm has no jamming: its segments are always soft'
        elif not self.segment:
            self.note = 'no segment is chosen: choose one first'
        else:
            self.release()
            self._do(f'segment {self.segment} is being softened', self._soften(self.segment))

    async def _soften(self, segment: int) -> str:
        for other in range(1, self.segments + 1):
            if other != segment and self._observed.stiff(other) is not True:
                await self._requests.set_stiff(other, True)
        await self._requests.set_stiff(segment, False)
        # Wait for the discovery of a servo that has just started, since motion may begin at once.
        servo = await until(lambda: running_nodes(self._node, [SERVO])[SERVO], ANSWER_TIMEOUT)
        return f'segment {segment} is soft: {MOVE if servo else NO_SERVO}'

    def stiffen(self) -> None:
        """Stiffen the chosen segment."""
        if self._jamming and self.segment:
            self.release()
            self._do(f'segment {self.segment} is being stiffened', self._stiffen(self.segment))

    async def _stiffen(self, segment: int) -> str:
        await self._requests.set_stiff(segment, True)
        return f'segment {segment} is stiff'

    def next_segment(self) -> None:
        """Choose the next segment."""
        if self.segments:
            self.release()
            self.segment, self.note = self.segment % self.segments + 1, ''

    def change_mode(self) -> None:
        """Change between bending the segment and moving the tip."""
        self.rest()
        self.mode, self.note = TIP if self.mode == BENDING else BENDING, ''

    def stop_all(self) -> None:
        """Turn the emergency stop on."""
        self._emergency, self.note = True, ''
        self._emergency_stop.publish(Bool(data=True))
        self.release()

    def keep_stopped(self) -> None:
        """Repeat that the emergency stop is on, if it is, since messages may be lost."""
        if self._emergency:
            self._emergency_stop.publish(Bool(data=True))
        elif monotonic() > self._silent_time:
            # A stop that is over is nothing that a node has to know when it starts.
            self._silent_time = inf
            self._node.destroy_publisher(self._emergency_stop)
            self._emergency_stop = self._node.create_publisher(Bool, EMERGENCY_STOP, LATCHED)

    def reset(self) -> None:
        """Turn the emergency stop off; if it is off, allow motion again."""
        if self._emergency and self._other_stops():
            return  # problem() reports it
        if self._emergency:
            self._emergency, self._silent_time = False, monotonic() + OFF_TIME
            self._emergency_stop.publish(Bool(data=False))
            self.note = 'the emergency stop is off: reset once more lets the tendons move again'
        elif self.stopped:
            self._do('motion is being resumed', self._requests.resume())
        else:
            self.note = 'nothing is stopped'

    def _other_stops(self) -> str:
        """Return why the emergency stop must not be turned off here; empty when it may be."""
        node = self._node
        others = ', '.join(sorted({  # besides one of this name that was killed a moment ago
            plain(info.node_name) for info in node.get_publishers_info_by_topic(
                node.resolve_topic_name(EMERGENCY_STOP)) if info.node_name != node.get_name()}))
        return others and (f'the emergency stop stays on: {others} may hold it on too; stop that '
                           'first')


def _limited(vector: Array, most: float) -> Array:
    """Return a vector of at most that length."""
    size = float(np.linalg.norm(vector))
    return vector if size <= most else vector * (most / size)
