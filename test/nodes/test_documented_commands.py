# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The commands of the documentation work on a running arm.

The front page and the tutorial are followed from top to bottom.  Of all other pages the ros2
commands are compared with the interfaces of the nodes; test_pages.py checks the other commands.
"""

from functools import partial
from itertools import pairwise
import os
from pathlib import Path
import re
import runpy
import shutil
import sys

import pytest
from sensor_msgs.msg import Imu, JointState
import yaml

from soft_continuum.client import Arm
from soft_continuum.parameters.arguments import COMMON_OPTIONS
from soft_continuum.ros.description import load_description
from soft_continuum.ros.names import NODES
from soft_continuum.ui.cli import demo
from soft_continuum.ui.cli.main import main
from soft_continuum.ui.cli.processes import NodeProcesses
from soft_continuum.user_files import description_file
from support import ros2_commands
from support.documented_commands import (
    blocks,
    Checker,
    command_lines,
    is_ros2,
    kept_signal_handlers,
    LINES,
    PAGES,
    program,
    ROOT,
)
from support.processes import module_command, Processes
from support.ros_rig import QUICK, Rig, STREAM

FOLLOWED = ('README.md', 'docs/tutorials/first_shapes.md')
REFUSED = ('soft_continuum jog right=2', 'soft_continuum run no_such_shape')
"""Lines that show what is not allowed."""
ELSEWHERE = ('up', 'ui', 'demo', 'characterize', 'converge', 'examples/hello_shapes.py')
"""What other tests run: the arm of this module is the one that up starts."""
START_TIMEOUT = 120.0  # s for five processes to import what they need, on a busy machine


def quick_file(directory):
    """Return a description file of the paper's arm, made quick."""
    parameters = {**load_description(description_file()), **QUICK,
                  'tendon_rate': 20.0, 'jamming_rate': 20.0}
    path = directory / 'quick.yaml'
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in parameters.items()}}}), encoding='utf-8')
    return path


def publish_sensors(rig):
    """Publish, and hear, what sensors of a rig or of the twin do."""
    for kind, topic in ((JointState, 'load_cells'), (Imu, 'disc_3/imu')):
        publisher = rig.observer.create_publisher(kind, topic, STREAM)
        rig.observer.create_timer(0.2, partial(publisher.publish, kind()))
        rig.record(kind, topic, STREAM)


@pytest.fixture(scope='module')
def arm(module_domain, tmp_path_factory):
    """
    Return an observer of the four nodes of a quick arm, in processes of their own.

    The commands run in this process, where they would delay the control of the tendons.
    """
    directory = tmp_path_factory.mktemp('arm')
    processes, rig = Processes(module_domain, directory), Rig(module_domain, namespace='/')
    try:
        processes.start([*module_command('up'), '--params-file', str(quick_file(directory))])
        rig.wait_for(lambda: all(map(len, rig.statuses.values())), 'four nodes', START_TIMEOUT)
        rig.wait_until_ready(*NODES)
        yield rig
    finally:
        processes.close()
        rig.close()


# The pages that a newcomer follows.


class Terminal:
    """Where the blocks of a page are typed, in a directory like the root of the repository."""

    def __init__(self, arm, directory, elsewhere, processes):
        """
        Prepare the directory.

        elsewhere, processes: an observer and a starter of processes in a domain of their own, for
        nodes that drive emulated boards.
        """
        self._arm, self._elsewhere, self._processes = arm, elsewhere, processes
        self._directory, self._checker = directory, Checker()
        for name in ('data', 'docs', 'examples'):
            (directory / name).symlink_to(ROOT / name)
        shutil.copytree(ROOT / 'config', directory / 'config')
        hardware = directory / 'config' / 'emulated_hardware.yaml'
        hardware.write_text(self._moved(hardware.read_text(encoding='utf-8')), encoding='utf-8')

    def _moved(self, text):
        return re.sub(r'/tmp\b', str(self._directory), text)

    def type(self, line):
        """Run a line; fail when it does not do what the page says."""
        words = program(self._moved(line))
        if is_ros2(line):
            ros2_commands.check(self._arm, line)()
            return
        self._checker.check(line)
        if words[0] == 'python':
            if words[1] not in ELSEWHERE:
                runpy.run_path(words[1], run_name='__main__')
        elif words[:2] == ['soft_continuum', 'emulate']:
            link = Path(words[words.index('--link') + 1])
            self._processes.start(module_command('emulate') + words[2:])
            self._arm.wait_for(link.exists, str(link))
        elif words[:2] == ['soft_continuum', 'up'] and len(words) > 2:
            # In this process, which has imported what they need.
            values = load_description(*(
                Path(file) for option, file in pairwise(words) if option == '--params-file'))
            nodes = self._elsewhere.start_arm(**values)
            self._elsewhere.end(nodes[0])
        elif words[0] == 'soft_continuum' and words[1] not in ELSEWHERE:
            with kept_signal_handlers():
                status = main(words[1:])
            assert status == (1 if line in REFUSED else 0), f'{line}: status {status}'


@pytest.fixture
def terminal(arm, make_rig, processes, tmp_path, monkeypatch):
    """Return a terminal whose commands find the arm."""
    directory = tmp_path / 'page'
    directory.mkdir()
    monkeypatch.chdir(directory)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(arm.context.get_domain_id()))
    monkeypatch.setattr(sys, 'argv', ['soft_continuum'])
    # On a busy machine nodes answer later than a reader would wait.
    monkeypatch.setitem(COMMON_OPTIONS['--timeout'], 'default', START_TIMEOUT)
    monkeypatch.setitem(Arm.__init__.__kwdefaults__, 'timeout', START_TIMEOUT)
    return Terminal(arm, directory, make_rig(namespace='/'), processes)


@pytest.mark.timeout(300)
@pytest.mark.parametrize('page', FOLLOWED)
def test_a_newcomer_can_follow_a_page_from_top_to_bottom(terminal, page):
    for language, text in blocks(PAGES[page]):
        if language == 'python':
            exec(compile(text, page, 'exec'), {'__name__': '__main__'})
        for line in command_lines(text) if language == 'sh' else ():
            terminal.type(line)


def test_the_demo_sets_the_shapes_of_the_paper(make_rig, domain, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setattr(sys, 'argv', ['soft_continuum'])
    monkeypatch.setattr(demo, 'description_file', lambda _: quick_file(tmp_path))
    # Its nodes run in this process, which has imported what they need.
    monkeypatch.setattr(NodeProcesses, '__enter__', lambda nodes: make_rig(
        namespace=f'/demo_{os.getpid()}').start(*nodes._names))
    with kept_signal_handlers():
        assert main(['demo']) == 0
    assert (tmp_path / 'demo_shapes.png').stat().st_size > 10_000
    shown = capfd.readouterr().out
    for shape in 'c_form', 'upright_c_form', 's_form':
        assert f'\n{shape}: ' in shown


# All other pages. These come last: of sensors that measure nothing every command waits a second.


@pytest.fixture(scope='module')
def every_node(arm, tmp_path_factory):
    """Return the arm with all other nodes."""
    arm.start('camera', 'disc_sensors', 'servo', 'teleop', ready=False)
    arm.start('recorder', ready=False, recorder__directory=str(tmp_path_factory.mktemp('bags')))
    publish_sensors(arm)
    return arm


@pytest.mark.parametrize('line', sorted({line for page in LINES for line in filter(
    is_ros2, LINES[page])}))
def test_the_nodes_have_what_a_ros2_line_names(every_node, line):
    ros2_commands.check(every_node, line)
