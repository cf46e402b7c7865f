# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""A client that writes down a run of the arm: the command ``record``."""

import argparse
from collections.abc import Sequence
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseArray
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Bool

from soft_continuum.analysis.recording import RecordingWriter
from soft_continuum.hardware.tendon_controller import TENDONS
from soft_continuum.nodes.runtime import end, make_executor, NODES, Signals
from soft_continuum.ros.qos import LATCHED, SENSOR
from soft_continuum_interfaces.action import RunShapeSequence

FEEDBACK = RunShapeSequence.Impl.FeedbackMessage
HEARD_WITHIN = 5.0  # s, before the command says that there is nothing to record


class Recorder(Node):
    """Writes what the nodes publish; moves and asks for nothing."""

    def __init__(self, writer: RecordingWriter, **options: Any) -> None:
        """Subscribe to all that a recording holds."""
        super().__init__('recorder', **options)
        self._writer = writer
        self._begin = time.monotonic()
        self._segments = 0
        self._progress = ''
        self._said: dict[str, str] = {}
        self.rows = 0
        self.idle_after_goal = False
        self.create_subscription(
            JointState, 'tendon_states', lambda m: self._tendons('tendons', m.position, 1e3),
            SENSOR)
        self.create_subscription(
            JointState, 'tendon_tensions', lambda m: self._tendons('tensions', m.effort, 1.0),
            SENSOR)
        self.create_subscription(PoseArray, 'segment_poses', self._count_segments, SENSOR)
        self.create_subscription(PoseArray, 'disc_poses', self._points, SENSOR)
        self.create_subscription(FEEDBACK, 'run_shape_sequence/_action/feedback',
                                 self._feedback, SENSOR)
        for name in NODES:
            self.create_subscription(
                DiagnosticStatus, f'{name}/status', lambda m, n=name: self._status(n, m), LATCHED)

    def start(self) -> None:
        """Nothing to do."""

    def quit(self) -> None:
        """Nothing to do: this node moves nothing."""

    @property
    def _time(self) -> float:
        return time.monotonic() - self._begin

    def _write(self, name: str, *values: float | str) -> None:
        self.rows += 1
        self._writer.write(name, self._time, *values)

    def _tendons(self, name: str, values: Sequence[float], scale: float) -> None:
        if len(values) == len(TENDONS):
            self._write(name, *(scale * value for value in values))

    def _points(self, message: PoseArray) -> None:
        now = self._time
        for number, pose in enumerate(message.poses, start=1):
            at, q = pose.position, pose.orientation
            self._writer.write('points', now, str(number), 1e3 * at.x, 1e3 * at.y, 1e3 * at.z,
                               q.x, q.y, q.z, q.w)
        self.rows += 1

    def _count_segments(self, message: PoseArray) -> None:
        """Subscribe to what there is of every segment, once it is known how many there are."""
        for n in range(self._segments + 1, len(message.poses) + 1):
            self.create_subscription(
                FluidPressure, f'segment_{n}/pressure',
                lambda m, n=n: self._write('pressures', str(n), m.fluid_pressure * 1e-3), SENSOR)
            self.create_subscription(
                Bool, f'segment_{n}/stiff',
                lambda m, n=n: self._write('stiff', str(n), str(int(m.data))), LATCHED)
        self._segments = max(self._segments, len(message.poses))

    def _feedback(self, message: Any) -> None:
        feedback = message.feedback
        text = f'{feedback.shape}: {feedback.phase}'
        if feedback.segment:
            text += f' segment {feedback.segment}'
        if text != self._progress:
            self._progress = text
            self._write('events', 'progress', text)

    def _status(self, name: str, message: DiagnosticStatus) -> None:
        if self._said.get(name) != message.message:
            self._said[name] = message.message
            self._write('events', name, message.message)
        if name == 'shape_sequencer':
            self.idle_after_goal = bool(self._progress) and message.message == 'idle'


def record(options: argparse.Namespace, writer: RecordingWriter) -> int:
    """Record until the time is over, the goal has ended, or Ctrl-C; return the exit status."""
    signals = Signals()
    executor, nodes = None, []
    begin = time.monotonic()
    try:
        rclpy.init(args=['record', '--ros-args', '-r', f'__ns:=/{options.namespace.strip("/")}'],
                   signal_handler_options=SignalHandlerOptions.NO)
        executor = make_executor()
        recorder = Recorder(writer)
        nodes.append(recorder)
        executor.add_node(recorder)
        signals.starting = False
        while not signals.received and not (options.goal and recorder.idle_after_goal):
            executor.spin_once(timeout_sec=0.1)
            age = time.monotonic() - begin
            if not recorder.rows and age > HEARD_WITHIN:
                print('record: no node is heard; start them first, with ./run up or ros2 launch '
                      'soft_continuum bringup.launch.py, in the same ROS_DOMAIN_ID and '
                      '--namespace', file=sys.stderr)
                return 1
            if options.duration and age > options.duration:
                break
    except KeyboardInterrupt:
        pass
    finally:
        signals.starting = False
        end(executor, nodes)
    print(f'{time.monotonic() - begin:.1f} s recorded in {options.output}')
    return 0
