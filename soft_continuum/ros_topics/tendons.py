# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tendons that another node moves: commands and joint states on topics, such as of ros2_control.

A position controller gets each set-point as it is due; a trajectory controller gets it as a
trajectory of one point, to be reached in one period.  So no more than one period of motion is
ever queued, and a joint comes to rest when the commands stop.
"""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Self, TYPE_CHECKING

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.protocols import (
    check_limits,
    check_motion,
    describe_pulls,
    HardwareError,
    TendonReading,
)
from soft_continuum.parameters.parameter import Parameter, TOPIC_NAME
from soft_continuum.ros_topics.device import POLL_INTERVAL, RosDevice
from soft_continuum.ros_topics.joint_states import Joints, JointWatch, PREFIX

if TYPE_CHECKING:
    from soft_continuum.ros_topics.link import CommandPublisher, Listener, RosLink

FOLLOW_TIME = 0.3
"""Time for which a joint may exceed following_error, s."""
STOP_TIMEOUT = 1.0  # s in which a stop must be confirmed, also by close()
LONGEST_STEP, STEP = 0.2, 0.02
"""s: a motion that is to take longer is sent in steps of so long, as read() is called."""
POSITIONS, TRAJECTORY = 'positions', 'trajectory'
KINDS = {POSITIONS: 'std_msgs/Float64MultiArray', TRAJECTORY: 'trajectory_msgs/JointTrajectory'}
STATES = 'sensor_msgs/JointState'
SAME_PLACE = 1e-3  # m by which joints may have moved while they were not watched


class RosTendons(RosDevice):
    """Tendons on the joints of another node; see TendonDriver for what the methods promise."""

    driver = 'tendon driver'
    reference_moves = False
    COMMISSIONING = 'soft_continuum.ros_topics.commissioning'
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter(f'{PREFIX}state_topic', 'joint_state_broadcaster/joint_states',
                  'topic of the joint states (sensor_msgs/JointState), with a single publisher',
                  form=TOPIC_NAME),
        Parameter(f'{PREFIX}command_topic', 'position_controller/commands',
                  'topic of the commands, with no other publisher', form=TOPIC_NAME),
        Parameter(f'{PREFIX}command_type', POSITIONS, 'message type of that topic: positions '
                  '(std_msgs/Float64MultiArray, in the order of ros_tendons.joints) or trajectory '
                  '(trajectory_msgs/JointTrajectory)', choices=(POSITIONS, TRAJECTORY)),
        Parameter(f'{PREFIX}joints', ('',), 'joint that pulls each tendon; empty: joints are '
                  'named like their tendons'),
        Parameter(f'{PREFIX}scales', (0.01,), 'pull per unit of the position of each joint: the '
                  'radius of a spool in m/rad, 1.0 for a linear joint in m; negative if '
                  'increasing positions pay out; a single value applies to all', -10.0, 10.0),
        Parameter(f'{PREFIX}zeros', (0.0,), 'position of each joint, in its unit, when the arm '
                  'is straight: exact with ros_tendons.absolute, otherwise approximate; a single '
                  'value applies to all', -1e6, 1e6),
        Parameter(f'{PREFIX}absolute', False, 'the joints keep their position when powered off, '
                  'so ros_tendons.zeros is the reference; false: ~/reference sets it after each '
                  'start'),
        Parameter(f'{PREFIX}effort_scales', (0.0,), 'tension per unit of the effort of each '
                  'joint, N, such as 1 / radius for a spool whose effort is in N m; 0.0 alone: '
                  'tensions are not derived from effort', -1e6, 1e6),
        Parameter(f'{PREFIX}timeout', 0.25, 'age at which the joint states are stale', 0.05, 2.0,
                  unit='s'),
        Parameter(f'{PREFIX}following_error', 0.003, 'position error of a tendon that is a fault '
                  'if it lasts', 1e-5, 0.1, unit='m'),
    )
    _known: ClassVar[dict[bytes, tuple[Joints, tuple[float, ...], tuple[float, ...],
                                       tuple[float, ...]]]] = {}
    """Joints, zeros, last positions and set-points by publisher of states, while this runs."""

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]) -> Self:
        """
        Return the driver that the parameters of the node describe.

        clock: not used; a device continues when a node's clock is paused or set.  Raises
        ParameterError.
        """
        return cls(Joints.from_parameters(values), values[f'{PREFIX}state_topic'],
                   values[f'{PREFIX}command_topic'], values[f'{PREFIX}command_type'],
                   values[f'{PREFIX}following_error'], values[f'{PREFIX}timeout'])

    def __init__(self, joints: Joints, state_topic: str, command_topic: str, command_type: str,
                 following_error: float, timeout: float, clock: Clock = STEADY) -> None:
        """Describe the device; following_error: m, timeout: s.  Nothing is opened yet."""
        super().__init__(clock)
        self._joints, self._topics, self._type = joints, (state_topic, command_topic), command_type
        self._following_error, self._timeout = following_error, timeout
        self._states: Listener
        self._commands: CommandPublisher
        self._publisher = b''  # of the states
        self._reset(JointWatch(joints))

    def _reset(self, watch: JointWatch) -> None:
        self._watch = watch
        self._setpoint: tuple[float, ...] | None = None  # positions that were sent last
        self._sent = 0.0  # s, when
        self._period = 0.0  # s, of the last command
        self._stop_by: float | None = None  # s, by when a stop must be confirmed
        self._near = 0.0  # s, when every joint was last where it was sent
        self._way: tuple[tuple[float, ...], tuple[float, ...], float] | None = None
        """Motion in steps: positions from and to, and its duration, s."""
        self._passed = 0.0  # s of that

    @staticmethod
    def topics(values: Mapping[str, Any]) -> tuple[dict[str, str], dict[str, str]]:
        """Return type by name of the topics that are published, and that are subscribed to."""
        return ({values[f'{PREFIX}command_topic']: KINDS[values[f'{PREFIX}command_type']]},
                {values[f'{PREFIX}state_topic']: STATES})

    # The connection.

    def _connect(self, link: 'RosLink') -> None:
        self._reset(JointWatch(self._joints))
        state_topic, command_topic = self._topics
        self._states = link.listen(STATES, f'{PREFIX}state_topic', state_topic, self._timeout)
        self._commands = link.publish_to(
            KINDS[self._type], f'{PREFIX}command_topic', command_topic)

    def _take_first(self) -> str:
        self._receive()
        if not self._watch.watched:
            return f'no joint state received on {self._states.topic}'
        self._recall()
        return ''

    def _recall(self) -> None:
        """Take up the zeros that were set while the same publisher had the joints here."""
        self._publisher = self._states.publisher
        positions = self._watch.positions
        joints, zeros, last, sent = self._known.pop(self._publisher, (None, (), (), ()))
        assert positions is not None
        if not self._watch.known:
            self._watch.zeros = positions
        if joints == self._joints and all(  # at most it has gone on to where it was sent
                min(0.0, way) - SAME_PLACE <= gone <= max(0.0, way) + SAME_PLACE
                for way, gone in zip(self._joints.pulls(sent, last),
                                     self._joints.pulls(positions, last), strict=True)):
            self._watch.zeros, self._watch.known = zeros, True

    def close(self) -> None:
        """Stop, hold and disconnect; an ``open`` under way ends with HardwareError."""
        self._closing.set()
        with self._lock:
            watch, opened = self._watch, self._opened
            if opened and watch.positions is not None:
                self._end_motion()
                if watch.known and watch.zeros is not self._joints.zeros:
                    self._known[self._publisher] = (
                        self._joints, watch.zeros, watch.positions,
                        self._setpoint or watch.positions)
            if opened:
                self._disconnect()

    def _end_motion(self) -> None:
        """Wait until the tendons rest, as long as that is known."""
        try:
            if self._moving():
                self._begin_stop()
            while self._moving():
                self._clock.sleep(POLL_INTERVAL)
                self._follow()
        except HardwareError:  # close() cannot do more; read() said it before, or open() will
            return

    # What the thread of control calls.

    def read(self) -> TendonReading:
        """Return the state that was received last."""
        with self._lock:
            self._follow()
            watch = self._watch
            speeds = watch.speeds() if self._moving() else (0.0,) * len(self._joints.tendons)
            return TendonReading(watch.pulls, speeds, watch.known, watch.tensions)

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Send all joints to ``pulls`` (m), to be there after ``duration`` (s)."""
        joints = self._joints
        check_motion(joints.tendons, pulls, duration)
        with self._lock:
            self._receive()
            if not self._watch.known:
                raise HardwareError('the position is not referenced; straighten the arm and call '
                                    '~/reference')
            check_limits(joints.tendons, pulls, self._watch.pulls, joints.pull_limits)
            if self._setpoint is None or not self._moving():
                self._near = self._now()
            self._stop_by = self._way = None
            target = joints.positions(pulls, self._watch.zeros)
            if duration <= LONGEST_STEP:
                self._send(target, duration)
            else:
                assert self._watch.positions is not None
                self._way = self._setpoint or self._watch.positions, target, duration
                self._passed = 0.0
                self._go_on(*self._way)

    def stop(self) -> None:
        """Command every joint to where it is, until states confirm that it rests."""
        with self._lock:
            self._receive()
            if self._moving():
                self._begin_stop()

    def reference(self) -> None:
        """Take the present positions of the joints as zero pull, until this process ends."""
        with self._lock:
            self._receive()
            if self._moving():
                raise HardwareError('the tendons are moving; wait until they rest')
            assert self._watch.positions is not None
            self._watch.zeros, self._watch.known = self._watch.positions, True
            self._setpoint = None

    def describe(self) -> str:
        """Return the positions of joints and tendons as text."""
        with self._lock:
            self._receive()
            joints = ', '.join(f'{name} {position:.4g}' for name, position in zip(
                self._joints.names, self._watch.positions or (), strict=True))
            return f'{joints}: {self._watch.describe()}'

    @property
    def zeros(self) -> tuple[float, ...]:
        """Positions of the joints at zero pull, in their units, for ros_tendons.zeros."""
        return self._watch.zeros

    # Commands.

    def _send(self, positions: tuple[float, ...], duration: float) -> None:
        self._setpoint, self._sent, self._period = positions, self._now(), duration
        self._commands.send(self._message(positions, duration))

    def _go_on(self, begin: tuple[float, ...], end: tuple[float, ...], duration: float) -> None:
        """Send the next step of a motion; what comes late is not caught up."""
        self._passed += min(self._now() - self._sent, STEP)
        share = min(1.0, self._passed / duration)
        if share == 1.0:
            self._way = None
        self._send(tuple(a + share * (b - a) for a, b in zip(begin, end, strict=True)), STEP)

    def _message(self, positions: tuple[float, ...], duration: float) -> Any:
        if self._type == POSITIONS:
            from std_msgs.msg import Float64MultiArray

            return Float64MultiArray(data=list(positions))
        from builtin_interfaces.msg import Duration
        from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

        # Without a stamp it begins on arrival, independently of the clocks of two computers.
        return JointTrajectory(joint_names=list(self._joints.names), points=[JointTrajectoryPoint(
            positions=list(positions),
            time_from_start=Duration(nanosec=max(1, min(999_999_999, int(1e9 * duration)))))])

    def _begin_stop(self) -> None:
        self._way = None
        if self._stop_by is not None and self._setpoint is not None:  # it is under way
            self._commands.send(self._message(self._setpoint, self._period))
            return
        assert self._watch.positions is not None
        self._stop_by = self._now() + STOP_TIMEOUT
        # Joints that were seen long ago are where they were sent since: back would be a motion.
        unseen = self._now() - self._watch.received > LONGEST_STEP
        self._send(self._setpoint if unseen and self._setpoint else self._watch.positions,
                   self._period)

    # States.

    def _receive(self) -> None:
        """Take new messages; raise HardwareError if wrong, stale or without a publisher."""
        with self._receiving() as link:
            if self._opened and self._watch.positions is None:
                raise HardwareError('a joint state was implausible; open the driver again')
            taken = self._states.take()
            if self._opened and self._states.publisher != self._publisher:
                self._watch.positions = None  # nothing is sent any more, not even a stop
                raise HardwareError(
                    f'the publisher of {self._states.topic} was restarted: the zero of its '
                    'positions may have changed; open the driver again')
            for message, stamp in taken:
                self._watch.take(message, stamp, self._now(), self._states.missed)
            if self._opened:
                link.check()
                self._states.check()

    def _now(self) -> float:
        """Return the time of the last look, s."""
        return self.link.looks() if self.link is not None else 0.0

    def _moving(self) -> bool:
        return not self._watch.rests(self._sent)

    def _follow(self) -> None:
        """Receive, and raise HardwareError when the joints do not do what they were sent."""
        self._receive()
        watch, now = self._watch, self._now()
        if self._setpoint is None or watch.positions is None:
            return
        if self._stop_by is not None:
            self._confirm_stop(self._setpoint, self._stop_by)
            return
        off = max(map(abs, self._joints.pulls(watch.positions, self._setpoint)))
        if off <= self._following_error:
            self._near = now
        elif off > 2.0 * self._following_error or now - self._near > FOLLOW_TIME:
            sent = self._joints.pulls(self._setpoint, watch.zeros)
            self._begin_stop()
            raise HardwareError(
                f'the joints do not follow: sent to '
                f'{describe_pulls(self._joints.tendons, sent)}, they are at {watch.describe()} '
                f'({PREFIX}following_error is {1e3 * self._following_error:g} mm); check that the '
                f'controller is active, and the order and signs of {PREFIX}joints and '
                f'{PREFIX}scales')
        if self._way is not None:
            self._go_on(*self._way)

    def _confirm_stop(self, setpoint: tuple[float, ...], stop_by: float) -> None:
        if not self._moving():
            self._stop_by, self._near = None, self._now()
        elif self._now() > stop_by:
            raise HardwareError(
                f'a stop was not confirmed within {STOP_TIMEOUT:g} s: the tendons may still move '
                f'({self._watch.describe()}); cut the power of the motors if they do, then check '
                'the controller')
        else:  # a single message may be lost
            self._commands.send(self._message(setpoint, self._period))
