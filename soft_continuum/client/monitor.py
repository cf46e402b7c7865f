# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Hears all that the nodes say of the arm."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import atan2
from time import monotonic
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Bool

from soft_continuum.client.connection import Connection, NODE_NAMES
from soft_continuum.client.state import ArmState, NodeReport, Pose

LATCHED = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
STREAM = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
FRESH = 2.0  # s: what is older is not known any more
SETTLE = 1.0  # s given to what a running node may have no reason to say
LEVELS = {DiagnosticStatus.OK: 'ok', DiagnosticStatus.WARN: 'warn'}  # others: error
SPOKEN_BY = {'tendon_states': 'tendon_actuation', 'joint_states': 'kinematics',
             'segment_poses': 'kinematics', 'disc_poses': 'kinematics',
             'tendon_tensions': 'kinematics'}


@dataclass(frozen=True)
class Said:
    """One ``~/status``."""

    level: str
    message: str
    values: dict[str, str]


class Monitor:
    """Subscribes to the state of the arm and keeps the latest of everything."""

    def __init__(self, connection: Connection) -> None:
        """Subscribe; raises NodesMissingError when none of the nodes runs."""
        self._connection = connection
        self._latest: dict[str, tuple[float, Any]] = {}
        self._ages: dict[str, float] = {}
        self.said: dict[str, deque[Said]] = {name: deque(maxlen=100) for name in NODE_NAMES}
        self.said_count = dict.fromkeys(NODE_NAMES, 0)
        alive = connection.wait_for(
            lambda: [name for name, runs in connection.running().items() if runs],
            connection.timeout)
        if not alive:
            raise connection.not_found('the arm')
        self.segments = len(connection.parameters(
            alive[0], ['arm.segment_lengths'])['arm.segment_lengths'])
        connection.do(self._subscribe)
        connection.wait_for(self._all_said, connection.timeout)
        connection.wait_for(self._complete, SETTLE)

    def _subscribe(self) -> None:
        subscribe: Callable[..., Any] = self._connection.node.create_subscription
        for name in NODE_NAMES:
            subscribe(DiagnosticStatus, f'{name}/status', partial(self._on_status, name), LATCHED)
        subscribe(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        for topic in SPOKEN_BY:
            kind = PoseArray if topic.endswith('poses') else JointState
            subscribe(kind, topic, partial(self._hear, SPOKEN_BY[topic], topic), STREAM)
        for n in range(1, self.segments + 1):
            for topic, kind, qos in ((f'segment_{n}/stiff', Bool, LATCHED),
                                     (f'segment_{n}/pressure', FluidPressure, STREAM)):
                subscribe(kind, topic, partial(self._hear, 'jamming_valves', topic), qos)

    def _hear(self, node: str, topic: str, message: Any) -> None:
        self._ages[node] = monotonic()
        self._latest[topic] = monotonic(), message
        self._connection.changed()

    def _on_status(self, node: str, message: DiagnosticStatus) -> None:
        self.said[node].append(Said(LEVELS.get(message.level, 'error'), message.message,
                                    {pair.key: pair.value for pair in message.values}))
        self.said_count[node] += 1
        self._hear(node, f'{node}/status', message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        space = self._connection.namespace.strip('/')
        for status in message.status:
            before, _, node = status.name.rpartition('/')
            if before == space and node in NODE_NAMES:
                self._hear(node, 'diagnostics', message)

    def _all_said(self) -> bool:
        running = self._connection.running()
        return all(self.said[name] for name in NODE_NAMES if running[name])

    def _complete(self) -> bool:
        running = self._connection.running()
        return all(running.values()) and len(self._latest.keys() - {'diagnostics'}) >= (
            len(NODE_NAMES) + len(SPOKEN_BY) + 2 * self.segments)

    # What is known.

    def age(self, node: str) -> float | None:
        """Return the s since a node was heard; None if never."""
        return monotonic() - self._ages[node] if node in self._ages else None

    def last_said(self, node: str) -> Said:
        """Return the latest ``~/status`` of a node; empty if there is none."""
        return self.said[node][-1] if self.said[node] else Said('', '', {})

    def said_since(self, node: str, number: int) -> list[Said]:
        """Return what a node said after its first ``number`` statuses."""
        new = self.said_count[node] - number
        return list(self.said[node])[-new:] if new > 0 else []

    def _fresh(self, topic: str) -> Any:
        time, message = self._latest.get(topic, (0.0, None))
        return message if monotonic() - time < FRESH else None

    def pressure(self, segment: int) -> float | None:
        """Return the absolute pressure of a segment (from 1), Pa."""
        message = self._fresh(f'segment_{segment}/pressure')
        return None if message is None else float(message.fluid_pressure)

    def stiff(self, segment: int) -> bool | None:
        """Return whether a segment (from 1) is stiff; None while no pressure backs it."""
        _, message = self._latest.get(f'segment_{segment}/stiff', (0.0, None))
        if message is None or self.pressure(segment) is None:
            return None
        return bool(message.data)

    def pulls(self) -> tuple[float, float] | None:
        """Return the pulls of the right and the left tendon, m."""
        return _pair(self._fresh('tendon_states'), 'position')

    def speeds(self) -> tuple[float, float] | None:
        """Return the speeds of the right and the left tendon, m/s."""
        return _pair(self._fresh('tendon_states'), 'velocity')

    def snapshot(self) -> ArmState:
        """Return all that is known now."""
        joints, poses = self._fresh('joint_states'), self._fresh('segment_poses')
        angles = None if joints is None else tuple(float(a) for a in joints.position)
        per_segment = len(angles) // self.segments if angles else 0
        discs = self._fresh('disc_poses')
        numbers = range(1, self.segments + 1)
        running = self._connection.running()
        return ArmState(
            pulls=self.pulls(), speeds=self.speeds(),
            tensions=_pair(self._fresh('tendon_tensions'), 'effort'),
            measured_tensions=_pair(self._fresh('tendon_states'), 'effort'),
            stiff=tuple(self.stiff(n) for n in numbers),
            pressures=tuple(self.pressure(n) for n in numbers),
            bending_angles=None if angles is None else tuple(
                sum(angles[i * per_segment:(i + 1) * per_segment])
                for i in range(self.segments)),
            segment_poses=None if poses is None else tuple(_pose(p) for p in poses.poses),
            tip=None if discs is None or not discs.poses else _pose(discs.poses[-1]),
            joint_angles=angles,
            nodes=tuple(self._report(name, running[name]) for name in NODE_NAMES))

    def _report(self, name: str, running: bool) -> NodeReport:
        said = self.last_said(name)
        return NodeReport(name, running, said.level or None, said.message, said.values,
                          self.age(name))


def _pair(message: JointState | None, field: str) -> tuple[float, float] | None:
    values = [] if message is None else getattr(message, field)
    return (float(values[0]), float(values[1])) if len(values) == 2 else None


def _pose(pose: Any) -> Pose:
    return Pose(pose.position.x, pose.position.z,
                2.0 * atan2(pose.orientation.y, pose.orientation.w))
