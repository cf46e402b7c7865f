# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How the executables end: on a signal, in peace, whatever they are doing."""

import os
from pathlib import Path
import select
import signal
import subprocess
import sys
import time

import pytest

from soft_continuum.ros.environment import PARENT
from soft_continuum.ui.cli.main import main
from soft_continuum.user_files import description_file
from support.documented_commands import kept_signal_handlers
from support.processes import assert_ended_in_peace, module_command
from support.ros_rig import ALL, DEADLINE

SIGNALS = (signal.SIGINT, signal.SIGTERM)
# While its modules are still being read, a signal ends it as it ends every program; and CPython
# ends itself by SIGINT once KeyboardInterrupt went through an exec(), as in a dataclass that is
# being made, though it was caught.
ENDED_EARLY = (0, 130, -signal.SIGTERM, -signal.SIGINT)


def test_every_node_starts_without_any_parameter_and_ends_in_peace_on_a_signal_or_several(
        rig, processes):
    nodes = [processes.node(name, installed=True, files=[]) for name in ALL]
    rig.wait_until_ready(*ALL)  # as `ros2 run soft_continuum NODE` does
    for node, number in zip(nodes, 2 * SIGNALS, strict=True):
        node.send(number)
    for number in SIGNALS:  # nor does a second one, or a third, disturb it
        nodes[0].send(number)
    for node in nodes:
        assert_ended_in_peace(node)


@pytest.mark.parametrize('name', ['kinematics', 'up'])
def test_a_signal_while_python_takes_a_process_down_does_not_change_how_it_ended(name, tmp_path):
    late = tmp_path / 'late.py'
    main = 'up.main' if name == 'up' else f'partial(runtime.run, {name!r})'
    late.write_text(f"""\
import os, signal, sys
from functools import partial
from soft_continuum.ui.cli import up
from soft_continuum.nodes import runtime

class Late:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)

last = Late()
sys.exit({main}())
""", encoding='utf-8')
    ros = [] if name == 'up' else ['--ros-args']
    ended = subprocess.run(
        [sys.executable, str(late), *ros, '--params-file', '/no/such/file'],
        capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert (ended.returncode, '/no/such/file' in ended.stderr) == (2, True), ended.stderr


def children(process):
    """Return process ids by node of a supervisor."""
    found = {}
    for pid in process.children:
        words = Path(f'/proc/{pid}/cmdline').read_bytes().decode().split('\0')
        found |= {name: pid for name in ALL if name in words}
    return found


def test_up_starts_the_four_nodes_under_a_namespace_and_reports_one_that_is_killed(
        make_rig, processes, tmp_path):
    patient = tmp_path / 'patient.yaml'
    patient.write_text('/**:\n  ros__parameters:\n    stale_timeout: 10.0\n')
    rig = make_rig(namespace='/lab/left')
    up = processes.start([
        *module_command('up'), '--namespace', '/lab/left/',
        '--params-file', str(description_file()), '--params-file', str(patient)])
    rig.wait_until_ready(*ALL)
    names = {f'{rig.namespace}/{name}' for name in (*ALL, 'observer')}
    rig.wait_for(lambda: names == {f'{space.rstrip("/")}/{name}' for name, space in
                                   rig.observer.get_node_names_and_namespaces()},
                 'the four nodes and no other in the graph')
    # One of them says it for all.
    rig.wait_for(lambda: up.output.count('can command this arm') == 1, 'who commands')
    assert rig.goal_when_heard((0.0, 0.0, 0.1)).result()[0] == 'SUCCEEDED'
    # Two arms share one TF tree.
    assert rig.segment_poses.last.header.frame_id == 'lab/left/base_link'
    nodes = children(up)
    assert sorted(nodes) == sorted(ALL)
    os.kill(nodes['kinematics'], signal.SIGKILL)
    rig.wait_for(lambda: 'kinematics was killed by SIGKILL' in up.output, 'a line')
    rig.wait_for_more(rig.tendons, 5)
    rig.wait_for_more(rig.pressures[0], 5)
    up.send(signal.SIGTERM)  # in test_twin.py it is SIGINT
    assert_ended_in_peace(up)


BY_LAUNCH = f"""\
import os, subprocess, sys
subprocess.run(sys.argv[1:], env={{**os.environ, {PARENT!r}: str(os.getpid())}})
"""
BY_UP = """\
import sys
from soft_continuum.ui.cli.processes import Child
Child('kinematics', sys.argv[5:], 'alone')._process.wait()
"""


@pytest.mark.parametrize(('start', 'number'), [
    (BY_LAUNCH, signal.SIGTERM), (BY_UP, signal.SIGKILL)], ids=['launch', 'up'])
def test_a_node_ends_with_the_process_that_started_it(rig, processes, start, number):
    starter = processes.start([sys.executable, '-c', start, *module_command('kinematics'),
                               '--ros-args', '-r', f'__ns:={rig.namespace}'])
    rig.wait_for(lambda: len(rig.statuses['kinematics']), 'words of the node')
    node, = starter.children
    end = os.pidfd_open(node)
    starter.send(number)
    assert select.select([end], [], [], DEADLINE)[0]
    os.close(end)


@pytest.mark.parametrize(('name', 'number'), [
    ('tendon_actuation', signal.SIGINT), ('shape_sequencer', signal.SIGTERM)])
def test_a_node_ends_in_peace_in_the_middle_of_a_sequence(rig, processes, name, number):
    slow = {'tendon_speed': 0.002, 'jamming_timeout': 5.0, 'stale_timeout': 2.0}
    node = processes.node(name, parameters=slow)
    rig.start(*(n for n in ALL if n != name), **slow)
    rig.wait_until_ready(*ALL)
    goal = rig.goal_in_motion((0.0, 0.0, 0.5))
    node.send(number)
    assert_ended_in_peace(node)
    if name == 'shape_sequencer':
        rig.come_to_rest()
        assert rig.pulls[0] < 0.005
    else:
        assert goal.result()[0] == 'ABORTED'


def let_start(node, until, delay=0.0):
    """Let a process start until something is true, and then for ``delay`` s: that is varied."""
    deadline = time.monotonic() + 2 * DEADLINE
    while not until():
        assert time.monotonic() < deadline
        with pytest.raises(subprocess.TimeoutExpired):
            node.process.wait(0.01)
    with pytest.raises(subprocess.TimeoutExpired):
        node.process.wait(delay)


@pytest.mark.parametrize(('number', 'delays'), [
    (signal.SIGINT, (0.0, 0.4)), (signal.SIGTERM, (0.2, 0.8))])
def test_a_node_that_is_starting_ends_in_peace(processes, number, delays):
    for delay in delays:
        node = processes.node('shape_sequencer')
        maps = Path(f'/proc/{node.process.pid}/maps')
        let_start(node, lambda m=maps: 'numpy' in m.read_text(encoding='utf-8'), delay)
        node.send(number)
        assert_ended_in_peace(node, ENDED_EARLY)


def test_a_node_that_still_compiles_its_solver_ends_in_peace(processes, tmp_path):
    # As on the first start after an installation: nothing is compiled yet.
    pytest.importorskip('numba')
    cache = tmp_path / 'cache'
    node = processes.start(
        [*module_command('kinematics'), '--ros-args', '--params-file', str(description_file())],
        environment={'XDG_CACHE_HOME': str(cache)})
    let_start(node, lambda: any(path.is_file() for path in cache.rglob('*')))
    node.send(signal.SIGINT)
    assert_ended_in_peace(node, ENDED_EARLY)


def said_by(monkeypatch, capfd, *words):
    """Return the exit status of a verb that ends by itself, in this process, and its errors."""
    monkeypatch.setattr(sys, 'argv', ['soft_continuum'])
    with kept_signal_handlers():
        try:
            status = main(words)
        except SystemExit as end:
            status = end.code
    return status, capfd.readouterr().err


@pytest.mark.parametrize(('arguments', 'named'), [
    (['up', '--tendon-driver', 'gbrl'], ["'gbrl'", 'simulated']),
    (['up', '--namespace', 'left arm'], ['left arm']),
    (['up', '--twin', 'perfect'], ['ideal, typical, severe']),
    (['up', '--twin', '--tendon-driver', 'simulated'], ['it has those for grbl, dynamixel']),
    (['kinematics', '--ros-args', '-r', '__ns:=/a b'], ['/a b']),
    (['kinematics', '--ros-args', '--no-such-flag'], ['--no-such-flag']),
])
def test_arguments_that_cannot_be_are_named_before_anything_starts(
        monkeypatch, capfd, arguments, named):
    status, output = said_by(monkeypatch, capfd, *arguments)
    assert status == 2
    assert all(word in output for word in named), output
    assert 'Traceback' not in output, output


@pytest.mark.parametrize('verb', ['kinematics', 'up', 'status', 'browser'])
def test_a_folder_for_logs_that_cannot_be_written_is_the_reason_that_is_said(
        monkeypatch, capfd, verb):
    monkeypatch.setenv('ROS_LOG_DIR', '/proc/none')
    status, output = said_by(monkeypatch, capfd, verb)
    assert status in (1, 2)
    assert 'ROS cannot write its logs to /proc/none: ' in output
    assert len(output.splitlines()) == 1, output
