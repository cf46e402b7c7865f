# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Starting, spinning and ending a node."""

from collections.abc import Callable, Sequence
from contextlib import suppress
import ctypes
import gc
from importlib import import_module
import os
from pathlib import Path
import re
import resource
import signal
import sys
import traceback
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.exceptions import NameValidationException
from rclpy.executors import Executor
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from soft_continuum.hardware.real_time import ask_for_a_larger_share
from soft_continuum.nodes.managed_node import ManagedNode
from soft_continuum.parameters.arguments import Parser
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.description import check_parameter_files
from soft_continuum.ros.entries import make_executor
from soft_continuum.ros.environment import (
    discard_old_logs,
    PARENT,
    reachable_addresses,
    require_log_folder,
    SAID,
    security_problem,
    wait_until_up,
    who_commands,
    with_enclave,
)
from soft_continuum.ros.names import RECORDER, TELEOP

SET_PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)
MEMORY = 2**30  # bytes that a node may use beyond those of its start; it needs a third of them

ELSEWHERE = {RECORDER: 'lab.recordings.recorder', TELEOP: 'ui.teleop.node'}
"""Modules of nodes that use the arm as clients do."""
ROS_ARGUMENT_ERRORS = (RCLError, UnknownROSArgsError, NameValidationException)


def node_class(name: str) -> type[Any]:
    """Return the class of the node called ``name``: ShapeSequencer for shape_sequencer."""
    class_name = name.title().replace('_', '')
    module = ELSEWHERE.get(name, f'nodes.{name}')
    found: type[Any] = getattr(import_module(f'soft_continuum.{module}'), class_name)
    return found


class Signals:
    """SIGINT and SIGTERM: they interrupt the start, and later only request the end of spinning."""

    def __init__(self) -> None:
        """Take over both signals."""
        self.received = False
        self.starting = True
        self._let(self._on_signal)

    def ignore(self) -> None:
        """Ignore further signals, which would kill the process during Python's shutdown."""
        self._let(signal.SIG_IGN)

    def _let(self, handler: Any) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, handler)

    def _on_signal(self, *_: Any) -> None:
        self.received = True
        if self.starting:
            self.starting = False
            raise KeyboardInterrupt

    def spin(self, executor: Executor, ended: Callable[[], bool] = lambda: False) -> None:
        """
        Spin until a signal comes, ROS is shut down, or ``ended`` returns True.

        Exceptions of callbacks are logged: a node that continues can still hold the tendons.
        """
        self.starting = False
        while not self.received and rclpy.ok() and not ended():
            try:
                executor.spin_once(timeout_sec=0.1)
            except Exception:
                get_logger('soft_continuum').error(
                    f'a callback failed; the node continues:\n{traceback.format_exc()}')


def end_with(parent: int) -> None:
    """
    End as by SIGTERM, holding the tendons, when the parent process ends.

    parent: its id; if that has ended already, this process ends at once.
    """
    ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGTERM)
    if os.getppid() != parent and not Path('/proc', str(parent)).exists():
        os._exit(1)


def run(name: str, args: Sequence[str] | None = None) -> int:
    """
    Run one node until SIGINT or SIGTERM; return the exit status.

    args: program and ROS arguments, by default those of this process.  Signals end the spinning
    first, so that the node can still hold the tendons and report it.
    """
    signals = Signals()
    arguments = list(sys.argv if args is None else args)
    executor: Executor | None = None
    nodes: list[Any] = []
    try:
        if parent := os.environ.pop(PARENT, ''):
            end_with(int(parent))
        check_parameter_files(arguments, [name])
        # rclpy ignores what is no ROS argument, such as --params-file without --ros-args.
        Parser(name, f'Run the node {name}. It takes ROS arguments only, such as --ros-args '
               '--params-file FILE -r __ns:=/NAME.').parse_args(remove_ros_args(arguments)[1:])
        require_log_folder(os.environ)
        discard_old_logs(os.environ)
        wait_until_up()
        if issubclass(kind := node_class(name), ManagedNode):
            ask_for_a_larger_share()  # before DDS starts its threads
        rclpy.init(args=with_enclave(arguments, name),
                   signal_handler_options=SignalHandlerOptions.NO)
        executor = make_executor()
        nodes.append(kind())
        executor.add_node(nodes[0])
        limit_memory()
        if not os.environ.get(SAID):
            addresses, log = reachable_addresses(), nodes[0].get_logger()
            (log.warning if addresses else log.info)(who_commands(os.environ, addresses))
        nodes[0].start()
        gc.freeze()  # to look through all that was imported takes 0.1 s, in which nothing runs
        signals.spin(executor)
    except ParameterError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 2
    except ROS_ARGUMENT_ERRORS as error:
        print(f'{name}: {argument_error(arguments, error)}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 0
    finally:
        signals.starting = False
        shut_down(executor, nodes)
        signals.ignore()
    return 0


def limit_memory() -> None:
    """
    Limit the memory of this node, which damaged DDS messages could exhaust.

    A node that ends this way counts as killed: the others detect it, and the motion ends.
    """
    with suppress(OSError, ValueError):  # a smaller limit than this is set already
        status = Path('/proc/self/status').read_text(encoding='ascii')
        used = int(re.findall(r'VmData:\s+(\d+) kB', status)[0]) * 1024
        resource.setrlimit(resource.RLIMIT_DATA, (
            used + MEMORY, resource.getrlimit(resource.RLIMIT_DATA)[1]))


def argument_error(arguments: Sequence[str], error: Exception) -> str:
    """Return which arguments ROS rejected, and why; or the problem with its security."""
    return security_problem(error, os.environ) or (
        f'ROS rejects these arguments: {" ".join(arguments[1:])}: {str(error).splitlines()[0]}')


def shut_down(executor: Executor | None, nodes: Sequence[Any]) -> None:
    """Let every node hold, then shut down."""
    for node in nodes:
        try:
            node.quit()
        except Exception:  # the others have to hold all the same
            get_logger('soft_continuum').error(traceback.format_exc())
    if executor is not None:
        executor.shutdown()
    for node in nodes:
        with suppress(Exception):  # the process ends anyway
            node.destroy_node()
    rclpy.try_shutdown()
