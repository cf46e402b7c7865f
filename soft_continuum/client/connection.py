# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS node on a thread of its own, and waiting for it with deadlines."""

from array import array
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from itertools import count
import os
import threading
from time import monotonic
import traceback
from typing import Any, TypeVar

from rcl_interfaces.srv import GetParameters
import rclpy
from rclpy.context import Context
from rclpy.exceptions import NameValidationException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.signals import SignalHandlerOptions

from soft_continuum.client.errors import ClientError, NoAnswerError, NodesMissingError

T = TypeVar('T')

NODE_NAMES = ('tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer')
POLL = 0.05  # s between two looks at what gives no notice, such as the ROS graph
HOW_TO_START = 'start them with `./run up` or `ros2 launch soft_continuum bringup.launch.py`'
_numbers = count(1)


class Connection:
    """
    A node in a context of its own, spun by a thread.

    All that creates, sends or destroys goes through ``do`` and so runs on that thread: rclpy may
    drop an answer that comes while another thread still notes the request.
    """

    def __init__(self, namespace: str, timeout: float) -> None:
        """Join the ROS graph; raises ClientError for a namespace that ROS does not take."""
        self.namespace = '/' + namespace.strip('/')
        self.timeout = timeout
        self.every_second: list[Callable[[], None]] = []
        self._changed = threading.Condition()
        self._clients: dict[str, Any] = {}
        self._open = True
        self._context = Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        try:
            # Without rosout and parameter services it starts in half the time.
            self.node = Node(
                f'client_{os.getpid()}_{next(_numbers)}', namespace=self.namespace,
                context=self._context, use_global_arguments=False, enable_rosout=False,
                start_parameter_services=False)
        except NameValidationException as error:
            self._context.try_shutdown()
            raise ClientError(f'namespace {namespace!r} is not one that ROS takes: '
                              f'{str(error).splitlines()[0]}') from None
        self.node.create_timer(1.0, lambda: [watch() for watch in list(self.every_second)])
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, name='soft_continuum', daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        while self._open:
            try:
                self._executor.spin_once(timeout_sec=0.2)
            except Exception:  # such as of a message that is not as documented
                self.node.get_logger().error(traceback.format_exc())

    def close(self, goodbye: Callable[[], None]) -> None:
        """Do ``goodbye`` on the thread, end it, leave the graph; a second call does nothing."""
        if not self._open:
            return

        def leave() -> None:
            try:
                goodbye()
            finally:
                self._open = False

        try:
            self.do(leave)
        finally:
            self._thread.join()
            self._executor.shutdown()
            self.node.destroy_node()
            self._context.try_shutdown()

    def do(self, function: Callable[[], T]) -> T:
        """Run ``function`` on the thread of the node; return what it returns or raise that."""
        if threading.current_thread() is self._thread:
            return function()
        if not self._open:
            raise ClientError('this Arm is closed; make a new one')
        done: Future[T] = Future()

        def run() -> None:
            try:
                done.set_result(function())
            except BaseException as error:
                done.set_exception(error)

        self._executor.create_task(run)
        return done.result()

    def changed(self) -> None:
        """Wake whoever waits; for callbacks."""
        with self._changed:
            self._changed.notify_all()

    def wait_for(self, condition: Callable[[], T], timeout: float) -> T:
        """Return what ``condition`` gives as soon as that is true, or at last after the wait."""
        deadline = monotonic() + timeout
        with self._changed:
            while not (value := condition()) and monotonic() < deadline:
                self._changed.wait(POLL)
        return value

    def wait_done(self, future: Any, timeout: float) -> bool:
        """Wait for a future of rclpy; return whether it is done."""
        future.add_done_callback(lambda _: self.changed())
        return bool(self.wait_for(future.done, timeout))

    # The graph.

    def running(self) -> dict[str, bool]:
        """Return which of the four nodes are in the graph."""
        there = self.node.get_node_names_and_namespaces()
        return {name: (name, self.namespace) in there for name in NODE_NAMES}

    def not_found(self, what: str, needed: Sequence[str] = NODE_NAMES) -> ClientError:
        """Return the error for something that did not appear within the timeout."""
        running = self.running()
        if all(running[name] for name in needed):
            return NoAnswerError(f'nothing of {what} within {self.timeout:g} s, though its node '
                                 'runs; is it active, and the machine not overloaded?')
        missing = [name for name in NODE_NAMES if not running[name]]
        verb = 'does' if len(missing) == 1 else 'do'
        text = (f'{", ".join(missing)} {verb} not run in namespace {self.namespace}; '
                f'{HOW_TO_START}')
        elsewhere = sorted({space for name, space in self.node.get_node_names_and_namespaces()
                            if name in NODE_NAMES and space != self.namespace})
        if elsewhere:
            text += f'; an arm was found in namespace {", ".join(elsewhere)}'
        if os.environ.get('ROS_DOMAIN_ID', '0') != '0':
            text += f'; looked in ROS_DOMAIN_ID {os.environ["ROS_DOMAIN_ID"]}'
        return NodesMissingError(text)

    # Services.

    def call(self, kind: Any, name: str, **request: Any) -> Any:
        """
        Call a service of one of the nodes; return its response.

        Raises NodesMissingError or NoAnswerError after ``timeout``.
        """
        if name not in self._clients:
            self._clients[name] = self.do(lambda: self.node.create_client(kind, name))
        client = self._clients[name]
        node = name.split('/')[0]
        if not self.wait_for(client.service_is_ready, self.timeout):
            raise self.not_found(name, [node])
        future = self.do(lambda: client.call_async(kind.Request(**request)))
        if not self.wait_done(future, self.timeout):
            raise self.not_found(f'an answer of {name}', [node])
        return future.result()

    def parameters(self, node: str, names: Sequence[str]) -> Mapping[str, Any]:
        """Return parameters of a node by name, without those that have no value."""
        values = self.call(GetParameters, f'{node}/get_parameters', names=list(names)).values
        if len(values) < len(names) > 1:  # a node that lacks one gives none
            return {k: v for name in names for k, v in self.parameters(node, [name]).items()}
        read = {name: parameter_value_to_python(value)
                for name, value in zip(names, values, strict=False)}
        return {name: value.tolist() if isinstance(value, array) else value
                for name, value in read.items() if value is not None}
