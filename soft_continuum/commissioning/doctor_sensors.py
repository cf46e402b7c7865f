# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``doctor --sensors``: checks the sensors of a running arm."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import degrees, isfinite
import re
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String

from soft_continuum.client.connection import Connection
from soft_continuum.client.tasks import until
from soft_continuum.hardware.commissioning import Check, FAIL, OK, WARN
from soft_continuum.mechanics.arm import STANDARD_GRAVITY
from soft_continuum.ros import urdf
from soft_continuum.ros.conversions import MAX_VARIANCE, measured_pose_from_ros, seconds
from soft_continuum.ros.entries import EVERY_STATE, LATCHED, MAX_BYTES, SENSOR, subscribe_unguarded
from soft_continuum.ros.names import CAMERA, DISC_SENSORS, LOAD_CELLS, SENSORS
from soft_continuum.text import MAX_NAME, printable

LOOK_PERIOD = 0.25  # s between two searches for new topics
MAX_MESSAGES = 20_000  # of one topic
MAX_DELAY, LATE = 1.0, 0.3  # s between a stamp and now: refused by the nodes, late
MIN_RATE = {'pose': 2.0, 'imu': 20.0, 'load cells': 5.0}  # Hz
MAX_DEVIATION_PX = 1.0  # of the corners of tags
MAX_GRAVITY_ERROR = 0.1  # relative, accelerations that disc_sensors accepts
REST_RATE = 0.05  # rad/s, standard deviation of a gyroscope at rest
MAX_BIAS = 0.1  # rad/s
STATUS = rf'(?:{"|".join(SENSORS)})\w*/status'  # of camera_2, too
KINDS: dict[str, tuple[Any, Any]] = {
    r'disc_\d{1,3}/measured_pose': (PoseWithCovarianceStamped, SENSOR),
    r'disc_\d{1,3}/imu': (Imu, SENSOR),
    LOAD_CELLS: (JointState, SENSOR),
    'disc_poses': (PoseArray, SENSOR),
    urdf.ROBOT_DESCRIPTION: (String, LATCHED),
    'tendon_states': (JointState, SENSOR),
    STATUS: (DiagnosticStatus, EVERY_STATE),
}
"""By name pattern of the subscribed topics in the namespace."""
NOTHING = ('no sensor publishes in namespace {}: no disc_N/measured_pose, disc_N/imu or '
           'load_cells; start camera or disc_sensors, and the sensor drivers')
SILENT = 'no messages from any sensor; do the drivers run, and are their topics remapped?'
IMU = 'sensor_msgs/msg/Imu'
Heard = Sequence[tuple[float, Any]]
"""Messages, each with its time of arrival, s, on the clock of the stamps."""


def checks(connection: Connection, duration: float) -> Iterator[Check]:
    """Receive for ``duration`` s; yield a check for each sensor of an arm."""
    listening = _Listening(connection.node)
    connection.requests.start(listening.run(duration)).result()
    yield from judged(listening.heard, listening.sources, connection.node.get_namespace())


class _Listening:
    """Collects sensor messages on the thread that spins the node."""

    def __init__(self, node: Any) -> None:
        self.heard: dict[str, list[tuple[float, Any]]] = {}
        self.sources: dict[str, tuple[str, ...]] = {}  # nodes that publish a topic
        self._node = node

    async def run(self, duration: float) -> None:
        for _ in range(max(1, round(duration / LOOK_PERIOD))):
            self._look()
            await until(lambda: False, LOOK_PERIOD)

    def _look(self) -> None:
        space = self._node.get_namespace().rstrip('/') + '/'
        for name, kinds in self._node.get_topic_names_and_types():
            topic = name.removeprefix(space) if name.startswith(space) else ''
            found = [kind for pattern, kind in KINDS.items() if re.fullmatch(pattern, topic)]
            if not found and IMU in kinds and self._is_taken(name):  # under the name it came with
                topic, found = name, [(Imu, SENSOR)]
            publishers = self._node.get_publishers_info_by_topic(name) if found else []
            if publishers:
                self.sources[topic] = tuple(sorted({p.node_name for p in publishers}))
            if publishers and topic not in self.heard:
                kind, qos = found[0]
                self.heard[topic] = []
                of_kind = '/'.join((kind.__module__.split('.')[0], 'msg', kind.__name__))
                if of_kind in kinds:
                    subscribe_unguarded(
                        self._node, kind, topic, partial(self._note, topic), qos,
                        urdf.MAX_BYTES if topic == urdf.ROBOT_DESCRIPTION else MAX_BYTES)

    def _is_taken(self, name: str) -> bool:
        """Whether disc_sensors of this arm subscribes to a topic."""
        return any((node.node_name, node.node_namespace) == (
            DISC_SENSORS, self._node.get_namespace())
            for node in self._node.get_subscriptions_info_by_topic(name))

    def _note(self, topic: str, message: Any) -> None:
        messages = self.heard[topic]
        if len(messages) < MAX_MESSAGES:
            messages.append((seconds(self._node.get_clock().now().to_msg()), message))


def judged(heard: dict[str, Any], sources: dict[str, tuple[str, ...]], space: str
           ) -> Iterator[Check]:
    """Yield a check for each sensor, from its messages by topic."""
    poses, imus = (sorted((t for t in heard if re.fullmatch(pattern, t)),
                          key=lambda t: (len(t), t))  # disc_9 before disc_10
                   for pattern in (r'disc_\d+/measured_pose', r'disc_\d+/imu|/.*'))
    sensors = [*poses, *imus, *([LOAD_CELLS] if LOAD_CELLS in heard else [])]
    if not any(heard[topic] for topic in sensors):
        yield Check('sensors', FAIL, SILENT if sensors else NOTHING.format(space))
    for topic in sorted(t for t in heard if re.fullmatch(STATUS, t) and heard[t]):
        yield _status(topic.removesuffix('/status'), heard[topic][-1][1])
    frame = next((m.header.frame_id for _, m in heard.get('disc_poses', ())), '')
    tendons = next((list(m.name) for _, m in heard.get('tendon_states', ())), [])
    described = heard.get(urdf.ROBOT_DESCRIPTION)
    axes = urdf.pose_axes_of(urdf.first_joint(described[-1][1].data) if described else ())
    for topic in poses:
        by = ', '.join(printable(name, MAX_NAME) for name in sources.get(topic, ()))
        yield _check(topic.replace('/', ' ').replace('_pose', ' pose').replace('_', ' '),
                     heard[topic], 'pose', partial(_pose, frame=frame, by=by, axes=axes))
    for topic in imus:
        step = printable(topic, MAX_NAME) if topic.startswith('/') else (
            topic.replace('/', ' ').replace('_', ' '))
        yield _check(step, heard[topic], 'imu', _imu)
    if LOAD_CELLS in heard:
        yield _check('load cells', heard[LOAD_CELLS], 'load cells',
                     partial(_load_cells, tendons=tendons))


def _status(node: str, message: DiagnosticStatus) -> Check:
    values = {pair.key: pair.value for pair in message.values}
    status = {DiagnosticStatus.OK: OK, DiagnosticStatus.WARN: WARN}.get(message.level, FAIL)
    parts = [message.message]
    if node.startswith(CAMERA) and values:
        parts.append(f'tags {values.get("tags", "") or "none"}, corners off by '
                     f'{values.get("deviation_px", "?")} px')
        try:
            off = float(values.get('deviation_px', 'nan'))
        except ValueError:
            off = float('nan')
        if off > MAX_DEVIATION_PX:
            status = WARN if status == OK else status
            parts.append('calibrate the lens and check the positions of the tags')
    return Check(node, status, printable('; '.join(parts)))


def _check(step: str, messages: Heard, kind: str,
           judge: Callable[[Sequence[Any]], tuple[str, str]]) -> Check:
    """Return the problem of a sensor's message times, or else of the messages."""
    if not messages:
        return Check(step, WARN, 'nothing received; does its sensor see the disc, is the message '
                     'type right?')
    times = np.array([time for time, _ in messages])
    stamps = np.array([seconds(message.header.stamp) for _, message in messages])
    delay = float(np.median(times - stamps))
    if abs(delay) > MAX_DELAY:
        return Check(step, FAIL, f'stamped {delay:.1f} s ago; synchronise the clocks of the '
                     'computers (negative: from the future; very large: no stamp)')
    status, text = judge([message for _, message in messages])
    span = float(np.ptp(times))
    rate = (len(times) - 1) / span if span > 0.0 else 0.0
    text = f'{text}, {rate:.1f} Hz, {delay * 1e3:.0f} ms late'
    if status == OK and rate < MIN_RATE[kind]:
        status, text = WARN, f'{text}; expected: {MIN_RATE[kind]:g} Hz or more'
    if status == OK and delay > LATE:
        status, text = WARN, f'{text}; is a computer overloaded, or a clock off?'
    return Check(step, status, text)


def _pose(messages: Sequence[PoseWithCovarianceStamped], frame: str, by: str,
          axes: NDArray[np.bool_]) -> tuple[str, str]:
    variances, reason = defaultdict(list), ''
    frame = frame or messages[0].header.frame_id
    for message in messages:
        try:
            _, covariance = measured_pose_from_ros(message, axes, frame)
        except ValueError as error:
            reason = str(error)
            continue
        position, angle = np.split(np.diag(covariance)[axes], [axes[:3].sum()])
        for what, found in (('position', position), ('angle', angle)):
            if found.max() < MAX_VARIANCE:
                variances[what].append(found.mean())
    parts = [f'by {by}' if by else 'received', f'in {printable(frame, MAX_NAME)}']
    if variances['position']:
        parts.append(f'{1e3 * np.sqrt(np.median(variances["position"])):.2f} mm')
    elif not reason:
        parts.append('position not measured')
    if variances['angle']:
        parts.append(f'{degrees(np.sqrt(np.median(variances["angle"]))):.2f} degrees')
    if reason:
        return FAIL, '; '.join([reason, ', '.join(parts)])
    return OK, ', '.join(parts)


def _imu(messages: Sequence[Imu]) -> tuple[str, str]:
    rows = np.array([[getattr(vector, axis) for vector in (m.linear_acceleration,
                                                           m.angular_velocity) for axis in 'xyz']
                     for m in messages])
    if not np.isfinite(rows).all():
        return FAIL, 'accelerations or rates that are not finite numbers'
    magnitude = float(np.median(np.linalg.norm(rows[:, :3], axis=1)))
    text = f'{magnitude:.2f} m/s^2'
    if abs(magnitude - STANDARD_GRAVITY) > MAX_GRAVITY_ERROR * STANDARD_GRAVITY:
        return FAIL, f'{text}, at rest it is 9.81; is it in m/s^2, gravity included?'
    if len(rows) > 10 and not np.ptp(rows, axis=0).any():
        return WARN, f'{text}; identical readings each time: is it frozen, or simulated?'
    if rows[:, 3:].std(axis=0).max() > REST_RATE:
        return OK, f'{text}, turning'
    bias = float(np.abs(rows[:, 3:].mean(axis=0)).max())
    text = f'{text}, bias {degrees(bias):.2f} degrees/s'
    return (WARN, f'{text}: large; is it in rad/s, does the arm turn?') if bias > MAX_BIAS else (
        OK, text)


def _load_cells(messages: Sequence[JointState], tendons: Sequence[str]) -> tuple[str, str]:
    names = [printable(name, MAX_NAME) for name in messages[-1].name]
    if not names or len(set(names)) < len(names) or any(
            len(m.effort) != len(m.name) for m in messages):
        return FAIL, (f'names {", ".join(names) or "none"}, tensions {len(messages[-1].effort)}; '
                      'needed: name and effort (N) of each tendon')
    if tendons and (unknown := set(names) - {printable(name, MAX_NAME) for name in tendons}):
        return FAIL, (f'names {", ".join(sorted(unknown))}; the tendons are '
                      f'{", ".join(printable(name, MAX_NAME) for name in tendons)}')
    if not all(map(isfinite, [force for m in messages for force in m.effort])):
        return FAIL, 'tensions that are not finite numbers; check the cables'
    means = np.mean([m.effort for m in messages if len(m.effort) == len(names)], axis=0)
    return OK, ', '.join(f'{name} {force:.1f} N' for name, force in zip(names, means, strict=True))
