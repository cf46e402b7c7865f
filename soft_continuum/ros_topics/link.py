# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Topics of other nodes, for a driver: read without waiting, and checked for other users.

Nothing here has a thread or an executor: a read takes the messages that DDS has received since.
So a control loop reads from a topic as from a port, independently of the rest of the process. This
module needs ROS, so drivers import it only when they are opened.
"""

from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module
from math import inf
import os
import threading
import time
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from soft_continuum.hardware.clock import Clock
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.ros.entries import MAX_BYTES
from soft_continuum.ros.names import UNKNOWN_NODE
from soft_continuum.text import plain

BACKLOG = 5
"""Messages that are checked one by one; of more, as from a sender at 1 kHz, only the newest."""
STATES = QoSProfile(depth=BACKLOG + 1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Compatible with every publisher, also with those of micro-ROS."""
COMMANDS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
"""Reaches subscribers of either reliability, those of ros2_control and of micro-ROS."""
GRAPH_PERIOD = 0.2  # s between two looks at who publishes
POLL_INTERVAL = 0.01  # s
CLOCK_DRIFT = 1e-3
"""Largest drift of two clocks, s per s."""


class Stamps:
    """
    The stamps of one sender, whose clock may differ from this one.

    A delayed message has a stamp that is older on arrival than those of others; a repeated
    message, or one out of order, has a stamp that is not newer.
    """

    def __init__(self, timeout: float) -> None:
        """Begin without a message; timeout: largest delay over other messages, s."""
        self.timeout = timeout
        self._last, self._delay, self._received = -inf, inf, -inf  # s

    def newer(self, stamp: float, now: float) -> bool:
        """
        Return whether a message is newer than all before; stamp: s of its sender, now: s here.

        Raises HardwareError for one that arrives too late.
        """
        if stamp <= self._last:
            return False
        if self._received > -inf:
            self._delay += CLOCK_DRIFT * (now - self._received)
        self._delay = min(self._delay, now - stamp)
        self._last, self._received = stamp, now
        if (late := now - stamp - self._delay) > self.timeout:
            raise HardwareError(
                f'it arrived {late:.2f} s later than others; allowed: {self.timeout:g} s; the '
                'network or its sender is too slow')
        return True


class Listener:
    """
    The messages on a topic, and how long ago the last one came.

    missed: whether messages were lost between or before those that were taken last.  number: of
    the last, counted by its sender.  lag: time since its stamp, s, on this computer's clock.
    publisher: GID of the sender; empty if unknown, as after a restart.
    """

    def __init__(self, link: 'RosLink', kind: Any, parameter: str, topic: str, timeout: float
                 ) -> None:
        """Subscribe; parameter: that names the topic, for messages.  timeout: s."""
        self.missed, self.number, self.lag, self.publisher = True, 0, 0.0, b''
        self.topic, self.parameter, self._kind = link.resolve(parameter, topic), parameter, kind
        self._link, self.timeout = link, timeout
        self._stamps, self._received = Stamps(timeout), link.looks()
        self._subscription = link.node.create_subscription(
            kind, self.topic, lambda _: None, STATES, raw=True)

    def take(self) -> list[tuple[Any, float]]:
        """
        Return the messages since the last call, each with its stamp in s.

        Messages without a stamp get the time at which they were sent; those that are not newer
        than earlier ones are ignored.  Raises HardwareError for an invalid or late message.
        """
        taken = []
        while (one := self._subscription.handle.take_message(self._kind, True)) is not None:
            taken.append(one)
        newest = [self._read(*one) for one in (taken[-1:] if len(taken) > BACKLOG else taken)]
        numbers = [info['publication_sequence_number'] for _, info in taken]
        if numbers:
            self.missed = len(newest) < len(taken) or numbers != [
                *range(self.number + 1, self.number + 1 + len(numbers))]
            if numbers[0] < self.number:
                self.publisher = b''
            self.number = numbers[-1]
        return [one for one in newest if one is not None]

    def _read(self, data: bytes, info: dict[str, Any]) -> tuple[Any, float] | None:
        if len(data) > MAX_BYTES:
            raise HardwareError(f'a message of {len(data)} bytes came on {self.topic}; allowed: '
                                f'{MAX_BYTES}')
        message, now = deserialize_message(data, self._kind), self._link.clock()
        if waited := info['received_timestamp'] * 1e-9:  # DDS had it before it was looked at
            now -= max(0.0, time.time() - waited)
        header = getattr(message, 'header', None)
        stamp = header.stamp.sec + header.stamp.nanosec * 1e-9 if header is not None else 0.0
        stamp = stamp or info['source_timestamp'] * 1e-9
        try:
            if not self._stamps.newer(stamp, now):
                return None
        except HardwareError as error:
            raise HardwareError(f'a message on {self.topic}: {error}') from None
        self._received, self.lag = self._link.looks(), time.time() - stamp
        return message, stamp

    def check(self) -> None:
        """Raise HardwareError when no newer message was received for too long."""
        age, timeout = self._link.looks() - self._received, self.timeout
        if age > timeout:
            raise HardwareError(
                f'nothing new on {self.topic} ({self.parameter}) for {age:.2f} s; allowed: '
                f'{timeout:g} s; its publisher or the network failed, or its stamps do not '
                'advance')

    @property
    def publishers(self) -> list[Any]:
        """Publishers of the topic, as reported by rclpy."""
        return list(self._link.node.get_publishers_info_by_topic(self.topic))

    nodes = publishers

    @property
    def problem(self) -> str:
        """Problem with the publishers of the topic, empty for none."""
        found = self.publishers
        where = f'{self.topic} ({self.parameter})'
        if not found:
            return (f'{where} has no publisher; start its node, activate its controller, or '
                    'correct the name')
        if len(found) > 1:
            return (f'{where} is published by {names(found)}; only one is allowed: stop the '
                    'others, or give this device a topic of its own')
        self.publisher = bytes(found[0].endpoint_gid)
        return _other_type(where, found, self._kind)


class CommandPublisher:
    """Publishes commands on a topic."""

    def __init__(self, link: 'RosLink', kind: Any, parameter: str, topic: str) -> None:
        """Create the publisher; nothing is sent."""
        self.topic, self.parameter, self._kind = link.resolve(parameter, topic), parameter, kind
        self._link = link
        self._publisher = link.node.create_publisher(kind, self.topic, COMMANDS)

    def send(self, message: Any) -> None:
        """Publish without waiting."""
        self._publisher.publish(message)

    @property
    def subscribers(self) -> list[Any]:
        """Subscribers of the topic, as reported by rclpy."""
        return list(self._link.node.get_subscriptions_info_by_topic(self.topic))

    @property
    def nodes(self) -> list[Any]:
        """Publishers and subscribers of the topic, this device included."""
        return [*self._link.node.get_publishers_info_by_topic(self.topic), *self.subscribers]

    @property
    def problem(self) -> str:
        """Problem with other users of the topic, empty for none."""
        node = self._link.node
        where = f'{self.topic} ({self.parameter})'
        publishers = node.get_publishers_info_by_topic(self.topic)
        if len(publishers) > 1:
            return (f'{where} is published by {names(publishers)}; only one is allowed: stop the '
                    'others')
        found = self.subscribers
        if not found:
            return (f'{where} has no subscriber; start its node, configure its controller, or '
                    'correct the name')
        if problem := _other_type(where, found, self._kind):
            return problem
        if not self._publisher.get_subscription_count():
            return (f'{names(found)} subscribes to {where} with an incompatible QoS: durability '
                    'must be volatile')
        return ''


class Looks:
    """
    Time for detecting stale peers; it stands still while this program does not look.

    At most GAP counts between two looks: a program that was delayed cannot know that nothing was
    received.
    """

    GAP = 0.1  # s

    def __init__(self, clock: Clock) -> None:
        """Begin with a look at time 0."""
        self._clock, self._last, self._time = clock, clock(), 0.0

    def look(self) -> None:
        """Add the time since the last look, at most GAP."""
        last, self._last = self._last, self._clock()
        self._time += min(self._last - last, self.GAP)

    def __call__(self) -> float:
        """Return the time of the last look, s."""
        return self._time


class RosLink:
    """
    A node for the topics of a device, with names and context of the node that uses it.

    It is used by one thread at a time.
    """

    def __init__(self, lender: Any | None, clock: Clock) -> None:
        """Start the node; lender: the node that has the driver, None outside of nodes."""
        self.clock, self._lender = clock, lender
        self.looks = Looks(clock)
        self._own = None if lender is not None else Context()
        try:
            if self._own is not None:
                rclpy.init(context=self._own, args=[])
            self.node = Node(
                f'{lender.get_name()}_device' if lender is not None else f'device_{os.getpid()}',
                context=self._own or lender.context,  # type: ignore[union-attr]
                namespace=lender.get_namespace() if lender is not None else '/',
                use_global_arguments=False, enable_rosout=False, start_parameter_services=False,
                parameter_overrides=[Parameter('start_type_description_service', value=False)])
        except Exception as error:  # no DDS, or its context was shut down
            raise HardwareError(f'ROS cannot be used: {type(error).__name__}: {error}') from error
        self.topics: list[Listener | CommandPublisher] = []
        self._looked, self._found = clock(), ''  # when the graph was looked at, and what was wrong

    def resolve(self, parameter: str, topic: str) -> str:
        """Return the whole name of a topic, as the lender would resolve it."""
        try:
            name: str = (self._lender or self.node).resolve_topic_name(topic)
        except Exception as error:  # of rclpy, for what is no name
            raise HardwareError(f'parameter {parameter} is {topic!r}, which is not a valid topic '
                                f'name: {str(error).splitlines()[0]}') from None
        return name

    def listen(self, kind: str, parameter: str, topic: str, timeout: float) -> Listener:
        """Return a listener to a topic; kind: such as sensor_msgs/JointState.  timeout: s."""
        listener: Listener = _made(
            Listener, self, short_message_class(kind), parameter, topic, timeout)
        self.topics.append(listener)
        return listener

    def publish_to(self, kind: str, parameter: str, topic: str) -> CommandPublisher:
        """Return a publisher on a topic; kind: such as std_msgs/Float64MultiArray."""
        commands: CommandPublisher = _made(
            CommandPublisher, self, short_message_class(kind), parameter, topic)
        self.topics.append(commands)
        return commands

    @property
    def problem(self) -> str:
        """Problem with other users of the topics, empty for none."""
        self._looked = self.clock()
        self._found = next((problem for topic in self.topics if (problem := topic.problem)), '')
        return self._found

    def check(self) -> None:
        """Raise HardwareError for a problem; looks only every GRAPH_PERIOD."""
        recent = self.clock() - self._looked < GRAPH_PERIOD
        if problem := self._found if recent else self.problem:
            raise HardwareError(problem)

    def wait_until(self, deadline: float, closing: threading.Event) -> str:
        """Wait until there is no problem; return the one that remains at ``deadline`` (clock)."""
        self._wait_while(lambda: bool(self.problem), deadline, closing)
        return self.problem

    def wait_for_names(self, deadline: float, closing: threading.Event) -> str:
        """
        Wait until the names of nodes on the topics are discovered; return the problem.

        deadline: when to continue without them, by the clock.
        """
        self._wait_while(lambda: any(info.node_name == UNKNOWN_NODE for topic in self.topics
                                     for info in topic.nodes), deadline, closing)
        return self.problem

    def _wait_while(self, condition: Callable[[], bool], deadline: float,
                    closing: threading.Event) -> None:
        while condition() and self.clock() < deadline and not closing.is_set():
            self.clock.sleep(POLL_INTERVAL)

    def close(self) -> None:
        """End the node."""
        with suppress(Exception):  # its context may have been shut down
            self.node.destroy_node()
        if self._own is not None:
            self._own.try_shutdown()


def _made(kind: Any, link: RosLink, message: Any, parameter: str, topic: str, *more: Any) -> Any:
    try:
        return kind(link, message, parameter, topic, *more)
    except HardwareError:
        raise
    except Exception as error:  # of rclpy, such as for a topic that has another type here
        raise HardwareError(f'{topic} ({parameter}) cannot be used: '
                            f'{str(error).split(", at ")[0]}') from error


def short_message_class(kind: str) -> Any:
    """Return the class of messages called ``kind``, such as std_msgs/Bool."""
    package, name = kind.split('/')
    return getattr(import_module(f'{package}.msg'), name)


def names(infos: Iterable[Any]) -> str:
    """Return the names of nodes that rclpy reports, as text."""
    return ' and '.join(sorted(
        'a node not yet discovered' if info.node_name == UNKNOWN_NODE
        else plain(f'{info.node_namespace.rstrip("/")}/{info.node_name}') for info in infos))


def _other_type(where: str, infos: Iterable[Any], kind: Any) -> str:
    wanted = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
    for info in infos:
        if info.topic_type != wanted:
            return (f'{names([info])} has {plain(info.topic_type)} on {where}; needed: {wanted}')
    return ''
