# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""
The paper's three shapes on a simulated rig: ``./run demo``.

Starts the four nodes in this process, sends the sequence to the action like any client, shows its
progress, then prints a table per shape and writes a picture.  All of it ends with this process.
"""

import argparse
from dataclasses import dataclass
import os
from pathlib import Path
import sys
import time
from typing import Any

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseArray
import numpy as np
import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from soft_continuum.analysis.figures import shapes_figure
from soft_continuum.mechanics import constant_curvature
from soft_continuum.mechanics.chain import Array, RigidChain
from soft_continuum.nodes.runtime import end, make_executor, node_class, NODES, Signals
from soft_continuum.nodes.up import description_file
from soft_continuum.parameters.files import load_arm, load_shapes
from soft_continuum.parameters.shapes import PAPER_SHAPES
from soft_continuum.ros.conversions import poses_from_ros
from soft_continuum.ros.qos import SENSOR
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Shape

SHAPES = tuple(PAPER_SHAPES)
TIMEOUT = 120.0  # s
DISCOVERY_TIMEOUT = 20.0  # s


@dataclass(frozen=True)
class Reached:
    """What the topics said while a shape was held: rad, (x, z, angle) rows in m and rad, m."""

    joint_angles: Array
    segment_poses: Array
    disc_poses: Array
    pulls: Array


class DemoClient(Node):
    """Sends the sequence, shows its progress and notes the shapes that were reached."""

    def __init__(self) -> None:
        """Subscribe to what the tables show."""
        super().__init__('demo')
        self.ended = False
        self.failure = ''
        self.reached: dict[str, Reached] = {}
        self._latest: dict[str, Any] = {}
        self._shown = ''
        for topic, kind in (('joint_states', JointState), ('segment_poses', PoseArray),
                            ('disc_poses', PoseArray), ('tendon_states', JointState)):
            self.create_subscription(
                kind, topic, lambda message, t=topic: self._latest.update({t: message}), SENSOR)
        self._action = ActionClient(self, RunShapeSequence, 'run_shape_sequence')
        self._started = time.monotonic()
        self._timer = self.create_timer(0.1, self._send)

    def start(self) -> None:
        """Nothing to do: the goal is sent when the nodes are there."""

    def quit(self) -> None:
        """Nothing to do: this node moves nothing."""

    def destroy_node(self) -> None:
        """Take down the action client before the node, as rclpy needs it."""
        self._action.destroy()
        super().destroy_node()

    def _send(self) -> None:
        if len(self._latest) < 4 or not self._action.server_is_ready():
            if time.monotonic() > self._started + DISCOVERY_TIMEOUT:
                self.failure, self.ended = 'the nodes did not start to publish', True
            return
        self._timer.cancel()
        goal = RunShapeSequence.Goal(
            shapes=[Shape(name=name, hold_time=Duration(nanosec=500_000_000)) for name in SHAPES])
        self._action.send_goal_async(goal, feedback_callback=self._on_feedback).add_done_callback(
            self._on_answer)

    def _on_answer(self, future: Any) -> None:
        if not future.result().accepted:
            self.failure, self.ended = 'the goal was rejected', True
            return
        future.result().get_result_async().add_done_callback(self._on_result)

    def _on_feedback(self, message: Any) -> None:
        feedback = message.feedback
        segment = f'segment {feedback.segment}' if feedback.segment else 'whole arm'
        line = f'{feedback.shape:<16}{segment:<12}{feedback.phase}'
        percent = f'{100 * feedback.progress:4.0f} %'
        if line != self._shown or sys.stdout.isatty():
            # On a terminal a phase counts up in place; elsewhere it is one line.
            new_line = '\n' if line != self._shown and self._shown else ''
            back = '\r' if sys.stdout.isatty() and not new_line else ''
            print(f'{new_line}{back}{percent}  {line}', end='', flush=True)
            self._shown = line
        if feedback.phase == RunShapeSequence.Feedback.HOLDING:
            tendons = self._latest['tendon_states']
            self.reached[feedback.shape] = Reached(
                np.array(self._latest['joint_states'].position),
                _planar(poses_from_ros(self._latest['segment_poses'])),
                _planar(poses_from_ros(self._latest['disc_poses'])), np.array(tendons.position))

    def _on_result(self, future: Any) -> None:
        result = future.result().result
        if result.error_code != RunShapeSequence.Result.SUCCESSFUL:
            self.failure = result.error_string
        self.ended = True
        print(flush=True)


def main() -> int:
    """Run the demo; return the exit status."""
    parser = argparse.ArgumentParser(
        prog='./run demo', description='Run the three shapes of the paper on a simulated rig.')
    parser.add_argument('--picture', type=Path, default=Path('demo_shapes.png'),
                        help='where to write the picture (default: %(default)s)')
    options = parser.parse_args()
    if not options.picture.resolve().parent.is_dir():
        parser.error(f'--picture {options.picture}: there is no such directory')
    signals = Signals()
    try:
        client = _run(signals)
    except KeyboardInterrupt:
        client = None
    if signals.received:
        print('\ninterrupted; everything that was started has ended')
        return 130
    if client is None or client.failure or not client.ended:
        reason = client.failure if client else ''
        print(f'the sequence failed: {reason or f"not done within {TIMEOUT:g} s"}',
              file=sys.stderr)
        return 1
    _report(client.reached, options.picture)
    return 0


def _run(signals: Signals) -> DemoClient | None:
    """Start nodes and client, spin until the sequence has ended, take all down."""
    print('Starting the four nodes on a simulated rig ...', flush=True)
    # A namespace of its own keeps it apart from an arm that may be running.
    rclpy.init(args=['demo', '--ros-args', '-r', f'__ns:=/demo_{os.getpid()}',
                     '--params-file', str(description_file()), '--log-level', 'warn'],
               signal_handler_options=SignalHandlerOptions.NO)
    executor, nodes, client = make_executor(), [], None
    try:
        for name in NODES:
            nodes.append(node_class(name)())
            nodes[-1].get_logger().set_level(rclpy.logging.LoggingSeverity.ERROR)
        client = DemoClient()
        nodes.append(client)
        for node in nodes:
            executor.add_node(node)
            node.start()
        deadline = time.monotonic() + TIMEOUT
        signals.spin(executor, lambda: client.ended or time.monotonic() >= deadline)
    finally:
        signals.starting = False
        end(executor, nodes)
    return client


def _report(reached: dict[str, Reached], picture: Path) -> None:
    """Print a table per shape and write the picture."""
    arm, library = load_arm(description_file()), load_shapes(description_file())
    for name in SHAPES:
        shape, angles = reached[name], library[name]
        print(f'\n{name}: {", ".join(f"{np.degrees(a):+.1f}" for a in angles)} degrees')
        print('                               x in mm   z in mm   tangent in degrees')
        rows = [(f'end of segment {i}, rigid chain', pose)
                for i, pose in enumerate(shape.segment_poses, start=1)]
        rows.append(('tip, rigid chain', shape.disc_poses[-1]))
        rows.append(('tip, constant curvature', constant_curvature.poses(arm, angles)[-1]))
        for label, (x, z, angle) in rows:
            print(f'{label:<30}{x * 1e3:8.2f}  {z * 1e3:8.2f}  {np.degrees(angle):10.2f}')
        right, left = shape.pulls * 1e3
        print(f'tendon pulls: right {right:.3f} mm, left {left:.3f} mm')
    shapes_figure(picture, RigidChain(arm),
                  {name: (reached[name].joint_angles, library[name]) for name in SHAPES})
    print(f'\nSimulated data. The rigid chain is under gravity, constant curvature is not.\n'
          f'Picture: {picture}')


def _planar(poses: Array) -> Array:
    """Return x, z (m) and angle (rad) of full poses."""
    return np.column_stack([poses[:, [0, 2]], 2.0 * np.arctan2(poses[:, 4], poses[:, 6])])
