# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes of their own, so that none can delay another; for machines without launch."""

from collections.abc import Sequence
import ctypes
import os
import signal
import subprocess
import sys
import threading
from time import monotonic
from types import TracebackType
from typing import Self

import rclpy
from rclpy.context import Context

from soft_continuum.nodes.runtime import check_parameter_files, run

END_TIMEOUT = 5.0  # s that nodes are given to hold and end; they need a fraction of one
SET_PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)
TWIN = 'twin'
CHILD = 'from soft_continuum.nodes.processes import child; child()'


class NodeProcesses:
    """
    Nodes that run while this context manager is open, each in a process of its own.

    A node that ends by itself is reported in one line; the others go on.  All end, holding the
    tendons, when the context is left, and also when this process is killed.
    """

    def __init__(self, names: Sequence[str], arguments: Sequence[str]) -> None:
        """
        Check everything that can be checked; nothing is started yet.

        arguments: program, then ROS arguments, for every node.  Raises ParameterError for a
        parameter file, one of runtime.ROS_ARGUMENT_ERRORS for arguments that ROS does not take.
        """
        check_parameter_files(arguments, names)
        context = Context()
        rclpy.init(args=list(arguments), context=context)
        context.shutdown()
        self._names, self._arguments = tuple(names), list(arguments[1:])
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._ending = False

    def __enter__(self) -> Self:
        """Start the nodes; to be called on the main thread, with which they end."""
        for name in self._names:
            process = self._processes[name] = start_child(name, self._arguments)
            threading.Thread(target=self._report_end, args=(name, process), daemon=True).start()
        return self

    def _report_end(self, name: str, process: 'subprocess.Popen[bytes]') -> None:
        status = process.wait()
        if not self._ending:
            how = (f'was killed by {signal.Signals(-status).name}' if status < 0
                   else f'ended with exit status {status}')
            print(f'{name} {how}; the other nodes go on', file=sys.stderr, flush=True)

    @property
    def running(self) -> bool:
        """Whether any of the nodes still runs."""
        return any(process.poll() is None for process in self._processes.values())

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 traceback: TracebackType | None) -> None:
        """Let all nodes hold and end; kill those that do not."""
        self._ending = True
        for process in self._processes.values():
            process.send_signal(signal.SIGINT)
        deadline = monotonic() + END_TIMEOUT
        for name, process in self._processes.items():
            try:
                process.wait(max(0.0, deadline - monotonic()))
            except subprocess.TimeoutExpired:
                print(f'{name} did not end within {END_TIMEOUT:g} s and is killed',
                      file=sys.stderr, flush=True)
                process.kill()
                process.wait()


def start_child(name: str, arguments: Sequence[str], stdout: int | None = None
                ) -> 'subprocess.Popen[bytes]':
    """Start a node, or the twin, in a process that ends with this one; stdout: as of Popen."""
    # Out of the terminal's process group: Ctrl-C comes to it through this process.
    return subprocess.Popen(
        [sys.executable, '-c', CHILD, str(os.getpid()), name, *arguments],
        stdin=subprocess.DEVNULL, stdout=stdout, start_new_session=True)


def child() -> None:
    """Run what start_child started."""
    parent, name, *arguments = sys.argv[1:]
    ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGTERM)
    if os.getppid() != int(parent):  # it died before
        os._exit(1)
    try:
        if name == TWIN:
            from soft_continuum.cli.twin import main
            status = main(arguments)
        else:
            status = run(name, [name, *arguments])
    except KeyboardInterrupt:  # before the node takes over the signals
        status = 130
    sys.stdout.flush()
    sys.stderr.flush()
    # All is taken down by now; what the interpreter would still do for numba takes 0.7 s.
    os._exit(status)
