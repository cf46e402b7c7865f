# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Controllers as ros2_control has them, on joints that move at a limited speed: a plant on topics.

What they take and refuse is what the sources of ros2_controllers say (forward_command_controller,
joint_trajectory_controller, joint_state_broadcaster), as far as it concerns positions.  They live
in a context of their own, as in another process.
"""

from collections.abc import Callable, Sequence
from functools import partial
from math import isfinite, nan
import threading
import time

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from soft_continuum.hardware.clock import STEADY
from soft_continuum.ros.entries import make_executor
from support import driver_waits

DEADLINE = 20.0  # s
RATE = 100.0  # Hz
RADIUS = 0.01  # m per rad
JOINTS = ('spool_right', 'spool_left')
until = partial(driver_waits.until, STEADY, step=0.005)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class OtherNodes:
    """Nodes of somebody else, in a context and on a thread of their own."""

    def __init__(self, domain: int, name: str, namespace: str = '/') -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node(name, context=self.context, namespace=namespace)
        self._executor = make_executor(self.context)
        self._executor.add_node(self.node)
        self._ending = False
        self._thread = threading.Thread(target=self._spin, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def _spin(self) -> None:
        while not self._ending:
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        if self._ending:
            return
        self._ending = True
        if self._thread.is_alive():
            self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


class Controllers(OtherNodes):
    """
    A joint_state_broadcaster, and a position or a trajectory controller of some joints.

    positions: of the joints by name, rad.  follows: whether joints move.  message: changes what is
    published, or returns None for nothing.  commands: how many were taken.
    """

    def __init__(self, domain: int, kind: str = 'positions', joints: Sequence[str] = JOINTS,
                 others: Sequence[str] = ('gripper',), speed: float = 20.0,
                 start: float = 0.3) -> None:
        super().__init__(domain, 'controller_manager')
        self.joints = tuple(joints)
        self.speed = speed  # rad/s
        self.positions = dict.fromkeys((*joints, *others), start)
        self.velocities = dict.fromkeys(self.positions, 0.0)
        self.targets = dict(self.positions)
        self.follows, self.commands, self.refused = True, 0, ''
        self.message: Callable[[JointState], JointState | None] = lambda message: message
        self._trajectory: list[tuple[float, dict[str, float]]] = []  # s, rad
        self._time = time.monotonic()
        self._states = self.node.create_publisher(
            JointState, 'joint_state_broadcaster/joint_states', 10)
        if kind == 'positions':
            self.commanded = self.node.create_subscription(
                Float64MultiArray, 'position_controller/commands', self._on_commands, 10)
        else:
            self.commanded = self.node.create_subscription(
                JointTrajectory, 'trajectory_controller/joint_trajectory', self._on_trajectory,
                BEST_EFFORT)
        self.node.create_timer(1.0 / RATE, self._update)
        self.start()

    def _on_commands(self, message: Float64MultiArray) -> None:
        if not all(map(isfinite, message.data)) or len(message.data) != len(self.joints):
            self.refused = f'{list(message.data)}'
            return
        self.commands += 1
        self.targets.update(zip(self.joints, message.data, strict=True))

    def _on_trajectory(self, message: JointTrajectory) -> None:
        times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in message.points]
        if sorted(message.joint_names) != sorted(self.joints):
            self.refused = "Joints on incoming trajectory don't match the controller joints."
        elif not times:
            self.refused = 'Empty trajectory received.'
        elif sorted(set(times)) != times:
            self.refused = 'Time between points is not strictly increasing'
        elif any(len(p.positions) != len(self.joints) for p in message.points):
            self.refused = 'Mismatch between joint_names size and positions'
        else:
            self.commands += 1
            now = time.monotonic()
            self._trajectory = [(now, dict(self.targets))] + [
                (now + t, dict(zip(message.joint_names, p.positions, strict=True)))
                for t, p in zip(times, message.points, strict=True)]

    def _desired(self, now: float) -> dict[str, float]:
        """Sample the trajectory: linear, as positions alone are interpolated; then its end."""
        points = self._trajectory
        for (begin, before), (end, after) in zip(points, points[1:], strict=False):
            if now < end:
                share = (now - begin) / (end - begin)
                return {name: before[name] + share * (after[name] - before[name])
                        for name in self.joints}
        return points[-1][1]

    def _update(self) -> None:
        now = time.monotonic()
        passed, self._time = now - self._time, now
        if self._trajectory:
            self.targets.update(self._desired(now))
        for name in self.joints if self.follows else ():
            step = self.speed * passed
            way = self.targets[name] - self.positions[name]
            way = max(-step, min(step, way))
            self.positions[name] += way
            self.velocities[name] = way / passed
        names = sorted(self.positions)  # not the order of the controller
        message = JointState(
            name=names, position=[self.positions[n] for n in names],
            velocity=[self.velocities[n] for n in names], effort=[nan] * len(names))
        message.header.stamp = self.node.get_clock().now().to_msg()
        if (shown := self.message(message)) is not None:
            self._states.publish(shown)

    @property
    def pulls(self) -> tuple[float, ...]:
        """Pulls of the tendons on spools whose radius is RADIUS, from the straight arm, m."""
        return tuple(RADIUS * (self.positions[name] - 0.3) for name in self.joints)
