# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Every command line of the documents does what it says.

A page gets a directory that looks like the root of the repository, and the nodes of a simulated
arm when a line talks to them.  What a line starts itself runs in another ROS domain.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
import re
import shlex
import shutil
import sys
import time

from processes import module_command, Processes
import pytest
from ros2_words import WORDS
from ros_rig import Rig

from soft_continuum.cli.registry import OPERATE, VERBS
from soft_continuum.nodes.runtime import NODES

ROOT = Path(__file__).resolve().parents[2]
FENCE = re.compile(r' *```(.*)')
COMMANDS = ('./run', 'soft_continuum', 'ros2', 'python', 'colcon', '.', 'sudo', 'ls', 'ssh')
NOT_HERE = {
    './run test': 'runs this',
    './run ui': 'test/browser',
    './run exec bash': 'opens a shell',
    'colcon build': './run does it',
    '. install/setup.bash': './run does it',
    'sudo ': 'changes the machine',
    'ls -l /dev/serial': 'needs a rig',
    'ssh ': 'needs another machine',
    'calibrate all': 'needs hands; test/commands/test_calibrate.py',
    'tendon_driver:=servo': 'the driver is an example; test/hardware/test_drivers.py',
}
EXECUTABLES = (*NODES, 'demo', 'up', 'doctor', 'calibrate', 'grbl_emulator', 'modbus_emulator')
REFUSED = ('soft_continuum jog --right 2', 'soft_continuum run no_such_shape',
           'soft_continuum run no_form --json')
"""Lines that show what is not allowed."""
SHORTER = {'--leak-time 30': '--leak-time 1'}
PATIENCE = 120.0  # s for a command


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


def command_lines(page: Path) -> list[str]:
    """Return the command lines of a page; a continued line is one."""
    return [line.strip() for language, text in blocks(page) if language == 'sh'
            for line in text.replace('\\\n', ' ').splitlines() if line.strip()]


PAGES = {page.relative_to(ROOT).as_posix(): page for page in (
    *ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md'), *ROOT.glob('msg_docs/*.md'))}
LINES = {name: lines for name, page in PAGES.items() if (
    lines := [line for line in command_lines(page)
              if not any(part in line for part in NOT_HERE)])}


class Terminal:
    """Where the lines of a page are typed."""

    def __init__(self, rig: Rig, directory: Path, here: Processes, elsewhere: Processes) -> None:
        self._rig, self._directory = rig, directory
        self._here, self._elsewhere = here, elsewhere
        for name in ('data', 'docs', 'examples', 'launch'):
            (directory / name).symlink_to(ROOT / name)
        shutil.copytree(ROOT / 'config', directory / 'config')
        hardware = directory / 'config' / 'emulated_hardware.yaml'
        hardware.write_text(self._moved(hardware.read_text(encoding='utf-8')), encoding='utf-8')
        for name in ('my_rig.yaml', 'calibration.yaml'):
            shutil.copy(hardware, directory / name)
        shutil.copy(directory / 'config' / 'manipulator.yaml', directory / 'my_arm.yaml')

    def _moved(self, text: str) -> str:
        return re.sub(r'/tmp\b', str(self._directory), text)

    def type(self, line: str) -> None:
        """Run a line; fail when it does not do what the page says."""
        for long, short in SHORTER.items():
            line = line.replace(long, short)
        words = shlex.split(self._moved(line))
        if words[:2] == ['./run', 'exec']:
            words = words[2:]
        elif words[0] == './run':
            words = module_command(words[1]) + words[2:]
        if words[:4] == ['ros2', 'launch', 'soft_continuum', 'bringup.launch.py']:
            words = self._launched(words[4:])
        elif words[:3] == ['ros2', 'run', 'soft_continuum']:
            words = module_command(words[3]) + words[4:]
        elif words[0] == 'ros2':
            self._nodes()
            WORDS[' '.join(words[1:3])](self._rig, words[3:])
            return
        elif words[0] == 'soft_continuum':
            words = [sys.executable, '-m', 'soft_continuum', *words[1:]]
        if words[0] == 'python':
            words[0] = sys.executable
        if words[3:4] and words[3] in EXECUTABLES:
            self._executable(words)
        elif 'record' in words[3:4]:
            self._nodes()
            recorder = self._here.start(words, directory=self._directory)
            time.sleep(3.0)
            assert self._rig.goal_when_heard('s_form').result(PATIENCE)[0] == 'SUCCEEDED'
            assert recorder.wait(PATIENCE) == 0, recorder.output
        else:
            self._command(words, line)

    def _launched(self, arguments: list[str]) -> list[str]:
        """Return the command that starts the same nodes as the launch file does."""
        options = {'params_file': '--params-file', 'more_params_file': '--params-file',
                   'namespace': '--namespace'}
        given = [argument.split(':=') for argument in arguments]
        return [*module_command('up'), *(x for key, value in given for x in (options[key], value))]

    def _nodes(self) -> None:
        """Start the nodes of a simulated arm, if they do not run."""
        if not len(self._rig.tendons):
            self._here.start(module_command('up'), directory=self._directory)
            self._rig.wait_until_ready(*NODES)
            self._rig.wait_for(lambda: len(self._rig.joints), 'joint_states')

    def _executable(self, words: list[str]) -> None:
        """Run an executable: a command to its end, an emulator for good, nodes for a while."""
        name = words[3]
        if name in ('doctor', 'calibrate'):
            self._command(words, name)
            return
        if name == 'demo':
            self._command(words, name)
            assert (self._directory / 'demo_shapes.png').exists()
            return
        process = self._elsewhere.start(words, directory=self._directory)
        if 'emulator' in name:
            link = Path(words[words.index('--link') + 1])
            self._rig.wait_for(lambda: link.exists() or time.sleep(0.05), str(link))
        else:
            assert name in {*NODES, 'up'}
            time.sleep(4.0)
            assert process.running and 'rror' not in process.output, process.output
            process.kill()

    def _command(self, words: list[str], line: str) -> None:
        if 'calibrate' in words:
            (self._directory / 'calibration.yaml').unlink(missing_ok=True)
        verb = VERBS.get(words[3]) if words[3:4] else None
        if verb and verb.target == OPERATE or 'hello_shapes' in words[-1]:
            self._nodes()
        command = self._here.start(words, directory=self._directory)
        status = command.wait(PATIENCE)
        refused = line in REFUSED or line.removeprefix('./run exec ') in REFUSED
        assert status == (1 if refused else 0), f'{line}: status {status}\n{command.output}'


@pytest.fixture
def terminal(make_rig: Callable[..., Rig], take_domain: Callable[[], int], tmp_path: Path,
             processes: Processes) -> Iterator[Terminal]:
    """Return a terminal in a directory of its own."""
    outputs = tmp_path / 'elsewhere'
    outputs.mkdir()
    (tmp_path / 'page').mkdir()
    elsewhere = Processes(take_domain(), outputs)
    yield Terminal(make_rig(namespace=''), tmp_path / 'page', processes, elsewhere)
    elsewhere.close()


@pytest.mark.timeout(600)  # sequences in real time
@pytest.mark.parametrize('page', LINES)
def test_the_command_lines_of_a_page_do_what_they_say(terminal: Terminal, page: str) -> None:
    for line in sorted(LINES[page], key=lambda line: 'emulator' not in line):
        terminal.type(line)


def test_no_command_line_hides_in_another_block() -> None:
    for name, page in PAGES.items():
        for language, text in blocks(page):
            assert language in ('', 'sh', 'text', 'json', 'yaml', 'python', 'math', '{toctree}'), (
                f'{name}: {language}')
            for line in text.splitlines():
                assert language == 'sh' or line.strip().split(' ')[0] not in COMMANDS[:5], (
                    f'{name}: {line}')


def test_what_is_not_run_is_still_in_the_documents() -> None:
    lines = [line for page in PAGES.values() for line in command_lines(page)]
    assert [part for part in NOT_HERE if not any(part in line for line in lines)] == []
