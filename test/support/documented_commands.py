# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The command lines of the documentation, and what can be checked of them without running them.

A line passes when the parser of its verb accepts it and the files that it reads exist: in the
repository, among those that an earlier line of the page writes, or among those that the page asks
its reader to write.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
import re
import shlex
import signal
import sys
from typing import Any

import pytest
import yaml

from soft_continuum.parameters.arguments import Parser
from soft_continuum.ros.parameter_table import NODE_PARAMETERS
from soft_continuum.ui.cli.main import call, NODE, VERBS

ROOT = Path(__file__).resolve().parents[2]
FENCE = re.compile(r' *```(.*)')
NOT_OURS = {'. install/setup.bash', 'colcon build', 'ls -l /dev/serial/by-id',
            'sudo usermod -aG dialout $USER',
            """printf '%s\\n' "$USER - rtprio 20" "$USER - nice -15" | sudo tee """
            '/etc/security/limits.d/99-soft_continuum.conf',
            'ssh -L 8080:127.0.0.1:8080 user@rig',
            'export ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET', 'sudo apt install python3-venv',
            '/usr/bin/python3 -m venv --system-site-packages ~/soft_continuum_venv'}
"""Lines that start no program of this project."""
OTHER_PROGRAMS = ('rosdep install ', 'ros2 run joy ', 'dask ', 'colcon build --base-paths ',
                  '~/soft_continuum_venv/bin/pip ', 'export PYTHONPATH=', 'ros2 security ',
                  'export ROS_', 'ROS_SECURITY_ENCLAVE_OVERRIDE=',
                  "./run exec sh -c 'catkin_tag_changelog ",
                  "./run exec sh -c 'cd soft_continuum_interfaces; ")
OF_THE_READER = {'my_arm.yaml', 'my_rig.yaml', 'my_shapes.yaml', 'left_arm.yaml',
                 'right_arm.yaml', 'calibration.yaml', 'my_study.yaml'}
OUTPUTS = ('output', 'picture', 'link', 'tendon_link', 'modbus_link')


def blocks(page: Path) -> Iterator[tuple[str, str]]:
    """Return language and text of the fenced blocks of a page."""
    language, lines = None, list[str]()
    for line in page.read_text(encoding='utf-8').splitlines():
        fence = FENCE.fullmatch(line)
        if fence and language is None:
            language, lines = fence[1], []
        elif fence and language is not None:
            yield language, '\n'.join(lines)
            language = None
        else:
            lines.append(line)


def command_lines(text: str) -> list[str]:
    """Return the command lines of a block; a continued line is one."""
    lines = re.sub(r'\\\n *', '', text).splitlines()
    return [line.strip() for line in lines if line.strip()]


SUBSCRIBED = ('camera/image_raw', 'camera/camera_info', 'tracker/disc_poses', 'disc_0/pose',
              'disc_3/pose', 'disc_3/imu')  # that a user may remap

PAGES = {page.relative_to(ROOT).as_posix(): page for page in (
    *ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md'), *ROOT.glob('msg_docs/*.md'))}
LINES = {name: lines for name, page in PAGES.items() if (lines := [
    line for language, text in blocks(page) if language == 'sh' for line in command_lines(text)])}


def is_ros2(line: str) -> bool:
    """Whether a line talks to running nodes by ros2, and does not start them."""
    return line.startswith('ros2 ') and line.split()[1] not in ('launch', 'run', 'security')


def program(line: str) -> list[str]:
    """Return the words of a line without what only enters the environment."""
    words = shlex.split(line)
    if words[:2] == ['./run', 'exec']:
        words = words[2:]
    if words[0] == './run' and words[1:] and words[1] in VERBS:
        words = ['soft_continuum', *words[1:]]
    if words[:3] == ['python', '-m', 'soft_continuum']:
        words = words[2:]
    return words


class Checker:
    """Checks the lines of one page, from its first to its last."""

    def __init__(self) -> None:
        """Begin a page: no line has written a file yet."""
        self._written: set[Path] = set()

    def check(self, line: str) -> None:
        """Raise AssertionError when a line that is no ros2 command is wrong."""
        words = program(line)
        if words[0] == 'soft_continuum':
            self.verb(words[1:])
        elif words[:3] == ['ros2', 'run', 'soft_continuum']:
            self.verb(words[3:])
        elif words[:2] == ['ros2', 'launch']:
            self.launch(words[2:])
        elif words[0] == './run':
            assert words[1] in commands_of_run(), f'./run has no {words[1]}'
        elif words[:2] == ['python', '-m']:
            assert find_spec(words[2]), words[2]
        elif words[0] in ('python', 'uv'):
            for word in words:
                if word.endswith(('.py', '.txt')):
                    self._read(word)
        else:
            assert words == ['bash'] or line in NOT_OURS or line.startswith(OTHER_PROGRAMS), (
                'neither a program of ours nor known')

    def verb(self, words: Sequence[str]) -> None:
        """Claim that a verb exists and that its parser accepts its options."""
        name, *options = words
        if name == 'emulate':
            name, *options = f'{options[0]}_emulator', *options[1:]
        assert name in VERBS, f'there is no verb {name}'
        if '--ros-args' in options:
            split = options.index('--ros-args')
            self._ros_arguments(name, options[split + 1:])
            options = options[:split]
        if VERBS[name].target == NODE:
            assert not options, f'{options} without --ros-args'
            return
        # What ui takes is what browser takes and more; the latter would start without a parser.
        given = accepted('ui' if name == 'browser' else name, options)
        for option, value in given.items():
            for path in value if isinstance(value, list) else [value]:
                if option in OUTPUTS:
                    self._written |= {Path(path)} - {Path()} if path else set()
                elif isinstance(path, Path) or option == 'params_file':
                    self._read(path)

    def launch(self, words: Sequence[str]) -> None:
        """Claim that the launch file exists and declares its arguments."""
        package, file, *arguments = words
        assert package == 'soft_continuum'
        text = (ROOT / 'launch' / file).read_text(encoding='utf-8')
        declared = {*re.findall(r"DeclareLaunchArgument\(\s*'(\w+)'", text),
                    'tendon_driver', 'jamming_driver'}
        for argument in arguments:
            name, assigned, value = argument.partition(':=')
            assert assigned and name in declared, f'{file} has no argument {name}'
            if name.endswith('params_file'):
                self._read(value)

    def _ros_arguments(self, node: str, words: Sequence[str]) -> None:
        parameters = {p.name: p for p in NODE_PARAMETERS.get(node, ())}
        for flag, value in zip(words[::2], words[1::2], strict=True):
            if flag == '--params-file':
                self._read(value)
            elif flag == '-p':
                name, _, text = value.partition(':=')
                assert name in parameters, f'{node} has no parameter {name}'
                parameters[name].check(yaml.safe_load(text))
            else:
                topic = value.partition(':=')[0] in SUBSCRIBED
                assert flag == '-p' or (
                    flag == '-r' and (topic or value.startswith(('__ns:=/', '__node:=camera_')))
                ), f'{flag} {value}'

    def _read(self, name: str | Path) -> None:
        path = Path(name)
        assert ((ROOT / path).exists() or path.as_posix() in OF_THE_READER
                or self._written & {path, *path.parents}), f'there is no {path}'


def commands_of_run() -> set[str]:
    """Return the commands that ./run lists."""
    return set(re.findall(r'^#? +(\w+) {2,}\w', (ROOT / 'run').read_text(encoding='utf-8'),
                          re.MULTILINE))


@contextmanager
def kept_signal_handlers() -> Iterator[None]:
    """Undo what a verb does to the handlers of signals, as the end of its process would."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Accepted(BaseException):
    """A parser accepted its arguments; the verb shall do nothing more."""


def accepted(verb: str, options: Sequence[str]) -> dict[str, Any]:
    """
    Return what the parser of a verb reads from options; the verb itself does not run.

    Raises AssertionError with the parser's message when it does not accept them.
    """
    said: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        for kind in (argparse.ArgumentParser, Parser):
            patch.setattr(kind, 'parse_args', _and_stop(kind.parse_args))
            patch.setattr(kind, 'error', lambda _, message: _refuse(said, message))
        patch.setattr(sys, 'argv', ['soft_continuum'])
        try:
            with kept_signal_handlers():
                call(VERBS[verb], list(options))
        except _Accepted as accepted:
            return dict(accepted.args[0])
        except SystemExit:
            raise AssertionError(f'{verb}: {said}') from None
    raise AssertionError(f'{verb} has no parser')


def _and_stop(parse: Callable[..., Any]) -> Callable[..., None]:
    def parse_args(*arguments: Any) -> None:
        raise _Accepted(vars(parse(*arguments)))

    return parse_args


def _refuse(said: list[str], message: str) -> None:
    said.append(message)
    raise SystemExit(2)
