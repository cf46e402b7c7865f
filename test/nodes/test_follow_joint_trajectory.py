# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
With control_msgs tendon_actuation serves FollowJointTrajectory; it judges goals as any trajectory.

The registries do not have control_msgs, so a stand-in with the published definitions is built,
once for a checkout, into build/control_msgs.
"""

import fcntl
import json
import os
from pathlib import Path
import subprocess
import sys

from action_msgs.msg import GoalStatus
import pytest

from soft_continuum.user_files import description_file
from support.processes import module_command

pytestmark = pytest.mark.timeout(600)
HERE = Path(__file__).resolve().parent
SOURCE, BUILD = HERE / 'control_msgs_stand_in', HERE.parents[1] / 'build' / 'control_msgs'
SEGMENT = 2


@pytest.fixture(scope='session')
def control_msgs():
    """Return the environment of a process that has control_msgs; build that if need be."""
    prefix = BUILD / 'install'
    BUILD.mkdir(parents=True, exist_ok=True)
    with (BUILD / 'lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (prefix / 'made').exists():
            for command in (
                    ['cmake', '-S', SOURCE, '-B', BUILD / 'build', '-G', 'Ninja',
                     f'-DCMAKE_INSTALL_PREFIX={prefix}', '-DBUILD_TESTING=OFF',
                     f'-DPython3_EXECUTABLE={sys.executable}'],
                    ['cmake', '--build', BUILD / 'build'],
                    ['cmake', '--install', BUILD / 'build']):
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                assert done.returncode == 0, done.stdout + done.stderr
            (prefix / 'made').touch()
    packages = next(prefix.glob('lib/python*/site-packages'))
    return {name: f'{path}:{os.environ.get(name, "")}' for name, path in (
        ('PYTHONPATH', packages), ('LD_LIBRARY_PATH', prefix / 'lib'),
        ('AMENT_PREFIX_PATH', prefix))}


@pytest.fixture
def goals(rig, processes, control_msgs):
    """Return how the goals of follow_client.py ended, of an arm with one soft segment."""
    node = processes.start([
        *module_command('tendon_actuation'), '--ros-args', '-r', f'__ns:={rig.namespace}',
        '--params-file', str(description_file()), '-p', 'stale_timeout:=10.0'],
        environment=control_msgs)
    rig.start('jamming_valves', 'kinematics')
    rig.wait_until_ready('tendon_actuation')
    rig.soften(SEGMENT)
    client = processes.start(
        [sys.executable, '-m', 'support.follow_client', rig.namespace],
        environment=control_msgs, directory=HERE.parent)
    assert client.wait(300.0) == 0, client.output
    lines = [json.loads(line) for line in client.output.splitlines() if line.startswith('{')]
    yield {line['name']: line for line in lines}
    node.kill()


def test_goals_of_follow_joint_trajectory_are_followed_refused_canceled_and_replaced(goals):
    ended = {name: (goal['status'], goal['code']) for name, goal in goals.items()}
    aborted = GoalStatus.STATUS_ABORTED
    assert ended == {
        'done': (GoalStatus.STATUS_SUCCEEDED, 0),
        'joints': (aborted, -2),
        'tolerance_joint': (aborted, -2),
        'empty': (aborted, -1),
        'nan': (aborted, -1),
        'far': (aborted, -1),
        'old': (aborted, -3),
        'long': (aborted, -1),
        'path': (aborted, -4),
        'final': (aborted, -5),
        'canceled': (GoalStatus.STATUS_CANCELED, -4),
        'replaced': (aborted, -4),
        'newer': (GoalStatus.STATUS_SUCCEEDED, 0),
    }
    done = goals['done']
    assert done['feedback'] > 5
    assert done['desired'] == [0.0010013, -0.0015]
    assert done['actual'] == pytest.approx(done['desired'], abs=1e-5)
    assert done['error'] == pytest.approx(
        [a - b for a, b in zip(done['desired'], done['actual'], strict=True)])
    for name, text in (('joints', 'middle_tendon'), ('empty', 'without points'),
                       ('nan', 'finite numbers'), ('far', 'pull_limits'),
                       ('old', 'header.stamp'), ('long', 'send it in parts'),
                       ('path', 'tolerance: 1e-09 m'),
                       ('final', 'tolerance: 1e-09 m'), ('replaced', 'by another trajectory')):
        assert text in goals[name]['text'], goals[name]
