# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Starting, spinning and ending nodes: the same for one node and for several in a process."""

from collections.abc import Callable, Sequence
from importlib import import_module
import signal
import sys
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.exceptions import NameValidationException
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from soft_continuum.parameters.files import load_description, read_parameter_file
from soft_continuum.parameters.nodes import ALL_PARAMETERS
from soft_continuum.parameters.parameter import Parameter, ParameterError

try:
    from rclpy.experimental import EventsExecutor as BestExecutor
except ImportError:  # before rclpy 7.1.4
    from rclpy.executors import SingleThreadedExecutor as BestExecutor

ROS_ARGUMENT_ERRORS = (RCLError, UnknownROSArgsError, NameValidationException)

NODES = {
    'tendon_actuation': 'TendonActuation',
    'jamming_valves': 'JammingValves',
    'kinematics': 'Kinematics',
    'shape_sequencer': 'ShapeSequencer',
}


def node_class(name: str) -> Callable[..., Any]:
    """Return the class of the node called ``name``."""
    found: Callable[..., Any] = getattr(import_module(f'soft_continuum.nodes.{name}'), NODES[name])
    return found


class Signals:
    """SIGINT and SIGTERM: they interrupt the start, and later only ask the spinning to end."""

    def __init__(self) -> None:
        """Take over both signals."""
        self.received = False
        self.starting = True
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def _on_signal(self, *_: Any) -> None:
        self.received = True
        if self.starting:
            self.starting = False
            raise KeyboardInterrupt

    def spin(self, executor: Executor, ended: Callable[[], bool] = lambda: False) -> None:
        """Spin until a signal comes, ROS is shut down, or ``ended`` says so."""
        self.starting = False
        while not self.received and rclpy.ok() and not ended():
            executor.spin_once(timeout_sec=0.1)


def make_executor() -> Executor:
    """Return the executor that serves these nodes best: events, in one thread."""
    return BestExecutor()


def run(names: Sequence[str], args: Sequence[str] | None = None) -> int:
    """
    Run nodes in this process until SIGINT or SIGTERM; return the exit status.

    Signals end the spinning first, so that nodes can still hold the tendons and say so.
    """
    signals = Signals()
    arguments = list(sys.argv if args is None else args)
    nodes: list[Any] = []
    executor: Executor | None = None
    try:
        check_parameter_files(arguments, names)
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        executor = make_executor()
        for name in names:
            nodes.append(node_class(name)())
            executor.add_node(nodes[-1])
        for node in nodes:
            node.start()
        signals.spin(executor)
    except ParameterError as error:
        print(f'{names[len(nodes)] if len(nodes) < len(names) else names[-1]}: {error}',
              file=sys.stderr)
        return 2
    except ROS_ARGUMENT_ERRORS as error:
        print(f'{names[0]}: {argument_error(arguments, error)}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 0
    finally:
        signals.starting = False
        end(executor, nodes)
    return 0


def argument_error(arguments: Sequence[str], error: Exception) -> str:
    """Say which arguments ROS did not take, and why."""
    return (f'ROS does not take these arguments: {" ".join(arguments[1:])}: '
            f'{str(error).splitlines()[0]}')


def end(executor: Executor | None, nodes: Sequence[Any]) -> None:
    """Let every node hold, then take all down."""
    for node in nodes:
        node.quit()
    if executor is not None:
        executor.shutdown()
    for node in nodes:
        _destroy(node)
    rclpy.try_shutdown()


def _destroy(node: Node) -> None:
    node.destroy_node()


def check_parameter_files(arguments: Sequence[str], names: Sequence[str]) -> None:
    """
    Read every ``--params-file`` in the arguments as the nodes will, before rclpy does.

    Raises ParameterError naming the file and the key; rclpy would only abort.
    """
    paths = [path for before, path in zip(arguments, arguments[1:], strict=False)
             if before == '--params-file']
    table = {p.name: p for p in ALL_PARAMETERS}
    for name in names:
        if paths:
            load_description(*paths, node=name)
        for path in paths:
            for key, value in read_parameter_file(path, name).items():
                _refuse_whole_numbers(path, key, value, table)


def _refuse_whole_numbers(path: str, key: str, value: Any, table: dict[str, Parameter]) -> None:
    """Refuse integers where ROS, other than the library, insists on a decimal point."""
    default = table[key].default if key in table else (0.0,) if key.startswith('shapes.') else 0
    items = value if isinstance(value, list) else [value]
    measure = isinstance(default, float | tuple)
    whole = [item for item in items if isinstance(item, int) and not isinstance(item, bool)]
    if measure and whole:
        raise ParameterError(
            f'{path}: parameter {key} is {value}; ROS wants a decimal point: '
            f'write {float(whole[0])} rather than {whole[0]}')
