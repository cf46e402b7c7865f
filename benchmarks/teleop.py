# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How long it takes from the stick to a motion, beside sending targets to the servo directly."""

from collections.abc import Callable
from functools import partial
from math import inf
import os
from random import randrange, uniform
import time

from geometry_msgs.msg import Vector3
import numpy as np
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState, Joy
from std_srvs.srv import SetBool, Trigger

from benchmarks.tables import machine, number, Section, table
from soft_continuum.ros.entries import EVERY_STATE, SENSOR, STREAM
from soft_continuum.ui.cli.processes import NodeProcesses
from soft_continuum.ui.cli.up import nodes_of, STEERING
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import TeleopState

REPEAT = 0.05  # s between two messages of a joystick, and between two targets
MOVED = 1e-6  # m of pull
START, LATE = 60.0, 2.0  # s
SPEED = 0.3  # rad/s, of teleop
SEGMENT, ENABLE, SOFTEN, NEXT = 2, 4, 0, 5


class Probe(Node):
    """A joystick, and a program that sends targets."""

    def __init__(self) -> None:
        """Publish and subscribe."""
        super().__init__('probe')
        self.joy = Joy(axes=[0.0] * 8, buttons=[0] * 11)
        self.state = TeleopState()
        self.pulls: tuple[float, ...] = ()
        self.moves = False
        self._target: float | None = None
        self._velocity = 0.0
        self._start: tuple[float, ...] = ()
        self._moved_time = inf
        self._joys = self.create_publisher(Joy, 'joy', STREAM)
        self._targets = self.create_publisher(Vector3, 'servo/target_bending', STREAM)
        self.create_subscription(TeleopState, 'teleop/state', self._on_state, EVERY_STATE)
        self.create_subscription(JointState, 'tendon_states', self._on_tendons, SENSOR)
        self.enable = self.create_client(SetBool, 'servo/enable')
        self.resume = self.create_client(Trigger, 'tendon_actuation/resume')
        self._next = 0.0

    def _on_state(self, state: TeleopState) -> None:
        self.state = state

    def _on_tendons(self, message: JointState) -> None:
        self.pulls, self.moves = tuple(message.position), any(message.velocity)
        if self._start and self._moved_time == inf and any(
                abs(now - then) > MOVED
                for now, then in zip(self.pulls, self._start, strict=True)):
            self._moved_time = time.perf_counter()

    def publish(self) -> None:
        """Publish what a joystick repeats, and the target if there is one."""
        self._next = time.perf_counter() + REPEAT
        self.joy.header.stamp = self.get_clock().now().to_msg()
        self._joys.publish(self.joy)
        if self._target is not None:
            self._target += self._velocity * REPEAT
            self._targets.publish(Vector3(x=self._target))

    def until(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Go on publishing until something is so; return whether it is."""
        end = time.perf_counter() + seconds
        while not condition() and (now := time.perf_counter()) < end:
            if now >= self._next:
                self.publish()
            rclpy.spin_once(self, timeout_sec=min(0.005, self._next - now))
        return condition()

    def show(self, *pressed: int, x: float = 0.0) -> None:
        """Hold buttons and the stick like this."""
        self.joy.buttons = [int(n in pressed) for n in range(11)]
        self.joy.axes = [x] + [0.0] * 7
        self.publish()

    def latency(self, begin: Callable[[], None], end: Callable[[], None]) -> float:
        """Return the time from ``begin`` to the first change of tendon_states, s."""
        self.until(lambda: not self.moves, LATE)
        self.until(lambda: False, uniform(0.3, 0.4))  # with no phase to anybody's cycle
        self._start, self._moved_time = self.pulls, inf
        sent = time.perf_counter()
        begin()
        self.until(lambda: self._moved_time < inf, LATE)
        self.until(lambda: False, 0.3)
        end()
        self._start = ()
        return self._moved_time - sent

    def target(self, bending: float | None, velocity: float = 0.0) -> None:
        """Send a target that moves, rad and rad/s, or none."""
        self._target, self._velocity = bending, velocity
        self.publish()


def run(quick: bool) -> Section:
    """Measure both, one after the other, and return the table."""
    count = 5 if quick else 40
    os.environ['ROS_DOMAIN_ID'] = str(randrange(1, 102))
    files = [description_file()]
    arguments = ['bench', '--ros-args', '--params-file', str(files[0])]
    with NodeProcesses((*nodes_of(files), *STEERING), arguments):
        rclpy.init()
        probe = Probe()
        by_stick, direct = (np.multiply(1e3, found) for found in _measure(probe, count))
        rclpy.shutdown()
    rows = [[name, *(number(float(np.percentile(found, part, method='higher')))
                     for part in (50, 95, 100))]
            for name, found in (('stick, by teleop and servo', by_stick),
                                ('targets, sent to servo', direct))]
    return Section('benchmarks/performance.md', 'teleop', f'{machine()}\n\n' + table(
        [f'ms, {count} times each', 'median', '95 %', 'worst'], rows))


def _measure(probe: Probe, count: int) -> tuple[list[float], list[float]]:
    _say(probe, 'nothing', lambda: probe.state.connected and 'no segment' in probe.state.message)
    for _ in range(SEGMENT):
        probe.show(NEXT)
        probe.until(lambda: False, 0.2)
        probe.show()
        probe.until(lambda: False, 0.2)
    _say(probe, 'its segment', lambda: probe.state.segment == SEGMENT)
    probe.show(SOFTEN)
    _say(probe, 'a soft segment', lambda: 'is soft' in probe.state.message)
    probe.show()
    _say(probe, 'a servo', lambda: bool(probe.count_subscribers('servo/target_bending')))
    probe.until(lambda: False, LATE)
    probe.show(ENABLE)
    _say(probe, 'ready', lambda: 'ready' in probe.state.message and probe.state.enabled)
    by_stick, direct = [], []
    for n in range(count):
        sign = 1.0 if n % 2 else -1.0
        probe.show(ENABLE)
        by_stick.append(probe.latency(
            partial(probe.show, ENABLE, x=sign), probe.show))
        direct.append(probe.latency(
            partial(probe.target, 0.1 * sign, -sign * SPEED), partial(probe.target, None)))
        probe.until(lambda: False, 0.6)  # servo.target_timeout
    return by_stick, direct


def _say(probe: Probe, what: str, condition: Callable[[], bool]) -> None:
    if not probe.until(condition, START):
        raise RuntimeError(f'not {what}: {probe.state}')
