# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Recipes of CONTRIBUTING.md, followed on a copy of the suite: what they touch is enough."""

import json
import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

from support.rig_fixtures import domains

ROOT = Path(__file__).resolve().parent.parent


class Copy:
    """A copy of the suite that is changed."""

    def __init__(self, root):
        self.root, self.touched = root, set()
        for name in ('soft_continuum', 'config', 'docs', 'msg_docs'):
            shutil.copytree(ROOT / name, root / name,
                            ignore=shutil.ignore_patterns('__pycache__', 'images'))

    def add(self, name, line, below=None):
        """Write a file of the suite, or add a line below another one."""
        path = self.root / 'soft_continuum' / name
        if below is None:
            path.write_text(line, encoding='utf-8')
            return
        text = path.read_text(encoding='utf-8')
        assert text.count(below) == 1
        path.write_text(text.replace(below, below + line), encoding='utf-8')
        self.touched.add(name)

    def run(self, *arguments):
        """Run Python on the copy and return how it ended."""
        paths = os.pathsep.join([str(self.root), os.environ.get('PYTHONPATH', '')])
        return subprocess.run([sys.executable, *arguments], cwd=self.root, capture_output=True,
                              text=True, timeout=300, env={**os.environ, 'PYTHONPATH': paths})

    def page(self, name):
        """Return a page after the tables were written."""
        done = self.run('-m', 'soft_continuum.ui.cli.reference')
        assert done.returncode == 0, done.stderr
        return (self.root / name).read_text(encoding='utf-8')


@pytest.fixture
def suite(tmp_path):
    return Copy(tmp_path)


@pytest.fixture
def domain(monkeypatch):
    """A ROS domain of its own."""
    with domains() as take:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(take()))
        yield


def test_a_parameter_is_one_entry_and_then_checked_and_described(suite):
    suite.add('ros/parameter_table.py',
              "        Parameter('pose_interval', 0.0, 'shortest time between two poses', 0.0, "
              "10.0,\n                  unit='s'),\n", below='    KINEMATICS: (\n')
    (suite.root / 'given.yaml').write_text(
        'kinematics: {ros__parameters: {pose_interval: 11.0}}', encoding='utf-8')
    done = suite.run('-c', 'from soft_continuum.ros.description import load_description\n'
                     'print(load_description(node="kinematics")["pose_interval"])\n'
                     'load_description("given.yaml", node="kinematics")')
    assert done.stdout == '0.0\n'
    assert 'pose_interval' in done.stderr and '10' in done.stderr.splitlines()[-1]
    assert '| `pose_interval` | double `0.0` s | 0 to 10 | shortest time' in suite.page(
        'msg_docs/kinematics.md')
    assert suite.touched == {'ros/parameter_table.py'}


def test_a_planner_is_a_module_a_row_with_the_shapes_that_it_suits_and_its_settings(suite):
    suite.add('planning/staying.py', """
import numpy as np

from soft_continuum.planning.plans import PlanResult


def stay(validator, start, shape, first):
    away = float(np.linalg.norm(start.state.tip - shape.tips[0].position))
    return PlanResult(start.plan(shape), tip_error=away)
""")
    suite.add('planning/shape_plans.py',
              'from soft_continuum.planning.staying import stay\n',
              below='from soft_continuum.planning.reach.passage import BlockedError, Node\n')
    suite.add('planning/shape_plans.py',
              '    (stay, lambda shape, settings: bool(shape.tips) and settings.stay),\n',
              below='Callable[[Shape, ReachSettings], bool]], ...] = (\n')
    suite.add('planning/settings.py',
              "    stay: bool = setting(False, 'stay where the arm is', read_only=False)\n",
              below='    lock_in: float = LOCK_IN_STDDEV\n')
    (suite.root / 'given.yaml').write_text(
        '/**: {ros__parameters: {reach.stay: true}}', encoding='utf-8')
    plan = ['-m', 'soft_continuum', 'plan', '0.1', '0.28', '--json']
    steps = [json.loads(suite.run(*plan, *more).stdout)['steps']
             for more in ([], ['--params-file', 'given.yaml'])]
    assert steps[0] and not steps[1]
    assert '| `reach.stay` * | bool `false` |' in suite.page('msg_docs/shape_sequencer.md')
    assert suite.touched == {'planning/shape_plans.py', 'planning/settings.py'}


def test_a_verb_is_one_line_and_the_module_with_its_function(suite):
    suite.add('ui/cli/wave.py', 'def main():\n    print("a wave")\n    return 0\n')
    suite.add('ui/cli/main.py',
              "        Verb('wave', 'wave at the arm', 'ui.cli.wave:main'),\n",
              below="    'start': (\n")
    done = suite.run('-m', 'soft_continuum', 'wave')
    assert (done.stdout, done.returncode) == ('a wave\n', 0)
    assert 'wave at the arm' in suite.run('-m', 'soft_continuum', '--help').stdout
    assert '| `wave` | wave at the arm |' in suite.page('docs/reference/command_line.md')
    assert suite.touched == {'ui/cli/main.py'}


def test_a_topic_is_a_publisher_a_row_with_its_reader_and_a_field_of_the_state(suite, domain):
    suite.add('nodes/disc_sensors.py', 'from std_msgs.msg import Int32\n',
              below='from sensor_msgs.msg import Imu\n')
    suite.add('nodes/disc_sensors.py',
              "        self._count = self.create_publisher(Int32, '~/count', STREAM)\n",
              below='        self._all_poses = self._feed(ALL_POSES)\n')
    suite.add('nodes/disc_sensors.py', '        self._count.publish(Int32(data=len(feeds)))\n',
              below='        feeds = list(self._feeds.values())\n')
    suite.add('../msg_docs/disc_sensors.md',
              '| `~/count` | `std_msgs/msg/Int32` | publishes | Number of sensors |\n',
              below='at most `disc_sensors.rate` per sensor |\n')
    suite.add('client/observed.py', 'from std_msgs.msg import Int32\n',
              below='from sensor_msgs.msg import FluidPressure, JointState\n')
    suite.add('client/observed.py', """\
    'disc_sensors/count': ObservedTopic(Int32, SENSOR, 'disc_sensors', {
        'sensor_count': lambda _, message: message.data}, optional=True),
""", below='TOPICS = {\n')
    suite.add('client/state.py', '    sensor_count: int | None = None\n',
              below='    sensors: tuple[NodeReport, ...] = ()\n')
    done = suite.run('-c', """
import rclpy
from rclpy.executors import SingleThreadedExecutor
from soft_continuum.client.observed import ObservedArm
from soft_continuum.nodes.disc_sensors import DiscSensors
rclpy.init()
nodes = DiscSensors(), rclpy.create_node('client')
arm, executor = ObservedArm(nodes[1]), SingleThreadedExecutor()
for node in nodes:
    executor.add_node(node)
print(arm.snapshot().sensor_count)
nodes[0].start()
while (found := arm.snapshot().sensor_count) is None:
    executor.spin_once(1.0)
print(found)
rclpy.shutdown()
""")
    assert done.stdout == 'None\n1\n', done.stderr
    assert suite.touched == {'nodes/disc_sensors.py', 'client/observed.py', 'client/state.py',
                             '../msg_docs/disc_sensors.md'}


def test_a_sensor_is_a_module_an_input_of_disc_sensors_and_its_parameters(suite, domain):
    suite.add('estimation/sensing/inclinometer.py', """
from math import cos, sin

import numpy as np

from soft_continuum.mechanics.rotations import UNKNOWN


def pose_of(angle, stddev):
    covariance = UNKNOWN * np.eye(6)
    covariance[4, 4] = stddev**2
    return np.array([0.0, 0.0, 0.0, 0.0, sin(angle / 2), 0.0, cos(angle / 2)]), covariance
""")
    suite.add('nodes/disc_sensors.py', 'from geometry_msgs.msg import Vector3Stamped\n',
              below='from typing import Any\n\n')
    suite.add('nodes/disc_sensors.py',
              'from soft_continuum.estimation.sensing import inclinometer\n',
              below='from soft_continuum.ros.ros_time import Age\n')
    suite.add('nodes/disc_sensors.py', "            'tilt': (Vector3Stamped, self._take_tilt),\n",
              below='Callable[[int, _Feed, Any], None]]] = {\n')
    suite.add('nodes/disc_sensors.py', """\
    def _take_tilt(self, n, feed, message):
        self._check_clock(message.header.stamp)
        found = inclinometer.pose_of(message.vector.y, self.parameters['tilt.stddev'])
        self._publish(n, feed, message.header.stamp, tracked_pose_to_ros(*found))

""", below='    # What all have.\n\n')
    suite.add('ros/parameter_table.py', """\
        Parameter('tilt.stddev', 0.02, 'standard deviation of an inclinometer', 1e-6, 1.0,
                  unit='rad'),
""", below='    DISC_SENSORS: (\n')
    row = '| `disc_N/tilt` | `geometry_msgs/msg/Vector3Stamped` | subscribes | Inclinometer |\n'
    suite.add('../msg_docs/disc_sensors.md', row,
              below='at most `disc_sensors.rate` per sensor |\n')
    done = suite.run('-c', """
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from rclpy.executors import SingleThreadedExecutor
from soft_continuum.nodes.disc_sensors import DiscSensors
rclpy.init()
nodes = DiscSensors(), rclpy.create_node('inclinometer')
executor, found, message = SingleThreadedExecutor(), [], Vector3Stamped()
for node in nodes:
    executor.add_node(node)
nodes[0].start()
tilts = nodes[1].create_publisher(Vector3Stamped, 'disc_3/tilt', 5)
nodes[1].create_subscription(PoseWithCovarianceStamped, 'disc_3/measured_pose', found.append, 5)
message.vector.y = 0.5
while not found:
    message.header.stamp = nodes[1].get_clock().now().to_msg()
    tilts.publish(message)
    executor.spin_once(0.1)
pose = found[0].pose
print(round(pose.pose.orientation.y, 3), round(pose.covariance[28], 6))
rclpy.shutdown()
""")
    assert done.stdout == '0.247 0.0004\n', done.stderr
    assert '| `tilt.stddev` | double `0.02` rad |' in suite.page('msg_docs/disc_sensors.md')
    assert suite.touched == {'nodes/disc_sensors.py', 'ros/parameter_table.py',
                             '../msg_docs/disc_sensors.md'}
