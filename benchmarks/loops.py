# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How steady the control loops are while a view is busy, goals are planned, or a board is dead."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
import os
from pathlib import Path
from random import randrange
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np
import rclpy
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile
from sensor_msgs.msg import FluidPressure, JointState

from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Shape

TENDON_PERIOD, VALVE_PERIOD = 0.02, 0.05  # s, of the parameters tendon_rate and jamming_rate
START, WARM = 60.0, 5.0  # s
GOAL_PERIOD = 0.5  # s between two goals, each of which is planned
SHAPES = ('c_form', 's_form')
PROGRAM = [sys.executable, '-m', 'soft_continuum']
VIEW = """
from importlib import import_module
import rclpy
rclpy.init()
node = rclpy.create_node('busy_view')
seen = set()

def subscribe():
    for name, kinds in node.get_topic_names_and_types():
        if name not in seen:
            seen.add(name)
            package, _, kind = kinds[0].split('/')
            node.create_subscription(getattr(import_module(package + '.msg'), kind), name,
                                     lambda _: sum(range(200000)), 10)

node.create_timer(0.5, subscribe)
rclpy.spin(node)
"""


class Observer:
    """Notes when the cycles ran, by the stamps of what the control loops read."""

    def __init__(self) -> None:
        """Join a domain in which nobody else is."""
        os.environ['ROS_DOMAIN_ID'] = str(randrange(1, 102))
        rclpy.init()
        self._node = rclpy.create_node('observer')
        self.tendons: list[float] = []
        self.valves: list[float] = []
        qos = QoSProfile(depth=1000)
        for kind, topic, stamps in ((JointState, 'tendon_states', self.tendons),
                                    (FluidPressure, 'segment_1/pressure', self.valves)):
            self._node.create_subscription(
                kind, topic, lambda message, stamps=stamps: stamps.append(_stamp(message)), qos)
        self._action = ActionClient(self._node, RunShapeSequence, 'run_shape_sequence')

    def spin(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Receive for a time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0 and not until():
            rclpy.spin_once(self._node, timeout_sec=min(left, 0.1))

    def send_goal(self, number: int) -> None:
        """Send a goal, which is planned and takes the place of the one before."""
        self._action.send_goal_async(
            RunShapeSequence.Goal(shapes=[Shape(name=SHAPES[number % len(SHAPES)])]))

    def close(self) -> None:
        """Leave the domain."""
        self._action.destroy()
        rclpy.shutdown()


def _stamp(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


@contextmanager
def _process(command: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.send_signal(signal.SIGINT)
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def measure(disturbance: str, seconds: float) -> tuple[list[float], list[float]]:
    """Return the stamps (s) of the cycles of tendons and valves during a disturbance."""
    progress(disturbance)
    with tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        observer = Observer()
        stack.callback(observer.close)
        up = [*PROGRAM, 'up']
        board: subprocess.Popen[bytes] | None = None
        if disturbance.startswith('dead'):
            name = 'grbl' if 'stepper' in disturbance else 'modbus'
            driver = 'tendon' if 'stepper' in disturbance else 'jamming'
            link, file = Path(directory, name), Path(directory, 'more.yaml')
            file.write_text(f'/**:\n  ros__parameters:\n    {name}.port: {link}\n',
                            encoding='utf-8')
            board = stack.enter_context(
                _process([*PROGRAM, f'{name}_emulator', '--link', str(link)]))
            while not link.exists():
                time.sleep(0.05)
            from soft_continuum.user_files import description_file
            up += [f'--{driver}-driver', name, '--params-file', str(description_file()),
                   '--params-file', str(file)]
        stack.enter_context(_process(up))
        observer.spin(START, lambda: bool(observer.tendons and observer.valves))
        if disturbance == 'busy view':
            stack.enter_context(_process([sys.executable, '-c', VIEW]))
        observer.spin(WARM)
        if board is not None:
            board.send_signal(signal.SIGSTOP)
        for stamps in (observer.tendons, observer.valves):
            stamps.clear()
        if disturbance == 'goals planned':
            for k in range(int(seconds / GOAL_PERIOD)):
                observer.send_goal(k)
                observer.spin(GOAL_PERIOD)
        else:
            observer.spin(seconds)
        return list(observer.tendons), list(observer.valves)


def _cells(stamps: Sequence[float], period: float) -> list[str]:
    """Return the median, 99.9 % and largest of the deviations of a period, ms."""
    if len(stamps) < 2:
        return ['none'] * 3
    gaps = np.diff(stamps)  # at rest of several periods: ten readings a second are published
    stddevs = np.sort(np.abs(gaps - period * np.maximum(np.round(gaps / period), 1))) * 1e3
    found = [stddevs[min(int(part * len(stddevs)), len(stddevs) - 1)]
             for part in (0.5, 0.999, 1.0)]
    return [number(float(v)) for v in found]


def run(quick: bool) -> Section:
    """Measure all disturbances and return the table."""
    seconds = 10.0 if quick else 60.0
    rows = []
    for disturbance in ('none', 'busy view', 'goals planned'):
        tendons, valves = measure(disturbance, seconds)
        rows.append([disturbance, *_cells(tendons, TENDON_PERIOD), *_cells(valves, VALVE_PERIOD)])
    tendons, _ = measure('dead valve board', seconds)
    _, valves = measure('dead stepper board', seconds)
    rows.append(['dead board of the other loop', *_cells(tendons, TENDON_PERIOD),
                 *_cells(valves, VALVE_PERIOD)])
    head = ['deviation, ms', 'tendons: median', '99.9 %', 'worst', 'valves: median', '99.9 %',
            'worst']
    return Section('benchmarks/performance.md', 'loops', f'{machine()}\n\n{table(head, rows)}')
