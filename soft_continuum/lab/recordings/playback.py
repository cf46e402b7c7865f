# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Playback of a recording: stand-in nodes publish it in a separate namespace."""

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Sequence
from math import isfinite
import os
from pathlib import Path
import sys
import threading
from time import monotonic
from typing import Any, Self

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
import yaml

from soft_continuum.lab.recordings.bag import (
    BagError,
    BagReader,
    DefinitionError,
    message_class,
    PARAMETERS,
    PICTURES,
    Topic,
)
from soft_continuum.ros.entries import EVERY_STATE, make_executor, STREAM
from soft_continuum.ros.environment import choose_own_network
from soft_continuum.ros.names import KINEMATICS, NODES

PERIOD = 0.04  # s
CLOSE_TIMEOUT = 10.0  # s
BEGIN = 0.5  # s, within which every topic has its first message
REPEAT_PERIOD = 1.0  # s, after which what stands still is published again
MAX_BYTES = 1_000_000_000  # of messages, which are kept in memory
COMMANDS = ('joint_trajectory', 'tendon_trajectory', 'emergency_stop')
"""Topics that command motion: they are never replayed."""


class Playback:
    """
    Plays one arm of a recording; use it in a ``with`` statement.

    namespace: of its nodes.  position: present time, s since the beginning.  duration: s.
    damage: as of BagReader.
    """

    def __init__(self, path: Path, namespace: str = '') -> None:
        """
        Read the recording; nothing is published yet.

        namespace: of the arm, where several were recorded.  Raises BagError.
        """
        self.namespace = f'/replay_{os.getpid()}'
        self.playing = False
        self.position, self._published = 0.0, -REPEAT_PERIOD
        self._open = True
        with BagReader(path) as bag:
            self._messages: list[tuple[float, str, bytes]] = []
            topics: dict[str, Topic] = {}
            begin, size = 0, 0
            for message in bag.messages():
                begin = begin or message.time
                if message.topic.kind in PICTURES:
                    continue
                size += len(message.data)
                if size > MAX_BYTES:
                    raise BagError(f'{path}: more than {MAX_BYTES / 1e9:g} GB of messages; record '
                                   'shorter runs')
                topics[message.topic.name] = message.topic
                self._messages.append(
                    (1e-9 * (message.time - begin), message.topic.name, message.data))
        arm = bag.arm_in([name.removesuffix('/tendon_states') or '/' for name in topics
                          if name.endswith('/tendon_states')], namespace)
        self.damage = bag.damage
        self._parameters = _parameters(bag.said_of(arm, PARAMETERS))
        self._space = arm.rstrip('/') + '/'
        self._topics = {name: topic for name, topic in topics.items() if name.startswith(
            self._space) and name.rpartition('/')[2] not in COMMANDS}
        self._messages = sorted(
            (m for m in self._messages if m[1] in self._topics), key=lambda m: m[0])
        self.duration = self._messages[-1][0] if self._messages else 0.0
        self._times = [time for time, *_ in self._messages]
        self._of_topic: dict[str, list[int]] = defaultdict(list)
        for number, (_, name, _) in enumerate(self._messages):
            self._of_topic[name].append(number)

    @property
    def is_described(self) -> bool:
        """Whether the parameters of the arm were recorded."""
        return KINEMATICS in self._parameters

    # Nodes.

    def __enter__(self) -> Self:
        """Start the stand-ins, and publish the initial state."""
        choose_own_network()
        self._context = Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._executor = make_executor(self._context)
        self._nodes = [Node(
            name, namespace=self.namespace, context=self._context, enable_rosout=False,
            parameter_overrides=self._parameters.get(name, []),
            automatically_declare_parameters_from_overrides=True) for name in NODES]
        for node in self._nodes:
            self._executor.add_node(node)
        self._publishers = {name: publisher for name, topic in self._topics.items()
                            if (publisher := self._publisher(topic)) is not None}
        self._nodes[0].create_timer(
            PERIOD, self._step, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._stepped = monotonic()
        self._thread = threading.Thread(target=self._spin, name='replay', daemon=True)
        self._thread.start()
        return self

    def _publisher(self, topic: Topic) -> Any:
        name = f'{self.namespace}/{topic.name.removeprefix(self._space)}'
        latched = 'transient_local' in topic.qos
        try:
            return self._nodes[0].create_publisher(
                message_class(topic.kind), name, EVERY_STATE if latched else STREAM)
        except (DefinitionError, InvalidTopicNameException):
            return None  # of a package that is not installed here, or no name at all

    def _spin(self) -> None:
        while self._open:
            self._executor.spin_once(timeout_sec=0.2)

    def __exit__(self, *_: object) -> None:
        """End the stand-ins."""
        self._open = False
        self._thread.join(CLOSE_TIMEOUT)
        if self._thread.is_alive():  # its resources must stay
            print(f'the replay did not end within {CLOSE_TIMEOUT:g} s; its nodes are left '
                  'running', file=sys.stderr)
            return
        self._executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        self._context.try_shutdown()

    # Playing; on the thread of the stand-ins.

    def play(self, playing: bool) -> None:
        """Play, from the beginning if it was at its end; or pause."""
        self._executor.create_task(self._play, playing)

    def seek(self, position: float) -> None:
        """Go to a time, s since the beginning; times outside of the recording are ignored."""
        if isfinite(position):
            self._executor.create_task(self._show, min(max(0.0, position), self.duration))

    def _play(self, playing: bool) -> None:
        if playing and self.position >= self.duration:
            self._show(0.0)
        self.playing = playing

    def _step(self) -> None:
        now = monotonic()
        elapsed, self._stepped = now - self._stepped, now
        if self.playing:
            first = bisect_right(self._times, self.position)
            self.position = min(self.position + elapsed, self.duration)
            self._publish(range(first, bisect_right(self._times, self.position)))
            self.playing = self.position < self.duration
        if now - self._published >= REPEAT_PERIOD:
            self._show(self.position)

    def _show(self, position: float) -> None:
        """Publish the last message of every topic up to a time, or to the end of the begin."""
        self.position, self._published = position, monotonic()
        end = bisect_right(self._times, max(position, BEGIN))
        self._publish(numbers[last - 1] for numbers in self._of_topic.values()
                      if (last := bisect_right(numbers, end - 1)))

    def _publish(self, numbers: Any) -> None:
        for number in numbers:
            _, name, data = self._messages[number]
            if name in self._publishers:
                self._publishers[name].publish(data)


def _parameters(text: str) -> dict[str, list[Parameter]]:
    """Return the recorded parameters of every node; none where they are not as recorded."""
    try:
        document = yaml.safe_load(text)
        return {str(node): [Parameter(str(name), value=value)
                            for name, value in values['ros__parameters'].items()
                            if _is_value(value)]
                for node, values in document.items() if node in NODES}
    except (yaml.YAMLError, RecursionError, AttributeError, KeyError, TypeError, ValueError):
        return {}


def _is_value(value: object) -> bool:
    items = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
    return bool(items) and isinstance(items[0], bool | int | float | str) and all(
        type(item) is type(items[0]) for item in items)
