# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Entry points of a node, bounded and guarded: messages, services, which may ask, and timers.

With the QoS profiles of the suite, and the executor of the nodes: EventsExecutor, in one thread.
"""

from collections.abc import Callable
import sys
import traceback
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.timer import Timer

from soft_continuum.ros.ros_time import Age

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # before rclpy 7.1.4
    EventsExecutor = None

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""State that late joiners need."""
STREAM = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
"""Streams that the suite publishes."""
COMMAND = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE,
                     lifespan=Duration(seconds=0.5))
"""Motion requests, which are not delivered late after a network failure."""
EVERY_STATE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE,
                         durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""State of which subscribers must not miss a change."""
OBSTACLES = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""Changes that must not be missed, from publishers of any durability."""
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Subscribed streams: compatible with any publisher."""

MAX_BYTES = 65536
"""Largest size of a message; converting one blocks every thread of a process for up to 0.1 s."""
LOG_PERIOD = 1.0  # s between two log lines of one kind
ANSWER_TIMEOUT = 30.0  # s within which the same request, made again, is the answer
FAILED = 'this request failed in the node; see its log'


def guarded(node: Any, function: Callable[..., Any]) -> Callable[..., Any]:
    """
    Return ``function`` with its exceptions caught and reported to ``node``, which continues.

    rclpy would end the process, and with it other tasks, such as holding the tendons.
    """
    def call(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except Exception as error:
            node.get_logger().error(
                f'a callback failed; the node continues:\n{traceback.format_exc()}',
                throttle_duration_sec=LOG_PERIOD)
            node.callback_failed(error)
            return None

    return call


def subscribe(node: Any, kind: Any, topic: str, callback: Callable[[Any], None],
              qos: QoSProfile, max_bytes: int = MAX_BYTES, **options: Any) -> Any:
    """Return a guarded subscription; options: as of ``subscribe_unguarded``."""
    return subscribe_unguarded(
        node, kind, topic, guarded(node, callback), qos, max_bytes, **options)


def subscribe_unguarded(node: Node, kind: Any, topic: str, callback: Callable[[Any], object],
                        qos: QoSProfile | int, max_bytes: int = MAX_BYTES,
                        convert: Callable[[bytes, Any], Any] = deserialize_message) -> Any:
    """
    Return a subscription; messages that are too long or malformed are ignored.

    convert: makes what ``callback`` gets, of a serialized message and its kind.
    """
    def on_data(data: bytes) -> None:
        problem = f'{len(data)} bytes; allowed: {max_bytes}'
        if len(data) <= max_bytes:
            try:
                message = convert(data, kind)
            except Exception as error:  # whatever the conversion finds wrong
                problem = str(error)
            else:
                callback(message)
                return
        node.get_logger().warning(f'ignored a message on {topic}: {problem}',
                                  throttle_duration_sec=LOG_PERIOD)

    return node.create_subscription(kind, topic, on_data, qos, raw=True)


def serve(node: Any, kind: Any, name: str, callback: Callable[[Any, Any], Any]) -> None:
    """Create a service of a std_srvs type; a callback that fails answers with the reason."""
    def on_request(request: Any, response: Any) -> Any:
        answer = guarded(node, callback)(request, response)
        if answer is None:
            response.success, response.message = False, FAILED
        return answer or response

    node.create_service(kind, name, on_request)


def serve_later(node: Any, kind: Any, name: str,
                callback: Callable[[Any, Callable[[Any], None]], None]) -> None:
    """
    Create a service with deferred responses: ``callback`` gets the request and a sender.

    rclpy expects the response when its callback returns, and sends it by a method of the service.
    """
    service = node.create_service(kind, name, lambda request, _: request)
    send = service.send_response

    def on_request(request: Any, header: Any) -> None:
        def begin() -> bool:
            callback(request, lambda response: send(response, header))
            return True

        if guarded(node, begin)() is None:
            send(kind.Response(success=False, message=FAILED), header)

    service.send_response = on_request


class Confirmation:
    """
    Asks for confirmation of a request that contradicts the known state.

    Repeating the request within ANSWER_TIMEOUT confirms it: std_srvs/Trigger has no fields.
    """

    def __init__(self) -> None:
        """Start without a question."""
        self._asked = Age()

    def ask(self, doubt: str, effect: str) -> str:
        """
        Return the question; empty without a doubt, or after confirmation.

        doubt: why it may be wrong.  effect: consequence of the request, and what to do first.
        """
        answered = self._asked.seconds <= ANSWER_TIMEOUT
        self._asked.clear()
        if answered or not doubt:
            return ''
        self._asked.refresh()
        return (f'nothing was done: as last known, {doubt}; {effect}, then call this again within '
                f'{ANSWER_TIMEOUT:g} s')


def repeat(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Call ``callback`` every ``period`` s of the steady clock, since ROS time may stand still."""
    return node.create_timer(period, guarded(node, callback), clock=Clock(
        clock_type=ClockType.STEADY_TIME))


def wake(timer: Timer) -> None:
    """Have a timer go on that was canceled because nothing waited for it."""
    if timer.is_canceled():
        timer.reset()


def make_executor(context: Context | None = None) -> Executor:
    """
    Return an executor of a context, by default that of the process.

    EventsExecutor needs a file behind stderr.  Without one, as in some notebooks, this is the
    slower SingleThreadedExecutor.
    """
    try:
        sys.stderr.fileno()
    except (AttributeError, OSError, ValueError):
        return SingleThreadedExecutor(context=context)
    return (EventsExecutor or SingleThreadedExecutor)(context=context)
