# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Runs each node as a separate process, so that none can delay another, without launch."""

from collections.abc import Sequence
import os
import signal
import subprocess
import sys
import threading
from time import monotonic
from typing import Self

import rclpy
from rclpy.context import Context
from rclpy.utilities import remove_ros_args

from soft_continuum.extras import remedy
from soft_continuum.nodes.runtime import argument_error, end_with, ROS_ARGUMENT_ERRORS, run
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.description import check_parameter_files
from soft_continuum.ros.environment import CLIENT, require_log_folder, SAID, with_enclave
from soft_continuum.ros.names import TWIN, TWIN_CAMERA

END_TIMEOUT = 20.0
"""s for nodes to hold and exit; a fraction of one is enough unless the computer is busy."""
CHILD = ('import signal; signal.signal(signal.SIGINT, signal.SIG_DFL); '  # while it imports
         'from soft_continuum.ui.cli.processes import child; child()')


class NodeProcesses:
    """
    Nodes that run while this context manager is open, each in a process of its own.

    A node that exits unexpectedly is reported in one line; the others continue.  All exit, holding
    the tendons, when the context is left, and also when this process is killed.
    """

    def __init__(self, names: Sequence[str], arguments: Sequence[str],
                 output: int | None = None) -> None:
        """
        Check everything that can be checked before the start.

        arguments: program, then ROS arguments, for every node.  output: descriptor of a file for
        their output, None: the output of this process. Raises ParameterError for a parameter
        file, and for arguments that are not valid in ROS.
        """
        check_parameter_files(arguments, names)
        require_log_folder(os.environ)
        context = Context()
        try:
            rclpy.init(args=with_enclave(arguments, (*names, CLIENT)[0]), context=context)
        except ROS_ARGUMENT_ERRORS as error:
            raise ParameterError(argument_error(arguments, error)) from None
        context.shutdown()
        if other := remove_ros_args(arguments)[1:]:  # rclpy ignores it
            raise ParameterError(f'unknown argument {other[0]!r}; those of ROS follow --ros-args')
        self._names, self._arguments = tuple(names), list(arguments[1:])
        self._output = output
        self._children: list[Child] = []

    def __enter__(self) -> Self:
        """Start the nodes; call it on the main thread, with which they exit."""
        self._children = [
            Child(name, self._arguments, 'the other nodes continue', self._output, self._output,
                  alone=name == self._names[0]) for name in self._names]
        return self

    @property
    def running(self) -> bool:
        """Whether any of the nodes still runs."""
        return any(child.running for child in self._children)

    def __exit__(self, *_: object) -> None:
        """Make all nodes hold and exit; kill those that do not."""
        end_processes(self._children)


class Child:
    """A node, or the twin, in a process that exits with this one; reports unexpected exits."""

    def __init__(self, name: str, arguments: Sequence[str], consequence: str,
                 stdout: int | None = None, stderr: int | None = None, alone: bool = True) -> None:
        """
        Start it; consequence: printed when it exits unexpectedly.

        stdout, stderr: as of Popen.  alone: whether it is the only one to print who can command
        the arm.
        """
        self.name, self._consequence, self._ending = name, consequence, False
        # Out of the terminal's process group: Ctrl-C comes to it through this process.
        self._process = subprocess.Popen(
            [sys.executable, '-c', CHILD, str(os.getpid()), name, *arguments],
            stdin=subprocess.DEVNULL, stdout=stdout, stderr=stderr, start_new_session=True,
            env={**os.environ, SAID: '' if alone else 'yes'})
        threading.Thread(target=self._report_end, daemon=True).start()

    @property
    def running(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def _report_end(self) -> None:
        status = self._process.wait()
        if not self._ending:
            how = (f'was killed by {signal.Signals(-status).name}' if status < 0
                   else f'ended with exit status {status}')
            print(f'{self.name} {how}; {self._consequence}', file=sys.stderr, flush=True)

    def interrupt(self) -> None:
        """Ask it to end."""
        self._ending = True
        self._process.send_signal(signal.SIGINT)

    def wait(self, timeout: float) -> None:
        """Wait for its end; kill it after ``timeout`` s."""
        try:
            self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            print(f'{self.name} did not end within {END_TIMEOUT:g} s and is killed',
                  file=sys.stderr, flush=True)
            self._process.kill()
            self._process.wait()


def end_processes(children: Sequence[Child]) -> None:
    """Make all of them exit at the same time; kill those that do not."""
    for one in children:
        one.interrupt()
    deadline = monotonic() + END_TIMEOUT
    for one in children:
        one.wait(max(0.0, deadline - monotonic()))


def child() -> None:
    """Run what a Child started."""
    parent, name, *arguments = sys.argv[1:]
    end_with(int(parent))
    try:
        if name in (TWIN, TWIN_CAMERA):
            from soft_continuum.ui.cli import twin
            status = (twin.main if name == TWIN else twin.camera)(arguments)
        else:
            status = run(name, [name, *arguments])
    except ImportError as error:
        if not (text := remedy(error)):
            raise
        print(f'{name}: {text}', file=sys.stderr)
        status = 1
    except KeyboardInterrupt:  # before the node handles the signals
        status = 130
    sys.exit(status)
