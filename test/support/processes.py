# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes of their own, as `ros2 run` starts them."""

from collections.abc import Sequence
import os
from pathlib import Path
import select
import signal
import subprocess
import sys
import time
from typing import Any

from ament_index_python.packages import get_package_prefix

from soft_continuum.ui.cli.processes import END_TIMEOUT
from soft_continuum.user_files import description_file

DEADLINE = 60.0  # s


def module_command(name: str) -> list[str]:
    """Return the command that runs an executable from the sources."""
    return [sys.executable, '-m', 'soft_continuum', name]


def installed_command(name: str) -> list[str]:
    """Return the command that `ros2 run soft_continuum NAME` runs."""
    prefix = Path(get_package_prefix('soft_continuum'))
    return [str(prefix / 'lib' / 'soft_continuum' / name)]


class NodeProcess:
    """One process and what it writes."""

    def __init__(self, command: Sequence[str], domain: int, output: Path,
                 environment: dict[str, str] | None = None,
                 directory: Path | None = None) -> None:
        self._path = output
        self._signalled = 0.0, 0.0
        with output.open('wb') as stream:
            self.process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=stream, stderr=stream, cwd=directory,
                env={**os.environ, 'ROS_DOMAIN_ID': str(domain), 'PYTHONUNBUFFERED': '1',
                     **(environment or {})})

    @property
    def output(self) -> str:
        """All that it has written."""
        return self._path.read_text(encoding='utf-8', errors='replace')

    @property
    def running(self) -> bool:
        """Whether it runs."""
        return self.process.poll() is None

    @property
    def children(self) -> list[int]:
        """Ids of the processes that it started and that run."""
        path = Path(f'/proc/{self.process.pid}/task/{self.process.pid}/children')
        return [int(pid) for pid in path.read_text(encoding='ascii').split()]

    def send(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self._signalled = time.monotonic(), self._kept_waiting()
        self.process.send_signal(number)

    def _kept_waiting(self) -> float:
        """Return the seconds for which it could run but was not given a processor."""
        path = Path(f'/proc/{self.process.pid}/schedstat')
        try:
            return int(path.read_text(encoding='ascii').split()[1]) * 1e-9
        except (OSError, IndexError):  # a kernel that does not tell
            return 0.0

    def ends_after(self, within: float = DEADLINE) -> float:
        """
        Wait for its end after a signal; return how long that took it, s.

        What the machine gave to others meanwhile does not count.
        """
        then, waited = self._signalled
        if self.running:
            end = os.pidfd_open(self.process.pid)
            ended, _, _ = select.select([end], [], [], within)
            os.close(end)
            assert ended, f'{self.process.args} still runs after {within:g} s:\n{self.output}'
            # Not waited for yet, it is still listed.
            return time.monotonic() - then - (self._kept_waiting() - waited)
        return 0.0

    def kill(self) -> None:
        """Kill it as `kill -9` does."""
        self.process.kill()
        self.process.wait(DEADLINE)

    def wait(self, within: float = DEADLINE) -> int:
        """Return its exit status."""
        try:
            return self.process.wait(within)
        except subprocess.TimeoutExpired:
            raise AssertionError(
                f'{self.process.args} still runs after {within:g} s:\n{self.output}') from None


class Processes:
    """Starts processes and ends every one of them."""

    def __init__(self, domain: int, directory: Path) -> None:
        self._domain = domain
        self._directory = directory
        self._started: list[NodeProcess] = []

    def start(self, command: Sequence[str], *,
              environment: dict[str, str] | None = None,
              directory: Path | None = None) -> NodeProcess:
        """Start a command as it is, in a directory."""
        output = self._directory / f'output_{len(self._started)}.txt'
        self._started.append(
            NodeProcess(command, self._domain, output, environment, directory))
        return self._started[-1]

    def node(self, name: str, *, namespace: str = '/arm_under_test', installed: bool = False,
             parameters: dict[str, Any] | None = None,
             files: Sequence[Path] | None = None) -> NodeProcess:
        """Start a node with the description file and parameters."""
        command = (installed_command if installed else module_command)(name)
        command += ['--ros-args', '-r', f'__ns:={namespace}']
        for path in [description_file()] if files is None else files:
            command += ['--params-file', str(path)]
        for key, value in (parameters or {}).items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            command += ['-p', f'{key}:={text}']
        return self.start(command)

    def close(self) -> None:
        """Kill what still runs, and show what all have written, for a test that failed."""
        for process in self._started:
            if process.running:
                process.kill()
            print(process.process.args, process.process.returncode, process.output, sep='\n')


def assert_ended_in_peace(node: NodeProcess, statuses: Sequence[int] = (0,)) -> None:
    """Claim that a node ends soon after a signal, without an error."""
    assert node.ends_after() < END_TIMEOUT, node.output
    status = node.wait()
    assert 'Traceback' not in node.output, node.output
    assert 'Error' not in node.output, node.output
    assert status in statuses, node.output
