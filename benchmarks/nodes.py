# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the kinematics node costs, with and without a camera, beside bare publishers."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import inf
import os
from pathlib import Path
from random import randrange
import subprocess
import sys
import time

from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import numpy as np
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState

from benchmarks.tables import machine, number, Section, table
from soft_continuum.ros.entries import LATCHED, SENSOR, STREAM
from soft_continuum_interfaces.msg import JammingValvesState

RATE = 100.0  # Hz
PICTURES = 3  # tendon_states for one picture
DISCS = 1, 2, 3  # that it shows
NOISE = 3e-4  # m
STIFF = True, True, False
PULLS = 0.004, -0.0045  # m, the largest; the soft segment follows a sine
PERIOD = 4.0  # s of that sine
START, WARM = 30.0, 2.0  # s
KINEMATICS = ['-m', 'soft_continuum', 'kinematics']

PUBLISHER = """
from geometry_msgs.msg import Pose, PoseArray
import rclpy
from sensor_msgs.msg import JointState
from soft_continuum.ros.entries import make_executor
from soft_continuum.ros.entries import STREAM
rclpy.init()
node = rclpy.create_node('bare')
names = [f'joint_{i}' for i in range(39)]
messages = {'segment_poses': PoseArray(poses=[Pose() for _ in range(3)]),
            'disc_poses': PoseArray(poses=[Pose() for _ in range(8)]),
            'joint_states': JointState(name=names, position=[0.0] * 39),
            'tendon_tensions': JointState(name=['right_tendon', 'left_tendon'],
                                          effort=[0.0, 0.0])}
publishers = [(node.create_publisher(type(m), name, STREAM), m) for name, m in messages.items()]

def publish():
    for publisher, message in publishers:
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)

node.create_timer(0.01, publish)
executor = make_executor()
executor.add_node(node)
while rclpy.ok():
    executor.spin_once(timeout_sec=0.1)
"""


class Probe(Node):
    """Says where the tendons are, and notes when the poses that follow come."""

    def __init__(self) -> None:
        """Say which segments are stiff."""
        super().__init__('probe')
        self.messages = 0
        self.latencies: list[float] = []
        self._sent = inf  # when the message went out that has not been answered yet
        self._message = JointState(name=['right_tendon', 'left_tendon'])
        self._tendons = self.create_publisher(JointState, 'tendon_states', STREAM)
        self._valves = self.create_publisher(
            JammingValvesState, 'jamming_valves/state', LATCHED)
        self._valves.publish(JammingValvesState(stiffness=[
            JammingValvesState.STIFF if stiff else JammingValvesState.NOT_STIFF
            for stiff in STIFF]))
        self._measured = {n: self.create_publisher(
            PoseWithCovarianceStamped, f'disc_{n}/measured_pose', STREAM) for n in DISCS}
        self._random = np.random.default_rng(1)
        self.create_subscription(PoseArray, 'segment_poses', self._on_poses, SENSOR)
        self._discs, self._predicted = PoseArray(), False
        self.create_subscription(PoseArray, 'disc_poses', self._on_discs, SENSOR)
        self.create_subscription(PoseArray, 'predicted_disc_poses', self._on_predicted, SENSOR)

    def _on_poses(self, _: PoseArray) -> None:
        self.messages += 1
        if self._sent < inf:
            self.latencies.append(time.perf_counter() - self._sent)
            self._sent = inf

    def _on_discs(self, poses: PoseArray) -> None:
        if not self._predicted:
            self._discs = poses

    def _on_predicted(self, poses: PoseArray) -> None:
        self._predicted, self._discs = True, poses

    def _picture(self) -> None:
        """Publish the discs as the model predicts them, with noise: only the cost is measured."""
        for n, publisher in self._measured.items():
            seen = PoseWithCovarianceStamped(header=self._discs.header)
            seen.pose.pose = self._discs.poses[2 * n]
            seen.pose.pose.position.x += float(self._random.normal(0.0, NOISE))
            seen.pose.covariance = (NOISE**2 * np.eye(6)).ravel()
            publisher.publish(seen)

    def drive(self, seconds: float, speak: bool, see: bool = False) -> None:
        """
        Publish tendon_states at RATE for a time, or only listen.

        see: publish every PICTURES of them what a camera would measure, too.
        """
        begin = time.perf_counter()
        for k in range(int(seconds * RATE)):
            if speak:
                part = 0.5 - 0.5 * np.cos(2 * np.pi * k / RATE / PERIOD)
                self._message.position = [float(part * pull) for pull in PULLS]
                if self._sent < inf:  # not answered before the next one: late
                    self.latencies.append(inf)
                self._sent = time.perf_counter()
                self._tendons.publish(self._message)
                if see and self._discs.poses and k % PICTURES == 0:
                    self._picture()
            while (left := begin + (k + 1) / RATE - time.perf_counter()) > 0.0:
                rclpy.spin_once(self, timeout_sec=left)


def run(quick: bool) -> Section:
    """Measure all processes and return the table."""
    seconds = 3.0 if quick else 30.0
    probe = _probe_alone()
    commands = {
        'a bare publisher of the same messages': ['-c', PUBLISHER],
        'kinematics': KINEMATICS,
        f'kinematics, {len(DISCS)} discs measured at {RATE / PICTURES:.0f} Hz': KINEMATICS,
    }
    rows = [[name, *_measure(probe, command, seconds, command is KINEMATICS, 'discs' in name)]
            for name, command in commands.items()]
    rclpy.shutdown()
    head = ['100 Hz', 'CPU, % of a core', 'tendon_states to segment_poses, ms: median', '99 %']
    return Section('benchmarks/performance.md', 'nodes', f'{machine()}\n\n{table(head, rows)}')


def _probe_alone() -> Probe:
    """Return a probe in a domain in which nobody else is: what it says is not so."""
    while True:
        os.environ['ROS_DOMAIN_ID'] = str(randrange(1, 102))
        rclpy.init()
        probe = Probe()
        time.sleep(3.5)  # Fast DDS announces itself every 3 s
        if probe.get_node_names() == ['probe']:
            return probe
        rclpy.shutdown()


def _measure(probe: Probe, command: Sequence[str], seconds: float, speak: bool, see: bool
             ) -> list[str]:
    with _process(command) as pid:
        deadline = time.monotonic() + START
        probe.messages = 0
        while not probe.messages:
            if time.monotonic() > deadline:
                raise RuntimeError(f'{command}: no segment_poses')
            probe.drive(0.1, speak)
        probe.drive(WARM, speak, see)
        probe.latencies.clear()
        probe.messages = 0
        before = _cpu_time(pid)
        probe.drive(seconds, speak, see)
        share = (_cpu_time(pid) - before) / seconds
    times = ['-', '-']
    if speak:
        latencies = 1e3 * np.sort(probe.latencies)
        found = [float(latencies[int(part * len(latencies))]) for part in (0.5, 0.99)]
        times = [number(v) if v < inf else f'over {1e3 / RATE:.0f}' for v in found]
    return [number(100.0 * share), *times]


@contextmanager
def _process(command: Sequence[str]) -> Iterator[int]:
    process = subprocess.Popen([sys.executable, *command])
    try:
        yield process.pid
    finally:
        process.kill()
        process.wait()


def _cpu_time(pid: int) -> float:
    """Return the processor time (s) that a process has taken, all of its threads."""
    fields = Path(f'/proc/{pid}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
