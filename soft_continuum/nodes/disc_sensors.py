# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node that converts data of trackers and IMUs into measured poses of the discs."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from math import inf
from time import monotonic
from typing import Any

from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
import numpy as np
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from soft_continuum.estimation.sensing.imus import imu_rotations, ImuSample, MountedImus
from soft_continuum.estimation.sensing.tare import offset_of, SensorError, straight_heights, Window
from soft_continuum.estimation.sensing.tracker import Tracker
from soft_continuum.nodes.suite_node import ERROR, OK, SuiteNode, WARN
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.scalars import as_yaml
from soft_continuum.ros.conversions import pose_from_ros, seconds, tracked_pose_to_ros
from soft_continuum.ros.entries import repeat, SENSOR, serve, STREAM, subscribe
from soft_continuum.ros.names import DISC_SENSORS, MEASURED_POSE
from soft_continuum.ros.ros_time import Age

ALL_POSES = 'tracker/disc_poses'
MAX_AGE = 1.0  # s between a stamp and now
STALE_AFTER = 2.0  # s without a message, and for which a problem is shown
REPORT_PERIOD = 0.25  # s
MAX_COUNT = 500  # messages of a sensor between two reports
MAX_READING = 1e4  # m/s^2 and rad/s, beyond any IMU
MAX_PROBLEMS = 4  # that the status lists


class DiscSensors(SuiteNode):
    """
    Converts data of other sensors on the discs into measured poses.

    Subscribes to disc_N/pose (geometry_msgs/PoseStamped), N from 0 at the base,
    tracker/disc_poses (geometry_msgs/PoseArray, all discs, base first) and disc_N/imu
    (sensor_msgs/Imu).  Publishes disc_N/measured_pose (geometry_msgs/PoseWithCovarianceStamped),
    ~/status and /diagnostics.  Serves ~/tare (std_srvs/Trigger).  It moves nothing.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters, topics and the service; raises ParameterError."""
        super().__init__(DISC_SENSORS, 'trackers and IMUs', **options)
        values = self.parameters
        arm = arm_from_parameters(values)
        self._heights = straight_heights(arm)
        count = len(self._heights)
        self._tracker = Tracker.of(values, arm)
        position, angle = (values[f'tracker.{name}_stddev'] for name in ('position', 'angle'))
        self._covariance = np.diag([position**2] * 3 + [angle**2] * 3)
        self._rotations = imu_rotations(values['imu.axes'], count)
        self._imus = MountedImus.of(values, arm)
        self._sources: list[str] = [''] * count  # topic of the pose of each disc
        self._followed = [Window[Any]() for _ in range(count)]
        self._tared: list[str] = []
        self._measured_poses = [self.create_publisher(
            PoseWithCovarianceStamped, MEASURED_POSE.format(n), STREAM) for n in range(count)]
        self._inputs: dict[str, tuple[Any, Callable[[int, _Feed, Any], None]]] = {
            'pose': (PoseStamped, self._take_body), 'imu': (Imu, self._take_imu)}
        self._feeds: dict[str, _Feed] = {}
        self._all_poses = self._feed(ALL_POSES)

    def start(self) -> None:
        """Create the subscriptions."""
        subscribe(self, PoseArray, ALL_POSES, self._on_all_poses, SENSOR)
        for n in range(len(self._heights)):
            for name, (kind, take) in self._inputs.items():
                topic = f'disc_{n}/{name}'
                subscribe(self, kind, topic, partial(self._on_message, topic, take, n), SENSOR)
        serve(self, Trigger, '~/tare', self._on_tare)
        repeat(self, REPORT_PERIOD, self._report)
        self._report()

    def _feed(self, name: str) -> '_Feed':
        if name not in self._feeds:
            self._feeds[name] = _Feed(name, 1.0 / self.parameters['disc_sensors.rate'])
        return self._feeds[name]

    def _on_message(self, topic: str, take: Any, n: int, message: Any) -> None:
        feed = self._feed(topic)
        feed.take(take, n, feed, message)

    # Poses of a tracker.

    def _on_all_poses(self, message: PoseArray) -> None:
        feed, count = self._all_poses, len(self._heights)
        if len(message.poses) != count:
            feed.refuse(f'{len(message.poses)} poses; the arm has {count} discs, all are needed, '
                        'base first')
            return
        feed.heard.refresh()
        for n, pose in enumerate(message.poses):
            own = self._feed(f'disc {n} of {ALL_POSES}')
            own.take(self._take_pose, n, own, message.header, pose)

    def _take_body(self, n: int, feed: '_Feed', message: PoseStamped) -> None:
        self._take_pose(n, feed, message.header, message.pose)

    def _take_pose(self, n: int, feed: '_Feed', header: Any, pose: Any) -> None:
        other = self._sources[n]
        if other not in ('', feed.name) and self._feeds[other].heard.seconds < STALE_AFTER:
            raise SensorError(f'ignored: {other} measures the same disc; use one of the two')
        self._check_clock(header.stamp)
        followed = self._tracker.in_base(header.frame_id, pose_from_ros(pose))
        self._sources[n] = feed.name
        self._followed[n].add(monotonic(), followed)
        found = self._tracker.disc(n, followed)
        self._publish(n, feed, header.stamp, tracked_pose_to_ros(found, self._covariance))

    # IMUs.

    def _take_imu(self, n: int, feed: '_Feed', message: Imu) -> None:
        self._check_clock(message.header.stamp)
        a, w, turn = message.linear_acceleration, message.angular_velocity, self._rotations[n]
        acceleration, rates = turn @ (a.x, a.y, a.z), turn @ (w.x, w.y, w.z)
        if not (np.abs([acceleration, rates]) < MAX_READING).all():  # also false for nan
            raise SensorError('accelerations or rates that are not finite numbers, or beyond '
                              f'{MAX_READING:g}')
        of_acceleration = turn @ _covariance(
            message.linear_acceleration_covariance.tobytes(), 'linear_acceleration') @ turn.T
        of_rate = turn @ _covariance(
            message.angular_velocity_covariance.tobytes(), 'angular_velocity') @ turn.T
        found = self._imus.measure(
            n, ImuSample(seconds(message.header.stamp), tuple(acceleration.tolist()), rates),
            np.diag(of_acceleration), np.diag(of_rate), monotonic())
        if found is not None:
            self._publish(n, feed, message.header.stamp, tracked_pose_to_ros(*found))

    # What all have.

    def _check_clock(self, stamp: Any) -> None:
        if stamp.sec == stamp.nanosec == 0:
            raise SensorError('no stamp; set header.stamp to the time of the measurement')
        delay = seconds(self.get_clock().now().to_msg()) - seconds(stamp)
        if abs(delay) > MAX_AGE:
            raise SensorError(f'stamped {delay:.1f} s ago; synchronize the clocks of the '
                              'computers (negative: from the future)')

    def _publish(self, n: int, feed: '_Feed', stamp: Any, message: Any) -> None:
        feed.good.refresh()
        if feed.is_due():
            message.header.stamp, message.header.frame_id = stamp, self.parameters['frame_id']
            self._measured_poses[n].publish(message)

    # Taring.

    def _on_tare(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message = self._tare()
            response.success = True
        except SensorError as error:
            response.message = str(error)
        return response

    def _tare(self) -> str:
        """Take what is measured as that of the straight arm; all or nothing."""
        now = monotonic()
        offsets, imus = list(self._tracker.offsets), self._imus.mounts.copy()
        followed, tilted = [], []
        for n, height in enumerate(self._heights):
            source = self._sources[n] or 'pose'
            try:
                if poses := self._followed[n].recent(now):
                    offsets[n] = offset_of(poses, height)
                    followed.append(str(n))
                source = 'imu'
                if (mount := self._imus.straight(n, now)) is not None:
                    imus[n] = mount
                    tilted.append(str(n))
            except SensorError as error:
                raise SensorError(f'disc {n}, {source}: {error}; nothing was tared') from None
        if not followed + tilted:
            raise SensorError(f'no measurements; {self._nothing()}')
        self._tracker, self._imus.mounts = replace(self._tracker, offsets=tuple(offsets)), imus
        self._tared = [f'{what} of disc {", ".join(discs)}' for what, discs in (
            ('pose', followed), ('tilt', tilted)) if discs]
        self._report()
        flat = tuple(float(v) for offset in offsets for v in offset)
        kept = [f'tracker: {{offsets: {as_yaml(flat, 6)}}}'] if followed else []
        name, turns = self._imus.kept()
        kept += [f'imu: {{{name}: {as_yaml(turns, 6)}}}'] if tilted else []
        return (f'tared: {"; ".join(self._tared)}. To keep this after a restart, add to the '
                f'parameter file: {DISC_SENSORS}: {{ros__parameters: {{{", ".join(kept)}}}}}')

    # The status.

    def _nothing(self) -> str:
        topics = ', '.join(map(self.resolve_topic_name, (
            ALL_POSES, *(f'disc_0/{name}' for name in self._inputs))))
        return (f'publish on {topics} and so on, or remap these to the topics of the sensors: -r '
                'disc_0/imu:=/my_imu/data')

    def _report(self) -> None:
        feeds = list(self._feeds.values())
        for feed in feeds:
            feed.count = 0
        good = sorted(feed.name for feed in feeds if feed.good.seconds < STALE_AFTER)
        problems = [f'{feed.name}: {feed.problem}' for feed in feeds if feed.problem
                    and feed.refused.seconds < STALE_AFTER]
        problems += [f'{feed.name}: nothing received for {STALE_AFTER:g} s' for feed in feeds
                     if STALE_AFTER <= feed.heard.seconds < inf
                     and not feed.name.endswith(f' of {ALL_POSES}')]
        if len(problems) > MAX_PROBLEMS:
            problems[MAX_PROBLEMS:] = [f'and {len(problems) - MAX_PROBLEMS} more']
        values = {'measured': ', '.join(good), 'tared': '; '.join(self._tared) or 'no',
                  **{f'gyroscope_bias_{n}': f'{bias} rad/s'
                     for n, bias in self._imus.biases().items()}}
        if problems:
            self.status.set(WARN if good else ERROR, '; '.join(problems), **values)
        elif good:
            self.status.set(OK, f'measured: {", ".join(good)}', **values)
        else:
            self.status.set(WARN, f'no measurements yet; {self._nothing()}', **values)


class _Feed:
    """
    What comes from one sensor of one disc.

    heard, good, refused: time since a message, one that was used, one that was not.  problem: of
    the latter.
    """

    def __init__(self, name: str, period: float) -> None:
        self.name, self.problem = name, ''
        self.heard, self.good, self.refused = Age(), Age(), Age()
        self._period, self._published = period, 0.0
        self.count = 0  # of messages since the last report

    def take(self, function: Any, *arguments: Any) -> None:
        """Call a function; a SensorError becomes the problem of this feed."""
        self.heard.refresh()
        self.count += 1
        try:
            if self.count > MAX_COUNT:
                raise SensorError(f'more than {MAX_COUNT / REPORT_PERIOD:g} messages per second; '
                                  'the others are left out')
            function(*arguments)
        except SensorError as error:
            self.refuse(str(error))

    def refuse(self, problem: str) -> None:
        self.heard.refresh()
        self.refused.refresh()
        self.problem = problem

    def is_due(self) -> bool:
        """Whether it is time to publish again."""
        now = monotonic()
        if now - self._published < 0.9 * self._period:
            return False
        self._published = now
        return True


@lru_cache(maxsize=64)
def _covariance(data: bytes, what: str) -> Any:
    """Return a covariance (3, 3) of an Imu message, zero if unknown."""
    matrix = np.frombuffer(data).reshape(3, 3)
    if matrix[0, 0] == -1.0:
        raise SensorError(f'its {what}_covariance marks {what} as not measured (-1)')
    if not np.isfinite(matrix).all() or np.linalg.eigvalsh((matrix + matrix.T) / 2.0)[0] < -1e-12:
        raise SensorError(f'its {what}_covariance is not valid; give zeros if it is unknown')
    return matrix
