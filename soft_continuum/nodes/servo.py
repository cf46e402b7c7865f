# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node that follows a moving target with one segment."""

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any

from geometry_msgs.msg import PointStamped, Vector3
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_msgs.msg import Bool, Empty, Float64
from std_srvs.srv import SetBool

from soft_continuum.hardware.clock import STEADY
from soft_continuum.mechanics.statics import Statics, StaticsError
from soft_continuum.nodes.arm_commander import MotionCommander
from soft_continuum.nodes.reported_arm import ArmObserver, TimedShape
from soft_continuum.nodes.suite_node import OK, SuiteNode, WARN
from soft_continuum.nodes.threads import load_model, loading, on_ros_thread, Worker
from soft_continuum.parameters.arm import arm_from_parameters, check_actuation
from soft_continuum.planning.bending_map import BendingLimits
from soft_continuum.ros.conversions import Stiffness
from soft_continuum.ros.entries import (
    EVERY_STATE,
    guarded,
    LATCHED,
    repeat,
    serve,
    STREAM,
    subscribe,
)
from soft_continuum.ros.names import SERVO, SHAPE_SEQUENCER
from soft_continuum.ros.ros_time import Age
from soft_continuum.sequencing.servo import (
    AngleServo,
    HeldSegmentMovedError,
    ServoSettings,
    TargetError,
)
from soft_continuum.text import plain
from soft_continuum_interfaces.msg import ShapeSequencerState, TendonActuationState

NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Targets: only the newest counts, from any publisher."""
MAX_TARGET_BYTES = 1000
SEQUENCE_TIMEOUT = 3.0  # s after its last state for a sequence to count as ended
CLOSE_TIMEOUT = 5.0  # s
SOON = 0.5  # s: longer preparations are reported when done
REFUSAL_PERIOD = 5.0  # s for which a refused target is reported


class Servo(SuiteNode):
    """
    Follows a moving target with the segment that is soft, while it is enabled.

    Without jamming, servo.segment selects the segment.  Subscribes to ~/target_angle
    (std_msgs/Float64), ~/target_bending (geometry_msgs/Vector3), ~/target_tip
    (geometry_msgs/PointStamped), ~/hold (std_msgs/Empty), tendon_states, segment_N/pressure and
    the ~/state of the nodes of an arm.  Publishes tendon_actuation/tendon_trajectory, ~/enabled
    (std_msgs/Bool, latched), ~/status and /diagnostics.  Serves ~/enable (std_srvs/SetBool).

    It moves nothing unless enabled; a stop, a sequence or a change of stiffness disables it.
    Everything runs on the thread that spins the node, except the computation of the bending range
    when the servo is enabled.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters, topics and the service."""
        super().__init__(SERVO, 'servo', **options)
        arm = arm_from_parameters(self.parameters)
        check_actuation(arm, self.parameters)
        self._jamming: bool = self.parameters['arm.jamming']
        self._segments = len(arm.segments)
        self._compiled = False
        self._servo: AngleServo | None = None  # while it is enabled
        self._preparing: object = None  # while a servo is made; another one each time
        self._worker = Worker('servo', self.thread_failed)
        self._level, self._ended = OK, 'not enabled yet'  # why it is not
        self._stiffness = Stiffness(())  # when it was enabled
        self._stops = 0
        self._refused, self._refused_age = '', Age()
        self._targets: dict[type, tuple[float, bytes]] = {}  # newest of each type, not read yet
        self._estimate: TimedShape | None = None  # that was taken in last
        self._sequence, self._sequence_age = False, Age()
        self._commander = MotionCommander(self, arm)
        self._observed = ArmObserver(self, arm, self.parameters, self._on_tendon_state)
        subscribe(self, ShapeSequencerState, f'{SHAPE_SEQUENCER}/state', self._on_sequencer,
                  EVERY_STATE)
        self._receive(Float64, '~/target_angle')
        self._receive(PointStamped, '~/target_tip')
        self._receive(Vector3, '~/target_bending')
        subscribe(self, Empty, '~/hold', self._on_hold, STREAM)
        self._enabled = self.create_publisher(Bool, '~/enabled', LATCHED)
        self._published: bool | None = None  # as ~/enabled
        serve(self, SetBool, '~/enable', self._on_enable)
        repeat(self, 1.0 / self.parameters['servo.rate'], self._tick)
        self._report()

    def start(self) -> None:
        """Load the model; the servo can be enabled once that is done."""
        load_model(self, self._observed.chain.arm, self._on_model)

    def _on_model(self) -> None:
        self._compiled = True

    def quit(self) -> None:
        """Hold the tendons before the process ends, if they move."""
        self._hold('the node ended', OK)
        self._report()
        self._worker.close(CLOSE_TIMEOUT)

    def callback_failed(self, error: Exception) -> None:
        """Hold, and report what a callback raised."""
        super().callback_failed(error)
        self._hold(f'servo failed: {type(error).__name__}: {error}')

    # Messages.

    def _receive(self, kind: type, topic: str) -> None:
        """Keep the newest target; it is read in the next cycle, so that a flood costs little."""
        def on_target(data: bytes) -> None:
            self._targets[kind] = STEADY(), data

        self.create_subscription(kind, topic, guarded(self, on_target), NEWEST, raw=True)

    def _on_hold(self, _: Empty) -> None:
        """Brake now, rather than when the last target is too old; it stays enabled."""
        self._targets.clear()
        if self._servo is not None:
            self._servo.clear_target()
            self._go_on(self._servo)

    def _on_sequencer(self, state: ShapeSequencerState) -> None:
        self._sequence = state.running
        self._sequence_age.refresh()
        if state.running:
            self._check()

    def _on_tendon_state(self, state: TendonActuationState) -> None:
        """Act on a stop or the end of the motion at once, however soon it is resumed."""
        self._commander.on_tendon_state(state)
        self._check()

    # Enabling and disabling.

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response
                   ) -> SetBool.Response:
        if not request.data:
            self._hold('on request', OK)
            response.success, response.message = True, 'disabled'
        elif self._servo is not None:
            response.success, response.message = True, 'already enabled'
        elif self._preparing is not None:
            response.success, response.message = True, 'already being prepared'
        else:
            problem = self._refusal() or self._enable()
            response.success = not problem
            response.message = problem or (
                f'{"enabled with" if self._servo else "being prepared for"} segment '
                f'{self._segment + 1}')
        self._report()
        return response

    def _refusal(self) -> str:
        """Return why the servo cannot be enabled now; empty when it can."""
        observed = self._observed
        if not self._compiled:
            return loading()
        if problem := observed.interlock:
            return problem
        if self._sequence_runs:
            return 'a sequence runs; wait for its end, or cancel it'
        if observed.moves:
            return 'the tendons move; wait until they rest'
        if problem := self._choice_problem():
            return problem
        if observed.shape is None or observed.estimate is None:
            return 'the shape of the arm is not known'
        if observed.shape.stiff != observed.jammed(observed.stiffness):
            return 'kinematics has not yet reported which segment is soft; try again'
        return ''

    def _choice_problem(self) -> str:
        """Return why no segment can follow; empty if one can."""
        observed, chosen = self._observed, self.parameters['servo.segment']
        if not self._jamming:
            return '' if chosen <= self._segments else (
                f'servo.segment is {chosen}; this arm has {self._segments}')
        soft = [n for n, stiff in enumerate(observed.stiff, start=1) if not stiff]
        if len(soft) != 1:
            return ('exactly one segment has to be soft; soft: '
                    f'{", ".join(map(str, soft)) or "none"}')
        vacuum = self.parameters['ambient_pressure'] - observed.pressures[soft[0] - 1]
        if not vacuum <= self.parameters['soft_vacuum']:
            return (f'segment {soft[0]} is not soft yet: its vacuum is {vacuum:.0f} Pa; '
                    f'soft_vacuum: {self.parameters["soft_vacuum"]:g} Pa')
        return ''

    @property
    def _segment(self) -> int:
        """The segment (0-based) that follows."""
        if self._jamming:
            return self._observed.stiff.index(False)
        return int(self.parameters['servo.segment'] or self._segments) - 1

    def _enable(self) -> str:
        """Enable the servo; return why that failed, empty when it did not."""
        observed, parameters = self._observed, self.parameters
        known = observed.shape_and_model
        if known is None:
            return 'the shape of the arm is not known'
        (shape, model), (low, high) = known, parameters['pull_limits']
        settings = ServoSettings(
            BendingLimits((low, high), parameters['tension_limit'],
                          parameters['antagonist_slack'], tuple(model.offsets.tolist())),
            speed=parameters['tendon_speed'], acceleration=parameters['tendon_acceleration'],
            period=1.0 / parameters['servo.rate'],
            **{name: parameters[f'servo.{name}'] for name in (
                'horizon', 'integral_time', 'response_time', 'extrapolation', 'friction_band',
                'target_timeout', 'measurement_timeout')})
        make = partial(AngleServo, Statics(model.chain.arm), settings, shape, self._segment,
                       self._jamming)
        self._stiffness, self._stops = observed.stiffness, observed.tendons.stops
        self._preparing = this = object()
        self._level, self._ended = OK, 'computing the bending range of the segment'
        made: Future[tuple[AngleServo | None, str]] = Future()

        def prepare() -> None:
            if this is self._preparing:  # else it was given up before its turn
                made.set_result(_made(make))
                on_ros_thread(self, self._on_made, this, *made.result())

        if not self._worker.submit(prepare):
            self._preparing = None
            return 'too many cancelled attempts to enable it are pending; try again'
        try:
            return self._begin(this, *made.result(SOON))
        except TimeoutError:
            return ''

    def _on_made(self, this: object, servo: AngleServo | None, problem: str) -> None:
        self._begin(this, servo, problem)
        self._report()

    def _begin(self, this: object, servo: AngleServo | None, problem: str) -> str:
        """Begin with a servo, unless it is not wanted any more; return why not."""
        if this is not self._preparing:
            return ''
        self._preparing = None
        if servo is not None:  # that took a while
            problem = self._problem()
        if servo is None or problem:
            self._level, self._ended = WARN, problem
            return problem
        self._servo = servo
        self._targets.clear()  # an old one must not move the arm
        self._estimate, self._refused = None, ''
        self._commander.begin()
        return ''

    @property
    def _sequence_runs(self) -> bool:
        return self._sequence and self._sequence_age.seconds <= SEQUENCE_TIMEOUT

    def _check(self) -> None:
        """Disable the servo when anything forbids that it goes on."""
        if self._servo is not None and (problem := self._problem()):
            self._disable(problem)

    def _problem(self) -> str:
        observed = self._observed
        if observed.stopped:
            return f'tendon motion was stopped: {observed.stopped}'
        if observed.tendons.stops != self._stops:
            return 'tendon motion was stopped and resumed'
        if failure := self._commander.motion_failure:
            return failure.message
        if problem := observed.interlock:
            return problem
        if observed.stiffness != self._stiffness:
            return 'a segment changed between soft and stiff'
        return 'a sequence runs' if self._sequence_runs else ''

    def _disable(self, reason: str, level: bytes = WARN) -> None:
        """Send no more: what was sent comes to rest within the horizon."""
        self._servo, self._level, self._ended = None, level, reason
        self._commander.begin()
        self._report()

    def _hold(self, reason: str, level: bytes = WARN) -> None:
        """Disable the servo, and let the tendons brake at once if it moves them."""
        if self._preparing is not None:
            self._preparing, self._level, self._ended = None, level, reason
        if self._servo is not None:
            self._commander.hold()
            self._disable(reason, level)

    # Following.

    def _tick(self) -> None:
        self._check()
        if self._servo is not None:
            self._go_on(self._servo)
        else:
            self._targets.clear()
        self._report()

    def _go_on(self, servo: AngleServo) -> None:
        now, estimate = STEADY(), self._observed.estimate
        if estimate is not None and estimate is not self._estimate:
            self._estimate = estimate
            try:
                servo.observe(estimate.shape, estimate.time, estimate.measured_time, now)
            except HeldSegmentMovedError as error:
                self._hold(str(error))
                return
        for kind, (time, data) in sorted(self._targets.items(), key=lambda item: item[1][0]):
            try:
                self._take_target(servo, kind, data, time)
                if self._refused_age.seconds > REFUSAL_PERIOD:
                    self._refused = ''
            except TargetError as error:
                self._refused = f'target refused: {error}'
                self._refused_age.refresh()
        self._targets.clear()
        piece = servo.advance(now, self._observed.pulls)
        if piece is not None:
            self._commander.follow(1, piece.start, piece.times, piece.pulls)

    def _take_target(self, servo: AngleServo, kind: type, data: bytes, time: float) -> None:
        """Follow a target from now on; raises TargetError for one that is not allowed."""
        if len(data) > MAX_TARGET_BYTES:
            raise TargetError(f'a message of {len(data)} bytes; allowed: {MAX_TARGET_BYTES}')
        try:
            message: Any = deserialize_message(data, kind)
        except Exception as error:  # whatever the conversion finds wrong
            raise TargetError(plain(str(error))) from None
        if kind is Float64:
            servo.set_angle(message.data, time)
            return
        if kind is Vector3:
            servo.set_angle(complex(message.x, message.y), time)
            return
        frame = self.parameters['frame_id']
        if message.header.frame_id != frame:
            raise TargetError(f'a tip in frame {plain(message.header.frame_id)!r}; needed: '
                              f'{frame!r}')
        point = message.point
        servo.set_tip(point.x, point.z, time, point.y)

    # What is published.

    def _report(self) -> None:
        servo, now = self._servo, STEADY()
        if servo is None:
            self.status.set(self._level, f'disabled: {self._ended}', enabled='false')
            self._tell_enabled(False)
            return
        refused = self._refused if self._refused_age.seconds <= REFUSAL_PERIOD else ''
        text = 'following' if servo.has_target(now) else 'holding: no target'
        limited = servo.limited if servo.has_target(now) else ''
        notes = [note for note in (refused, limited and f'limited by {limited}') if note]
        self.status.set(
            WARN if notes else OK, '; '.join([text, *notes]), enabled='true',
            segment=servo.segment + 1, refused=refused, limited=limited,
            corrected='by measurements' if servo.is_measured(now) else 'no: only predicted')
        self._tell_enabled(True)

    def _tell_enabled(self, enabled: bool) -> None:
        if enabled is not self._published:
            self._published = enabled
            self._enabled.publish(Bool(data=enabled))


def _made(make: Callable[[], AngleServo]) -> tuple[AngleServo | None, str]:
    """Return a servo, or why it cannot be made."""
    try:
        return make(), ''
    except StaticsError as error:
        return None, str(error)
